"""The paper's Table 2 beside a fit: how large the parameters of another throttle body are."""

from __future__ import annotations

import math

from ..estimation.intervals import LUMPS
from ..model.paper import TABLE_2
from ..rig.base import RigConfig

_AT_THE_MOTOR = {"K_b": 1, "K_m": 1, "B_m": 2}  # symbol -> power of N that takes it to the plate


def beside(config: RigConfig) -> dict[str, float]:
    """Table 2 as it compares with this rig's parameters, SI by symbol, combinations among them.

    Empty for a rig that is no plate between two stops. Where the gear ratio is not known, the rig's motor is described
    as seen from the plate, and so is the table's. J_m and J_L are left out: they contradict the J_eq printed with them.
    """
    if not all(map(math.isfinite, config.travel)):
        return {}
    n = TABLE_2["N"]
    combined = {symbol: lump.of(TABLE_2, n) for symbol, lump in LUMPS.items()}
    printed = {symbol: value for symbol, value in TABLE_2.items() if symbol not in ("J_m", "J_L", "N")}
    if not config.gear_ratio_given:
        printed |= {symbol: n**power * TABLE_2[symbol] for symbol, power in _AT_THE_MOTOR.items()}
    return combined | printed
