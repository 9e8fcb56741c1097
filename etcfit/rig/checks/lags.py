"""Finds instruments that are too slow: a current channel with a low-pass, and a log that is slower than its input.

The rise of a held winding's current after a step has two time constants behind a low-pass.

    one lag    y = y_0 + A (1 - exp(-s/T)),                                                       s = t - t_0 >= 0
    two lags   y = y_0 + A (1 - (T_a exp(-s/T_a) - T_b exp(-s/T_b)) / (T_a - T_b))

t_0 is free in both, so a pure delay of a channel is no second lag. The rise is the same with T_a and T_b exchanged, so
the current does not show which of them is L/R and which is that of the channel. With a low-pass that is much faster
than L/R, or than the log, only one lag is visible; R T is then an upper bound of L, and the record shows a low-pass
only where T is much longer than that of any winding.

Source: Doebelin 2003, ch. 3 (two instruments of first order in a row). Differs from source: no.

A log is too slow where the input changes between two samples at unknown instants.

    y_(k+1) - y_k = a + sum_j b_j y_(k-j) + sum_j c_j u_(k-j) + d u_(k+1),   j = 0 ... 3

With an input that is held from sample to sample, or that the log resolves, the logged past predicts the next position.
Where a controller acted several times between two samples, the next input u_(k+1) improves the prediction, d > 0. A
controller that reads the position makes d non-zero too, but negative, because it counteracts the motion. Samples around
a lone edge are left out, because the fit estimates its instant.

A setpoint that steps between two samples moves the plate before the sample at which the logged input jumps. Motions
that the past does not predict are counted before each jump that follows a quiet input. Where the log resolves its
input, they go against the jump at least as often as with it. If they go with it too often, the log is too slow (sign
test).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import comb
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .. import TEST_BY_NAME
from ..base import Channel, Finding, Measurement, RigConfig
from ..signals import MAD_TO_SIGMA, drive_voltage, jumps, on_times
from .base import Records, by_chance, found_in
from .circuit import Value

if TYPE_CHECKING:
    from scipy.optimize import OptimizeResult

WINDING = ("inductance", "response")  # tests that show L, best first
CURE = ("Look up the bandwidth of the current's channel, 1/(2 pi T): log again with a channel ten times faster than "
        "the winding, or replace the column y by y + T dy/dt.")  # fmt: skip
SLOW = (0.03, 0.2)  # shares of the record at which the search for one lag starts
FAST = (0.3, 0.05)  # shares of that lag at which the search for a second one starts
GAIN = 30.0  # least fall of chi2 by two lags, over all steps of a test
LAG_ERROR = 0.2  # largest relative error of either time constant
LEFT = 2.0  # largest rms residual with two lags, standard deviations of the noise
ALIKE = 3.0  # largest ratio of the time constants of a test
LONGEST = 8e-3  # s: longest L/R of the winding of a small motor
LONGEST_ERRORS = 8.0  # standard errors by which L/R must be longer
STEP_SAMPLES = 30  # least number of samples after the step
FLAT = 0.03  # largest change of the voltage after the step, share of the step

LAGS = 4
AHEAD = 5.5  # least d in standard errors
NEW = 0.08  # least rms of the part of the input that its past does not predict, over its standard deviation
LEVELS = 8  # least number of fiftieths of its span that an input takes: a binary signal usually has the logger's clock
FEWEST = 100  # least number of samples
ALONE = 0.1  # share of an edge: changes around a lone edge are smaller
EDGE, EDGE_SHARE = 9.0, 0.02  # standard deviations of the noise, and share of the span: a larger change is an edge
JUMP, QUIET = 0.05, 0.25  # least jump over the span, and largest change in the three samples before it, over the jump
MOVED = 2.0  # standard deviations by which the plate has moved before a jump
CHANCE = 0.04  # probability of such counts by chance, below which a log is too slow


class Rise(NamedTuple):
    """Both time constants of one rise."""

    slow: float  # s
    fast: float  # s
    error: float  # the larger of their relative errors
    gain: float  # fall of chi2 by two lags
    left: float  # rms residual with two lags, standard deviations of the noise


def slow_current(records: Records) -> Iterator[Finding]:
    """A low-pass in the current's channel: two time constants with the plate held, or an impossibly long L/R."""
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
        f"'{channel.header}' rises after the step with two lags of "
        f"{1e3 * a:.3g} and {1e3 * b:.3g} ms (chi2 falls by {gain:.0f} compared with one delayed lag): one "
        "is L/R of the winding, the other a low-pass in the current's channel. This current does not show which is "
        f"which, and a fit takes both as the winding's{henries}.", CURE, channel="current",
    ))  # fmt: skip


