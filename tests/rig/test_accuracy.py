"""[accuracy] of rig.toml: what it may say, in SI, and what it says wrongly."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from etcfit.errors import MeasurementError
from etcfit.rig.base import Accuracy
from etcfit.rig.config import read_config
from folders import TOML


def read(folder: Path, *lines: str) -> dict[str, Accuracy]:
    path = folder / "rig.toml"
    path.write_text("\n".join([TOML, "[accuracy]", *lines, ""]), encoding="utf-8")
    return dict(read_config(path).accuracy)


SAID: dict[str, tuple[str, Accuracy]] = {
    "share and number": ('current = "1 % + 5 mA"', Accuracy(0.01, 5e-3)),
    "the other way round": ('current = "5 mA + 1 %"', Accuracy(0.01, 5e-3)),
    "plus and minus, no blanks": ('voltage = "±0.2%+10mV"', Accuracy(2e-3, 0.01)),
    "in ASCII": ('emf = "+/- 0.1 V"', Accuracy(0.0, 0.1)),
    "a share alone": ('gear = "0.5 %"', Accuracy(5e-3)),
    "parts per million": ('time = "50 ppm"', Accuracy(50e-6)),
    "a torque": ('torque = "2 % + 2 mN*m"', Accuracy(0.02, 2e-3)),
    "an exponent": ('emf = "1e-3 V"', Accuracy(0.0, 1e-3)),
    "a speed": ('motor_speed = "5 rpm"', Accuracy(0.0, 5 * math.pi / 30)),
    "an angle": ('sensor_end_points = "0.5 deg"', Accuracy(0.0, math.radians(0.5))),
    "the sensor's volts": ('sensor_end_points = "10 mV"', Accuracy(0.0, 0.01 * math.radians(90.0) / 4.28)),
    "standard deviations": ('current = { sd = "0.5 % + 2 mA" }', Accuracy(5e-3, 2e-3, "normal")),
}


@pytest.mark.parametrize(("line", "expected"), SAID.values(), ids=SAID.keys())
def test_what_it_may_say(tmp_path: Path, line: str, expected: Accuracy) -> None:
    (found,) = read(tmp_path, line).values()
    np.testing.assert_allclose((found.relative, found.absolute), (expected.relative, expected.absolute), rtol=1e-12)
    assert found.distribution == expected.distribution


def test_a_bound_is_a_rectangle_and_an_sd_is_itself() -> None:
    """GUM 4.3.7: u = a / sqrt 3; checked against the spread of what is equally likely within the bound."""
    within = np.random.default_rng(0).uniform(-0.01, 0.01, 200_000)
    assert Accuracy(0.01, 0.01).gain_sd == pytest.approx(np.std(within), rel=0.01)
    assert Accuracy(0.01, 0.01).offset_sd == pytest.approx(np.std(within), rel=0.01)
    assert Accuracy(0.01, 0.02, "normal").gain_sd == 0.01
    assert Accuracy(0.01, 0.02, "normal").offset_sd == 0.02


def test_it_is_empty_where_nothing_is_stated(tmp_path: Path) -> None:
    assert read(tmp_path) == {}


WRONG: dict[str, tuple[str, str]] = {
    "unknown channel": ('curent = "1 %"', r"accuracy\.curent: unknown key\..*Did you mean 'current'\?"),
    "a number": ("current = 0.01", r"accuracy\.current: found 0\.01\..*Write current = \"1 % \+ 5 mA\""),
    "no unit": ('current = "0.01"', r"found '0\.01'\. It must be numbers with units, joined by \+"),
    "a sum that does not end": ('current = "1 % +"', r"numbers with units, joined by \+"),
    "negative": ('current = "-1 %"', r"numbers with units"),
    "wrong dimension": ('current = "5 mV"', r"unit 'mV' is not one of current\..*A or mA"),
    "no unit at all": ('voltage = "1 bananas"', r"unit 'bananas' is not known"),
    "a length of a ratio": ('gear = "1 deg"', r"accuracy\.gear: found the unit 'deg'\..*a share of the value"),
    "nothing": ('current = "0 %"', r"above 0 and at most 100 %"),
    "more than all": ('current = "150 %"', r"above 0 and at most 100 %"),
    "another table": ('current = { bound = "1 %" }', r"found \{'bound': '1 %'\}"),
    "an sd that is a number": ("current = { sd = 0.01 }", r"\{ sd = \"1 % \+ 5 mA\" \}"),
}


@pytest.mark.parametrize(("line", "message"), WRONG.values(), ids=WRONG.keys())
def test_what_it_says_wrongly(tmp_path: Path, line: str, message: str) -> None:
    with pytest.raises(MeasurementError) as caught:
        read(tmp_path, line)
    error = caught.value
    assert re.search(message, str(error), re.DOTALL), str(error)
    assert error.where.startswith(str(tmp_path / "rig.toml:"))
    assert all((error.found, error.required, error.mend))


def test_volts_of_a_sensor_need_its_calibration(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text('[rig]\nname = "bench"\n[accuracy]\nsensor_end_points = "10 mV"\n', encoding="utf-8")
    with pytest.raises(MeasurementError, match=r"rig\.toml has no \[tps\]"):
        read_config(path)
