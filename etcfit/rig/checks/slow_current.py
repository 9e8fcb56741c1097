"""A current channel behind a low-pass: the rise of a held winding's current after a step has two time constants.

    one lag    y = y_0 + A (1 - exp(-s/T)),                                                       s = t - t_0 >= 0
    two lags   y = y_0 + A (1 - (T_a exp(-s/T_a) - T_b exp(-s/T_b)) / (T_a - T_b))

t_0 is free in both, so a channel that is merely late is none. The rise is the same with T_a and T_b exchanged: which of
them is L/R and which is the channel's, no current tells. A low-pass that is much faster than L/R, or than the log,
leaves one lag; then R T is an upper bound of L, and no record says so, but one much slower than a winding's.

Source: Doebelin 2003, ch. 3 (two instruments of first order in a row). Differs from source: no.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import erfc
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np

from ...ranges import real, whole
from .. import TEST_BY_NAME
from ..base import Channel, Measurement, RigConfig
from ..finding import Finding
from ..signals import drive_voltage
from .base import AbstractDetector, Records, everywhere, in_files
from .circuit import Circuit, Value

if TYPE_CHECKING:
    from scipy.optimize import OptimizeResult

WINDING = ("inductance", "response")  # tests that tell L, best first
CURE = ("Look up the bandwidth of the current's channel, 1/(2 pi T): log again with one ten times faster than the "
        "winding, or put y + T dy/dt in the place of the column y.")  # fmt: skip
SLOW = (0.03, 0.2)  # parts of the record at which the search for one lag begins
FAST = (0.3, 0.05)  # parts of that lag at which the search for a second one begins


class Rise(NamedTuple):
    """Time constants of one rise, s, the slow one first; the relative error of the fast one; by how much two lags lower
    chi2, and the noises that they leave, rms."""

    slow: float
    fast: float
    error: float
    gain: float
    left: float


@dataclass(frozen=True)
class SlowCurrent(AbstractDetector):
    """See the module.

    Args:
        gain: by how much two lags must lower chi2, over all steps of a test.
        error: of the fast time constant, relative, at most.
        left: noises, rms, that two lags may leave.
        alike: largest over smallest of a test's time constants, at most.
        winding: s; no winding of a small motor has an L/R as long.
        errors: standard errors by which L/R must be longer.
        fewest: samples before and after the step.
        flat: of the step, by which the voltage may move after it.
    """

    gain: float = real(30.0, 0.0)
    error: float = real(0.2, 0.0)
    left: float = real(2.0, 0.0)
    alike: float = real(3.0, 1.0)
    winding: float = real(8e-3, 0.0)
    errors: float = real(8.0, 0.0)
    fewest: int = whole(30, 10)
    flat: float = real(0.03, 0.0)
    kind: ClassVar[str] = "slow_current"
    explains: ClassVar[bool] = True

    def find(self, records: Records) -> Iterator[Finding]:
        found = [each for test, traces in records.tests.items() for each in self._of_steps(test, traces, records)]
        yield from found or self._of_circuit(records)

    def _of_steps(self, test: str, traces: tuple[Measurement, ...], records: Records) -> Iterator[Finding]:
        """By the two time constants of a held winding."""
        if not TEST_BY_NAME[test].boundary.plate_held or test in records.blamed:
            return
        read = {t.file: rise for t in traces if (rise := self._rise(t, records.config)) is not None}
        if read and self._is_slow([*read.values()]):
            yield self._finding(test, read, traces, records)

    def _is_slow(self, rises: list[Rise]) -> bool:
        fast = [rise.fast for rise in rises]
        error = sum(rise.error**-2 for rise in rises) ** -0.5
        sound = all(rise.left < self.left and rise.gain > 0.0 for rise in rises) and max(fast) < self.alike * min(fast)
        return sound and error < self.error and sum(rise.gain for rise in rises) > self.gain

    def _of_circuit(self, records: Records) -> Iterator[Finding]:
        """By an L/R that no winding has; in every test, where no other test has a shorter one."""
        lags = {name: lag for name, circuit in records.circuits.items() if (lag := _lag(circuit)) is not None}
        test = next((name for name in WINDING if name in lags), None)
        if test is None:
            return
        circuit, (lag, error) = records.circuits[test], lags[test]
        assert circuit.L is not None, "it has a lag"
        if lag - self.errors * error > self.winding:
            alike = all(value > self.winding / 2.0 for value, _ in lags.values())
            yield Finding(
                self.kind, lag, "s", float(erfc((lag - self.winding) / error / 2**0.5)),
                f"In {test} the current follows the voltage with a lag of {1e3 * lag:.3g} +- {1e3 * error:.2g} ms; L/R "
                "of a small motor's winding is a few. One lag says only the sum of the winding's and of a low-pass in "
                f"the current's channel: {circuit.L.value:.3g} H is an upper bound of L_a.",
                CURE, None if alike else test, channel="current",
            )  # fmt: skip

    def _rise(self, trace: Measurement, config: RigConfig) -> Rise | None:
        """Of the one step of a trace; None where it has none, or more."""
        volts, current = drive_voltage(trace, config), trace.channels.get("current")
        if volts is None or current is None or not np.array_equal(volts.time, current.time):
            return None
        v = volts.value
        k = int(np.argmax(np.abs(np.diff(v)))) + 1
        if k < 5 or v.size - k < self.fewest:
            return None
        before, after = v[: k - 1], v[k + 1 :]
        step = float(np.median(after) - np.median(before))
        loose = max(self.flat * abs(step), 6.0 * volts.sigma)
        if abs(step) < 20.0 * volts.sigma or max(np.ptp(before), np.ptp(after)) > 2.0 * loose:
            return None
        return _fitted(current, k)

    def _finding(self, test: str, slow: dict[str, Rise], traces: tuple[Measurement, ...], records: Records) -> Finding:
        a, b = (float(np.median([rise[n] for rise in slow.values()])) for n in (0, 1))
        gain = sum(rise.gain for rise in slow.values())
        channel = next(t for t in traces if t.file in slow).channels["current"]
        circuit = records.circuits.get(test) or next(iter(records.circuits.values()), None)
        R = circuit.R.value if circuit is not None and circuit.R is not None else None
        henries = f": {R * a:.3g} or {R * b:.3g} H, not {R * (a + b):.3g}" if R is not None and R > 0.0 else ""
        where = in_files(test, list(slow), traces)
        return Finding(
            self.kind, a, "s", float(erfc((gain / 2.0) ** 0.5)),
            f"{where[0].upper()}{where[1:]} '{channel.header}' rises after the step as behind two lags, of "
            f"{1e3 * a:.3g} and {1e3 * b:.3g} ms (two lower chi2 by {gain:.0f} against one that may begin late): one "
            "is L/R of the winding, the other a low-pass in the current's channel. Which is which this current cannot "
            f"tell, and a fit takes both for the winding's{henries}.",
            CURE, test, everywhere(list(slow), traces), "current",
        )  # fmt: skip


def _lag(circuit: Circuit) -> Value | None:
    """L/R, s; None where either does not show."""
    if circuit.L is None or circuit.R is None or circuit.R.value <= 0.0:
        return None
    return Value(circuit.L.value / circuit.R.value, circuit.L.error / circuit.R.value)


def _fitted(current: Channel, k: int) -> Rise | None:
    """Both models on the rise that begins about sample k."""
    from scipy.optimize import least_squares  # takes longer to import than a check of most folders

    t, y = current.time - current.time[k], current.value
    interval, length = float(np.median(np.diff(t))), float(t[-1])
    noise = max(current.sigma, current.quantum / np.sqrt(12.0))

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
