"""One picture of how sure each way of asking is: graph reading, Laplace, profile likelihood and posterior."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .. import style
from ..numbers import Digits

_EDGE = 6.0  # of the unit of the axis
LAPLACE, PROFILE, POSTERIOR = style.SIMULATED, "#009e73", style.READING


@dataclass(frozen=True)
class Spread:
    """One parameter, SI.

    Args:
        symbol, unit: which.
        fitted, stderr: of the fit; no standard error where it is a compromise.
        mean, sd, low, high: of the posterior.
        profile: its interval, or None.
        reading, truth: or None.
        apart: they differ in width by more than 20 %.
    """

    symbol: str
    unit: str
    fitted: float
    stderr: float | None
    mean: float
    sd: float
    low: float
    high: float
    profile: tuple[float, float] | None
    reading: float | None
    truth: float | None
    apart: bool

    @property
    def scale(self) -> float:
        """Unit of the axis: the standard error of the fit, or where it has none the posterior's standard deviation."""
        return self.sd if self.stderr is None else self.stderr


def draw(rig: str, spreads: Sequence[Spread], synthetic: bool) -> Figure:
    """A row a parameter; 95 % intervals about the fitted value, see `Spread.scale`."""
    tall = 1.6 + 0.46 * max(1, len(spreads))
    fig = style.figure(11.0, tall, synthetic)
    panel = fig.subplots(1, 1)
    fig.subplots_adjust(left=0.2, right=0.62, top=1.0 - 0.8 / tall, bottom=0.62 / tall)
    panel.axvline(0.0, color="black", lw=0.8)
    if any(spread.reading is not None for spread in spreads):
        panel.plot([], [], "o", color=style.MEASURED, label="graph reading")  # one beyond the edge is an arrow
    for row, spread in enumerate(spreads):
        _row(panel, row, spread)
        panel.text(1.02, row, _words(spread), transform=panel.get_yaxis_transform(), va="center", fontsize=10)
    panel.set_yticks(range(len(spreads)), [s.symbol for s in spreads])
    panel.set_ylim(len(spreads) - 0.4, -0.6)
    panel.set_xlim(-_EDGE, _EDGE)
    unit = "standard errors of the fit" if all(s.stderr is not None for s in spreads) else "standard deviations"
    panel.set_xlabel(f"distance from the fitted value [{unit}]")
    fig.suptitle(f"{rig}  ·  how sure", x=0.015, y=1.0 - 0.1 / tall, ha="left", va="top", fontsize=13)
    style.legend(fig, [panel], 0.015, 1.0 - 0.42 / tall, "upper left")
    return fig


def _row(panel: Axes, row: int, spread: Spread) -> None:
    def at(value: float) -> float:
        return float(np.clip((value - spread.fitted) / spread.scale, -_EDGE, _EDGE))

    bars = [((spread.low, spread.high), 0.2, POSTERIOR, "posterior, 95 %")]
    if spread.stderr is not None:
        ends = spread.fitted - 1.96 * spread.stderr, spread.fitted + 1.96 * spread.stderr
        bars.insert(0, (ends, -0.2, LAPLACE, "Laplace, 95 %"))
    if spread.profile is not None:
        bars.append((spread.profile, 0.0, PROFILE, "profile, 95 %"))
    for (low, high), shift, colour, label in bars:
        panel.plot([at(low), at(high)], [row + shift] * 2, color=colour, lw=4, solid_capstyle="butt", label=label)
    panel.plot(at(spread.mean), row + 0.2, "|", color="white", ms=5)
    if spread.reading is not None:
        x = at(spread.reading)
        marker = "o" if abs(x) < _EDGE else ("<" if x < 0.0 else ">")
        panel.plot(x, row, marker, color=style.MEASURED, ms=7, ls="none", clip_on=False)
    if spread.truth is not None:
        panel.plot(
            at(spread.truth), row, "D", color="black", mfc="white", ms=6, ls="none", label="truth", clip_on=False
        )


def _words(spread: Spread) -> str:
    digits = Digits.of(spread.mean, spread.sd)
    flag = "   > 20 % apart" if spread.apart else ""
    return f"{digits(spread.mean)} ± {digits(spread.sd)} {spread.unit}{flag}"
