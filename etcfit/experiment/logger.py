"""How a planned test is to be logged: columns, ranges, resolution."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..rig.base import CHANNELS, Channel
from .campaign import Campaign, PlannedTest
from .plan import channels

_ROOM = 1.25  # of a range over what is expected
_FINE = 3.0  # steps of a logger may be so many standard deviations of the noise wide: 12 of a uniform error's variance


@dataclass(frozen=True)
class LoggedColumn:
    """One column of the record, in the unit of its header.

    Args:
        header: as it stands in the CSV.
        low, high: range that the logger needs.
        resolution: coarsest step that loses nothing; 0 where it does not matter.
    """

    header: str
    low: float
    high: float
    resolution: float


def logger(test: PlannedTest, campaign: Campaign) -> tuple[LoggedColumn, ...]:
    """Columns of a planned test's record, time first, in the headers that this rig has used so far."""
    plan, s = test.candidate.plan, campaign.setting
    out = [LoggedColumn("time [s]", 0.0, test.candidate.seconds, 0.01 * float(plan.time[1] - plan.time[0]))]
    drive = () if plan.volts is None else ("voltage",)
    for name in (*drive, *channels(plan, s)):
        value = plan.volts if name == "voltage" and plan.volts is not None else test.forecast.shown[name]
        out.append(_column(name, value, s.noise[name], _used(campaign, plan.test, name)))
    return tuple(out)


def _used(campaign: Campaign, test: str, name: str) -> Channel | None:
    """How the rig logged it in this test, or else in another; None where it never did."""
    every = [m for m in campaign.rig.measurements if name in m.channels]
    return next((m.channels[name] for m in sorted(every, key=lambda m: m.test != test)), None)


def _column(name: str, value: np.ndarray, noise: float, used: Channel | None) -> LoggedColumn:
    header = f"{name} [{CHANNELS[name]}]" if used is None else used.header
    ends = np.array([value.min(), value.max()])
    spread = 0.5 * np.ptp(ends) * (_ROOM - 1.0) + 5.0 * noise
    ends = ends + np.array([-spread, spread])
    scale = 1.0
    if used is not None:
        ends, scale = np.sort(used.logged(ends)), abs(used.scale)
    return LoggedColumn(header, float(ends[0]), float(ends[1]), float(_FINE * noise / scale))
