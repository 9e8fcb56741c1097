"""Haltech Elite and Nexus."""

from __future__ import annotations

from .profile import NOT_DIVIDED, EcuProfile

HALTECH = EcuProfile(
    name="haltech",
    title="Haltech Elite/Nexus",
    source="Haltech support, Drive By Wire, Elite "
    "(https://support.haltech.com/portal/en/kb/articles/drive-by-wire-elite): two sensors each of pedal and throttle, "
    "the direction of the motor found by the calibration, the motor cut on a fault; nothing of the controller",
    notation=None,
    gains=("proportional", "integral", "derivative"),
    fixes={},
    assumes={"duty": 1.0, "compensated": 0.0},
    assumed=(
        "clock and derivative filter as the options and [ecu] of rig.toml say: the article names neither",
        "the PID of the textbook: a derivative of the error, an integral that stands still at the duty's limit",
        "a duty of up to 100 %",
        NOT_DIVIDED,
        "no feed-forward: none is described",
        "gains called by what they are: the article does not name them; Nexus like Elite",
    ),
)
"""Closed."""
