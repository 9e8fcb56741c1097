"""What a planned test will show: what is played, and each quantity with a band over what is not known of the rig."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...experiment.campaign import Campaign, PlannedTest
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
    unit, values = _as_read(name, test.forecast.shown[name], own)
    _band(panel, test.forecast.time, values)
    panel.set_ylabel(style.unit_label(name, unit))
    if name == "current" and np.abs(values).max() > 0.7 * campaign.settings.current and unit == "A":
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


def _band(panel: Axes, time: np.ndarray, values: np.ndarray) -> None:
    panel.fill_between(time, values.min(axis=0), values.max(axis=0), color=_BAND, lw=0, label="over the models")
    panel.plot(*style.thin(time, values[0]), color=style.SIMULATED, lw=1.3, label="expected")


def _winding(panel: Axes, test: PlannedTest, campaign: Campaign) -> None:
    _band(panel, test.forecast.time, campaign.settings.ambient + test.forecast.warmth)
    panel.set_ylabel("winding [°C]")
