"""Instruments slower than what they record: a current channel behind a low-pass, a log slower than its input.

The rise of a held winding's current after a step has two time constants behind a low-pass.

    one lag    y = y_0 + A (1 - exp(-s/T)),                                                       s = t - t_0 >= 0
    two lags   y = y_0 + A (1 - (T_a exp(-s/T_a) - T_b exp(-s/T_b)) / (T_a - T_b))

t_0 is free in both, so a channel that is merely late is none. The rise is the same with T_a and T_b exchanged: which of
them is L/R and which is the channel's, no current shows. A low-pass that is much faster than L/R, or than the log,
leaves one lag; then R T is an upper bound of L, and no record says so, but one much slower than a winding's.

Source: Doebelin 2003, ch. 3 (two instruments of first order in a row). Differs from source: no.

A log is slower than what acts in it where the input changes between two samples, and when is unknown.

    y_(k+1) - y_k = a + sum_j b_j y_(k-j) + sum_j c_j u_(k-j) + d u_(k+1),   j = 0 ... 3

An input that is held from sample to sample, or that a log follows, gives the next position from what was logged up to
now. Where a controller acted several times between two samples, the next input u_(k+1) shows it too, d > 0. A
controller that reads the position also makes d other than zero, but below it: it pulls back. Samples about a lone edge
are left out: its instant is sought by the fit.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .. import TEST_BY_NAME
from ..base import Channel, Finding, Measurement, RigConfig
from ..signals import drive_voltage, jumps, on_times
from .base import Records, by_chance, found_in
from .circuit import Value

if TYPE_CHECKING:
    from scipy.optimize import OptimizeResult

WINDING = ("inductance", "response")  # tests that show L, best first
CURE = ("Look up the bandwidth of the current's channel, 1/(2 pi T): log again with one ten times faster than the "
        "winding, or put y + T dy/dt in the place of the column y.")  # fmt: skip
SLOW = (0.03, 0.2)  # parts of the record at which the search for one lag begins
FAST = (0.3, 0.05)  # parts of that lag at which the search for a second one begins
GAIN = 30.0  # by how much two lags must lower chi2, over all steps of a test
LAG_ERROR = 0.2  # of either time constant, relative, at most
LEFT = 2.0  # noises, rms, that two lags may leave
ALIKE = 3.0  # largest over smallest of a test's time constants, at most
LONGEST = 8e-3  # s; no winding of a small motor has a longer L/R
LONGEST_ERRORS = 8.0  # standard errors by which L/R must be longer
STEP_SAMPLES = 30  # after the step, at least
FLAT = 0.03  # of the step, by which the voltage may move after it

LAGS = 4
AHEAD = 5.5  # standard errors of d
NEW = 0.08  # rms of what the input's own past does not predict, of its standard deviation, at least
LEVELS = 8  # fiftieths of its span that an input takes, at least: a binary signal is made for one clock
FEWEST = 100  # samples
ALONE = 0.1  # of an edge's size: changes about a lone edge are smaller
EDGE, EDGE_SHARE = 9.0, 0.02  # noises, and of the span: an edge


class Rise(NamedTuple):
    """Both time constants of one rise."""

    slow: float  # s
    fast: float  # s
    error: float  # the larger of theirs, relative
    gain: float  # by which two lags lower chi2
    left: float  # noises that two lags leave, rms


def slow_current(records: Records) -> Iterator[Finding]:
    """A low-pass in the current's channel: two time constants with the plate held, or an L/R that no winding has."""
    found = []
    for test, traces in records.tests.items():
        if not TEST_BY_NAME[test].boundary.plate_held or test in records.blamed:
            continue
        read = {t.file: rise for t in traces if (rise := _rise(t, records.config)) is not None}
        rises, fast = [*read.values()], [rise.fast for rise in read.values()]
        sound = rises and all(r.left < LEFT and r.gain > 0.0 for r in rises) and max(fast) < ALIKE * min(fast)
        sure = sound and sum(r.error**-2 for r in rises) ** -0.5 < LAG_ERROR
        if sure and sum(r.gain for r in rises) > GAIN:
            found.append(_of_two_lags(read, traces, records))
    yield from found or _of_circuit(records)


