"""The throttle controller of rusEFI: its gains and limits, the behaviour of its loop, and the form of its tune file."""

from __future__ import annotations

from ..ecu import Notation
from .profile import BiasTable, EcuProfile, Limit, Pasting, Scheduling

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
