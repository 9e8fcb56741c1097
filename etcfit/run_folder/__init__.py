"""RUN/: its JSON files, the models that later stages load, and the manifest that says what was made from what."""

from __future__ import annotations

from .advice import advice_json, save_advice
from .design import design_json, rusefi, written_for
from .diagnosis import diagnosis_json
from .fit import GEAR_RATIO, effects_of, fit_json, hashes, parameters_json, readings_of, versions
from .folder import RunFolder
from .frequency import frequency_json
from .manifest import (
    CONVERGED,
    DIAGNOSIS_STATE,
    FIT_STATE,
    MANIFEST,
    NOT_CONVERGED,
    POSTERIOR,
    STAGE_FILES,
    SUPERSEDED,
    begin,
    finish,
    is_current,
    read_records,
    require,
    settings_before,
)
from .model import read_design, read_draws, sines_of
from .plan import plan_json, waiting_folder
from .play import play_files
from .reduction import reduction_json
from .results import save_design, save_posterior, save_reduction
from .state import (
    exit_of,
    fitted_to,
    has_diagnosis,
    is_done,
    last_failure,
    load_diagnosis,
    load_final,
    load_fit,
    must_belong,
    save_diagnosis,
    save_fit,
)
from .supply_table import supply_table_json

__all__ = [
    "CONVERGED",
    "DIAGNOSIS_STATE",
    "FIT_STATE",
    "GEAR_RATIO",
    "MANIFEST",
    "NOT_CONVERGED",
    "POSTERIOR",
    "STAGE_FILES",
    "SUPERSEDED",
    "RunFolder",
    "advice_json",
    "begin",
    "design_json",
    "diagnosis_json",
    "effects_of",
    "exit_of",
    "finish",
    "fit_json",
    "fitted_to",
    "frequency_json",
    "has_diagnosis",
    "hashes",
    "is_current",
    "is_done",
    "last_failure",
    "load_diagnosis",
    "load_final",
    "load_fit",
    "must_belong",
    "parameters_json",
    "plan_json",
    "play_files",
    "read_design",
    "read_draws",
    "read_records",
    "readings_of",
    "reduction_json",
    "require",
    "rusefi",
    "save_advice",
    "save_design",
    "save_diagnosis",
    "save_fit",
    "save_posterior",
    "save_reduction",
    "settings_before",
    "sines_of",
    "supply_table_json",
    "versions",
    "waiting_folder",
    "written_for",
]
