"""rig.toml: what it may say, in SI, and what it says wrongly."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from etcfit.errors import MeasurementError
from etcfit.model.ecu import ERRORS, FORMS, OUTPUTS, Ecu, Notation, Terms
from etcfit.rig.base import Accuracy, Fixed, Prior, RigConfig, Start, Tied, TpsCalibration
from etcfit.rig.config import read_config
from etcfit.rig.ecu import GAINS, SUPPLY_SD, ecu_lines
from etcfit.rig.units import to_channel
from folders import TOML

FULL = """[rig]
name = "Bosch 0280750148, bench"
synthetic = true
gear_ratio = 20.68
supply_V = 12
travel_deg = [-5.0, 90.0]

[tps]
closed_V = 0.45
open_V = 4.73
travel_deg = 90.0

[columns]
"TP (Main) (V)" = "tps [V]"
"Lambda" = "ignore"

[noise]
current_mA = 10
tps_V = 0.0428
motor_speed_rpm = 60.0
torque_Nm = 0.02
duty = 0.01
temperature_degC = 0.5
setpoint_deg = 0.1

[tests.inductance]
series_ohm = "free"
[tests.resistance]
series_ohm = 0.2

[parameters]
K_m = "K_b"
J_L = { value = 0.0011, sd = 0.0002 }
B_L = { fixed = 0.0 }
R_a = 1.5

[model]
effects = ["limp_home_spring"]

[holdout]
files = ["response/drive_4.csv", "static_load\\\\ramp_2.csv", "./sine/1.csv"]
"""


def read(tmp_path: Path, text: str | bytes) -> RigConfig:
    path = tmp_path / "rig.toml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_config(path)


def test_every_key_arrives_in_si(tmp_path: Path) -> None:
    config = read(tmp_path, FULL)
    assert (config.name, config.synthetic, config.supply_V) == ("Bosch 0280750148, bench", True, 12.0)
    assert (config.gear_ratio, config.gear_ratio_given) == (20.68, True)
    assert config.travel == pytest.approx((np.radians(-5.0), np.pi / 2))
    assert config.tps == TpsCalibration(0.45, 4.73, np.pi / 2)
    assert config.columns == {"TP (Main) (V)": "tps [V]", "Lambda": "ignore"}
    assert config.series_ohm == {"inductance": None, "resistance": 0.2}
    assert config.parameters == {"K_m": Tied("K_b"), "J_L": Prior(0.0011, 0.0002), "B_L": Fixed(0.0), "R_a": Start(1.5)}
    assert config.effects == ("limp_home_spring",)
    assert config.holdout == ("response/drive_4.csv", "static_load/ramp_2.csv", "sine/1.csv")


def test_noise_is_converted_by_channel(tmp_path: Path) -> None:
    """tps volts become the angle they stand for: 0.0428 V of 4.28 V is a hundredth of the travel."""
    expected = {
        "current": 0.01, "position": np.pi / 200, "motor_speed": 2 * np.pi, "torque": 0.02, "duty": 0.01,
        "temperature": 0.5, "setpoint": np.radians(0.1),
    }  # fmt: skip
    assert dict(read(tmp_path, FULL).noise) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("key", "channel", "sigma"),
    [("position_rad", "position", 0.5), ("position_percent", "position", np.pi / 400), ("emf_V", "emf", 0.5),
     ("motor_speed_rad_s", "motor_speed", 0.5), ("torque_N_m", "torque", 0.5), ("voltage_mV", "voltage", 5e-4)],
)  # fmt: skip
def test_noise_keys_take_usual_units(tmp_path: Path, key: str, channel: str, sigma: float) -> None:
    assert dict(read(tmp_path, f"[noise]\n{key} = 0.5").noise) == pytest.approx({channel: sigma})


def test_defaults(tmp_path: Path) -> None:
    config = read(tmp_path, "")
    assert config == RigConfig(name=tmp_path.name)
    assert not config.gear_ratio_given


def test_endless_travel(tmp_path: Path) -> None:
    assert read(tmp_path, "[rig]\ntravel_deg = [-inf, inf]").travel == (-np.inf, np.inf)


def test_the_second_track_of_a_sensor_falls_while_the_plate_opens(tmp_path: Path) -> None:
    """closed_V above open_V is no mistake: 4.55 V closed and 0.35 V open, so 4.55 V is angle 0 and 2.45 V half way."""
    config = read(tmp_path, "[tps]\nclosed_V = 4.55\nopen_V = 0.35\ntravel_deg = 90")
    assert config.tps is not None
    _, volts = to_channel("tps", "V", config.travel, config.tps)
    angles = [volts.scale * v + volts.offset for v in (4.55, 2.45, 0.35)]
    assert angles == pytest.approx([0.0, np.pi / 4, np.pi / 2], abs=1e-12)


def test_unusual_nameplates_are_taken(tmp_path: Path) -> None:
    """A direct drive, a robot's gearbox, 48 V, a plate of many turns."""
    for ratio, supply, travel in ((0.05, 1.5, [-900.0, 900.0]), (5000.0, 48.0, [-0.5, 0.5])):
        config = read(tmp_path, f"[rig]\ngear_ratio = {ratio}\nsupply_V = {supply}\ntravel_deg = {travel}")
        assert (config.gear_ratio, config.supply_V) == (ratio, supply)
        assert config.travel == pytest.approx(np.radians(travel))


