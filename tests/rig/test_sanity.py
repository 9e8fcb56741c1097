"""Traces that cannot be, and the likely slip of units."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from folders import back_emf, constant, inductance, only_response, resistance, response, scaled
from mistakes import assert_refused

R, BACK_EMF, RESISTANCE, INDUCTANCE = response(), back_emf(), resistance(), inductance()
WRONG: dict[str, tuple[Mapping[str, str | bytes], str]] = {
    "tps outside": (
        only_response(R.with_cell(9, 3, "4.99")),
        r"1\.csv:11: column 'tps \[V\]' is 4\.99 V.*4\.944 V.*\[tps\]",
    ),
    "degrees as radians": (only_response(scaled(R, 3, 10).with_header(3, "position [rad]")), r"really in deg or %"),
    "mA as A": (
        only_response(R.with_header(2, "current [A]")),
        r"current must lie between -500 A and 500 A.*really in mA",
    ),
    "mV as V": (only_response(scaled(R, 1, 1e3)), r"voltage must lie between.*really in mV"),
    "V as mV": (only_response(R.with_header(1, "voltage [mV]")), r"stays below .* mV in every trace.*really in V"),
    "s as ms": ({"back_emf/1.csv": BACK_EMF.with_header(0, "time [ms]").text()}, r"lasts 0\.000236 s.*really in s"),
    "ms as s": (only_response(R.with_header(0, "time [s]")), r"samples are [\d.]+ s apart.*really in ms"),
    "s as us": ({"resistance/1.csv": RESISTANCE.with_header(0, "time [us]").text()}, r"lasts 3\.9e-07 s"),
    "ms as days": (only_response(R.with_header(0, "time [day]")), r"to a day"),
    "A as mA, held": (
        {"resistance/1.csv": RESISTANCE.with_header(2, "current [mA]").text()},
        r"between 0\.02 and 1000 ohm",
    ),
    "mA as A, held": ({"inductance/1.csv": scaled(INDUCTANCE, 2, 1e3).text()}, r"between 0\.02 and 1000 ohm"),
    "radians as degrees": (
        {"back_emf/1.csv": scaled(BACK_EMF, 2, np.pi / 180).text()},
        r"sweeps 1\.\d+ % of the travel.*rad",
    ),
    "duty of percent": (
        only_response(scaled(R, 1, 10).with_header(1, "duty [1]")),
        r"duty must lie between.*really in %",
    ),
    "supply": (only_response(R.with_header(2, "supply [V]")), r"supply must lie between 1 V and 60 V.*really in mV"),
    "frozen position": (only_response(constant(R, 3)), r"'tps \[V\]' never changes from 2\.\d+ V.*response test needs"),
    "frozen release": ({"back_emf/1.csv": constant(BACK_EMF, 2).text()}, r"'position \[deg\]' never changes"),
    "frozen current": ({"inductance/1.csv": constant(INDUCTANCE, 2).text()}, r"'current \[A\]' never changes"),
}


@pytest.mark.parametrize(("changes", "message"), WRONG.values(), ids=WRONG.keys())
def test_each_mistake_has_its_own_message(tmp_path: Path, changes: Mapping[str, str | bytes], message: str) -> None:
    assert_refused(tmp_path, changes, message)
