"""What is made from a fit that is no estimate says so."""

from __future__ import annotations

from rich.console import Group, RenderableType

from ..estimation.fitted_model import FitState
from .blocks import sentences


def cautioned(part: RenderableType, state: FitState) -> RenderableType:
    """A table, and above it what a reader must know of the fit behind it."""
    if not state.cautions:
        return part
    return Group(sentences("Caution", state.cautions) or "", "", part)