@pytest.mark.parametrize("line", ["N = 20.68", "N = { fixed = 20.68 }"])
def test_the_gear_ratio_may_stand_among_the_parameters(tmp_path: Path, line: str) -> None:
    config = read(tmp_path, f"[parameters]\n{line}")
    assert (config.gear_ratio, config.gear_ratio_given, dict(config.parameters)) == (20.68, True, {})


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_any_encoding_of_an_editor(tmp_path: Path, encoding: str, newline: str) -> None:
    text = FULL.replace("bench", "Prüfstand").replace("\n", newline)
    assert read(tmp_path, text.encode(encoding)).name == "Bosch 0280750148, Prüfstand"


ECU = """[rig]
supply_V = 12.5
[ecu]
P = 4.0
I = 'free'
D = { value = 30, scale = 'free' }
unit = '%/%'
form = 'ticks'
period_ms = 2.0
"""


def test_gains_of_an_ecu_arrive_in_volts_radians_and_seconds(tmp_path: Path) -> None:
    """Duty % for a % of the travel: 0.125 V for 0.9 deg; 30 ticks of 2 ms."""
    config = read(tmp_path, ECU)
    assert config.ecu is not None
    assert config.ecu == Ecu(period=2e-3, filter=2e-3, delay=0.0, supply=12.5)
    assert config.ecu.late == pytest.approx(1e-3)
    p, d = config.parameters["K_p"], config.parameters["K_d"]
    assert isinstance(p, Fixed)
    assert p.value == pytest.approx(4.0 * 0.125 / np.radians(0.9))
    assert isinstance(d, Start)
    assert d.value == pytest.approx(30.0 * 2e-3 * 0.125 / np.radians(0.9))
    assert "K_i" not in config.parameters
    assert config.parameters["t_e"] == Fixed(2e-3)
    assert config.parameters["V_e"] == Prior(12.5, SUPPLY_SD * 12.5)


def test_limits_of_an_ecu_are_written_as_they_were_read(tmp_path: Path) -> None:
    """Those of a firmware that clamps its integral, and of one that differences the position."""
    said = Ecu(2e-3, 12.5, 0.0, 2e-3, duty=0.9, integral=0.3, slew=400.0, dead_band=math.radians(0.5),
               setpoint_weight=0.5, derivative_weight=0.0)  # fmt: skip
    gains = Terms(4.0, 0.137, 30.0)
    for ecu in (said, Ecu(1e-3, 12.5)):
        lines = ecu_lines(ecu, Notation("%", "%", "ticks"), gains)
        assert len(lines) == (15 if ecu is said else 9)
        config = read(tmp_path, "\n".join(("[rig]", "supply_V = 12.5", *lines, "")))
        assert config.ecu == pytest.approx(ecu)
    constants = read(tmp_path, "\n".join(("[rig]", "supply_V = 12.5", *ecu_lines(said, Notation(), gains)))).parameters
    limit, known = constants["V_e"], [constants[symbol] for symbol in ("I_e", "d_e", "c")]
    assert isinstance(limit, Prior)
    assert (limit.value, limit.sd) == (pytest.approx(0.9 * 12.5), pytest.approx(0.09 * 12.5))
    assert [each.value for each in known if isinstance(each, Fixed)] == pytest.approx([0.3, 0.9, 0.0])


