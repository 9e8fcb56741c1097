"""How a fleet ends."""

from __future__ import annotations

from pathlib import Path

from ...errors import command
from ..fleet.page import NAME
from ..fleet.words import Content, verdict
from .base import Closing


def of_fleet(content: Content, run: Path) -> Closing:
    """What somebody must do something about, else that nothing is bad; gains for all units come next."""
    said = verdict(content)
    bad = [sentence.text for sentence in said if sentence.bad]
    answer = " ".join(bad) if bad else " ".join(sentence.text for sentence in said)
    odd = content.get("odd") or ()
    page = content["members"][odd[0]["unit"]].get("page") if odd else None  # of the oddest
    return Closing(answer, command("design", run, "--fleet"), (run / NAME, *([run / page] if page else [])))
