"""The loop under the conditions of a car: other supplies, winding temperatures and frictions than at the bench."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from ...model.parameters import Scalar
from ...model.throttle import Throttle
from ..settings import ConditionSettings
from .loop import Loop

DRY_FRICTION = ("T_f", "T_s", "T_m", "mu_g", "T_z")  # every parameter that scales with it


class Conditions(NamedTuple):
    """Of one model, or one each of many, shape (D,).

    Args:
        supply: V.
        winding: temperature, degrees Celsius.
        friction: dry friction over that of the bench.
    """

    supply: Scalar
    winding: Scalar
    friction: Scalar


def corners(settings: ConditionSettings) -> Conditions:
    """Every corner of the ranges, shape (8,) each."""
    ends = product(settings.supply, settings.winding, settings.friction)
    return Conditions(*np.array(list(ends)).T)


def scattered(settings: ConditionSettings, count: int, rng: np.random.Generator) -> Conditions:
    """Uniform over the ranges, shape (count,) each."""
    every = (settings.supply, settings.winding, settings.friction)
    return Conditions(*(rng.uniform(low, high, count) for low, high in every))


def under(loop: Loop, conditions: Conditions, settings: ConditionSettings) -> Loop:
    """Each model of a loop under a condition of its own.

        v = duty V_supply,    R = R_a (1 + alpha (T - T_bench)),    T_f, ... times the factor

    The ECU does not know the supply: its duty is a share of whatever there is. One that divides by the battery voltage
    sends the volts that it means, up to its largest duty of that supply. The magnets stay as they are.

    Args:
        loop: D models.
        conditions: shape (D,) each.
        settings: copper and the bench.
    """
    warmer = 1.0 + settings.copper * (conditions.winding - settings.bench)
    drive = np.ones(loop.draws) if loop.drive is None else loop.drive
    throttles = scaled(loop.throttles, {"R_a": warmer, **dict.fromkeys(DRY_FRICTION, conditions.friction)})
    if loop.ecu.compensated:
        return replace(loop, throttles=throttles, ceiling=loop.ecu.duty * np.asarray(conditions.supply))
    return replace(loop, throttles=throttles, drive=drive * conditions.supply / loop.ecu.supply)


def at_corners(loop: Loop, settings: ConditionSettings) -> Loop:
    """The nominal model at every corner of the ranges."""
    there = corners(settings)
    return under(loop.taking(np.zeros(there.supply.size, dtype=int)), there, settings)


def scaled(throttle: Throttle, factors: dict[str, Any]) -> Throttle:
    """Models with some of their parameters times a factor, of every effect that has them."""

    def each(effect: Any) -> Any:
        changed = {name: factor * getattr(effect, name) for name, factor in factors.items() if hasattr(effect, name)}
        return replace(effect, **changed) if changed else effect

    return replace(throttle, effects=tuple(each(effect) for effect in throttle.effects))