def _of_two_lags(rises: dict[str, Rise], traces: tuple[Measurement, ...], records: Records) -> Finding:
    a, b = (float(np.median([rise[n] for rise in rises.values()])) for n in (0, 1))
    gain = sum(rise.gain for rise in rises.values())
    channel = next(t for t in traces if t.file in rises).channels["current"]
    circuit = records.circuits.get(traces[0].test) or next(iter(records.circuits.values()), None)
    R = circuit.R.value if circuit is not None and circuit.R is not None else None
    henries = f": {R * a:.3g} or {R * b:.3g} H, not {R * (a + b):.3g}" if R is not None and R > 0.0 else ""
    return found_in(rises, traces, Finding(
        "slow_current", a, "s", by_chance(gain**0.5),
        f"'{channel.header}' rises after the step as behind two lags, of "
        f"{1e3 * a:.3g} and {1e3 * b:.3g} ms (two lower chi2 by {gain:.0f} against one that may begin late): one "
        "is L/R of the winding, the other a low-pass in the current's channel. Which is which this current cannot "
        f"tell, and a fit takes both for the winding's{henries}.", CURE, channel="current",
    ))  # fmt: skip


def _of_circuit(records: Records) -> Iterator[Finding]:
    """An L/R that no winding has; a finding of every test where none has a shorter one."""
    lags = {name: Value(c.L.value / c.R.value, c.L.error / c.R.value) for name, c in records.circuits.items()
            if c.L and c.R and c.R.value > 0.0}  # fmt: skip
    test = next((name for name in WINDING if name in lags), None)
    if test is None:
        return
    circuit, (lag, error) = records.circuits[test], lags[test]
    if circuit.L is not None and lag - LONGEST_ERRORS * error > LONGEST:
        alike = all(value > LONGEST / 2.0 for value, _ in lags.values())
        yield Finding(
            "slow_current", lag, "s", by_chance((lag - LONGEST) / error),
            f"In {test} the current follows the voltage with a lag of {1e3 * lag:.3g} +- {1e3 * error:.2g} ms; L/R "
            "of a small motor's winding is a few. One lag says only the sum of the winding's and of a low-pass in "
            f"the current's channel: {circuit.L.value:.3g} H is an upper bound of L_a.",
            CURE, None if alike else test, channel="current",
        )  # fmt: skip


def _rise(trace: Measurement, config: RigConfig) -> Rise | None:
    """Rise of the current after a trace's only voltage step; None without exactly one."""
    volts, current = drive_voltage(trace, config), trace.channels.get("current")
    if volts is None or current is None or not np.array_equal(volts.time, current.time):
        return None
    v = volts.value
    k = int(np.argmax(np.abs(np.diff(v)))) + 1
    if k < 5 or v.size - k < STEP_SAMPLES:
        return None
    before, after = v[: k - 1], v[k + 1 :]
    step = float(np.median(after) - np.median(before))
    loose = max(FLAT * abs(step), 6.0 * volts.sigma)
    if abs(step) < 20.0 * volts.sigma or max(np.ptp(before), np.ptp(after)) > 2.0 * loose:
        return None
    return _fitted(current, k)


def _fitted(current: Channel, k: int) -> Rise:
    """Fit both models to the rise that begins about sample k."""
    from scipy.optimize import least_squares  # takes longer to import than a check of most folders

    t, y = current.time - current.time[k], current.value
    interval, length = float(np.median(np.diff(t))), float(t[-1])
    noise = current.error

    def miss(p: np.ndarray) -> np.ndarray:
        shape = _shape(np.maximum(t - interval * p[0], 0.0), *np.exp(p[1:]))
        rows = np.column_stack([np.ones(t.size), shape])
        return (y - rows @ np.linalg.lstsq(rows, y, rcond=None)[0]) / noise

    def best(starts: Sequence[Sequence[float]]) -> OptimizeResult:
        lags = len(starts[0])
        low, high = (np.log(0.01 * interval), np.log(30.0 * length))
        bounds = [-2.0, *([low] * lags)], [0.3 * length / interval, *([high] * lags)]
        tried = [least_squares(miss, [-0.5, *np.clip(np.log(start), low + 0.1, high - 0.1)], bounds=bounds)
                 for start in starts]  # fmt: skip
        return min(tried, key=lambda each: each.cost)

    one = best([(length * part,) for part in SLOW])
    lag = float(np.exp(one.x[1]))
    two = best([(lag, lag * part) for part in FAST])
    slow, fast = sorted(np.exp(two.x[1:]), reverse=True)
    scale = max(2.0 * two.cost / t.size, 1.0)
    spread = np.sqrt(scale * np.diag(np.linalg.pinv(two.jac.T @ two.jac)))
    gain = 2.0 * (one.cost - two.cost) / scale
    return Rise(slow, fast, float(np.max(spread[1:])), gain, float(np.sqrt(2.0 * two.cost / t.size)))


