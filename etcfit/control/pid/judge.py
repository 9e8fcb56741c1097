"""How well a response follows its setpoint, and what that costs: the figures of `loop_figures`, computed."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ..loop_figures import FIGURES, TRACKING, By, LoopFigures, symbols_by
from ..response import AtLevel, Run
from .setpoint import Setpoint, Stretch


def judge(setpoint: Setpoint, time: np.ndarray, share: np.ndarray) -> LoopFigures:
    """How well a response follows: each figure the worst of all levels, or of all stretches.

    Args:
        setpoint: what was asked for.
        time: s, shape (K,), from 0 with an even step.
        share: of the travel, shape (..., K); what is not finite counts as infinitely far off.
    """
    share = np.where(np.isfinite(share), share, np.inf)
    return _tracking(setpoint, setpoint.levels, setpoint.stretches, time, share)


def judge_each(setpoint: Setpoint, time: np.ndarray, share: np.ndarray) -> dict[str, LoopFigures]:
    """The same scenario by scenario, each with the tracking error over all of its own.

    Of a log, which has no levels, there is nothing but the tracking error; the others are NaN.
    """
    share = np.where(np.isfinite(share), share, np.inf)
    out = {}
    for name in setpoint.scenarios:
        levels = setpoint.only(name)
        parts = [part for part in (*levels, *setpoint.stretches) if part.scenario == name]
        whole = Stretch(min(part.begins for part in parts), max(part.ends for part in parts))
        out[name] = _tracking(setpoint, levels, (whole,), time, share)
    return out


def _tracking(setpoint: Setpoint, levels: Any, stretches: Any, time: np.ndarray, share: np.ndarray) -> LoopFigures:
    at = [AtLevel.of(level, time, share) for level in levels]
    nothing = np.full(share.shape[:-1], np.nan)

    def worst(symbol: str) -> np.ndarray:
        formula = FIGURES[symbol].how["formula"]
        if FIGURES[symbol].how["by"] is By.LEVEL:
            every = [formula(each) for each in at]
        else:
            every = [formula(setpoint, stretch, time, share) for stretch in stretches]
        return np.max(np.stack(every), axis=0) if every else nothing

    return LoopFigures(**{symbol: worst(symbol) for symbol in TRACKING})


def with_effort(figures: LoopFigures, run: Run) -> LoopFigures:
    """Figures, and those of what the response costs."""
    return replace(figures, **{symbol: FIGURES[symbol].how["formula"](run) for symbol in symbols_by(By.RUN)})


def with_heat(figures: LoopFigures, winding: Any, bridge: float) -> LoopFigures:
    """Figures, and the heat that the current makes.

    Args:
        figures: with the current.
        winding, bridge: resistances, ohm.
    """
    current = figures.current_rms_A
    return replace(
        figures, **{symbol: FIGURES[symbol].how["formula"](current, winding, bridge) for symbol in symbols_by(By.HEAT)}
    )
