"""The rules that need no experiment."""

from __future__ import annotations

from .amigo import amigo
from .as_found import as_found
from .base import Rule
from .damping_optimum import damping_optimum
from .simc import simc
from .tyreus_luyben import tyreus_luyben
from .ziegler_nichols import ziegler_nichols

FORMULAS: tuple[Rule, ...] = (ziegler_nichols, tyreus_luyben, simc, amigo, damping_optimum, as_found)
