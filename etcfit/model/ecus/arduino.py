"""A controller built on Arduino's PID library."""

from __future__ import annotations

from ..ecu import Notation
from ..feed_forward import Term
from .profile import EcuProfile, Limit, Scheduling

ARDUINO = EcuProfile(
    name="arduino",
    title="Arduino PID library",
    source="br3ttb, Arduino-PID-Library: PID_v1.cpp (Compute, SetTunings, SetOutputLimits), proportional on error",
    notation=Notation("%", "%"),
    gains=("Kp", "Ki", "Kd"),
    fixes={
        "filter": 0.0,
        "duty": 1.0,
        "integral": 1.0,
        "slew": 0.0,
        "dead_band": 0.0,
        "setpoint_weight": 1.0,
        "derivative_weight": 0.0,
    },
    assumed=(
        "input and setpoint in % of the travel, output in % of duty: another scale takes another Kp, Ki and Kd",
        "its sample time as the options and [ecu] of rig.toml say; the library's own default is 100 ms",
    ),
    limits=(
        Limit("SetSampleTime", "ms", lambda ecu, travel: 1e3 * ecu.period),
        Limit("SetOutputLimits, Min", "%", lambda ecu, travel: -100.0 * ecu.duty),
        Limit("SetOutputLimits, Max", "%", lambda ecu, travel: 100.0 * ecu.duty),
    ),
    code=(Term.FRICTION, Term.RATE),
    scheduling=Scheduling.CODE,
)
"""output = Kp error + I - Kd (input - last input) / T: a derivative of the position alone, so that a step of the
setpoint gives no kick; I and the output are each clamped to the output's limits. Ki and Kd are of continuous time
(`SetTunings` takes the sample time into account). What a sketch adds to the output the library knows nothing of: the
sketch limits the sum once more. Of `SetTunings` the source says that "tunings can also be adjusted on the fly during
normal operation"."""
