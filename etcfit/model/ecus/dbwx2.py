"""DBWX2, the drive-by-wire controller beside a MegaSquirt."""

from __future__ import annotations

import math

from ..ecu import Notation
from .profile import BiasTable, EcuProfile, Limit

DBWX2 = EcuProfile(
    name="dbwx2",
    title="MegaSquirt DBWX2",
    source="MegaSquirt DBWX2, Users manual (beta), p. 16: PID settings, BIAS",
    notation=Notation("%", "%"),
    gains=("P", "I", "D"),
    fixes={},
    assumes={"duty": 1.0, "integral": 1.0},
    assumed=(
        "gains in % of duty over % of travel, per s and times s; the manual names no unit: set P alone first and see "
        "that an error of 1 % gives P % of duty",
        "clock and derivative filter as the options and [ecu] of rig.toml say: the manual calls the clock a setting "
        "and says nothing of a filter",
        "a derivative of the error, and an integral that runs on up to its clamp",
        "a bias table of 8 points: the manual names no number",
    ),
    limits=(
        Limit("Update I/D", "Hz", lambda ecu, travel: 1.0 / ecu.period),
        Limit("PID I MIN", "%", lambda ecu, travel: 100.0 * ecu.dead_band / travel),
        Limit("I MAX", "%", lambda ecu, travel: 100.0),
        Limit("PID clamp", "%", lambda ecu, travel: 100.0 * min(ecu.integral or math.inf, ecu.duty)),
    ),
    bias=BiasTable("target", "BIAS"),
)
"""The manual's own words: "Update I/D: This is the PID controller update frequency. PID I MIN: Often referred as
'deadband'. The PID integrator is paused when the position error is smaller than what is set. I MAX: [...] can be used
to reset the integrator to 0 when position error is larger that set value. To disable this put in 100%. PID clamp
settings: This setting can limit the maximum PID calculation outputs." The bias is "a duty cycle value [...] for a given
'target' opening [...] from -100 to +100". The firmware is closed.

`Ecu` knows no integral that is emptied far from the setpoint: I MAX is written as disabled.
"""
