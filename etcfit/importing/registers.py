"""Registers of servo drives that keep the sign in a bit of its own.

    value = raw                raw < 2^k
    value = -(raw - 2^k)       raw >= 2^k

Feetech's STS has it in bit 10 of the load and in bit 15 of speed and position, older Dynamixels in bit 10.

Source: Feetech, STS3215 memory table; Robotis, AX-12 control table, "Present Load". Differs from source: no.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..rig.columns import sign_bit, without_sign_bit
from .sheet import TIME
from .take import LEFT_OUT, Take


def signed(take: Take) -> Take:
    """The column with its sign taken out of the bit; as it is where there is no such bit."""
    if take.quantity in (LEFT_OUT, TIME, "tps", "supply", "temperature"):
        return take
    bit = sign_bit(take.column.values, take.quantity)
    if bit is None:
        return take
    raw = take.column.values
    largest = np.array([np.nanmax(raw)])
    why = f"the sign stands in bit {bit}: {largest[0]:.0f} is {without_sign_bit(largest, bit)[0]:.0f}"
    column = replace(take.column, values=without_sign_bit(raw, bit))
    return replace(take, column=column, reason=f"{take.reason}; {why}")
