"""Tuning rules: one file each, registered here and nowhere else."""

from __future__ import annotations

from .amigo import amigo
from .as_found import as_found
from .base import Refusal, Rule, Task
from .damping_optimum import damping_optimum
from .figures import LoopFigures, Requirements
from .gains import Gains
from .manual import manual
from .optimal import optimal
from .relay import relay
from .simc import simc
from .tyreus_luyben import tyreus_luyben
from .ziegler_nichols import ziegler_nichols

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
