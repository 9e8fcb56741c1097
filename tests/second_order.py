"""Logs of the independent second-order loop as the package holds them."""

from __future__ import annotations

from etcfit.car_log.log import Series
from independent import second_order


def log(
    levels: list[float], zeta: float, wn: float, rate: float, noise: float = 0.0, seed: int = 0, held: float = 1.0
) -> tuple[Series, Series]:
    """Position and setpoint; arguments as of `independent.second_order.log`."""
    made = second_order.log(levels, zeta, wn, rate, noise, seed, held)
    return Series(made["time"], made["position"]), Series(made["time"], made["setpoint"])
