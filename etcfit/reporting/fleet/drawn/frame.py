"""What every picture of a fleet begins with: panels under a title, axes in powers of a thousand."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from ... import style
from ..words import Content, title

ODD, LIMIT, UNITS = style.SIMULATED, "#b03a00", style.READING


def frame(content: Content, rest: str, size: tuple[float, float], grid: tuple[int, int]) -> tuple[Figure, list[Axes]]:
    """A figure, inches, with its title and so many rows and columns of panels below it."""
    wide, tall = size
    fig = style.figure(wide, tall, bool(content.get("synthetic")))
    head = style.wrapped(f"{title(content)}  ·  {rest}", wide, 13)
    top = 0.55 + 0.24 * head.count("\n")
    fig.set_layout_engine("constrained", rect=(0.0, 0.0, 1.0, 1.0 - top / tall), h_pad=0.08, w_pad=0.08)
    fig.suptitle(head, x=0.015, y=1.0 - 0.1 / tall, ha="left", va="top", fontsize=13)
    return fig, list(fig.subplots(*grid, squeeze=False).ravel())


def power_of(values: np.ndarray | Sequence[float]) -> int:
    """The power of a thousand that is split off, as a power of ten; 0 where numbers read well without one."""
    finite = np.abs(np.asarray(values, dtype=float))
    size = float(np.max(finite[np.isfinite(finite)], initial=0.0))
    if size == 0.0 or 1e-2 <= size < 1e5:
        return 0
    return 3 * math.floor(math.log10(size) / 3.0 + 1e-9)


_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def unit_of(unit: str, power: int) -> str:
    """ "10⁻⁶ kg m²", as an axis has it in brackets."""
    plain = "1" if unit in ("", "1") else unit.replace("**2", "²").replace("*", " ")
    return f"10{str(power).translate(_RAISED)} {plain}" if power else plain


def formatter(power: int) -> FuncFormatter:
    """Ticks of numbers without that power of ten."""
    return FuncFormatter(lambda value, _: f"{value / 10.0**power:.6g}")
