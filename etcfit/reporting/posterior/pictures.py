"""All pictures of a posterior: paths and drawing functions, in the order of interest."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ...estimation.intervals import Z_95, intervals, lumped
from ...posterior.profile import RISE, Profile
from ...posterior.sampling import Band, Posterior
from ...posterior.target import truths
from ...run_folder.fit import readings_of
from ...run_folder.posterior import disagree
from .. import style
from ..drawing import Job
from ..numbers import with_error
from ..pictures import file_name
from ..traces import headed, name_of, signal, source, stack

_INSIDE = "#f2c49b"
_ERRORS_SHOWN = 0.998  # share of the errors inside their panel


def draw_band(band: Band, synthetic: bool) -> Figure:
    """Two panels per channel: the signal, and measured - predicted with the band about zero."""
    trace = band.trace
    heights = [h for _ in trace.channels for h in (1.7, 1.3)]
    fig, panels = stack(heights, synthetic)
    for m in range(len(trace.channels)):
        signal(panels[2 * m], trace, m, band.mean[:, m], "posterior mean")
        _error(panels[2 * m + 1], band, m)
    inside = (f"{name.replace('_', ' ')} {100.0 * share:.1f} %"
              for name, share in zip(trace.channels, band.inside, strict=True))  # fmt: skip
    said = "inside the 95 % band: " + ", ".join(inside)
    return headed(fig, panels, f"{name_of(trace)}, posterior predictive", said)


def _error(panel: Axes, band: Band, m: int) -> None:
    trace, channel = band.trace, source(band.trace, band.trace.channels[m])
    t, half = trace.instants, Z_95 * band.sd[:, m] / abs(channel.scale)
    error = (trace.data[:, m] - band.mean[:, m]) / channel.scale
    size = np.abs(error[np.isfinite(error)])
    limit = 1.15 * max(float(np.quantile(size, _ERRORS_SHOWN)), float(np.quantile(half, _ERRORS_SHOWN)))
    panel.fill_between(t, -half, half, color=_INSIDE, lw=0, label="95 % band")
    panel.plot(*style.thin(t, np.clip(error, -limit, limit)), ".", ms=2.0, color=style.MEASURED)
    panel.axhline(0.0, color=style.SIMULATED, lw=1.0)
    panel.set_ylim(-limit, limit)
    panel.set_ylabel(f"error [{channel.unit or '1'}]")


with warnings.catch_warnings():  # it loads ArviZ, which announces its next version once a day
    warnings.simplefilter("ignore", FutureWarning)
    import corner


_CELL = 1.15  # inches
_SHOWN = 4.0  # range in standard deviations on both sides


def draw_corner(
    rig: str, draws: Mapping[str, np.ndarray], units: Mapping[str, str], truths: Mapping[str, float], synthetic: bool
) -> Figure:
    """Each axis is the distance from the posterior mean in per cent of it, so that ticks are short.

    Args:
        draws: SI by symbol, shape (D,) each.
        truths: true values, SI by symbol, if known.
    """
    symbols = list(draws)
    side = 1.6 + _CELL * len(symbols)
    fig = style.figure(side, side, synthetic)
    percent = {s: _percent(d, d) for s, d in draws.items()}
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
        truths=[float(_percent(truths[s], draws[s])) if s in truths else None for s in symbols],
        truth_color=style.SIMULATED,
    )
    fig.subplots_adjust(left=0.085, right=0.985, bottom=0.085, top=0.985, wspace=0.06, hspace=0.06)
    drawn = [axes for axes in fig.axes if axes.get_frame_on()]
    for axes in drawn:  # corner empties those above the diagonal
        axes.tick_params(labelsize=8)
        axes.grid(False)
        axes.xaxis.set_major_locator(MaxNLocator(3, prune="both"))
        axes.yaxis.set_major_locator(MaxNLocator(3, prune="both"))
    fig.text(0.985, 0.955, _means(rig, draws, units, bool(truths)), ha="right", va="top", fontsize=11, linespacing=1.5)
    return fig


def _percent(value: np.ndarray | float, draws: np.ndarray) -> np.ndarray:
    mean = float(np.mean(draws))
    return 100.0 * (np.asarray(value) - mean) / abs(mean)


def _means(rig: str, draws: Mapping[str, np.ndarray], units: Mapping[str, str], synthetic: bool) -> str:
    """Means, because the axes show distances from them."""
    lines = [f"{rig}: posterior", "distance from the mean [%], 1 and 2 sd"]
    lines += ["orange: what the data were made from"] if synthetic else []
    for s, d in draws.items():
        lines.append(f"{s} = {with_error(float(np.mean(d)), float(np.std(d)))} {units[s]}")
    return "\n".join(lines)


_ACROSS = 3


def draw_profiles(rig: str, profiles: Sequence[Profile], units: Mapping[str, str], synthetic: bool) -> Figure:
    """Rise of chi2 over its minimum with one parameter held and the others fitted."""
    across = min(_ACROSS, len(profiles))
    down = -(-len(profiles) // across)
    tall = 0.7 + 2.9 * down
    fig = style.figure(max(5.0, 4.2 * across), tall, synthetic)
    grid = fig.subplots(down, across, squeeze=False)
    for panel, profile in zip(grid.flat, profiles, strict=False):
        _panel(panel, profile, units[profile.symbol])
    for panel in grid.flat[len(profiles) :]:
        panel.set_visible(False)
    style.title(fig, f"{rig}  ·  profile likelihood")
    fig.tight_layout(rect=(0.0, 0.0, 1.0, 1.0 - 0.4 / tall))
    return fig


def _panel(panel: Axes, profile: Profile, unit: str) -> None:
    panel.plot(profile.value, profile.rise, "o-", color=style.READING, ms=4)
    panel.axhline(RISE, color=style.SIMULATED, ls="--", lw=1.2)
    for end in (profile.low, profile.high):
        if end is not None:
            panel.axvline(end, color=style.SIMULATED, lw=1.0)
    panel.set_ylim(-0.3, min(3.0 * RISE, max(1.5 * RISE, 1.1 * float(np.max(profile.rise)))))
    panel.set_xlabel(f"{profile.symbol} [{unit}]")
    panel.set_ylabel("rise of chi2 [1]")
    panel.set_title(f"{profile.symbol}: {profile.kind}", loc="left")


_EDGE = 6.0  # edge of the picture, in units of the axis
LAPLACE, PROFILE, POSTERIOR = style.SIMULATED, "#009e73", style.READING


@dataclass(frozen=True)
class Spread:
    """One parameter, SI."""

    # symbol, unit: symbol and unit of the parameter
    symbol: str
    unit: str
    # fitted, stderr: value and standard error of the fit; no standard error for a compromise
    fitted: float
    stderr: float | None
    # mean, sd, low, high: figures of the posterior
    mean: float
    sd: float
    low: float
    high: float
    profile: tuple[float, float] | None  # interval of the profile, or None
    # reading, truth: reading and true value, or None
    reading: float | None
    truth: float | None
    apart: bool  # whether the widths differ by more than 20 %

    @property
    def scale(self) -> float:
        """Unit of the axis: the standard error of the fit, or without one the posterior's standard deviation."""
        return self.sd if self.stderr is None else self.stderr


