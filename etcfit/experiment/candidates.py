"""Driven traces to choose the next tests from: each shape at a few amplitudes, bands and durations, about half travel.

    quiet | ramp that frees the plate and opens it half | A wave(t) about the balance there | ramp down | quiet

Dry friction holds a plate that is led slowly to the balance itself, so the ramp overcomes friction first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from ..rig import TEST_BY_NAME
from .plan import PLANS, QUIET, Plan, Setting, even_clock, sine_sweep
from .settings import CampaignSettings

FULL = 10_000  # counts of a duty of 1: what is played is a whole number of them
_LEAD, _STAY, _DOWN, _OUT, _REST = 0.8, 0.2, 0.2, 0.8, 0.2  # s: ramp up, wait, to the balance, ramp down, wait
LEVELS = 5  # amplitudes of each shape to try
_LEAST, _MOST = 1.2, 2.5  # amplitude, times friction and times what takes a slow plate from stop to stop
_SLOWEST = 0.4  # Hz, of a multisine and of a chirp
_LINES = 8  # of a multisine
_SEED = 2015  # of the levels of steps: a plan made twice is the same plan


def _multisine(time: np.ndarray, band: float) -> np.ndarray:
    """Sum of sines, logarithmically spaced up to the band, their phases those of a low peak:

        wave = sum_k sin(2 pi f_k t + phi_k) / peak,    phi_k = -pi k (k - 1) / K

    Source: Schroeder 1970, IEEE Trans. Inf. Theory 16:85. Differs from source: the lines are spaced by ratios.
    """
    hertz = np.geomspace(_SLOWEST, band, _LINES)
    k = np.arange(1, _LINES + 1)
    sines = np.sin(2.0 * np.pi * np.outer(time, hertz) - np.pi * k * (k - 1) / _LINES).sum(axis=1)
    return sines / np.abs(sines).max()


def _steps(time: np.ndarray, band: float) -> np.ndarray:
    """Levels above and below the middle in turn, each held for 1 to 3 halves of the band's period.

        wave = +-a_k,    a_k uniform in 0.4 to 1, the largest 1

    Source: amplitude-modulated pseudo-random signals, Nelles 2001, ch. 17. Differs from source: sides alternate, for a
    plate between two stops must come back.
    """
    rng = np.random.default_rng(_SEED)
    half = 0.5 / band
    count = int(time[-1] / half) + 2
    size = rng.uniform(0.4, 1.0, count) * np.where(np.arange(count) % 2, -1.0, 1.0)
    ends = np.cumsum(half * rng.integers(1, 4, count))
    wave = size[np.searchsorted(ends, time, side="right")]
    return wave / np.abs(wave).max()


def _ramps(time: np.ndarray, band: float) -> np.ndarray:
    """A triangle of the band's frequency: 0, 1, -1, 0 along straight lines.

    Slow, it shows spring and dry friction as the paper's static-load test does, without running into the stop.
    Source: the paper's static-load test. Differs from source: about half travel, in both directions.
    """
    return 2.0 / np.pi * np.arcsin(np.sin(2.0 * np.pi * band * time))


@dataclass(frozen=True)
class Shape:
    """A voltage about the one that balances the spring, as a share of its amplitude.

    v(t) = v_centre + A wave(t),    |wave| <= 1
    """

    name: str
    bands: tuple[float, ...]  # Hz, the fastest that is in it; each a candidate
    wave: Callable[[np.ndarray, float], np.ndarray]  # of evenly spaced times from 0, s, shape (n,), and band
    says: Callable[[float], str]  # what it is with this band, in a few words for whoever plays it
    test: str = "response"  # rig test whose folder takes the record


SHAPES = (
    Shape("multisine", (3.0, 10.0), _multisine, lambda f: f"multisine, {_LINES} lines {_SLOWEST:g} to {f:g} Hz"),
    Shape(
        "chirp",
        (3.0, 10.0),
        lambda time, f: sine_sweep(time, _SLOWEST, f, float(time[-1])),
        lambda f: f"sine sweep {_SLOWEST:g} to {f:g} Hz",
    ),
    Shape("steps", (2.0, 5.0), _steps, lambda f: f"steps to either side, {0.5 / f:.2g} to {1.5 / f:.2g} s each"),
    Shape("ramps", (0.33, 1.0), _ramps, lambda f: f"ramps up and down, {f:g} a second"),
)
"""A new shape is a function and a line here."""


@dataclass(frozen=True, eq=False)
class Played:
    """What is put out, sample and hold."""

    time: np.ndarray  # evenly spaced from 0, s, shape (n,)
    counts: np.ndarray  # duty of the supply, whole ten-thousandths, -10,000 to 10,000, shape (n,)
    supply: float  # voltage that a duty of 1 is, V

    @property
    def volts(self) -> np.ndarray:
        """Terminal voltage, V, shape (n,)."""
        return self.supply * self.counts / FULL


def _played(time: np.ndarray, volts: np.ndarray, supply: float) -> Played:
    """The nearest counts."""
    return Played(time, np.rint(FULL * volts / supply).astype(int), supply)


@dataclass(frozen=True, eq=False)
class Candidate:
    """A trace that may be made next."""

    kind: str  # name of its shape, or of its rig test where it is one that was not made yet
    plan: Plan  # what is driven and logged
    played: Played | None  # what is put out; None with open terminals
    # between which instants the plate must keep off the stops, s; None where it need not
    window: tuple[float, float] | None
    group: tuple[str, float, float]  # candidates of one group differ in amplitude alone

    @property
    def seconds(self) -> float:
        """How long its log is, s."""
        return float(self.plan.time[-1])

    @property
    def free_plate(self) -> bool:
        """Whether the plate can move and somebody might care where."""
        boundary = TEST_BY_NAME[self.plan.test].boundary
        return not (boundary.plate_held or boundary.gear_apart or boundary.released)


def candidates(s: Setting, settings: CampaignSettings, made: set[str], without: tuple[str, ...]) -> list[Candidate]:
    """Every trace to choose from: shapes, and the rig tests that are neither made already nor unwanted (`without`)."""
    absent = [name for name in PLANS if name not in made and name not in without]
    every = [_undone(PLANS[name](s), s, settings) for name in absent]
    for shape in SHAPES:
        if shape.test not in without:
            every += _driven(shape, s, settings)
    return every


def _undone(plan: Plan, s: Setting, settings: CampaignSettings) -> Candidate:
    """A rig test of the paper's that was not made yet; its own plan says where the plate goes."""
    played = None
    if plan.volts is not None:
        time = even_clock(float(plan.time[-1]), settings.play)
        latest = np.clip(np.searchsorted(plan.time, time + 1e-9, side="right") - 1, 0, None)
        played = _played(time, plan.volts[latest], s.supply)
    return Candidate(plan.test, plan, played, None, (plan.test, 0.0, 0.0))


