"""Missing torque (or voltage) of the model along its axes, before and after, and the effects that explain it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...diagnosis.findings import Diagnosis, Motion, Share
from ...estimation.identifiability import listed
from .. import style
from ..numbers import short
from .ledger import QUANTITIES, prefixed

_BINS = 40
_FEWEST = 12  # least number of samples in a drawn bin
_CLIPPED = 0.002  # share of the samples at either end of an axis that is outside the picture
_LOSES = 1e-9  # share of the missing torque below which an effect counts as acting elsewhere


@dataclass(frozen=True, eq=False)
class Samples:
    """The missing torque or voltage of all traces, concatenated, shape (n,) each; only where it is known before and
    after.
    """

    axes: Mapping[str, np.ndarray]  # values of the axes by name, see `Motion`
    # before, after: missing amount with the first and with the final model, SI
    before: np.ndarray
    after: np.ndarray
    # contribution of each added effect there, SI; without those that contribute nothing
    effects: Mapping[str, np.ndarray]

    @classmethod
    def of_motions(cls, motions: Sequence[Motion], enters: str) -> Samples:
        """Collect "torque" or "voltage"."""
        names = dict.fromkeys(name for motion in motions for name in motion.effects)
        before = _end_to_end([getattr(motion, enters) for motion in motions])
        after = _end_to_end([motion.after[enters] for motion in motions])
        seen = np.isfinite(before) & np.isfinite(after)
        axes = {
            a: _end_to_end([motion.axes[a] for motion in motions])[seen] for a in (motions[0].axes if motions else ())
        }
        every = {name: _end_to_end([_of_effect(m, name, enters) for m in motions])[seen] for name in names}
        size = _LOSES * float(np.sqrt(np.mean(before[seen] ** 2))) if seen.any() else 0.0
        acting = {name: part for name, part in every.items() if np.any(np.abs(part) > size)}
        return cls(axes, before[seen], after[seen], acting)


def _end_to_end(parts: Sequence[np.ndarray]) -> np.ndarray:
    return np.concatenate([np.asarray(part, dtype=float) for part in parts]) if parts else np.empty(0)


def _of_effect(motion: Motion, name: str, enters: str) -> np.ndarray:
    part = motion.effects.get(name, {}).get(enters)
    return np.zeros(motion.torque.size) if part is None else np.nan_to_num(np.asarray(part, dtype=float))


@dataclass(frozen=True, eq=False)
class Bins:
    """Equal steps along an axis."""

    edges: np.ndarray  # shape (B + 1,)
    place: np.ndarray  # bin of each sample, shape (n,); outside 0 ... B-1 if it is beyond the edges.

    @classmethod
    def along(cls, axis: np.ndarray) -> Bins:
        """Bins over nearly all of the range; outliers at the ends would compress the picture."""
        low, high = np.quantile(axis, (_CLIPPED, 1.0 - _CLIPPED))
        edges = np.linspace(low, max(high, low + 1e-12), _BINS + 1)
        return cls(edges, np.digitize(axis, edges) - 1)

    @property
    def centres(self) -> np.ndarray:
        return 0.5 * (self.edges[1:] + self.edges[:-1])

    def quartiles(self, y: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Lower quartile, median and upper quartile in each bin, shape (3, B); NaN for too few samples."""
        out = np.full((3, _BINS), np.nan)
        for k in range(_BINS):
            mine = y[rows & (self.place == k)]
            if mine.size >= _FEWEST:
                out[:, k] = np.quantile(mine, (0.25, 0.5, 0.75))
        return out


def ways(samples: Samples, axis: str) -> tuple[np.ndarray, ...]:
    """Sets of rows for one curve each, shape (n,): all rows, or, over the angle, opening and closing if their curves
    differ by more than their own spread."""
    every = (np.ones(samples.before.size, dtype=bool),)
    if axis != "angle" or "speed" not in samples.axes:
        return every
    bins, speed = Bins.along(samples.axes["angle"]), samples.axes["speed"]
    both = speed > 0.0, speed < 0.0
    opening, closing = (bins.quartiles(samples.before, rows) for rows in both)
    apart, spread = np.abs(opening[1] - closing[1]), 0.5 * (opening[2] - opening[0] + closing[2] - closing[0])
    seen = np.isfinite(apart)
    return both if seen.sum() > 4 and np.median(apart[seen]) > np.median(spread[seen]) else every


def curve_rms(bins: Bins, y: np.ndarray, curves: Sequence[np.ndarray]) -> float:
    """Root mean square of the median curves of all sets of rows: the systematic part of the missing amount."""
    medians = np.concatenate([bins.quartiles(y, rows)[1] for rows in curves])
    seen = np.isfinite(medians)
    return float(np.sqrt(np.mean(medians[seen] ** 2))) if seen.any() else 0.0


