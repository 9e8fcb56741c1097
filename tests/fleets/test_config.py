"""What fleet.toml and units.csv say is taken in SI, and what is wrong in them is said with its line."""

from __future__ import annotations

import datetime
import math
import pickle
from pathlib import Path

import pytest

from etcfit.errors import MeasurementError
from etcfit.fleets.config import FleetConfig, Member, read_fleet

TOML = """[fleet]
name = "line 4"
shared = ["K_b"]

[limits]
K_s = { low = 100, high = 160, unit = "mN*m/rad" }
opening_time = { high = 120, unit = "ms" }
theta_0 = { low = 5, unit = "deg" }

[rig]
gear_ratio = 20.68
"""
CSV = """unit,serial,date,batch,temperature_C,part,colour
b,0012,2026-07-31T14:05+02:00,x,23.5,p1,red

a,,2026-07-30,,,,
"""


def fleet(folder: Path, toml: str | None = None, csv: str | None = None, units: tuple[str, ...] = ("a", "b")) -> Path:
    for unit in units:
        (folder / unit).mkdir()
    for name, text in (("fleet.toml", toml), ("units.csv", csv)):
        if text is not None:
            (folder / name).write_text(text, encoding="utf-8")
    return folder


def test_a_fleet_needs_neither_file(tmp_path: Path) -> None:
    (tmp_path / ".git").mkdir()
    found = read_fleet(fleet(tmp_path))
    assert found == FleetConfig(tmp_path.name, str(tmp_path), (), {}, {"a": Member(), "b": Member()}, found.common)
    assert found.units == ("a", "b")
    assert found.common.tables == {}


def test_everything_is_taken_in_si(tmp_path: Path) -> None:
    found = read_fleet(fleet(tmp_path, TOML, CSV))
    assert (found.name, found.shared, found.units) == ("line 4", ("K_b",), ("b", "a"))
    stiffness, time, angle = (found.limits[name] for name in ("K_s", "opening_time", "theta_0"))
    assert (stiffness.low, stiffness.high) == pytest.approx((0.1, 0.16), rel=1e-14)
    assert (time.low, time.high, time.unit) == (-math.inf, pytest.approx(0.12), "s")
    assert (angle.low, angle.high, angle.unit) == (pytest.approx(math.radians(5)), math.inf, "rad")
    b = found.members["b"]
    assert b == Member("0012", datetime.datetime(2026, 7, 31, 12, 5), "x", None, None, b.temperature, "p1")
    assert b.temperature == pytest.approx(296.65)
    assert found.members["a"] == Member(date=datetime.datetime(2026, 7, 30))
    assert found.common.tables == {"rig": {"gear_ratio": 20.68}}
    assert pickle.loads(pickle.dumps(found)) == found  # it is sent to workers


def test_columns_may_have_other_names_and_separators(tmp_path: Path) -> None:
    toml = '[fleet]\nunits = "list.csv"\n[units]\nunit = "Nr."\nrig = "bench"\n'
    (tmp_path / "list.csv").write_bytes('\ufeffNr.;bench\r\nb;"k; 1"\r\na; k2 \r\n'.encode())
    found = read_fleet(fleet(tmp_path, toml))
    assert found.members == {"b": Member(rig="k; 1"), "a": Member(rig="k2")}