def _driven(shape: Shape, s: Setting, settings: CampaignSettings) -> Iterator[Candidate]:
    """A shape at each amplitude, band and duration."""
    lower, upper = s.rest, s.open
    centre = s.balance(0.5 * (lower + upper))
    most = s.friction + s.volts(s.values["K_s"] * 0.5 * (upper - lower))
    room = settings.supply * s.supply - abs(centre)
    if room <= 0.0:
        return
    least = min(_LEAST * s.friction, 0.8 * room)
    freed = min(centre + s.friction, settings.supply * s.supply)
    begin = QUIET + _LEAD + _STAY + _DOWN
    levels = np.array([0.0, 0.0, freed, freed, centre, centre, 0.0, 0.0])
    for amplitude in map(float, np.geomspace(least, max(min(_MOST * most, room), 1.01 * least), LEVELS)):
        for band in shape.bands:
            for duration in settings.durations:
                wave = shape.wave(even_clock(duration, settings.play), band)
                corners = np.cumsum([0.0, QUIET, _LEAD, _STAY, _DOWN, duration, _OUT, _REST])
                time = even_clock(float(corners[-1]), settings.play)
                volts = np.interp(time, corners, levels)
                volts[np.searchsorted(time, begin - 1e-9) + np.arange(wave.size)] += amplitude * wave
                played = _played(time, volts, s.supply)
                says = f"{shape.says(band)}, {centre:.2f} ± {amplitude:.2f} V, {duration:g} s"
                logged = even_clock(float(time[-1]), s.rate)
                plan = Plan(shape.test, says, logged, np.interp(logged, time, played.volts), s.rest)
                yield Candidate(shape.name, plan, played, (begin, begin + duration), (shape.name, band, duration))
