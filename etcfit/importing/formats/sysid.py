"""SysId's JSON: tests of one mechanism, rows of time, voltage, position and velocity.

    {"sysid": true, "test": "Simple", "units": "Rotations", "unitsPerRotation": 1.0,
     "slow-forward": [[s, V, position, velocity], ...], "fast-backward": ...}

A drivetrain has rows of time, V left and right, positions and velocities likewise, angle and its rate: two
motors.

Source: WPILib, sysid/docs/data-collection.md. Differs from source: units of length are refused, for a motor's equation
is one of angles.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ...errors import MeasurementError
from ..labels import column
from ..sheet import Sheet, time_base

TESTS = ("slow-forward", "slow-backward", "fast-forward", "fast-backward", "track-width")
_ANGLES = {"rotations": "turn", "radians": "rad", "degrees": "deg"}
_SIMPLE, _DRIVE = ("voltage", "position", "motor_speed"), 9  # columns behind the time; cells of a drivetrain's row


def is_sysid(content: Any) -> bool:
    """A file of SysId, by what it holds."""
    return isinstance(content, dict) and content.get("sysid") is True


def sheets_of(content: Mapping[str, Any], where: str) -> list[Sheet]:
    """One sheet a motor and test.

    Raises:
        MeasurementError: a unit of length, a row of another width, or no test.
    """
    units = str(content.get("units", "")).casefold()
    if units not in _ANGLES:
        raise MeasurementError(where, f"its units are '{content.get('units')}'.",
                               f"An angle is required: {', '.join(_ANGLES)}.",
                               "Record with the encoder's angle; a wheel's radius is no business of its "
                               "motor.")  # fmt: skip
    found: list[Sheet] = []
    for test in TESTS:
        rows = content.get(test)
        if rows:
            found += _sheets(np.asarray(_numbers(rows, where, test), dtype=float), where, test, _ANGLES[units])
    if not found:
        raise MeasurementError(where, "no test in it.", f"One of {', '.join(TESTS)} is required.", "Record one.")
    return found


def _numbers(rows: Any, where: str, test: str) -> list[list[float]]:
    widths = {len(row) if isinstance(row, list) else 0 for row in rows} if isinstance(rows, list) else {0}
    if widths not in ({1 + len(_SIMPLE)}, {_DRIVE}):
        raise MeasurementError(where, f"rows of '{test}' have {', '.join(map(str, sorted(widths)))} numbers.",
                               f"{1 + len(_SIMPLE)} of a mechanism, or {_DRIVE} of a drivetrain, are required.",
                               "Save it again with SysId.")  # fmt: skip
    try:
        return [[float(cell) for cell in row] for row in rows]
    except (TypeError, ValueError) as err:
        raise MeasurementError(where, f"a row of '{test}' holds what is no number: {err}.", "Numbers are required.",
                               "Save it again with SysId.") from err  # fmt: skip


def _sheets(rows: np.ndarray, where: str, test: str, unit: str) -> list[Sheet]:
    motors = {"mechanism": (1, 2, 3)} if rows.shape[1] == 1 + len(_SIMPLE) else {"left": (1, 3, 5), "right": (2, 4, 6)}
    made = []
    for motor, places in motors.items():
        units = ("V", unit, f"{unit}/s")
        columns = [column(name, rows[:, k], of) for name, k, of in zip(_SIMPLE, places, units, strict=True)]
        made.append(Sheet(where, f"{motor}: {test}", (time_base(rows[:, 0] - rows[0, 0]), *columns)))
    return made
