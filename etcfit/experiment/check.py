"""What a measurement folder holds, what is odd about it, and what its traces can identify. Fits nothing.

The verdict is that of the Fisher information of the start model, at the values that the paper's graphs read.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..car_log.study import Study, study_traces
from ..errors import MeasurementError
from ..estimation.identifiability import Identifiability, analyse, listed, sentences
from ..estimation.levenberg_marquardt import fisher_information
from ..estimation.ready import ready, start_values
from ..problem.free_parameters import Layout, free_parameters
from ..problem.problem import EstimationProblem
from ..problem.trace import Trace
from ..rig.base import Channel, Rig
from ..rig.ecu import GAINS
from ..rig.paper_readings import Readings, read_graphs
from ..rig.signals import runs
from .settings import CheckSettings

_SURE = 1e8  # information on a relative change of what is taken as known: far more than any data give
_LIVELY = 0.25  # share of neighbouring samples that may be equal in a channel whose rest on one value means saturation
_RUN_SHARE = 0.005  # of a trace's samples that a clipped run has at least


@dataclass(frozen=True)
class Clock:
    """Time base of a trace."""

    # samples, duration: rows; s
    samples: int
    duration: float
    rate: float  # 1/median interval, Hz
    jitter: float  # rms of interval/median - 1, gaps left out
    gaps: int  # intervals of more than `gap` medians
    longest: float  # the longest interval, s


@dataclass(frozen=True)
class ChannelCheck:
    """One channel of a trace, in the unit that was logged."""

    # name, unit: what, in what
    name: str
    unit: str
    # low, high: range
    low: float
    high: float
    sigma: float  # noise of one sample; `estimated` where rig.toml does not give it
    estimated: bool
    quantum: float  # resolution; 0 where none is seen
    empty: int  # rows without a value
    clipped: int  # samples that sit on one extreme value in long runs
    frozen: bool  # never changes


@dataclass(frozen=True)
class TraceCheck:
    """One trace."""

    file: str
    test: str
    held_out: bool
    clock: Clock
    channels: tuple[ChannelCheck, ...]


@dataclass(frozen=True, eq=False)
class CheckResult:
    """What `check` found."""

    rig: Rig  # as read
    traces: tuple[TraceCheck, ...]  # each trace
    identifiability: Identifiability | None  # of the start model; None where nothing can be fitted
    directions: tuple[str, ...]  # each null or weak direction in a sentence, worst first
    readings: Readings | None  # the paper's graphs; None where they could not be read either
    warnings: tuple[str, ...]  # what a reader must know, `why_not` included
    why_not: str = ""  # why there is no verdict, or ""
    gains: tuple[str, ...] = ()  # sentences: what a known gain of the ECU would make identifiable
    settings: CheckSettings = CheckSettings()  # what it was decided by
    follows: tuple[Study, ...] = ()  # traces with a setpoint, as `drive` judges a log, by the same thresholds


def check(rig: Rig, settings: CheckSettings = CheckSettings()) -> CheckResult:
    """Look at a rig without fitting it.

    Args:
        rig: a measurement folder.
        settings: what is odd about a clock or a channel.
    Raises:
        MeasurementError: rig.toml asks for what no fit can do.
    """
    free_parameters(rig.config)  # refuses what `fit` refuses; traces that cannot be fitted are shown all the same
    traces = tuple(
        TraceCheck(m.file, m.test, m.held_out, clock(m.time, settings),
                   tuple(channel_check(name, c, m.time.size, settings) for name, c in m.channels.items()))
        for m in rig.measurements
    )  # fmt: skip
    follows = study_traces(rig)
    try:
        judged = verdict(rig)
    except MeasurementError as error:
        return CheckResult(rig, traces, None, (), None, rig.warnings, str(error), settings=settings,
                           follows=follows)  # fmt: skip
    found = judged.identifiability
    words = sentences(found.directions, judged.traces)
    warnings = (*rig.warnings, *judged.notes)
    gains = _were_gains_known(judged)
    return CheckResult(rig, traces, found, words, judged.readings, warnings, gains=gains, settings=settings,
                       follows=follows)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Foresight:
    """What the traces to be fitted can identify."""

    layout: Layout  # of the start model
    x: np.ndarray  # coordinates of the readings at which it was judged, shape (P,)
    information: np.ndarray  # of the traces and the user's priors, shape (P, P)
    readings: Readings  # the paper's graphs
    notes: tuple[str, ...]  # on traces left out
    traces: tuple[Trace, ...]  # those to be fitted

    @cached_property
    def identifiability(self) -> Identifiability:
        return analyse(self.layout, self.x, self.information)

    def knowing(self, symbols: tuple[str, ...]) -> tuple[str, ...]:
        """Symbols, others than these, that would become identifiable were these known."""
        known = np.array([s in symbols for s in self.layout.free])
        sure = np.diag(known * _SURE / self.layout.reach(self.x) ** 2)
        lost = analyse(self.layout, self.x, self.information + sure).lost
        return tuple(s for s in self.identifiability.lost if s not in lost and s not in symbols)


def _were_gains_known(verdict: Foresight) -> tuple[str, ...]:
    """What each gain of the ECU that is sought in vain would make identifiable were it known, and all of them."""
    unknown = tuple(s for s in GAINS.values() if s in verdict.identifiability.lost)
    keys = {symbol: key for key, symbol in GAINS.items()}
    out = []
    for group in dict.fromkeys((*((s,) for s in unknown), unknown)) if unknown else ():
        if told := verdict.knowing(group):
            names = " and ".join(f"{s} ([ecu] {keys[s]})" for s in group)
            out.append(f"Were {names} known, {listed(told)} would be identifiable too.")
    return tuple(out)


def verdict(rig: Rig) -> Foresight:
    """What the traces to be fitted can identify, at the values that the paper's graphs read.

    Raises:
        MeasurementError: nothing to fit.
    """
    known = free_parameters(rig.config)
    fitted, _, notes = ready(rig)
    readings = read_graphs(rig)
    told = readings
    if {*GAINS.values()} & {*known.layout.free}:
        # A plate read with gains of the ECU that nobody knows is of no size that could be held against any other:
        # nominal sizes are better, for a gain that is not known tells less than one that is.
        told = replace(readings, values={s: v for s, v in readings.values.items() if s not in readings.nominal})
    x = known.layout.coordinates(start_values(known, told))
    problem = EstimationProblem.of_traces(rig.config, known, fitted).refined(x)
    problem = problem.with_integrator_states(x)
    weighted = problem.weighted(problem.kalman(x))
    jacobian = problem.linearise(x, weighted).jacobian
    rows = jacobian.reshape(-1, x.size)
    rows = rows[np.isfinite(rows).all(axis=1)]
    information = fisher_information(weighted.prior_sd[: x.size], rows)
    return Foresight(known.layout, x, information, readings, notes, fitted)


def clock(time: np.ndarray, settings: CheckSettings = CheckSettings()) -> Clock:
    """Rate, jitter and gaps of a time base, s, shape (n,), n >= 2."""
    dt = np.diff(time)
    median = float(np.median(dt))
    gap = dt > settings.gap * median
    jitter = float(np.sqrt(np.mean((dt[~gap] / median - 1.0) ** 2)))
    return Clock(time.size, float(time[-1] - time[0]), 1.0 / median, jitter, int(gap.sum()), float(dt.max()))


def channel_check(name: str, channel: Channel, rows: int, settings: CheckSettings = CheckSettings()) -> ChannelCheck:
    """One channel of a trace of so many rows."""
    size, logged = abs(channel.scale), channel.logged(channel.value)
    return ChannelCheck(
        name=name,
        unit=channel.unit,
        low=float(logged.min()),
        high=float(logged.max()),
        sigma=channel.sigma / size,
        estimated=channel.sigma_estimated,
        quantum=channel.quantum / size,
        empty=rows - channel.value.size,
        clipped=clipped(channel.value, settings),
        frozen=bool(np.ptp(channel.value) == 0.0),
    )


def clipped(value: np.ndarray, settings: CheckSettings = CheckSettings()) -> int:
    """Samples that rest on the lowest or the highest value while the channel is lively everywhere else.

    A commanded staircase, or a quantised signal without noise, rests on many values; that is no saturation.
    """
    low, high = value.min(), value.max()
    extreme = (value == low) | (value == high)
    same = np.diff(value) == 0.0
    elsewhere = ~extreme[1:]
    if low == high or elsewhere.sum() < 4 * settings.run or same[elsewhere].mean() > _LIVELY:
        return 0
    least = max(settings.run, round(_RUN_SHARE * value.size), 2)
    return sum(stop - start for end in (low, high) for start, stop in runs(value == end) if stop - start >= least)