def draw_spreads(rig: str, spreads: Sequence[Spread], synthetic: bool) -> Figure:
    """One row per parameter; 95 % intervals about the fitted value, see `Spread.scale`."""
    fig, panel = style.titled(f"{rig}  ·  how sure", 1.6 + 0.46 * max(1, len(spreads)), (0.2, 0.62), synthetic)
    panel.axvline(0.0, color="black", lw=0.8)
    if any(spread.reading is not None for spread in spreads):
        panel.plot([], [], "o", color=style.MEASURED, label="graph reading")  # one beyond the edge is an arrow
    for row, spread in enumerate(spreads):
        _row(panel, row, spread)
        words = f"{with_error(spread.mean, spread.sd)} {spread.unit}{'   > 20 % apart' if spread.apart else ''}"
        panel.text(1.02, row, words, transform=panel.get_yaxis_transform(), va="center", fontsize=10)
    panel.set_yticks(range(len(spreads)), [s.symbol for s in spreads])
    panel.set_ylim(len(spreads) - 0.4, -0.6)
    panel.set_xlim(-_EDGE, _EDGE)
    unit = "standard errors of the fit" if all(s.stderr is not None for s in spreads) else "standard deviations"
    panel.set_xlabel(f"distance from the fitted value [{unit}]")
    style.legend_above(fig, panel)
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


def jobs(posterior: Posterior, profiles: Mapping[str, Profile], bands: Sequence[Band]) -> list[Job]:
    """Every picture: path below RUN/pictures/posterior, and the call that draws it."""
    config = posterior.fit.rig.config
    name, synthetic = config.name, config.synthetic
    units = {s: unit for s, (unit, _) in posterior.described.items()}
    draws = {s: posterior.draws[s].ravel() for s in posterior.chain.symbols}
    every: list[Job] = [
        (Path("intervals.png"), partial(draw_spreads, name, _spreads(posterior, profiles), synthetic)),
        (Path("corner.png"), partial(draw_corner, name, draws, units, truths(posterior.fit.rig), synthetic)),
    ]
    if profiles:
        every.append((Path("profiles.png"), partial(draw_profiles, name, [*profiles.values()], units, synthetic)))
    return [*every, *((Path("bands") / file_name(b.trace), partial(draw_band, b, synthetic)) for b in bands)]


def _spreads(posterior: Posterior, profiles: Mapping[str, Profile]) -> list[Spread]:
    """Parameters with a number from both the fit and the posterior, without tied ones."""
    fit, read, true = posterior.fit, readings_of(posterior.fit), truths(posterior.fit.rig)
    known = intervals(fit) | lumped(fit)
    out = []
    for s, m in posterior.marginals.items():
        profile, fitted = profiles.get(s), known[s]
        if m.status != "estimated":
            continue
        ends = None if profile is None or profile.low is None or profile.high is None else (profile.low, profile.high)
        unit = posterior.described[s][0]
        out.append(Spread(s, unit, fitted.value, fitted.stderr or None, m.mean, m.sd, m.low, m.high, ends,
                                  read.get(s), true.get(s), disagree(m, profile)))  # fmt: skip
    return out
