"""FOME."""

from __future__ import annotations

from dataclasses import replace

from .profile import BiasTable
from .rusefi import RUSEFI

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
