"""RUN/: its JSON files, the models that later stages load, and the manifest that says what was made from what.

`codec` writes any frozen object whole and loads it bit for bit; `manifest` is run.json; `commit` puts the files of a
stage in place, all or none; `state` holds the models. A module for each JSON file.

Names are imported when they are first used: who reads a fit need not load what writes gains and posteriors.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .advice import advice_json as advice_json
    from .advice import save_advice as save_advice
    from .design import design_json as design_json
    from .design import rusefi as rusefi
    from .design import written_for as written_for
    from .diagnosis import diagnosis_json as diagnosis_json
    from .fit import GEAR_RATIO as GEAR_RATIO
    from .fit import effects_of as effects_of
    from .fit import fit_json as fit_json
    from .fit import hashes as hashes
    from .fit import parameters_json as parameters_json
    from .fit import readings_of as readings_of
    from .fit import versions as versions
    from .folder import RunFolder as RunFolder
    from .frequency import frequency_json as frequency_json
    from .manifest import CONVERGED as CONVERGED
    from .manifest import DIAGNOSIS_STATE as DIAGNOSIS_STATE
    from .manifest import FIT_STATE as FIT_STATE
    from .manifest import FLEET as FLEET
    from .manifest import MANIFEST as MANIFEST
    from .manifest import NOT_CONVERGED as NOT_CONVERGED
    from .manifest import POSTERIOR as POSTERIOR
    from .manifest import STAGE_FILES as STAGE_FILES
    from .manifest import SUPERSEDED as SUPERSEDED
    from .manifest import is_current as is_current
    from .manifest import is_fleet as is_fleet
    from .manifest import note_seconds as note_seconds
    from .manifest import read_records as read_records
    from .manifest import replacing as replacing
    from .manifest import require as require
    from .manifest import set_aside_stale as set_aside_stale
    from .manifest import settings_before as settings_before
    from .model import read_design as read_design
    from .model import read_draws as read_draws
    from .model import sines_of as sines_of
    from .plan import plan_json as plan_json
    from .plan import waiting_folder as waiting_folder
    from .play import play_files as play_files
    from .reduction import reduction_json as reduction_json
    from .results import save_design as save_design
    from .results import save_posterior as save_posterior
    from .results import save_reduction as save_reduction
    from .state import exit_of as exit_of
    from .state import fitted_to as fitted_to
    from .state import has_diagnosis as has_diagnosis
    from .state import is_done as is_done
    from .state import last_failure as last_failure
    from .state import load_diagnosis as load_diagnosis
    from .state import load_final as load_final
    from .state import load_fit as load_fit
    from .state import must_belong as must_belong
    from .state import refuse_among_measurements as refuse_among_measurements
    from .state import save_diagnosis as save_diagnosis
    from .state import save_fit as save_fit
    from .supply_table import supply_table_json as supply_table_json

MODULE_OF = {
    "advice_json": "advice",
    "save_advice": "advice",
    "design_json": "design",
    "rusefi": "design",
    "written_for": "design",
    "diagnosis_json": "diagnosis",
    "GEAR_RATIO": "fit",
    "effects_of": "fit",
    "fit_json": "fit",
    "hashes": "fit",
    "parameters_json": "fit",
    "readings_of": "fit",
    "versions": "fit",
    "RunFolder": "folder",
    "frequency_json": "frequency",
    "CONVERGED": "manifest",
    "DIAGNOSIS_STATE": "manifest",
    "FIT_STATE": "manifest",
    "FLEET": "manifest",
    "MANIFEST": "manifest",
    "NOT_CONVERGED": "manifest",
    "POSTERIOR": "manifest",
    "STAGE_FILES": "manifest",
    "SUPERSEDED": "manifest",
    "is_current": "manifest",
    "is_fleet": "manifest",
    "note_seconds": "manifest",
    "read_records": "manifest",
    "replacing": "manifest",
    "require": "manifest",
    "set_aside_stale": "manifest",
    "settings_before": "manifest",
    "read_design": "model",
    "read_draws": "model",
    "sines_of": "model",
    "plan_json": "plan",
    "waiting_folder": "plan",
    "play_files": "play",
    "reduction_json": "reduction",
    "save_design": "results",
    "save_posterior": "results",
    "save_reduction": "results",
    "exit_of": "state",
    "fitted_to": "state",
    "has_diagnosis": "state",
    "is_done": "state",
    "last_failure": "state",
    "load_diagnosis": "state",
    "load_final": "state",
    "load_fit": "state",
    "must_belong": "state",
    "refuse_among_measurements": "state",
    "save_diagnosis": "state",
    "save_fit": "state",
    "supply_table_json": "supply_table",
}

__all__ = [*MODULE_OF]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name not in MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f".{MODULE_OF[name]}", __name__), name)
    globals()[name] = value
    return value