def _shape(s: np.ndarray, slow: float, fast: float = 0.0) -> np.ndarray:
    """Rise from 0 to 1 behind one lag or two, s seconds after the step."""
    if fast <= 0.0:
        return 1.0 - np.exp(-s / slow)
    if abs(slow - fast) < 1e-4 * slow:
        return 1.0 - (1.0 + s / slow) * np.exp(-s / slow)
    return 1.0 - (slow * np.exp(-s / slow) - fast * np.exp(-s / fast)) / (slow - fast)


class Look(NamedTuple):
    """The input of one trace."""

    ahead: float  # t of the next sample as a predictor of the motion before it
    new: float  # rms of what its own past does not predict, of its standard deviation
    rate: float  # of the log, Hz


def slow_log(records: Records) -> Iterator[Finding]:
    """Logs in which the next input predicts the motion before it."""
    for traces, slow in records.where(_look):
        channels = next(t for t in traces if t.file in slow).channels
        worst = max(slow.values(), key=lambda look: look.ahead)
        name = "voltage" if "voltage" in channels else "duty"
        yield found_in(slow, traces, Finding(
            "slow_log", worst.rate, "Hz", by_chance(worst.ahead),
            f"the log is slower than what acts in it: at {worst.rate:.4g} Hz '{channels[name].header}' changes "
            f"between two samples, for its next sample tells the motion before it ({worst.ahead:.0f} standard errors), "
            f"and {100.0 * worst.new:.0f} % of its rms is new from one sample to the next. A fit or a diagnosis can "
            "only guess what acted in between.",
            "Log at the rate at which the controller acts, or faster; or log the setpoint and take [ecu] in "
            "rig.toml, so that the model works out what acted between samples.", channel=name,
        ))  # fmt: skip


def _look(trace: Measurement, config: RigConfig) -> Look | None:
    """What predicts the motion, where it is the next input; None where the log follows its input."""
    drive = drive_voltage(trace, config)
    position = trace.channels.get("position") or trace.channels.get("motor_speed")
    if drive is None or position is None or drive.value.size < FEWEST:
        return None
    u, y = drive.value, on_times(position, drive.time)
    span, sd = float(np.ptp(u)), float(np.std(u))
    if span == 0.0 or np.ptp(y) == 0.0 or np.unique(np.round(50.0 * u / span)).size < LEVELS:
        return None
    k = np.arange(LAGS, u.size - 1)
    k = k[~_about_lone_edges(drive)[k + 1]]
    if k.size < FEWEST:
        return None
    own = np.column_stack([np.ones(k.size), *(u[k - j] for j in range(LAGS))])
    new = float(np.sqrt(np.mean(_remains(own, u[k + 1]) ** 2))) / sd
    if new < NEW:
        return None
    past = np.column_stack([own, *(y[k - j] for j in range(LAGS))])
    rate = 1.0 / float(np.median(np.diff(drive.time)))
    # t of d: both less what the past explains of them (Frisch and Waugh 1933)
    ahead, move = _remains(past, u[k + 1]), _remains(past, y[k + 1] - y[k])
    power = float(ahead @ ahead)
    slope = float(ahead @ move) / max(power, 1e-300)
    error = float(np.sqrt(np.mean((move - slope * ahead) ** 2) / max(power, 1e-300)))
    look = Look(slope / max(error, 1e-300), new, rate)
    return look if look.ahead > AHEAD else None


def _about_lone_edges(drive: Channel) -> np.ndarray:
    """True at samples whose regression sees a lone edge, shape (n,)."""
    steps = np.abs(np.diff(drive.value))
    padded = np.concatenate((np.zeros(2), steps, np.zeros(2)))
    others = np.max([padded[j : j + steps.size] for j in (0, 1, 3, 4)], axis=0)
    lone = jumps(drive, EDGE, EDGE_SHARE) & (others < ALONE * steps)
    out = np.zeros(drive.value.size, dtype=bool)
    for j in range(-1, 3):
        at = np.flatnonzero(lone) + j
        out[at[(at >= 0) & (at < out.size)]] = True
    return out


def _remains(rows: np.ndarray, right: np.ndarray) -> np.ndarray:
    """What a least-squares fit leaves, shape (n,)."""
    size = np.maximum(np.max(np.abs(rows), axis=0), 1e-12)
    return right - rows / size @ np.linalg.lstsq(rows / size, right, rcond=None)[0]