def _of_circuit(records: Records) -> Iterator[Finding]:
    """An impossibly long L/R; a finding for every test if no test has a shorter one."""
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
            "of a small motor's winding is a few. This lag is the sum of that of the winding and that of a low-pass in "
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
    from scipy.optimize import least_squares  # its import takes longer than the check of most folders

    t, y = current.time - current.time[k], current.value - np.mean(current.value)
    interval, length = float(np.median(np.diff(t))), float(t[-1])
    noise = current.error

    def miss(p: np.ndarray) -> np.ndarray:
        shape = _shape(np.maximum(t - interval * p[0], 0.0), *np.exp(p[1:]))
        shape -= np.mean(shape)
        # y_0 and A by linear regression
        return (y - shape * (shape @ y / max(shape @ shape, 1e-300))) / noise

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
    new: float  # rms of the part that its past does not predict, over its standard deviation
    rate: float  # sample rate of the log, Hz
    along: int  # motions before a jump, in its direction
    against: int  # and in the other one


def slow_log(records: Records) -> Iterator[Finding]:
    """Logs in which the next input predicts the motion before it, or the plate moves before jumps of the input."""
    for traces, looks in records.where(_look):
        predicted = {file: look for file, look in looks.items() if look.ahead > AHEAD}
        moved = {file: look for file, look in looks.items() if look.along > look.against}
        along, against = (sum(each) for each in zip(*((m.along, m.against) for m in looks.values()), strict=True))
        chance = sum(comb(along + against, j) for j in range(against + 1)) / 2.0 ** (along + against)
        slow = predicted or (moved if chance < CHANCE else {})
        if not slow:
            continue
        channels = next(t for t in traces if t.file in slow).channels
        worst = max(slow.values(), key=lambda look: look.ahead if predicted else look.along - look.against)
        name = "voltage" if "voltage" in channels else "duty"
        why = (
            f"its next sample predicts the motion before it ({worst.ahead:.0f} standard errors)"
            if predicted
            else f"the plate has moved before {along + against} of its jumps, {along} times in their direction"
        )
        yield found_in(slow, traces, Finding(
            "slow_log", worst.rate, "Hz", by_chance(worst.ahead) if predicted else chance,
            f"the log is too slow: at {worst.rate:.4g} Hz '{channels[name].header}' changes between two samples, "
            f"because {why}, and {100.0 * worst.new:.0f} % of its rms is new from one sample to the next. A fit or a "
            "diagnosis can only guess the input between samples.",
            "Log at the rate of the controller, or faster; or log the setpoint and write [ecu] in rig.toml, so that "
            "the model computes the input between samples.", channel=name,
        ))  # fmt: skip


def _look(trace: Measurement, config: RigConfig) -> Look | None:
    """The input of a trace; None where its past predicts it, or where it has few levels."""
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
    # t of d: both sides less the part that the past explains (Frisch and Waugh 1933)
    ahead, move = _remains(past, u[k + 1]), _remains(past, y[k + 1] - y[k])
    power = float(ahead @ ahead)
    slope = float(ahead @ move) / max(power, 1e-300)
    error = float(np.sqrt(np.mean((move - slope * ahead) ** 2) / max(power, 1e-300)))
    jump, before = np.abs(u[k + 1] - u[k]), np.max([np.abs(u[k - j] - u[k - j - 1]) for j in range(LAGS - 1)], axis=0)
    jumped = (jump > JUMP * span) & (before < QUIET * jump)
    noise = MAD_TO_SIGMA * float(np.median(np.abs(move - np.median(move))))
    with_it = np.sign(ahead[jumped]) * move[jumped] / max(noise, 1e-300)
    along, against = int(np.sum(with_it > MOVED)), int(np.sum(with_it < -MOVED))
    return Look(slope / max(error, 1e-300), new, 1.0 / float(np.median(np.diff(drive.time))), along, against)


def _about_lone_edges(drive: Channel) -> np.ndarray:
    """True at samples whose regression includes a lone edge, shape (n,)."""
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
    """Residual of a least-squares fit, shape (n,)."""
    size = np.maximum(np.max(np.abs(rows), axis=0), 1e-12)
    return right - rows / size @ np.linalg.lstsq(rows / size, right, rcond=None)[0]
