"""Every parameter against every other, as sampled."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass

with warnings.catch_warnings():  # it loads ArviZ, which announces its next version once a day
    warnings.simplefilter("ignore", FutureWarning)
    import corner
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from .. import style
from ..numbers import Digits

_CELL = 1.15  # inches
_SHOWN = 4.0  # standard deviations either way


@dataclass(frozen=True, eq=False)
class CornerPicture:
    """What a corner plot shows.

    Args:
        rig: its name.
        draws: SI by symbol, shape (D,) each.
        units: by symbol.
        truths: SI by symbol, where known.
        synthetic: the data were made up.
    """

    rig: str
    draws: Mapping[str, np.ndarray]
    units: Mapping[str, str]
    truths: Mapping[str, float]
    synthetic: bool


def draw(picture: CornerPicture) -> Figure:
    """Each axis is a distance from the posterior mean in per cent of it, so that ticks stay short."""
    symbols = list(picture.draws)
    side = 1.6 + _CELL * len(symbols)
    fig = style.figure(side, side, picture.synthetic)
    percent = {s: _percent(d, d) for s, d in picture.draws.items()}
    limit = [_SHOWN * float(np.std(d)) for d in percent.values()]
    corner.corner(
        np.stack(list(percent.values()), axis=1),
        fig=fig,
        range=[(-w, w) for w in limit],
        bins=25,
        smooth=1.0,
        levels=(0.393, 0.865),
        color=style.READING,
        plot_datapoints=False,
        fill_contours=True,
        max_n_ticks=3,
        labels=[f"{s.replace('series_ohm.', 'R ')} [%]" for s in symbols],
        label_kwargs={"fontsize": 10},
        labelpad=0.12,
        truths=[_truth(picture, s) for s in symbols],
        truth_color=style.SIMULATED,
    )
    fig.subplots_adjust(left=0.085, right=0.985, bottom=0.085, top=0.985, wspace=0.06, hspace=0.06)
    drawn = [axes for axes in fig.axes if axes.get_frame_on()]
    for axes in drawn:  # corner empties those above the diagonal
        axes.tick_params(labelsize=8)
        axes.grid(False)
        axes.xaxis.set_major_locator(MaxNLocator(3, prune="both"))
        axes.yaxis.set_major_locator(MaxNLocator(3, prune="both"))
    fig.text(0.985, 0.955, _words(picture), ha="right", va="top", fontsize=11, linespacing=1.5)
    return fig


def _percent(value: np.ndarray | float, draws: np.ndarray) -> np.ndarray:
    mean = float(np.mean(draws))
    return 100.0 * (np.asarray(value) - mean) / abs(mean)


def _truth(picture: CornerPicture, symbol: str) -> float | None:
    return float(_percent(picture.truths[symbol], picture.draws[symbol])) if symbol in picture.truths else None


def _words(picture: CornerPicture) -> str:
    """Means, since the axes show distances from them."""
    lines = [f"{picture.rig}: posterior", "distance from the mean [%], 1 and 2 sd"]
    lines += ["orange: what the data were made from"] if picture.truths else []
    for s, d in picture.draws.items():
        digits = Digits.of(float(np.mean(d)), float(np.std(d)))
        lines.append(f"{s} = {digits(float(np.mean(d)))} ± {digits(float(np.std(d)))} {picture.units[s]}")
    return "\n".join(lines)