@pytest.mark.parametrize(
    ("toml", "said"),
    [
        ("[fleet]\nnane = 1\n", r"fleet.toml:2: fleet.nane: unknown key.*Did you mean 'name'"),
        ("[flet]\n", r"fleet.toml:1: flet: unknown key.*Did you mean 'fleet'"),
        ("[fleet]\nshared = 'K_b'\n", r"fleet.toml:2: fleet.shared: found 'K_b'. It must be a list of symbols"),
        ("[fleet\n", r"fleet.toml:1: .*fleet.toml must be valid TOML"),
        ("name = 'a'\n[fleet]\nname = 'b'\n", r"fleet.toml:1: name: \[fleet\] has a name too"),
        ("[limits]\nR_a = 3\n", r"fleet.toml:2: limits.R_a: found 3. It must name a unit"),
        ("[limits]\nR_a = {unit = 'ohm'}\n", r"fleet.toml:2: limits.R_a: .*low or high or both"),
        ("[limits]\nR_a = {low = 1, unit = 'ohn'}\n", r"fleet.toml:2: limits.R_a: unit 'ohn' is not known"),
        ("[limits]\nR_a = {low = 1, unit = 'ohm', hi = 2}\n", r"limits.R_a.hi: unknown key"),
        ("[limits]\nR_a = {low = 2, high = 1, unit = 'ohm'}\n", r"fleet.toml:2: limits.R_a: low is 2 and high is 1"),
        ("[limits]\nR_a = {low = 'x', unit = 'ohm'}\n", r"limits.R_a.low: found 'x'. It must be a number"),
        ("[fleet]\nunits = 'x.csv'\n", r"fleet.toml:2: fleet.units: found 'x.csv', which is not there"),
        ("[units]\nserial = 'nr'\n", r"fleet.toml:1: units: columns of units.csv, which is not there"),
        ("[rig]\nname = 'x'\n", r"fleet.toml:2: rig.name: .*every unit would have this name"),
        ("[rig]\n\ngear_ratio = 'x'\n", r"fleet.toml:3: rig.gear_ratio: found 'x'"),
        ("[tps]\nclosed = 1\n", r"fleet.toml:2: tps.closed: unknown key"),
    ],
)
def test_what_is_wrong_in_fleet_toml_is_said_with_its_line(tmp_path: Path, toml: str, said: str) -> None:
    with pytest.raises(MeasurementError, match=said):
        read_fleet(fleet(tmp_path, toml))


@pytest.mark.parametrize(
    ("csv", "said"),
    [
        ("unit\na\nb\na\n", r"units.csv:4: unit a has a row already, in line 2"),
        ("unit\na\nb\n\nbb\n", r"units.csv:5: unit bb has no folder.*Did you mean 'b'"),
        ("unit\nb\n", r"units.csv: no row for a. "),
        ("serial\na\nb\n", r"units.csv:1: no column 'unit' among serial"),
        ("unit,unit\na,a\n", r"units.csv:1: column 'unit' appears twice"),
        ("unit,date\na,31.7.2026\nb,\n", r"units.csv:2: date: '31.7.2026'. It must be a date of ISO 8601"),
        ("unit,temperature_C\na,\nb,warm\n", r"units.csv:3: temperature_C: 'warm'"),
        ("unit,temperature_C\na,\nb,-300\n", r"units.csv:3: temperature_C: '-300'"),
        ("unit,serial\na,1,2\nb,\n", r"units.csv:2: 3 cells. The header has 2"),
        ("unit,serial\n,1\n", r"units.csv:2: unit is empty"),
        ("", r"units.csv: it is empty"),
    ],
)
def test_what_is_wrong_in_units_csv_is_said_with_its_line(tmp_path: Path, csv: str, said: str) -> None:
    with pytest.raises(MeasurementError, match=said):
        read_fleet(fleet(tmp_path, None, csv))


def test_a_column_that_is_named_must_be_there(tmp_path: Path) -> None:
    with pytest.raises(MeasurementError, match=r"fleet.toml:2: units.serial: found 'nr'.*has: unit, Nr."):
        read_fleet(fleet(tmp_path, '[units]\nserial = "nr"\n', "unit,Nr.\na,1\nb,2\n"))


def test_many_folders_without_a_row_are_counted(tmp_path: Path) -> None:
    with pytest.raises(MeasurementError, match=r"no row for u0, u1, u2 and 5 more"):
        read_fleet(fleet(tmp_path, None, "unit\nu8\n", tuple(f"u{k}" for k in range(9))))
