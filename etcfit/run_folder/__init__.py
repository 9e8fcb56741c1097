"""RUN/: its JSON files and the states that later commands start from, each written whole or not at all."""

from __future__ import annotations

from .design import design_json, rusefi
from .diagnosis import diagnosis_json
from .fit import GEAR_RATIO, effects_of, fit_json, hashes, parameters_json, readings_of, versions
from .frequency import frequency_json
from .model import POSTERIOR, read_draws, read_fitted, read_sines
from .reduction import reduction_json
from .state import (
    DIAGNOSIS_STATE,
    FIT_STATE,
    State,
    final_rig,
    final_state,
    fitted_values,
    read_state,
    rig_of,
    write_diagnosis_state,
    write_state,
)

__all__ = [
    "DIAGNOSIS_STATE",
    "FIT_STATE",
    "GEAR_RATIO",
    "POSTERIOR",
    "State",
    "design_json",
    "diagnosis_json",
    "effects_of",
    "final_rig",
    "final_state",
    "fit_json",
    "fitted_values",
    "frequency_json",
    "hashes",
    "parameters_json",
    "read_draws",
    "read_fitted",
    "read_sines",
    "read_state",
    "readings_of",
    "reduction_json",
    "rig_of",
    "rusefi",
    "versions",
    "write_diagnosis_state",
    "write_state",
]
