"""The linear plant, and what it leaves out, for formats that hold no more."""

from __future__ import annotations

from collections.abc import Iterator

from ..model.effects.actuation_delay import ActuationDelay
from ..model.effects.position_sensor_lag import PositionSensorLag
from .base import Source

_BESIDE = (ActuationDelay, PositionSensorLag)  # kept beside the transfer function


def cannot_hold(source: Source) -> Iterator[str]:
    """What a transfer function has no place for."""
    reduction = source.reduction
    place = f"{100.0 * reduction.share:.0f} % of the travel ({reduction.theta:.4g} rad, {reduction.volts:.4g} V)"
    yield f"The transfer function holds near {place}: dry friction, preload and the stops have none."
    if bent := [effect.name for effect in source.beyond_the_paper if effect not in _BESIDE]:
        yield (f"Of {', '.join(bent)} only the slope at that place is in it, and what an effect remembers stands "
               "still. The formats c and fmu hold them.")  # fmt: skip


def gains(source: Source) -> dict[str, float]:
    """Kp (V/rad), Ki (V/(rad s)) and Kd (V s/rad) of pid.json; {} where none were designed."""
    if source.pid is None:
        return {}
    return {name: float(source.pid["gains"][name]) for name in ("Kp", "Ki", "Kd")}
