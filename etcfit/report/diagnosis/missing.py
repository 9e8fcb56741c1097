"""What the model lacks over what it depends on: missing torque (or voltage) before and after, and what took it away."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...diagnose.findings import Diagnosis, Share
from .. import style
from ..numbers import short
from .ledger import listed
from .samples import Bins, Samples, curve_rms, directions_differ

_POINTS = 4000
_FEWEST = 100  # samples worth a picture
_PANELS = 3
_TELLING = 0.05  # share of what is missing that is worth a panel
_SHOWN = 0.99  # of the samples lie inside the panels


@dataclass(frozen=True)
class Scale:
    """How a quantity is shown: shown = factor * SI."""

    label: str
    factor: float = 1.0


AXES = {
    "angle": Scale("plate angle [deg]", 180.0 / np.pi),
    "speed": Scale("plate speed [rad/s]"),
    "current": Scale("current [A]"),
    "load": Scale("torque through the gear [N m]"),
    "time": Scale("time [s]"),
}
_UNITS = {"torque": "N m", "voltage": "V"}


@dataclass(frozen=True, eq=False)
class MissingPicture:
    """What a picture of the missing torque or voltage shows.

    Args:
        enters: "torque" or "voltage".
        samples: along the measured motion.
        shares: what it depends on, largest first.
        added: effects found.
        white: nothing was missing in the first place.
        synthetic: the data were made up.
    """

    enters: str
    samples: Samples
    shares: tuple[Share, ...]
    added: tuple[str, ...]
    white: bool
    synthetic: bool

    @classmethod
    def of(cls, diagnosis: Diagnosis, enters: str) -> MissingPicture | None:
        """None where too little is known of it."""
        samples = Samples.of(diagnosis.motions, enters)
        if samples.before.size < _FEWEST:
            return None
        first = diagnosis.rounds[0].evidence if diagnosis.rounds else None
        shares = tuple(share for share in first.shares if share.enters == enters) if first else ()
        shares = tuple(sorted(shares, key=lambda share: -share.share))
        synthetic = diagnosis.after.rig.config.synthetic
        return cls(enters, samples, shares, diagnosis.added, first is not None and first.white, synthetic)

    @property
    def telling(self) -> tuple[str, ...]:
        """The axes worth a panel: those it depends on most, two at least."""
        known = [s.axis for s in self.shares if s.share > _TELLING and s.axis in self.samples.axes]
        rest = [s.axis for s in self.shares] + ["angle", "speed"]
        more = [axis for axis in dict.fromkeys(rest) if axis not in known and axis in self.samples.axes]
        varying = [axis for axis in (*known[:_PANELS], *more) if np.ptp(self.samples.axes[axis]) > 0.0]
        return tuple(varying[: max(2, min(_PANELS, len(known)))])


def draw(picture: MissingPicture) -> Figure:
    """Above what was missing, below what is left; a column a quantity, all on one scale."""
    axes = picture.telling
    fig = style.figure(4.3 * len(axes) + (2.4 if len(axes) < 2 else 0.8), 7.2, picture.synthetic)
    factor, unit = _unit(picture)
    grid = fig.subplots(2, len(axes), sharex="col", sharey=True, squeeze=False)
    title = style.wrapped(finding(picture), 46 * len(axes))
    top = 0.92 + 0.26 * title.count("\n")
    fig.subplots_adjust(left=0.085, right=0.985, top=1.0 - (top + 0.3) / 7.2, bottom=0.08, wspace=0.08, hspace=0.12)
    limit = _limit(picture.samples)
    for column, axis in enumerate(axes):
        _column(grid[0, column], grid[1, column], picture, axis, factor)
        grid[0, column].set_title(_share(picture, axis), loc="left", fontsize=11)
    grid[0, 0].set_ylim(-limit * factor, limit * factor)
    grid[0, 0].set_ylabel(f"missing {picture.enters}, BEFORE [{unit}]")
    grid[1, 0].set_ylabel(f"missing {picture.enters}, AFTER [{unit}]")
    fig.suptitle(title, x=0.015, y=0.985, ha="left", va="top", fontsize=14, fontweight="bold")
    style.legend(fig, list(grid.ravel()), 0.085, 1.0 - (top - 0.42) / 7.2, "upper left")
    return fig


def finding(picture: MissingPicture) -> str:
    """The picture in one sentence."""
    enters, samples = picture.enters, picture.samples
    if picture.white and not picture.added:
        return f"No {enters} is missing: what is left is noise"
    axis = picture.telling[0] if picture.telling else "angle"
    lead = f"The missing {enters} depends on the {axis}" if _dependent(picture) else f"The missing {enters}"
    colon = ":" if _dependent(picture) else ""
    acting = [name for name in picture.added if name in samples.effects]
    if not picture.added:
        return f"{lead}{colon} {'no effect of the catalogue takes it away' if colon else 'is left as it was'}"
    bins = Bins.along(samples.axes[axis])
    left = curve_rms(bins, samples.after) / max(curve_rms(bins, samples.before), 1e-300)
    who = listed(acting or picture.added)
    verb = "takes" if len(acting or picture.added) == 1 else "take"
    what = _taken(left) if colon else _taken(left).replace("it", "what is by rule")
    return f"{lead}{colon} {who} {verb} {what}" if colon else f"Of the missing {enters}, {who} {verb} {what}"


def _dependent(picture: MissingPicture) -> bool:
    return bool(picture.shares) and picture.shares[0].share > _TELLING


def _taken(left: float) -> str:
    """Words for what is left of the median curve, as a share of what it was."""
    if left < 0.2:
        return "it away"
    if left < 0.5:
        return "most of it away"
    return "part of it away" if left < 0.9 else "nothing of it away"


def _share(picture: MissingPicture, axis: str) -> str:
    share = next((s.share for s in picture.shares if s.axis == axis), None)
    return "" if share is None else f"a curve over the {axis} is {100.0 * share:.0f} % of it"


def _unit(picture: MissingPicture) -> tuple[float, str]:
    small = _limit(picture.samples) < 0.2
    unit = _UNITS[picture.enters]
    return (1e3, f"m{unit}") if small else (1.0, unit)


def _limit(samples: Samples) -> float:
    """Of the panels, SI: nearly all that was missing, and all of the effects' median lies inside."""
    every = np.abs(np.concatenate((samples.before, samples.after)))
    return 1.2 * max(float(np.quantile(every, _SHOWN)), 1e-12)