def test_a_bias_table_arrives_in_radians_and_shares_and_is_written_as_it_was_read(tmp_path: Path) -> None:
    pairs = ((0.0, -20.0), (14.0, 12.5), (100.0, 25.0))
    lines = ecu_lines(Ecu(2e-3, 12.5), Notation(), Terms(1.0, 2.0, 0.0), pairs)
    config = read(tmp_path, "\n".join(("[rig]", "supply_V = 12.5", *lines, "")))
    assert np.asarray(config.bias) == pytest.approx(np.asarray(pairs) * (math.pi / 200.0, 0.01))
    assert read(tmp_path, ECU).bias == ()


def test_where_no_gain_gives_volts_a_scale_the_supply_does_not_either(tmp_path: Path) -> None:
    """A gain of zero is none; one with a standard deviation is one."""
    free = ECU.replace("P = 4.0", "P = 'free'")
    assert read(tmp_path, free).parameters["V_e"] == Start(12.5)
    assert read(tmp_path, free.replace("I = 'free'", "I = 0.0")).parameters["V_e"] == Start(12.5)
    believed = free.replace("I = 'free'", "I = { value = 0.137, sd = 0.01 }")
    assert isinstance(read(tmp_path, believed).parameters["V_e"], Prior)


@pytest.mark.parametrize("unit", [f"{output}/{error}" for output in OUTPUTS for error in ERRORS])
@pytest.mark.parametrize("form", FORMS)
def test_gains_are_written_as_they_were_read(tmp_path: Path, unit: str, form: str) -> None:
    typed = {"P": 4.0, "I": 0.137, "D": 30.0}
    gains = "".join(f"{key} = {value}\n" for key, value in typed.items())
    config = read(
        tmp_path, f"[rig]\nsupply_V = 12.5\n[ecu]\n{gains}unit = '{unit}'\nform = '{form}'\nperiod_ms = 2.0\n"
    )
    output, error = unit.split("/")
    assert config.ecu is not None
    assert config.notation is not None
    assert config.notation == Notation(output, error, form)
    known = [config.parameters[symbol] for symbol in GAINS.values()]
    si = [each.value for each in known if isinstance(each, Fixed)]
    back = config.notation.written((si[0], si[1], si[2]), config.ecu, np.pi / 2)
    assert back._asdict() == pytest.approx(typed)


def test_a_notation_is_that_of_a_unit_that_was_named(tmp_path: Path) -> None:
    assert read(tmp_path, ECU).notation == Notation("%", "%", "ticks")
    free = (
        ECU.replace("4.0", "'free'").replace("{ value = 30, scale = 'free' }", "'free'").replace("unit = '%/%'\n", "")
    )
    assert read(tmp_path, free).notation is None
    assert read(tmp_path, "").notation is None


def test_an_integral_gain_in_ticks_grows_with_their_rate(tmp_path: Path) -> None:
    """I per tick, twice as many a second: the paper's 0.137 is 68.5 per s at 2 ms."""
    ticks = read(tmp_path, ECU.replace("I = 'free'", "I = { value = 0.137, sd = 0.01 }").replace("%/%", "V/rad"))
    known = ticks.parameters["K_i"]
    assert isinstance(known, Prior)
    assert (known.value, known.sd) == (pytest.approx(68.5), pytest.approx(5.0))
    seconds = read(tmp_path, ECU.replace("form = 'ticks'", "").replace("%/%", "V/deg").replace("'free'\nD", "7\nD"))
    given = seconds.parameters["K_i"]
    assert isinstance(given, Fixed)
    assert given.value == pytest.approx(7.0 * 180.0 / np.pi)


