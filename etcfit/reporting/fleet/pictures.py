"""RUN/pictures/fleet: the population, what goes together, control charts, odd units; for a slide or a report."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from .columns import Columns
from .words import Content

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


def draw_fleet(content: Content, units: pd.DataFrame, folder: Path) -> tuple[Path, ...]:
    """Every picture that there is something for; those of before go.

    Args:
        content: fleet.json.
        units: units.parquet.
        folder: RUN/pictures/fleet.
    Returns:
        The pictures, the population first.
    """
    from .. import style

    for old in folder.glob("*.png"):
        old.unlink()
    written: list[Path] = []
    for name, draw in _jobs(content, Columns.of(content.get("units") or (), units)):
        with style.drawing():
            style.save(draw(), folder / name)
        written.append(folder / name)
    return tuple(written)


def _jobs(content: Content, columns: Columns) -> Iterator[tuple[str, Callable[[], Figure]]]:
    from .drawn import charts, correlation, odd, population

    if population.shown(content, columns):
        yield "population.png", partial(population.draw, content, columns)
    if (content.get("correlation") or {}).get("symbols"):
        yield "correlation.png", partial(correlation.draw, content)
    for symbol in content.get("charts") or {}:
        yield f"chart_{_plain(symbol)}.png", partial(charts.draw, content, symbol)
    if content.get("odd"):
        yield "odd.png", partial(odd.draw, content)


def _plain(symbol: str) -> str:
    """Of a file's name: nothing but letters, digits, - and _."""
    return "".join(c if c.isalnum() or c in "-_" else "_" for c in symbol)
