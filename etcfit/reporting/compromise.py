"""What is made from a model whose parameters are a compromise says so."""

from __future__ import annotations

from rich.console import Group, RenderableType

from ..estimation.result import FitResult
from .blocks import sentences


def cautioned(part: RenderableType, result: FitResult) -> RenderableType:
    """A table, and below it a caution where the parameters of its model are a compromise."""
    if result.compromise is None:
        return part
    text = f"The parameters behind this are a compromise, not estimates: {result.compromise.why}."
    return Group(part, sentences("Caution", [text]) or "")
