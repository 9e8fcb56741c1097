"""Fleets made by hand: units drawn about a design, and each as the independent generator knows it."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np

from etcfit.estimation.fitted_model import FleetModel, fleet_model
from etcfit.model.effects import EFFECT_BY_NAME
from etcfit.problem.free_parameters import free_parameters
from etcfit.rig.base import Fixed, RigConfig
from independent.truth import CONSISTENT, RETURN_MARGIN, Truth

CONFIG = RigConfig("line", synthetic=True, gear_ratio=20.68, gear_ratio_given=True, supply_V=12.0)


def truths(count: int, seed: int, spread: float = 0.05, centre: Truth = CONSISTENT) -> list[Truth]:
    """Units of one design: every parameter lognormal about the centre, K_m = K_b; all of them return."""
    rng, found = np.random.default_rng(seed), []
    while len(found) < count:
        drawn = {f.name: getattr(centre, f.name) * np.exp(spread * rng.standard_normal())
                 for f in fields(Truth) if f.name not in ("K_m", "N")}  # fmt: skip
        truth = replace(centre, **drawn, K_m=drawn["K_b"])
        if truth.T_PL - truth.T_f > RETURN_MARGIN:
            found.append(truth)
    return found


def of(units: list[Truth], effects: tuple[str, ...] = (), position_noise: float = 0.0, **further: Any) -> FleetModel:
    """The model that a perfect fit of these units would give.

    Args:
        units: their truths.
        effects: further ones of the model.
        position_noise: rad.
        further: values of these effects' parameters, shape (U,).
    """
    config = replace(CONFIG, effects=effects, parameters={"B_m": Fixed(2.0e-5)})
    known = free_parameters(config)
    assert all(name in EFFECT_BY_NAME for name in effects)
    values = {f.name: np.array([getattr(unit, f.name) for unit in units]) for f in fields(Truth) if f.name != "N"}
    names = [f"u{k:03d}" for k in range(len(units))]
    return fleet_model(config, known, names, values | further, position_noise)
