"""A log slower than what acts in it: the input changes between two samples, and nobody can say when.

    y_(k+1) - y_k = a + sum_j b_j y_(k-j) + sum_j c_j u_(k-j) + d u_(k+1),   j = 0 ... 3

An input that is held from sample to sample, or that a log follows, tells the next position by what was logged up to
now. Where a controller acted several times between two samples, the next input u_(k+1) tells of it besides, d > 0. A
controller that reads the position also makes d other than zero, but below it: it pulls back. Samples about a lone edge
are left out: its instant is sought by the fit.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import erfc
from typing import ClassVar, NamedTuple

import numpy as np

from ...ranges import real, whole
from ..base import Measurement, RigConfig
from ..finding import Finding
from ..signals import drive_voltage, on_times
from .base import AbstractDetector, Records, everywhere, in_files

LAGS = 4
ALONE = 0.1  # of an edge's size: changes about a lone edge are smaller
EDGE, EDGE_SHARE = 9.0, 0.02  # noises, and of the span: an edge


class Look(NamedTuple):
    """One trace: t of the next input; rms of what the input's own past does not tell, of its standard deviation; Hz."""

    ahead: float
    new: float
    rate: float


@dataclass(frozen=True)
class SlowLog(AbstractDetector):
    """See the module.

    Args:
        errors: standard errors of d.
        new: rms of what the input's own past does not tell, of its standard deviation, at least.
        levels: fiftieths of its span that an input takes, at least: a binary signal is made for one clock.
        fewest: samples.
    """

    errors: float = real(5.5, 0.0)
    new: float = real(0.08, 0.0)
    levels: int = whole(8, 2)
    fewest: int = whole(100, 20)
    kind: ClassVar[str] = "slow_log"

    def find(self, records: Records) -> Iterator[Finding]:
        for test, traces in records.tests.items():
            read = {t.file: look for t in traces if (look := self._look(t, records.config)) is not None}
            slow = {file: look for file, look in read.items() if look.ahead > self.errors}
            if slow:
                yield self._finding(test, slow, traces, records)

    def _look(self, trace: Measurement, config: RigConfig) -> Look | None:
        """None where the input is one that a log follows."""
        drive = drive_voltage(trace, config)
        position = trace.channels.get("position") or trace.channels.get("motor_speed")
        if drive is None or position is None or drive.value.size < self.fewest:
            return None
        u, y = drive.value, on_times(position, drive.time)
        span, sd = float(np.ptp(u)), float(np.std(u))
        if span == 0.0 or np.ptp(y) == 0.0 or np.unique(np.round(50.0 * u / span)).size < self.levels:
            return None
        k = np.arange(LAGS, u.size - 1)
        k = k[~_about_lone_edges(u, drive.sigma)[k + 1]]
        if k.size < self.fewest:
            return None
        own = np.column_stack([np.ones(k.size), *(u[k - j] for j in range(LAGS))])
        new = float(np.sqrt(np.mean(_remains(own, u[k + 1]) ** 2))) / sd
        if new < self.new:
            return None
        past = np.column_stack([own, *(y[k - j] for j in range(LAGS))])
        rate = 1.0 / float(np.median(np.diff(drive.time)))
        return Look(_t_of_next(_remains(past, u[k + 1]), _remains(past, y[k + 1] - y[k])), new, rate)

    def _finding(self, test: str, slow: dict[str, Look], traces: tuple[Measurement, ...], records: Records) -> Finding:
        trace = next(t for t in traces if t.file in slow)
        drive = drive_voltage(trace, records.config)
        assert drive is not None, "a trace without a drive is not looked at"
        worst, where = max(slow.values(), key=lambda look: look.ahead), in_files(test, list(slow), traces)
        channel = "voltage" if "voltage" in trace.channels else "duty"
        return Finding(
            self.kind, worst.rate, "Hz", float(erfc(worst.ahead / 2**0.5)),
            f"{where[0].upper()}{where[1:]} the log is slower than what acts in it: at {worst.rate:.4g} Hz "
            f"'{drive.header}' changes between two samples, for its next sample tells the motion before it "
            f"({worst.ahead:.0f} standard errors), and {100.0 * worst.new:.0f} % of its rms is new from one sample to "
            "the next. A fit or a diagnosis can only guess what acted in between.",
            "Log at the rate at which the controller acts, or faster; or log the setpoint and take [ecu] in rig.toml, "
            "so that the model works out what acted between samples.", test, everywhere(list(slow), traces), channel,
        )  # fmt: skip


def _t_of_next(ahead: np.ndarray, move: np.ndarray) -> float:
    """t of d: both less what the past tells of them (Frisch and Waugh 1933)."""
    power = float(ahead @ ahead)
    slope = float(ahead @ move) / max(power, 1e-300)
    return slope / max(float(np.sqrt(np.mean((move - slope * ahead) ** 2) / max(power, 1e-300))), 1e-300)


def _about_lone_edges(u: np.ndarray, sigma: float) -> np.ndarray:
    """True at samples whose regression sees a lone edge, shape (n,)."""
    steps = np.abs(np.diff(u))
    padded = np.concatenate((np.zeros(2), steps, np.zeros(2)))
    others = np.max([padded[j : j + steps.size] for j in (0, 1, 3, 4)], axis=0)
    lone = (steps > max(EDGE * sigma, EDGE_SHARE * float(np.ptp(u)))) & (others < ALONE * steps)
    out = np.zeros(u.size, dtype=bool)
    for j in range(-1, 3):
        at = np.flatnonzero(lone) + j
        out[at[(at >= 0) & (at < u.size)]] = True
    return out


def _remains(rows: np.ndarray, right: np.ndarray) -> np.ndarray:
    """What a least-squares fit leaves, shape (n,)."""
    size = np.maximum(np.max(np.abs(rows), axis=0), 1e-12)
    return right - rows / size @ np.linalg.lstsq(rows / size, right, rcond=None)[0]
