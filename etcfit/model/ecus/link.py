"""Link G4X and G5."""

from __future__ import annotations

from ..ecu import Notation
from .profile import EcuProfile, Limit

LINK = EcuProfile(
    name="link",
    title="Link G4X/G5",
    source="Link, PCLink help for G4X: E-Throttle, and its first-time setup (a PID behind a PWM output with DC clamp "
    "values, tables of target positions)",
    notation=Notation("%", "%"),
    gains=("Proportional Gain", "Integral Gain", "Derivative Gain"),
    fixes={},
    assumes={"duty": 1.0},
    assumed=(
        "gains in % of duty over % of travel, per s and times s; the help names no unit: set the proportional gain "
        "alone first and see that an error of 1 % gives as many % of duty",
        "clock and derivative filter as the options and [ecu] of rig.toml say; the help names neither",
        "the PID of the textbook: a derivative of the error, an integral that stands still at the DC clamp",
        "no feed-forward: none is described",
    ),
    limits=(Limit("DC clamp", "%", lambda ecu, travel: 100.0 * ecu.duty),),
)
"""Closed: the help says what the settings are, not what the controller computes."""
