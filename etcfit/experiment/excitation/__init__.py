"""Shapes of excitation, a file each; a new one is a file and its name in the tuple."""

from __future__ import annotations

from .base import AbstractShape
from .chirp import Chirp
from .multisine import Multisine
from .ramps import Ramps
from .steps import Steps

_EVERY = (Multisine, Chirp, Steps, Ramps)
SHAPES: tuple[AbstractShape, ...] = tuple(shape() for shape in _EVERY)

__all__ = ["SHAPES", "AbstractShape"]