def _column(above: Axes, below: Axes, picture: MissingPicture, axis: str, factor: float) -> None:
    samples, scale = picture.samples, AXES[axis]
    bins = Bins.along(samples.axes[axis])
    ways = _ways(samples) if axis == "angle" and directions_differ(samples) else _one(samples)
    for panel, y in ((above, samples.before), (below, samples.after)):
        panel.axhline(0.0, color="black", lw=0.8)
        for way in ways:
            _cloud(panel, samples.axes[axis] * scale.factor, y * factor, way)
            _median(panel, bins, y * factor, scale.factor, way)
        rms = factor * curve_rms(bins, y)
        panel.text(0.98, 0.03, f"median curve: {short(rms, 2)} rms", transform=panel.transAxes, ha="right", va="bottom",
                   fontsize=10, bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.5, "alpha": 0.85})  # fmt: skip
    _effects(above, picture, bins, axis, factor, ways)
    below.set_xlabel(scale.label)
    below.set_xlim(bins.edges[0] * scale.factor, bins.edges[-1] * scale.factor)


@dataclass(frozen=True, eq=False)
class Way:
    """Samples that make one curve.

    Args:
        rows: which, shape (n,).
        points, line: colours.
        dashes: of the effects' lines.
        label: of the median.
    """

    rows: np.ndarray
    points: str
    line: str
    dashes: str
    label: str


def _one(samples: Samples) -> Sequence[Way]:
    return (Way(np.ones(samples.before.size, dtype=bool), "#b8b8b8", "black", "-", "median, quartiles"),)


def _ways(samples: Samples) -> Sequence[Way]:
    speed = samples.axes["speed"]
    return (
        Way(speed > 0.0, "#a9c9e2", style.OPENING, "-", "opening: median, quartiles"),
        Way(speed < 0.0, "#f3d9a6", style.CLOSING, "--", "closing: median, quartiles"),
    )


def _cloud(panel: Axes, x: np.ndarray, y: np.ndarray, way: Way) -> None:
    rows = np.flatnonzero(way.rows)
    if rows.size > _POINTS // 2:
        rows = rows[np.random.default_rng(0).permutation(rows.size)[: _POINTS // 2]]
    panel.plot(x[rows], y[rows], ".", ms=2.5, color=way.points, alpha=0.6, mew=0, zorder=1)


def _median(panel: Axes, bins: Bins, y: np.ndarray, stretch: float, way: Way) -> None:
    low, middle, high = bins.quartiles(y, way.rows)
    x = bins.centres * stretch
    panel.fill_between(x, low, high, color=way.line, alpha=0.18, lw=0, zorder=2)
    panel.plot(x, middle, color=way.line, lw=2.2, label=way.label, zorder=3)


def _effects(
    panel: Axes, picture: MissingPicture, bins: Bins, axis: str, factor: float, ways: Sequence[Way]
) -> None:
    """What each added effect contributes, and, where that is not all, what the whole new model does."""
    samples, stretch = picture.samples, AXES[axis].factor
    for color, (name, part) in zip(style.EFFECTS, samples.effects.items(), strict=False):
        for way in ways:
            panel.plot(bins.centres * stretch, bins.quartiles(part * factor, way.rows)[1], way.dashes, color=color,
                       lw=2.4, label=name if way.dashes == "-" else "_", zorder=4)  # fmt: skip
    if len(samples.effects) and len(ways) == 1:
        gained = bins.quartiles((samples.before - samples.after) * factor)[1]
        panel.plot(bins.centres * stretch, gained, ":", color=style.TAG, lw=2.0, zorder=5,
                   label="final model less first, refitted parameters included")  # fmt: skip