_POINTS = 4000
_WORTH_A_PICTURE = 100  # least number of samples for a picture
_PANELS = 3
_TELLING = 0.05  # least share of the missing amount for a panel
_SHOWN = 0.99  # share of the samples inside the panels


_UNITS = {"torque": "N m", "voltage": "V"}


@dataclass(frozen=True, eq=False)
class MissingPicture:
    """Contents of a picture of the missing torque or voltage."""

    enters: str  # "torque" or "voltage"
    samples: Samples  # samples along the measured motion
    shares: tuple[Share, ...]  # shares of the axes, largest first
    added: tuple[str, ...]  # effects found
    white: bool  # whether nothing was missing from the beginning
    synthetic: bool  # whether the data are synthetic

    @classmethod
    def of_diagnosis(cls, diagnosis: Diagnosis, enters: str) -> MissingPicture | None:
        """The contents, or None with too few samples."""
        samples = Samples.of_motions(diagnosis.motions, enters)
        if samples.before.size < _WORTH_A_PICTURE:
            return None
        first = diagnosis.rounds[0].evidence if diagnosis.rounds else None
        shares = tuple(share for share in first.shares if share.enters == enters) if first else ()
        shares = tuple(sorted(shares, key=lambda share: -share.share))
        synthetic = diagnosis.after.rig.config.synthetic
        picture = cls(enters, samples, shares, diagnosis.added, first is not None and first.white, synthetic)
        return picture if picture.telling else None

    @property
    def telling(self) -> tuple[str, ...]:
        """The axes with a panel: those with the largest shares, at least two."""
        known = [s.axis for s in self.shares if s.share > _TELLING and s.axis in self.samples.axes]
        rest = [s.axis for s in self.shares] + ["angle", "speed"]
        more = [axis for axis in dict.fromkeys(rest) if axis not in known and axis in self.samples.axes]
        varying = [axis for axis in (*known[:_PANELS], *more) if np.ptp(self.samples.axes[axis]) > 0.0]
        return tuple(varying[: max(2, min(_PANELS, len(known)))])


def draw(picture: MissingPicture) -> Figure:
    """The missing amount before above, after below; one column per axis, all on one scale."""
    axes = picture.telling
    wide = 4.3 * len(axes) + (2.4 if len(axes) < 2 else 0.8)
    fig = style.figure(wide, 7.2, picture.synthetic)
    limits = _limits(picture.samples)
    factor, unit = prefixed(max(-limits[0], limits[1]), _UNITS[picture.enters])
    grid = fig.subplots(2, len(axes), sharex="col", sharey=True, squeeze=False)
    for column, axis in enumerate(axes):
        _column(grid[0, column], grid[1, column], picture, axis, (factor, unit))
        share = next((s.share for s in picture.shares if s.axis == axis), None)
        words = "" if share is None else f"{100.0 * share:.0f} % of it is a curve over the {axis}"
        grid[0, column].set_title(words, loc="left", fontsize=11)
    grid[0, 0].set_ylim(limits[0] * factor, limits[1] * factor)
    grid[0, 0].set_ylabel(f"missing {picture.enters}, BEFORE [{unit}]")
    grid[1, 0].set_ylabel(f"missing {picture.enters}, AFTER [{unit}]")
    _head(fig, list(grid.ravel()), style.wrapped(finding(picture), wide, 13))
    return fig


