"""Emtron."""

from __future__ import annotations

from ..ecu import Notation
from .profile import BiasTable, EcuProfile, Limit, Scheduling

EMTRON = EcuProfile(
    name="emtron",
    title="Emtron",
    source="Emtron, help: DBW Closed Loop Control (DBW PID Setup) and DBW Closed Loop tables",
    notation=Notation("%", "%"),
    gains=("DBW Proportional Gain Table", "DBW Integral Gain Table", "DBW Derivative Gain Table"),
    fixes={"derivative_weight": 1.0},
    assumes={"duty": 1.0, "integral": 1.0},
    assumed=(
        "gains in % of duty over % of travel, per s and times s; the help names no unit: set the proportional gain "
        "alone first and see that an error of 1 % gives as many % of duty",
        "clock and derivative filter as the options and [ecu] of rig.toml say; the help names neither",
        "an integral that runs on up to its limit, and a feed-forward table of 8 points",
        "one number in every cell of the gain tables; no target filter, no dead band of the output",
    ),
    limits=(
        Limit("DBW Min Duty Clamp Table", "%", lambda ecu, travel: -100.0 * ecu.duty),
        Limit("DBW Max Duty Clamp Table", "%", lambda ecu, travel: 100.0 * ecu.duty),
        Limit("DBW Neg Integral Limit Table", "%", lambda ecu, travel: -100.0 * min(ecu.integral or 1.0, 1.0)),
        Limit("DBW Pos Integral Limit Table", "%", lambda ecu, travel: 100.0 * min(ecu.integral or 1.0, 1.0)),
        Limit("DBW Deadband +/-", "%", lambda ecu, travel: 0.0),
        Limit("DBW Target Filter", "ms", lambda ecu, travel: 0.0),
    ),
    bias=BiasTable("target", "DBW Feed Forward %DC Table"),
    scheduling=Scheduling.TABLE,
)
"""The help's own words: derivative "gain is based on the rate of change of error"; limits "the maximum I gain
compensation used by the closed loop system", and the minimum; clamps "the minimum duty cycle that can be used"; "a Feed
Forward Table to provide a base duty for the PID function"; within the dead band "the output control signal is held
constant", which `Ecu` does not know: it is written as 0. Of each gain: "this table can be expanded into 3D (X axis
enabled), and any runtime can be used", with an example in which the proportional gain "is spanned across Battery
Voltage". The firmware is closed.
"""