WRONG: dict[str, tuple[str | bytes, str]] = {
    "unknown table": ("[rigg]\n", r"rig\.toml:1: rigg: unknown key.*Did you mean 'rig'"),
    "unknown key": ("[rig]\n\ngear_ration = 2", r"rig\.toml:3: rig\.gear_ration: unknown.*Did you mean 'gear_ratio'"),
    "unknown nested key": ("[tests.sine]\nohm = 1", r"rig\.toml:2: .*unknown.*series_ohm"),
    "table that is none": ("rig = 3", r"rig: found 3.*table"),
    "text for number": ("[rig]\ngear_ratio = '20'", r"rig\.toml:2: rig\.gear_ratio: found '20'.*number"),
    "bool for number": ("[rig]\nsupply_V = true", r"found True.*number"),
    "nan": ("[rig]\nsupply_V = nan", r"found nan.*number"),
    "inf": ("[rig]\nsupply_V = inf", r"found inf.*finite"),
    "negative": ("[rig]\ngear_ratio = -1", r"above 0"),
    "number for text": ("[rig]\nname = 3", r"rig\.toml:2: .*text"),
    "text for bool": ("[rig]\nsynthetic = 'yes'", r"rig\.toml:2: .*true or false"),
    "gear ratio too large": ("[rig]\ngear_ratio = 1e90", r"rig\.toml:2: .*found 1e\+90\. .*0\.01 and 10000\. Count"),
    "gear ratio too small": ("[rig]\ngear_ratio = 1e-3", r"found 0\.001\. .*between 0\.01 and 10000"),
    "gear ratio endless": ("[rig]\ngear_ratio = inf", r"rig\.gear_ratio: found inf\. It must be finite"),
    "gear ratio none": ("[rig]\ngear_ratio = nan", r"rig\.gear_ratio: found nan.*number"),
    "N too large": ("[parameters]\nN = 1e5", r"rig\.toml:2: parameters\.N: found 100000\.0\. .*10000"),
    "supply in mV": ("[rig]\nsupply_V = 12000", r"rig\.toml:2: .*found 12000\. .*between 1 and 100 V\. .*volts"),
    "travel too large": ("[rig]\ntravel_deg = [0, 1e5]", r"rig\.toml:2: .*found 100000\.0\. .*3600 degrees"),
    "travel in nothing": ("[rig]\ntravel_deg = [0, 1e-6]", r"found \[0, 1e-06\]\. .*0\.1 degrees apart"),
    "tps backwards": ("[tps]\nclosed_V = 1\nopen_V = 4\ntravel_deg = -90", r"rig\.toml:4: .*found -90\. .*above 0"),
    "tps travel": ("[tps]\nclosed_V = 1\nopen_V = 4\ntravel_deg = 1e9", r"rig\.toml:4: .*between 0\.1 and 3600"),
    "tps in mV": ("[tps]\nclosed_V = 450\nopen_V = 4.7\ntravel_deg = 90", r"rig\.toml:2: .*found 450\. .*-100 and 100"),
    "series of megohms": ("[tests.sine]\nseries_ohm = 1e6", r"rig\.toml:2: .*between 0 and 10000 ohm"),
    "travel of one": ("[rig]\ntravel_deg = [90]", r"two numbers"),
    "travel swapped": ("[rig]\ntravel_deg = [90, 0]", r"below the open stop"),
    "tps incomplete": ("[tps]\nclosed_V = 0.45\ntravel_deg = 90", r"rig\.toml:1: tps\.open_V: missing"),
    "tps flat": ("[tps]\nclosed_V = 1\nopen_V = 1\ntravel_deg = 90", r"must differ"),
    "column of no unit": ("[columns]\n'A B' = 'voltage'", r"rig\.toml:2: columns\.A B: .*no unit"),
    "column unknown": ("[columns]\nA = 'volts [V]'", r"columns\.A: column 'volts \[V\]' is not known"),
    "column wrong unit": ("[columns]\nA = 'voltage [A]'", r"'A' is not one of voltage"),
    "noise unknown": ("[noise]\ncurent_A = 1", r"rig\.toml:2: .*unknown channel.*'current'"),
    "noise without unit": ("[noise]\ncurrent = 1", r"unit missing.*current_A"),
    "noise wrong unit": ("[noise]\ncurrent_V = 1", r"'V' is not one of current"),
    "noise zero": ("[noise]\ncurrent_A = 0.0", r"above 0"),
    "noise twice": ("[noise]\ncurrent_A = 1.0\ncurrent_mA = 1.0", r"rig\.toml:3: .*second value for current"),
    "noise of tps": ("[noise]\ntps_V = 0.1", r"no \[tps\]"),
    "series": ("[tests.sine]\nseries_ohm = 'fre'", r'"free" or a number'),
    "series negative": ("[tests.sine]\nseries_ohm = -1", r'"free" or a number'),
    "tests no table": ("[tests]\nsine = 1", r"tests\.sine: found 1"),
    "parameter list": ("[parameters]\nR_a = [1]", r"rig\.toml:2: parameters\.R_a: .*\{fixed"),
    "parameter half a prior": ("[parameters]\nR_a = {value = 1}", r"\{value = 1\.0, sd"),
    "parameter sd 0": ("[parameters]\nR_a = {value = 1, sd = 0}", r"above 0"),
    "parameter form": ("[parameters]\nR_a = {fixd = 1}", r"rig\.toml:2: .*\{fixed = 0\.0\}"),
    "parameter symbol": ("[parameters]\n'R a' = 1", r"no symbol"),
    "parameter without quotes": (
        "[parameters]\nlate.response.current = {fixed = 0.002}",
        r'rig\.toml:2: .*in quotes\. Write "late\.response\.current" = ',
    ),
    "parameter of a place that is none": ("[parameters]\n'late.' = 1", r"rig\.toml:2: parameters\.late\.: no symbol"),
    "circle": ("[parameters]\nK_m = 'K_b'\nK_b = 'K_m'", r"circle: K_m = K_b = K_m"),
    "itself": ("[parameters]\nK_m = 'K_m'", r"circle"),
    "N tied": ("[parameters]\nN = 'K_m'", r"gear_ratio = 20"),
    "N twice": ("[rig]\ngear_ratio = 20\n[parameters]\nN = 21", r"same quantity"),
    "effects": ("[model]\neffects = 'stribeck'", r"list of texts"),
    "holdout": ("[holdout]\nfiles = [1]", r"list of texts"),
    "huge integer": ("[rig]\nsupply_V = 1" + 400 * "0", r"finite"),
    "ecu without a gain": (ECU.replace("P = 4.0\n", ""), r"rig\.toml:3: ecu\.P: missing.*P = \"free\""),
    "ecu without a period": (ECU.replace("period_ms = 2.0", ""), r"ecu\.period_ms: missing"),
    "ecu unknown key": (ECU + "gain = 1", r"rig\.toml:10: ecu\.gain: unknown key"),
    "ecu without supply": (ECU.replace("supply_V = 12.5", ""), r"rig\.toml:3: ecu: no \[rig\] supply_V"),
    "ecu gain": (ECU.replace("4.0", "-4.0"), r"rig\.toml:4: ecu\.P: found -4\.0\..*scale = \"free\""),
    "ecu gain of zero to a scale": (ECU.replace("value = 30", "value = 0"), r"rig\.toml:6: ecu\.D: .*above 0"),
    "ecu gain with a known scale": (ECU.replace("scale = 'free'", "scale = 2"), r"ecu\.D: .*one of these forms"),
    "ecu unit": (ECU.replace("%/%", "V per deg"), r"rig\.toml:7: ecu\.unit: found 'V per deg'\..*V/deg"),
    "ecu without unit": (ECU.replace("unit = '%/%'", ""), r"ecu\.unit: missing"),
    "ecu form": (ECU.replace("'ticks'", "'tick'"), r"rig\.toml:8: ecu\.form: found 'tick'"),
    "ecu period": (ECU.replace("= 2.0", "= 2000"), r"rig\.toml:9: ecu\.period_ms: found 2000"),
    "ecu without stops": (ECU.replace("[ecu]", "travel_deg = [-inf, inf]\n[ecu]"), r"ecu\.unit: .*end stops"),
    "ecu gain twice": (ECU + "[parameters]\nK_p = 4", r"rig\.toml:11: parameters\.K_p: .*\[ecu\] already"),
    "nested too deep": ("a = " + 5000 * "[", r"valid TOML"),
    "binary": (b"PK\x03\x04\x00\x01\x02", "text"),
    "accuracy in volts of no sensor": ('[accuracy]\nsensor_end_points = "10 mV"', r"rig\.toml has no \[tps\]"),
    **{
        f"ecu {key} of {value}": (f"{ECU}{key} = {value}\n", rf"ecu\.{key}.*{value}")
        for key, value in (("duty", "0"), ("duty", "90"), ("integral", "-0.3"), ("slew_V_per_s", "inf"),
                           ("derivative_weight", "2"), ("dead_band_deg", "'wide'"))
    },
    **{
        f"ecu bias {table}": (
            f"{ECU}bias_percent = {table}\n", r"ecu\.bias_percent.*rising.*Write bias_percent = \[\[0, -20\]")
        for table in ("20", "[1, 2]", "[[1, 2, 3]]", "[[10, 2], [5, 3]]", "[[0, 'x']]", "[[0, 200]]")
    },
}  # fmt: skip


