"""Tuning rules: all are registered here."""

from __future__ import annotations

from ...model.pid import Gains
from ..loop_figures import LoopFigures, Requirements
from .base import Refusal, Rule, Task
from .experiments import manual, relay
from .formulas import amigo, as_found, damping_optimum, simc, tyreus_luyben, ziegler_nichols
from .optimal import optimal

RULES: dict[str, Rule] = {
    "optimal": optimal,
    "ziegler_nichols": ziegler_nichols,
    "tyreus_luyben": tyreus_luyben,
    "simc": simc,
    "amigo": amigo,
    "damping_optimum": damping_optimum,
    "relay": relay,
    "manual": manual,
    "as_found": as_found,
}

__all__ = ["RULES", "Gains", "LoopFigures", "Refusal", "Requirements", "Rule", "Task"]
