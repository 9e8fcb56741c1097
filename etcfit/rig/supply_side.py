"""A current logged at the bridge's supply, made that of the motor.

    i = i_s / d,    d = duty, or v / V_s

Where the duty is near zero the supply's current tells nothing of the motor's: no value there. The noise grows as the
duty falls, and is taken as one for all samples of a test.

Source: Mohan, Undeland and Robbins 2003, ch. 7 (full bridge: mean current of its source). Differs from source: no.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ..errors import MeasurementError
from .base import RigConfig
from .columns import Column

SUPPLY_CURRENT = "supply_current"
LEAST, SHARE = 0.1, 0.5  # of a duty that counts; of a trace's largest, where that is small


def with_motor_current(columns: Mapping[str, Column], config: RigConfig, where: str) -> Mapping[str, Column]:
    """The columns, `current` in the place of `supply_current`.

    Args:
        columns: by quantity.
        config: of the rig.
        where: path of the CSV.

    Raises:
        MeasurementError: `current` is there too, or the duty can be worked out of nothing.
    """
    logged = columns.get(SUPPLY_CURRENT)
    if logged is None:
        return columns
    if "current" in columns:
        both = f"columns '{columns['current'].header}' and '{logged.header}' are both a current."
        raise MeasurementError(where, both,
                               "The model has one, the motor's.",
                               "Leave the supply's out: set it to \"ignore\" under [columns].")  # fmt: skip
    duty = _duty(columns, config, where, logged.header)
    size = np.abs(duty)
    least = min(LEAST, SHARE * float(np.nanmax(size, initial=0.0)))
    value = logged.logged / np.where(size > least, duty, np.nan)
    out = {name: column for name, column in columns.items() if name != SUPPLY_CURRENT}
    return out | {"current": replace(logged, quantity="current", logged=value)}


def _duty(columns: Mapping[str, Column], config: RigConfig, where: str, header: str) -> np.ndarray:
    """-1 to 1, shape (n,); NaN in rows that do not tell it."""
    if "duty" in columns:
        return columns["duty"].value
    volts = columns["supply"].value if "supply" in columns else config.supply_V
    if "voltage" not in columns or volts is None:
        raise MeasurementError(where, f"column '{header}' without a duty.",
                               "The motor's current is that of the supply over the duty.",
                               "Log the duty; or the voltage, with [rig] supply_V in rig.toml.")  # fmt: skip
    return columns["voltage"].value / volts