@pytest.mark.parametrize(("text", "message"), WRONG.values(), ids=WRONG.keys())
def test_each_mistake_has_its_own_message(tmp_path: Path, text: str | bytes, message: str) -> None:
    with pytest.raises(MeasurementError) as caught:
        read(tmp_path, text)
    assert re.search(message, str(caught.value)), str(caught.value)


def test_no_two_mistakes_share_a_message(tmp_path: Path) -> None:
    """Where the texts differ only in what was found, they name different keys."""
    said = []
    for text, _ in WRONG.values():
        with pytest.raises(MeasurementError) as caught:
            read(tmp_path, text)
        said.append(str(caught.value))
    assert len(set(said)) == len(said)


HIDING = [("a\\nb", "U+000A"), ("a\\u001b[2J", "U+001B"), ("\\u202Eb", "U+202E"), ("\\u2066b\\u2069", "U+2066, U+2069"),
          ("a\\u2028b", "U+2028")]  # fmt: skip


@pytest.mark.parametrize(("name", "said"), HIDING)
def test_a_name_in_which_something_hides_is_refused(tmp_path: Path, name: str, said: str) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(f'[rig]\nname = "{name}"\n', encoding="utf-8")
    with pytest.raises(MeasurementError, match=rf"rig\.toml:2: rig\.name: {re.escape(said)} in it.*Type it anew"):
        read_config(path)


