"""No ECU in particular."""

from __future__ import annotations

from ..ecu import Notation
from ..feed_forward import Term
from .profile import BiasTable, EcuProfile, Limit, Scheduling

GENERIC = EcuProfile(
    name="generic",
    title="Generic",
    source="Astrom and Hagglund 2006, Advanced PID Control, ch. 3 and 13: parallel form, backward differences, a "
    "low-pass on the derivative, an integral that stands still at the limit",
    notation=Notation("%", "%"),
    gains=("P", "I", "D"),
    fixes={},
    assumed=("clock, delay and derivative filter as the options and [ecu] of rig.toml say",),
    limits=(
        Limit("period", "ms", lambda ecu, travel: 1e3 * ecu.period),
        Limit("derivative filter", "ms", lambda ecu, travel: 1e3 * ecu.filter),
        Limit("duty limit", "%", lambda ecu, travel: 100.0 * ecu.duty),
        Limit("integral limit, 0: none", "%", lambda ecu, travel: 100.0 * ecu.integral),
        Limit("integral dead band", "%", lambda ecu, travel: 100.0 * ecu.dead_band / travel),
        Limit("slew limit, 0: none", "% of duty/s", lambda ecu, travel: 100.0 * ecu.slew / ecu.supply),
        Limit("setpoint weight of P", "", lambda ecu, travel: ecu.setpoint_weight),
        Limit("setpoint weight of D", "", lambda ecu, travel: ecu.derivative_weight),
    ),
    bias=BiasTable("position", "duty"),
    code=(Term.FRICTION, Term.RATE),
    scheduling=Scheduling.CODE,
)
"""The controller that gains are sought for where no ECU is named; named, its gains are also written in %."""
