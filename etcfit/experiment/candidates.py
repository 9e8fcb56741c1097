"""Driven traces to choose the next tests from: each shape at a few amplitudes, bands and durations, about half travel.

    quiet | ramp that frees the plate and opens it half | A wave(t) about the balance there | ramp down | quiet

Dry friction holds a plate that is led slowly to the balance itself, so the ramp overcomes friction first.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..rig import TEST_BY_NAME
from .excitation import SHAPES, AbstractShape
from .plan import PLANS, Plan
from .setting import Setting
from .settings import CampaignSettings

FULL = 10_000  # counts of a duty of 1: what is played is a whole number of them
_LEAD, _STAY, _DOWN, _OUT, _REST = 0.8, 0.2, 0.2, 0.8, 0.2  # s: ramp up, wait, to the balance, ramp down, wait
_LEAST, _MOST = 1.2, 2.5  # amplitude, times friction and times what takes a slow plate from stop to stop


@dataclass(frozen=True, eq=False)
class Played:
    """What is put out, sample and hold.

    Args:
        time: evenly spaced from 0, s, shape (n,).
        counts: duty of the supply, whole ten-thousandths, -10,000 to 10,000, shape (n,).
        supply: voltage that a duty of 1 is, V.
    """

    time: np.ndarray
    counts: np.ndarray
    supply: float

    @property
    def volts(self) -> np.ndarray:
        """Terminal voltage, V, shape (n,)."""
        return self.supply * self.counts / FULL

    @classmethod
    def of(cls, time: np.ndarray, volts: np.ndarray, supply: float) -> Played:
        """The nearest counts."""
        return cls(time, np.rint(FULL * volts / supply).astype(int), supply)


@dataclass(frozen=True, eq=False)
class Candidate:
    """A trace that may be made next.

    Args:
        kind: name of its shape, or of its rig test where it is one that was not made yet.
        plan: what is driven and logged.
        played: what is put out; None with open terminals.
        window: between which instants the plate must keep off the stops, s; None where it need not.
        group: candidates of one group differ in amplitude alone.
    """

    kind: str
    plan: Plan
    played: Played | None
    window: tuple[float, float] | None
    group: tuple[str, float, float]

    @property
    def seconds(self) -> float:
        """How long its log is, s."""
        return float(self.plan.time[-1])


def candidates(s: Setting, settings: CampaignSettings, made: set[str], without: tuple[str, ...]) -> list[Candidate]:
    """Every trace to choose from: shapes, and the rig tests that were not made yet.

    Args:
        s: the rig.
        settings: amplitudes, durations.
        made: rig tests of which there are traces.
        without: rig tests that nobody wants to make.
    """
    absent = [name for name in PLANS if name not in made and name not in without]
    every = [_undone(PLANS[name](s), s, settings) for name in absent]
    for shape in SHAPES:
        if shape.test not in without:
            every += _of_shape(shape, s, settings)
    return every


def _undone(plan: Plan, s: Setting, settings: CampaignSettings) -> Candidate:
    """A rig test of the paper's that was not made yet; its own plan says where the plate goes."""
    played = None
    if plan.volts is not None:
        time = _clock(float(plan.time[-1]), settings.play)
        latest = np.clip(np.searchsorted(plan.time, time + 1e-9, side="right") - 1, 0, None)
        played = Played.of(time, plan.volts[latest], s.supply)
    return Candidate(plan.test, plan, played, None, (plan.test, 0.0, 0.0))


def _of_shape(shape: AbstractShape, s: Setting, settings: CampaignSettings) -> Iterator[Candidate]:
    lower, upper = s.rest, s.open
    centre = s.balance(0.5 * (lower + upper))
    most = s.friction + s.volts(s.values["K_s"] * 0.5 * (upper - lower))
    room = settings.supply * s.supply - abs(centre)
    if room <= 0.0:
        return
    least = min(_LEAST * s.friction, 0.8 * room)
    for amplitude in np.geomspace(least, max(min(_MOST * most, room), 1.01 * least), settings.levels):
        for band in shape.bands:
            for duration in settings.durations:
                yield _driven(shape, s, settings, centre, float(amplitude), band, duration)


def _driven(
    shape: AbstractShape,
    s: Setting,
    settings: CampaignSettings,
    centre: float,
    amplitude: float,
    band: float,
    duration: float,
) -> Candidate:
    wave = shape.wave(_clock(duration, settings.play), band)
    begin = s.settings.quiet + _LEAD + _STAY + _DOWN
    end = begin + duration
    freed = min(centre + s.friction, settings.supply * s.supply)
    corners = np.cumsum([0.0, s.settings.quiet, _LEAD, _STAY, _DOWN, duration, _OUT, _REST])
    levels = np.array([0.0, 0.0, freed, freed, centre, centre, 0.0, 0.0])
    time = _clock(float(corners[-1]), settings.play)
    volts = np.interp(time, corners, levels)
    inside = np.searchsorted(time, begin - 1e-9) + np.arange(wave.size)
    volts[inside] += amplitude * wave
    played = Played.of(time, volts, s.supply)
    says = f"{shape.says(band)}, {centre:.2f} ± {amplitude:.2f} V, {duration:g} s"
    logged = _clock(float(time[-1]), s.rate)
    plan = Plan(shape.test, says, logged, np.interp(logged, time, played.volts), s.rest)
    return Candidate(shape.name, plan, played, (begin, end), (shape.name, band, duration))


def free_plate(candidate: Candidate) -> bool:
    """Whether the plate can move and somebody might care where."""
    boundary = TEST_BY_NAME[candidate.plan.test].boundary
    return not (boundary.plate_held or boundary.gear_apart or boundary.released)


def _clock(duration: float, rate: float) -> np.ndarray:
    return np.arange(round(duration * rate)) / rate
