"""Style of all pictures: colours for colour-blind readers, letters legible on a slide, units on the axes.

Source: Okabe and Ito 2008 (colours). Figures are made without pyplot, so that they share no state.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from ..files import whole

DPI = 110
MEASURED = "#4d4d4d"
SIMULATED = "#d55e00"
READING = "#0072b2"
BEFORE, AFTER, UNKNOWN = "#56b4e9", SIMULATED, "#cc79a7"  # the models of a diagnosis
OPENING, CLOSING = "#0072b2", "#e69f00"
EFFECTS = ("#009e73", "#d55e00", "#6a3d9a", "#8c510a", "#17becf", "#7f7f00")  # one per effect
DRIVE = "#009e73"
BAND = "#e8e8e8"
FAILED = "#b2182b"  # missed requirements
TAG = "#cc3399"
_THIN = 1200  # number of bins for a long trace; a panel has about as many pixels

RC: Any = {
    "figure.dpi": DPI,
    "font.size": 11,
    "axes.titlesize": 11,
    "axes.labelsize": 11,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e3e3e3",
    "grid.linewidth": 0.7,
    "axes.axisbelow": True,
    "lines.linewidth": 1.6,
    "text.parse_math": False,  # a name may contain dollars
    "legend.frameon": False,
    "legend.fontsize": 10,
    "path.simplify_threshold": 0.5,
    "agg.path.chunksize": 10000,
}


@contextmanager
def drawing() -> Iterator[None]:
    """Use our style inside, and restore the caller's settings afterwards."""
    with rc_context(RC):
        yield


def figure(width: float, height: float, synthetic: bool) -> Figure:
    """An empty figure, inches; with a tag in the corner if the data are synthetic."""
    fig = Figure(figsize=(width, height), dpi=DPI)
    FigureCanvasAgg(fig)
    if synthetic:
        fig.text(0.995, 0.993, "SYNTHETIC DATA", color=TAG, fontsize=9, fontweight="bold", ha="right", va="top")
    return fig


def title(fig: Figure, text: str, x: float = 0.015, bold: bool = False) -> None:
    """A title a tenth of an inch below the upper edge; x as a share of the width."""
    fig.suptitle(text, x=x, y=1.0 - 0.1 / fig.get_figheight(), ha="left", va="top", fontsize=13,
                 fontweight="bold" if bold else "normal")  # fmt: skip


def titled(
    text: str, tall: float, sides: tuple[float, float], synthetic: bool, bold: bool = False
) -> tuple[Figure, Axes]:
    """A figure of one panel below a title with line breaks; between both is space for `legend_above`.

    Args:
        tall: height in inches, with a title of one line.
        sides: left and right edge of the panel, shares of the width.
    """
    head = wrapped(text, 11.0, 13)
    top = 0.85 + 0.24 * head.count("\n")
    tall += top - 0.85
    fig = figure(11.0, tall, synthetic)
    panel = fig.subplots(1, 1)
    fig.subplots_adjust(left=sides[0], right=sides[1], top=1.0 - top / tall, bottom=0.62 / tall)
    title(fig, head, bold=bold)
    return fig, panel


def caution(fig: Figure, said: Sequence[str], y: float) -> None:
    """Cautions of the fit behind a picture, on the right below the tag of synthetic data; y as a share."""
    text = "\n".join(textwrap.fill(each, 62) for each in said)
    fig.text(0.985, y, text, color=TAG, fontsize=8, fontweight="bold", ha="right", va="top")


def save(fig: Figure, path: Path) -> None:
    """Write a PNG, completely or not at all."""
    if engine := fig.get_layout_engine():  # savefig would draw everything twice, once for the layout
        engine.execute(fig)
        fig.set_layout_engine(None)
    with whole(path) as draft:
        fig.savefig(draft, format="png", dpi=DPI, facecolor="white", pil_kwargs={"compress_level": 3})


def thin(t: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest sample of every bin of a long trace, in order of time, so that no peak is lost.

    Args:
        t, y: shape (n,); samples that are not finite are left out.
    """
    seen = np.isfinite(y)
    t, y = t[seen], y[seen]
    if t.size <= 2 * _THIN:
        return t, y
    width = -(-t.size // _THIN)
    bins = np.pad(y, (0, -t.size % width), mode="edge").reshape(-1, width)
    first = width * np.arange(bins.shape[0])
    keep = np.unique(np.concatenate((first + bins.argmin(axis=1), first + bins.argmax(axis=1))))
    return t[keep], y[keep]


def broken(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A line with gaps: NaN where x rises by more than five of its usual steps."""
    step = np.diff(x)
    gaps = np.flatnonzero(step > 5.0 * np.median(step)) + 1 if x.size > 10 else np.empty(0, dtype=int)
    return np.insert(x, gaps, np.nan), np.insert(y, gaps, np.nan)


def unit_label(name: str, unit: str) -> str:
    """ "position [deg]"; the unit of a ratio is 1."""
    return f"{name.replace('_', ' ')} [{unit or '1'}]"


def channel_label(name: str, unit: str) -> str:
    """ "TPS [V]" if a position is the sensor's volts, else "position [deg]"."""
    return unit_label("TPS" if (name, unit) == ("position", "V") else name, unit)


def quiet_axis(axes: Axes) -> None:
    """Remove tick labels if the panel below has the same."""
    axes.tick_params(labelbottom=False)


def labels(axes: Sequence[Axes]) -> dict[str, Any]:
    """Entries of a legend of these panels."""
    return {label: handle for ax in axes for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)}


def legend(
    fig: Figure,
    axes: Sequence[Axes],
    x: float,
    y: float,
    loc: Literal["upper left", "upper right"] = "upper right",
    most: int = 99,
) -> None:
    """One legend for all panels, each label once; x, y as shares of the figure; `columns` labels per line at most."""
    handles = labels(axes)
    columns = max(1, min(most, len(handles)))
    drawn = fig.legend(list(handles.values()), list(handles), loc=loc, bbox_to_anchor=(x, y), ncols=columns,
                       borderaxespad=0.0)  # fmt: skip
    for handle in drawn.legend_handles:
        if isinstance(handle, Line2D):
            handle.set_markersize(7)


def legend_above(fig: Figure, panel: Axes) -> None:
    """The legend of a panel in a line above it."""
    box = panel.get_position()
    legend(fig, [panel], box.x0, box.y1 + 0.36 / fig.get_figheight(), "upper left")


def wrapped(text: str, width: float, size: float) -> str:
    """A bold title, broken at words for a figure of that width, inches, beside the tag of synthetic data."""
    whole = re.sub(r"(?<=[\d→]) (?=\S)|(?<=\S) (?=→)", "\N{NO-BREAK SPACE}", text)  # a number keeps its unit
    return "\n".join(textwrap.wrap(whole, int((width - 1.5) / (0.0094 * size))))


def log_ticks(axis: Axis, limits: tuple[float, float]) -> None:
    """Plain numbers at 1, 2 and 5 of each decade, or only at the decades if there are many."""
    few = limits[1] < 300.0 * limits[0]
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if few else (1.0,)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())
