"""Headers that cannot be read, each by its own message; a header is quantity and unit."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

import folders
from etcfit.errors import MeasurementError
from etcfit.rig.columns import parse_header
from etcfit.rig.reader import read_folder
from folders import TOML, only_response, response
from mistakes import assert_refused

R = response()
WRONG: dict[str, tuple[Mapping[str, str | bytes], str]] = {
    "unknown channel": (
        only_response(R.with_header(2, "curent [mA]")),
        r"1\.csv:1: column 'curent \[mA\]' is not known.*"
        r"\[columns\].*Did you mean 'current \[A\]'",
    ),
    "foreign header": (
        only_response(R.with_header(2, "TP (Main) (V)")),
        r"1\.csv:1: column 'TP \(Main\) \(V\)' is not known.*under \[columns\], as \"TP \(Main\) \(V\)\" =",
    ),
    "no unit": (
        only_response(R.with_header(2, "current")),
        r"1\.csv:1: column 'current' has no unit.*A or mA.*as in 'current \[A\]'",
    ),
    "empty unit": (only_response(R.with_header(2, "current []")), r"column 'current \[\]' has no unit"),
    "wrong dimension": (
        only_response(R.with_header(2, "current [mV]")),
        r"unit 'mV' is not one of current.*Correct the unit",
    ),
    "no such unit": (only_response(R.with_header(2, "current [quux]")), r"unit 'quux' is not known"),
    "a formula": (only_response(R.with_header(2, "current [9**9**9**9]")), r"unit '9\*\*9\*\*9\*\*9' is not known"),
    "per minute": (only_response(R.with_header(2, "motor_speed [1/min]")), r"'1/min' is not one of motor_speed.*rpm"),
    "Hz": (only_response(R.with_header(2, "motor_speed [Hz]")), r"'Hz' is not one of motor_speed.*rpm"),
    "plain angle": (only_response(R.with_header(3, "position [1]")), r"'1' is not one of position.*deg"),
    "no time": (only_response(R.without(0)), r"1\.csv:1: no time column among 'voltage"),
    "duplicate": (
        only_response(R.with_header(2, "voltage [V]")),
        r"1\.csv:1: columns 'voltage \[V\]' and 'voltage \[V\]' are both",
    ),
    "position and tps": (
        only_response(R.with_header(2, "position [deg]")),
        r"'position \[deg\]' and 'tps \[V\]' are both position",
    ),
    "two mapped to one": (
        {"rig.toml": TOML + "[columns]\nA = 'voltage [V]'", **only_response(R.with_header(2, "A"))},
        r"rig\.toml:11 \[columns\], for .*1\.csv:1: columns 'voltage \[V\]' and 'A' are both voltage",
    ),
    "mapped to what needs a calibration": (
        {
            "rig.toml": "[rig]\n\n[columns]\nB = 'ignore'\n'A  B' = 'tps [V]'\n",
            **only_response(R.with_header(3, "A  B")),
        },
        r"rig\.toml:3 \[columns\], for .*1\.csv:1: column 'A  B': tps needs",
    ),
    "tps uncalibrated": ({"rig.toml": "[rig]\nsupply_V = 12"}, r"1\.csv:1: column 'tps \[V\]': tps needs.*Add \[tps\]"),
    "percent of endless": (
        {
            "rig.toml": TOML.replace("[tps]", "travel_deg = [0, inf]\n[tps]"),
            **only_response(R.with_header(3, "position [%]")),
        },
        r"without end stops",
    ),
}


@pytest.mark.parametrize(("changes", "message"), WRONG.values(), ids=WRONG.keys())
def test_each_mistake_has_its_own_message(tmp_path: Path, changes: Mapping[str, str | bytes], message: str) -> None:
    assert_refused(tmp_path, changes, message)


@pytest.mark.parametrize(
    ("header", "factor"), [("current [-1 mA]", -1.0), ("current [1.03 mA]", 1.03), ("current [1e-3 A]", 1.0)]
)
def test_a_number_may_stand_before_the_unit(tmp_path: Path, header: str, factor: float) -> None:
    plain = read_folder(folders.changed(tmp_path / "plain", folders.only_response(R)))
    scaled = read_folder(folders.changed(tmp_path / "scaled", folders.only_response(R.with_header(2, header))))
    one, other = (rig.measurements[-1].channels["current"] for rig in (plain, scaled))
    np.testing.assert_allclose(other.value, factor * one.value, rtol=1e-12)
    np.testing.assert_allclose(other.logged(other.value), R.column(2), rtol=1e-9)


@pytest.mark.parametrize("header", ["current [0 mA]", "current [1e-30 A]", "current [-1]", "current [--1 A]"])
def test_but_not_any(tmp_path: Path, header: str) -> None:
    with pytest.raises(MeasurementError, match="current"):
        read_folder(folders.changed(tmp_path, folders.only_response(R.with_header(2, header))))


@pytest.mark.parametrize(
    ("header", "parsed"),
    [
        ("time [ms]", ("time", "ms")),
        ("  Motor Speed [ rpm ] ", ("motor_speed", "rpm")),
        ("position [%]", ("position", "%")),
        ("current [-1 A]", ("current", "-1 A")),
        ("time [1.02 s]", ("time", "1.02 s")),
    ],
)
def test_case_spaces_and_factors_are_understood(header: str, parsed: tuple[str, str]) -> None:
    assert parse_header(header) == parsed
