"""Which effects of the rig its checks state, read off the records before any fit, and how large."""

from __future__ import annotations

from collections.abc import Iterable

from ..model.effects import AbstractEffect
from ..model.rig_effects import AbstractRigEffect
from ..rig.base import Finding


def stated_effects(
    findings: Iterable[Finding], candidates: Iterable[type[AbstractEffect]]
) -> dict[type[AbstractEffect], float]:
    """Effects of the rig that the findings state, and the value of the first parameter of each, SI."""
    families = [e for e in candidates if issubclass(e, AbstractRigEffect) and e.stated]
    return {
        effect: effect.stated[finding.kind](finding.size)
        for finding in findings
        for effect in families
        if finding.kind in effect.stated and _is_at_its_place(finding, effect)
    }


def _is_at_its_place(finding: Finding, effect: type[AbstractRigEffect]) -> bool:
    place = effect.place
    return place.test == (finding.test or "") and place.channel in ("", finding.channel) and not place.file
