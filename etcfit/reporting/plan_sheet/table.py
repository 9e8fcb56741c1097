"""What `etcfit plan` prints."""

from __future__ import annotations

import numpy as np
from rich.console import Group, RenderableType

from ...experiment.campaign import Campaign, PlannedTest, remark
from ..blocks import headed, plain_table, rig_title, sentences
from ..numbers import short


def plan_table(campaign: Campaign) -> RenderableType:
    """A campaign for stdout."""
    why = list(dict.fromkeys(why for _, why in campaign.left_out))
    parts = [
        rig_title(campaign.rig.config, f"the next {len(campaign.tests)} tests, {campaign.seconds:.0f} s of log"),
        _tests(campaign),
        _stderr(campaign),
        sentences("Cautions", campaign.cautions),
        sentences(f"Left out: {len(campaign.left_out)} candidates would pass a limit, as", why[:3]),
    ]
    return Group(*(part for part in parts if part is not None))


def _tests(campaign: Campaign) -> RenderableType:
    table = plain_table("record as", "what", "A", "winding, degC", "pause, s", left=2)
    table.columns[1].no_wrap = False
    for test in campaign.tests:
        note = remark(test, campaign.setting)
        says = test.candidate.plan.says + (f" ({note})" if note else "")
        table.add_row(test.file, says, f"{amps(test):.1f}", f"{hottest(test, campaign):.0f}", f"{test.pause:.0f}")
    return headed("In this order", table)


def _stderr(campaign: Campaign) -> RenderableType:
    table = plain_table("", *(symbol.replace("series_ohm.", "R_s ") for symbol in campaign.symbols))
    rows = (("standard error now, %", campaign.now), ("expected after it, %", campaign.expected))
    for name, sd in rows:
        table.add_row(name, *(short(100.0 * each, 2) for each in sd))
    table.add_row("share", *(f"{share:.2f}" for share in campaign.expected / campaign.now))
    return headed("What it will tell", table)


def amps(test: PlannedTest) -> float:
    """Largest current expected, A."""
    current = test.forecast.shown.get("current")
    return 0.0 if current is None else float(np.abs(current).max())


def hottest(test: PlannedTest, campaign: Campaign) -> float:
    """Highest temperature of the winding expected, degC."""
    return campaign.settings.ambient + float(test.forecast.warmth.max())
