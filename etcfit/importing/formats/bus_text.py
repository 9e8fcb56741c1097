"""Text logs of a bus: frames as bytes, which cannot be decoded without the bus's DBC.

They are recognised only to give a clear error; frames are decoded from MDF only (`mdf`).

    (1436509052.249713) can0 044#2A366C2BBA                  candump
    Time Stamp,ID,Extended,Bus,LEN,D1,D2,...                 SavvyCAN (GVRET)
    ***BUSMASTER Ver 3.2.2***                                BUSMASTER
    base hex  timestamps absolute                            Vector ASC

Source: can-utils, candump; Vector, ASC logging; BUSMASTER; samples of SavvyCAN and python-can.
Differs from source: no.
"""

from __future__ import annotations

import re

from ...errors import MeasurementError
from ..sheet import Sheet

_BUS = (
    ("candump", re.compile(r"\(\d+\.\d+\)\s+\S+\s+[0-9A-Fa-f]+#")),
    ("SavvyCAN", re.compile(r"(Time Stamp,ID,Extended|ID,Data Bytes)")),
    ("BUSMASTER", re.compile(r"\*\*\*BUSMASTER")),
    ("Vector", re.compile(r"date [^\n]*\n\s*base (hex|dec)\s+timestamps ")),
)


def _program(text: str) -> str | None:
    return next((name for name, pattern in _BUS if pattern.match(text)), None)


def is_bus(text: str) -> bool:
    """Whether a text has frames of a bus."""
    return _program(text) is not None


def refuse_bus(text: str, where: str) -> list[Sheet]:
    """Refuse it.

    Raises:
        MeasurementError: always, with the name of the program.
    """
    found = f"frames of a bus as bytes, as {_program(text)} logs them."
    raise MeasurementError(where, found, "Signals are needed: position, setpoint, duty.",
                           "Decode the frames with the bus's DBC and export the signals as CSV, or log as MDF (.mf4) "
                           "and give `etcfit import` the DBC beside it.")  # fmt: skip
