"""What a planned test will show: what is played, and each quantity with a band over what is not known of the rig."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...experiment.campaign import Campaign, PlannedTest, band
from ...experiment.plan import channels
from ...rig import TEST_BY_NAME
from ...rig.base import Channel
from .. import style
from ..stack import headed, stack

_BAND = "#f2c49b"
_LIMIT = "#a83a00"
# how a person reads them, where the rig has not logged them in a unit of its own
_UNITS = {"current": ("A", 1.0), "position": ("deg", float(np.pi / 180.0)), "emf": ("V", 1.0),
          "motor_speed": ("rpm", float(np.pi / 30.0))}  # fmt: skip


def shown(test: PlannedTest, campaign: Campaign) -> tuple[str, ...]:
    """Channels worth a panel: what is logged, and current and angle whether logged or not."""
    boundary = TEST_BY_NAME[test.candidate.plan.test].boundary
    still = {"position"} if boundary.plate_held or boundary.gear_apart else set()
    idle = {"current"} if boundary.terminals_open else set()
    wanted = {*channels(test.candidate.plan, campaign.setting), "current", "position"} - still - idle
    return tuple(name for name in test.forecast.shown if name in wanted)


def draw(test: PlannedTest, campaign: Campaign, number: int) -> Figure:
    """Panels one above the other on one time axis."""
    names, plan = shown(test, campaign), test.candidate.plan
    heights = [1.1] * (plan.volts is not None) + [1.8] * len(names) + [1.0] * ("current" in names)
    fig, panels = stack(heights, campaign.rig.config.synthetic)
    rest = list(panels)
    if test.candidate.played is not None:
        panel = rest.pop(0)
        played = test.candidate.played
        panel.step(played.time, played.volts, where="post", color=style.DRIVE, lw=1.2, label="played")
        panel.set_ylabel("voltage [V]")
    for name in names:
        _channel(rest.pop(0), test, campaign, name)
    if "current" in names:
        _winding(rest.pop(0), test, campaign)
    panels[-1].set_xlim(0.0, float(plan.time[-1]))
    return headed(fig, panels, f"Test {number}: {test.file}", "")


def _channel(panel: Axes, test: PlannedTest, campaign: Campaign, name: str) -> None:
    own = next((m.channels[name] for m in campaign.rig.measurements if name in m.channels), None)
    unit, value = _as_read(name, test.forecast.shown[name][0], own)
    ends = np.stack([_as_read(name, end, own)[1] for end in band(test, campaign.setting, name)])
    _banded(panel, test.forecast.time, value, ends)
    panel.set_ylabel(style.unit_label(name, unit))
    if name == "current" and np.abs(ends).max() > 0.7 * campaign.settings.current:
        panel.axhline(campaign.settings.current, color=_LIMIT, lw=1.0, ls="--", label="limit")
    if name == "position" and unit == "deg":
        for stop in (campaign.setting.rest, campaign.setting.open):
            panel.axhline(float(np.degrees(stop)), color=_LIMIT, lw=1.0, ls="--", label="rest, open stop")


def _as_read(name: str, values: np.ndarray, own: Channel | None) -> tuple[str, np.ndarray]:
    """Unit and values as a person reads them: in that of the rig's logs, an angle in degrees."""
    if own is not None and name not in ("position", "current"):
        return own.unit, own.logged(values)
    unit, size = _UNITS[name]
    return unit, values / size


def _banded(panel: Axes, time: np.ndarray, value: np.ndarray, ends: np.ndarray) -> None:
    """A line in its band; ends have shape (2, n), in either order."""
    panel.fill_between(time, ends.min(axis=0), ends.max(axis=0), color=_BAND, lw=0, label="must stay within")
    panel.plot(*style.thin(time, value), color=style.SIMULATED, lw=1.1, label="expected")


def _winding(panel: Axes, test: PlannedTest, campaign: Campaign) -> None:
    warm = campaign.settings.ambient + test.forecast.warmth
    _banded(panel, test.forecast.time, warm[0], np.stack([warm.min(axis=0), warm.max(axis=0)]))
    panel.set_ylabel("winding [°C]")
