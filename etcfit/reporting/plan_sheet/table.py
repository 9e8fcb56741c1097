"""What `etcfit plan` prints."""

from __future__ import annotations

import numpy as np
from rich.console import Group, RenderableType

from ...experiment.campaign import Campaign, PlannedTest
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
        sentences(f"Left out: {len(campaign.left_out)} candidates would exceed a limit, for example", why[:3]),
    ]
    return Group(*(part for part in parts if part is not None))


def _tests(campaign: Campaign) -> RenderableType:
    table = plain_table("record as", "what", "current, A", "winding, degC", "pause, s", left=2, prose=("what",),
                        paths=("record as",))  # fmt: skip
    for test in campaign.tests:
        note = campaign.remark(test)
        says = test.candidate.plan.says + (f" ({note})" if note else "")
        table.add_row(test.file, says, f"{amps(test):.1f}", f"{hottest(test, campaign):.0f}", f"{test.pause:.0f}")
    return headed("In this order", table)


def _stderr(campaign: Campaign) -> RenderableType:
    table = plain_table("parameter", "standard error now, %", "expected after all tests, %", "expected/now")
    for symbol, now, expected in zip(campaign.symbols, campaign.now, campaign.expected, strict=True):
        table.add_row(symbol, short(100.0 * now, 2), short(100.0 * expected, 2), f"{expected / now:.2f}")
    return headed("What these tests will tell", table)


def amps(test: PlannedTest) -> float:
    """Largest current expected, A."""
    current = test.forecast.shown.get("current")
    return 0.0 if current is None else float(np.abs(current).max())


def hottest(test: PlannedTest, campaign: Campaign) -> float:
    """Highest temperature of the winding expected, degC."""
    return campaign.settings.ambient + float(test.forecast.warmth.max())
