"""Syvecs."""

from __future__ import annotations

from .profile import NOT_DIVIDED, EcuProfile

SYVECS = EcuProfile(
    name="syvecs",
    title="Syvecs",
    source="no public page of Syvecs that describes its throttle controller was found (November 2026); everything "
    "here is assumed",
    notation=None,
    gains=("proportional", "integral", "derivative"),
    fixes={},
    assumes={"duty": 1.0, "compensated": 0.0},
    assumed=(
        "clock and derivative filter as the options and [ecu] of rig.toml say: nothing that was found names neither",
        "the PID of the textbook: a derivative of the error, an integral that stands still at the duty's limit",
        "a duty of up to 100 %",
        NOT_DIVIDED,
        "no feed-forward: none is known of",
        "gains called by what they are",
    ),
)
"""Closed; its help comes with its program and was not read."""