def _head(fig: Figure, panels: list[Axes], title: str) -> None:
    """Title, legend below it in as many lines as needed, and the panels below."""
    wide, tall = fig.get_size_inches()
    most = int(wide / 3.2)
    lines = -(-len(style.labels(panels)) // most)
    top = 0.5 + 0.26 * title.count("\n")
    fig.subplots_adjust(left=0.085, right=0.985, top=1.0 - (top + 0.45 + 0.2 * lines) / tall, bottom=0.08, wspace=0.08,
                        hspace=0.12)  # fmt: skip
    style.title(fig, title, bold=True)
    style.legend(fig, panels, 0.085, 1.0 - top / tall, "upper left", most)


def finding(picture: MissingPicture) -> str:
    """The picture in one sentence."""
    enters, samples = picture.enters, picture.samples
    axis = picture.telling[0]
    bins, curves = Bins.along(samples.axes[axis]), ways(samples, axis)
    was, now = curve_rms(bins, samples.before, curves), curve_rms(bins, samples.after, curves)
    if picture.white and not picture.added:
        return f"No {enters} is missing: what is left is noise"
    if not picture.shares or picture.shares[0].share < _TELLING:
        return f"The missing {enters} follows nothing that was measured: nothing to take away"
    lead = f"The missing {enters} depends on the {axis}"
    if not picture.added:
        return f"{lead}: no effect of the catalogue takes it away"
    acting = [name for name in picture.added if name in samples.effects] or list(picture.added)
    return f"{lead}: {listed(acting)} take{'s' if len(acting) == 1 else ''} {_taken(now / max(was, 1e-300))}"


def _taken(left: float) -> str:
    """The rest of the median curve as a share of the original, in words."""
    if left < 0.2:
        return "it away"
    if left < 0.5:
        return "most of it away"
    return "part of it away" if left < 0.9 else "nothing of it away"


def _limits(samples: Samples) -> tuple[float, float]:
    """Limits of the panels, SI: nearly all samples, zero, and the effects are inside."""
    out = 0.5 * (1.0 - _SHOWN)
    every = (samples.before, samples.after, *samples.effects.values())
    low = min(0.0, *(float(np.quantile(part, out)) for part in every))
    high = max(0.0, *(float(np.quantile(part, 1.0 - out)) for part in every))
    room = max(0.12 * (high - low), 1e-12)
    return low - 1.5 * room, high + room  # the figure is printed below


def _column(above: Axes, below: Axes, picture: MissingPicture, axis: str, shown: tuple[float, str]) -> None:
    (factor, unit), samples, (name, axis_unit, scale) = shown, picture.samples, QUANTITIES[axis]
    bins = Bins.along(samples.axes[axis])
    curves = ways(samples, axis)
    drawn = [Way(rows, *look) for rows, look in zip(curves, _TWO if len(curves) > 1 else _ONE, strict=True)]
    for panel, y in ((above, samples.before), (below, samples.after)):
        panel.axhline(0.0, color="black", lw=0.8)
        for way in drawn:
            rows = np.flatnonzero(way.rows)
            if rows.size > _POINTS // 2:
                rows = rows[np.random.default_rng(0).permutation(rows.size)[: _POINTS // 2]]
            at = samples.axes[axis][rows] * scale
            panel.plot(at, y[rows] * factor, ".", ms=3.5, color=way.points, alpha=0.7, mew=0, zorder=1)
            low, middle, high = bins.quartiles(y * factor, way.rows)
            panel.fill_between(bins.centres * scale, low, high, color=way.line, alpha=0.18, lw=0, zorder=2)
            panel.plot(bins.centres * scale, middle, color=way.line, lw=2.2, label=way.label, zorder=3)
        text = f"median curve: {short(factor * curve_rms(bins, y, curves), 2)} {unit} rms"
        panel.text(0.98, 0.03, text, transform=panel.transAxes, ha="right", va="bottom", fontsize=10,
                   bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.5, "alpha": 0.85})  # fmt: skip
    _effects(above, picture, bins, axis, factor, drawn)
    below.set_xlabel(style.unit_label(name, axis_unit))
    below.set_xlim(bins.edges[0] * scale, bins.edges[-1] * scale)


@dataclass(frozen=True, eq=False)
class Way:
    """Samples of one curve."""

    rows: np.ndarray  # mask of the samples, shape (n,)
    # points, line: colours
    points: str
    line: str
    dashes: str  # dashes of the effects' lines
    label: str  # label of the median


_ONE = (("#b8b8b8", "black", "-", "median, quartiles"),)
_TWO = (
    ("#a9c9e2", style.OPENING, "-", "opening: median, quartiles"),
    ("#f3d9a6", style.CLOSING, "--", "closing: median, quartiles"),
)


def _effects(panel: Axes, picture: MissingPicture, bins: Bins, axis: str, factor: float, drawn: Sequence[Way]) -> None:
    """Contribution of each added effect and, if that is one curve, of the whole new model."""
    samples, x = picture.samples, bins.centres * QUANTITIES[axis][2]
    for color, (name, part) in zip(cycle(style.EFFECTS), samples.effects.items(), strict=False):
        for way in drawn:
            panel.plot(x, bins.quartiles(part * factor, way.rows)[1], way.dashes, color=color, lw=2.4, zorder=4,
                       label=name if way.dashes == "-" else "_")  # fmt: skip
    if samples.effects and len(drawn) == 1:
        gained = bins.quartiles((samples.before - samples.after) * factor, drawn[0].rows)[1]
        panel.plot(x, gained, ":", color=style.UNKNOWN, lw=2.4, zorder=5, label="all that the final model adds")