def test_a_name_may_be_of_any_language(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    name = "Drosselklappe Nº 3 – 試験台 دریچه\u200cگاز"  # with the joiner that Persian needs
    path.write_text(f'[rig]\nname = "{name}"\n', encoding="utf-8")
    assert read_config(path).name == name


def accuracy(folder: Path, *lines: str) -> dict[str, Accuracy]:
    return dict(read(folder, "\n".join([TOML, "[accuracy]", *lines, ""])).accuracy)


ACCURACY: dict[str, tuple[str, Accuracy]] = {
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


@pytest.mark.parametrize(("line", "expected"), ACCURACY.values(), ids=ACCURACY.keys())
def test_an_accuracy_arrives_in_si(tmp_path: Path, line: str, expected: Accuracy) -> None:
    (found,) = accuracy(tmp_path, line).values()
    np.testing.assert_allclose((found.relative, found.absolute), (expected.relative, expected.absolute), rtol=1e-12)
    assert found.distribution == expected.distribution


def test_a_bound_is_a_rectangle_and_an_sd_is_itself() -> None:
    """GUM 4.3.7: u = a / sqrt 3; checked against the spread of what is equally likely within the bound."""
    within = np.random.default_rng(0).uniform(-0.01, 0.01, 200_000)
    assert Accuracy(0.01, 0.01).gain_sd == pytest.approx(np.std(within), rel=0.01)
    assert Accuracy(0.01, 0.01).offset_sd == pytest.approx(np.std(within), rel=0.01)
    assert Accuracy(0.01, 0.02, "normal").gain_sd == 0.01
    assert Accuracy(0.01, 0.02, "normal").offset_sd == 0.02


def test_no_accuracy_where_nothing_is_stated(tmp_path: Path) -> None:
    assert accuracy(tmp_path) == {}


WRONG_ACCURACY: dict[str, tuple[str, str]] = {
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


@pytest.mark.parametrize(("line", "message"), WRONG_ACCURACY.values(), ids=WRONG_ACCURACY.keys())
def test_each_mistake_of_an_accuracy_has_its_message(tmp_path: Path, line: str, message: str) -> None:
    with pytest.raises(MeasurementError) as caught:
        accuracy(tmp_path, line)
    assert re.search(message, str(caught.value), re.DOTALL), str(caught.value)
    assert caught.value.where.startswith(str(tmp_path / "rig.toml:"))
