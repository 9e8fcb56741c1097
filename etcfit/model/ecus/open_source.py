"""Engine computers with a published controller, and a generic one."""

from __future__ import annotations

import math
from dataclasses import replace

from ..ecu import Notation
from ..feed_forward import Term
from .profile import BiasTable, EcuProfile, Limit, Pasting, Scheduling

# The throttle controller of rusEFI: its gains and limits, the behaviour of its loop, and the form of its tune file
RUSEFI = EcuProfile(
    name="rusefi",
    title="rusEFI",
    source="rusEFI firmware: electronic_throttle.cpp (ETB_DUTY_LIMIT 0.9, getOpenLoop, setOutput, etb_iTermMin and "
    "etb_iTermMax -30 and 30 by default), electronic_throttle_impl.h (ETB_LOOP_FREQUENCY 500), efi_pid.cpp "
    "(getUnclampedOutput, updateITerm), rusefi_config.txt (ETB_BIAS_CURVE_LENGTH 8; etbJamDetectThreshold in "
    "whole %, etbJamTimeout)",
    notation=Notation("%", "%"),
    gains=("etb_pFactor", "etb_iFactor", "etb_dFactor"),
    fixes={
        "period": 2e-3,
        "filter": 0.0,
        "duty": 0.9,
        "integral": 0.3,
        "slew": 0.0,
        "dead_band": 0.0,
        "setpoint_weight": 1.0,
        "derivative_weight": 1.0,
        "compensated": 0.0,
    },
    limits=(
        Limit("etb_offset", "", lambda ecu, travel: 0.0),
        Limit("etb_minValue", "", lambda ecu, travel: -100.0),
        Limit("etb_maxValue", "", lambda ecu, travel: 100.0),
        Limit("etb_iTermMin", "", lambda ecu, travel: -100.0 * ecu.integral),
        Limit("etb_iTermMax", "", lambda ecu, travel: 100.0 * ecu.integral),
    ),
    bias=BiasTable("etbBiasBins", "etbBiasValues"),
    scheduling=Scheduling.NONE,
    pasting=Pasting.TUNE_FILE,
    jam=("etbJamDetectThreshold", "etbJamTimeout"),
)
"""500 Hz, everything in %: a derivative of the error over one tick without a filter, an integral that runs on within
+-30 % (its default; a setting there), P + I + D within +-100 %, the bias table added, the duty within +-90 %.

Since April 2025 the firmware divides by the time measured between ticks; that is 2 ms wherever the ECU keeps up.
"""


FOME = replace(
    RUSEFI,
    name="fome",
    title="FOME",
    source="FOME firmware: electronic_throttle.cpp (ETB_DUTY_LIMIT 0.9, getOpenLoop, setOutput, etb_iTermMin and "
    "etb_iTermMax -30 and 30 by default), electronic_throttle_impl.h (ETB_LOOP_FREQUENCY 500), efi_pid.cpp "
    "(getUnclampedOutput, getOutput, updateITerm), fome_config.txt (etbBiasBins in steps of 0.5 %, "
    "etbBiasValues of 0.1 %)",
    bias=BiasTable("etbBiasBins", "etbBiasValues", positions=201, decimals=1),
    jam=None,
)
"""A fork of rusEFI whose throttle controller is still the same, line by line; but its bias table names positions in
steps of 0.5 % of the travel and duties in steps of 0.1 %, so that a point may miss the corner of a limp-home spring."""


# DBWX2, the drive-by-wire controller beside a MegaSquirt
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


# A controller built on Arduino's PID library
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
(`SetTunings` takes the sample time into account). The library does not know what a sketch adds to its output: the
sketch limits the sum again. Of `SetTunings` the source says that "tunings can also be adjusted on the fly during
normal operation"."""


# No ECU in particular
GENERIC = EcuProfile(
    name="generic",
    title="Generic",
    source="Astrom and Hagglund 2006, Advanced PID Control, ch. 3 and 13: parallel form, backward differences, a "
    "low-pass on the derivative, an integral that stops at the limit",
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
"""The controller that is tuned if no ECU is named; if it is named, its gains are also written in %."""
