"""What units tell together, from results made by hand: studied, written, read back; no fit."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import etcfit
from etcfit.api.fleet import Fleet
from etcfit.api.fleet_work import refuse_wrong_limits, rig_of_one
from etcfit.errors import MeasurementError, UsageError
from etcfit.fleets.config import FleetConfig, read_fleet
from etcfit.fleets.fitting import FitWork, Results
from etcfit.fleets.study import FleetStudy, study
from etcfit.fleets.unit import FailedUnit, TraceMisfit, UnitEstimate, UnitParameter, UnitResult
from etcfit.rig.config import config_of
from etcfit.run_folder.fleet import UNITS, parts_of, read_fleet_files, save_fleet
from etcfit.run_folder.manifest import FLEET
from schemas import read_valid

N = 20.68
DESIGN = {"R_a": 1.5, "L_a": 1.5e-3, "K_b": 0.016, "J_eq": 1.7e-3, "B_eq": 9.0e-3, "K_s": 0.13, "T_PL": 0.35,
          "T_f": 0.2}  # fmt: skip
SPREAD, KNOWN = 0.04, 0.005  # between units, and of one unit's own data; shares of the mean
UNITS_MADE = 12
FLEET_TOML = f"""[fleet]
name = "by hand"

[rig]
gear_ratio = {N}
supply_V = 12.0
synthetic = true

[limits]
K_s = {{ low = 100, high = 160, unit = "mN*m/rad" }}
opening_time = {{ high = 500, unit = "ms" }}
"""


def fleet_folder(path: Path, toml: str = FLEET_TOML) -> FleetConfig:
    names = [f"u{k:02d}" for k in range(UNITS_MADE)]
    for name in [*names, "wrong"]:
        (path / name / "response").mkdir(parents=True)
        (path / name / "rig.toml").write_text(f'[rig]\nname = "{name}"\n', encoding="utf-8")
    (path / "fleet.toml").write_text(toml, encoding="utf-8")
    rows = [f"{name},S{k},2026-07-{k + 1:02d},B{k // 6},{20 + k}" for k, name in enumerate([*names, "wrong"])]
    text = "\n".join(["unit,serial,date,batch,temperature_C", *rows, ""])
    (path / "units.csv").write_text(text, encoding="utf-8")
    return read_fleet(path)


def result_of(unit: str, values: Mapping[str, float]) -> UnitResult:
    """A unit that is known to be so, whatever motor and plate have of the sums."""
    symbols, value = tuple(values), np.array(list(values.values()))
    stderr = KNOWN * np.abs(value)
    known = {s: UnitParameter(v, "1", e, v - 2 * e, v + 2 * e, "estimated")
             for s, v, e in zip(symbols, value.tolist(), stderr.tolist(), strict=True)}  # fmt: skip
    parts = {"K_m": values["K_b"], "J_m": 0.5 * values["J_eq"] / N**2, "J_L": 0.5 * values["J_eq"],
             "B_m": 0.5 * values["B_eq"] / N**2, "B_L": 0.5 * values["B_eq"]}  # fmt: skip
    known |= {s: UnitParameter(v, "1", None, None, None, "not identifiable") for s, v in parts.items()}
    own = UnitEstimate(unit, symbols, value, np.diag(1.0 / stderr**2))
    traces = (TraceMisfit("response/1.csv", "response", 1.0),)
    return UnitResult(own, known, traces, 1.0, unit != "u03", "made by hand", True, "", 1.0, ("by hand",))


@dataclass(frozen=True)
class Kept:
    config: FleetConfig
    known: FleetStudy
    run: Path


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Kept:
    """A fleet studied and saved."""
    config = fleet_folder(tmp_path_factory.mktemp("fleet"))
    rng = np.random.default_rng(8101)
    fitted = tuple(result_of(unit, {s: v * (1.0 + SPREAD * rng.standard_normal()) for s, v in DESIGN.items()})
                   for unit in config.units if unit != "wrong")  # fmt: skip
    failed = (FailedUnit("wrong", "wrong/response: no trace. <Record> one."),)
    toml = rig_of_one(config)
    results = Results(fitted, failed, FitWork(config.location, config.common))
    known = study(config, config_of(toml, "fleet"), results)
    run = tmp_path_factory.mktemp("run")
    save_fleet(run, known, toml, {"u05": "units/u05/report.html"})
    return Kept(config, known, run)


def test_what_is_written_fits_the_schema(kept: Kept) -> None:
    written = read_valid(kept.run / FLEET)
    assert written["units"] == [f"u{k:02d}" for k in range(UNITS_MADE)]
    assert written["synthetic"] is True
    assert [each["unit"] for each in written["failed"]] == ["wrong"]
    assert [each["unit"] for each in written["not_converged"]] == ["u03"]
    assert written["members"]["u05"]["page"] == "units/u05/report.html"
    assert written["members"]["u02"]["temperature"] == pytest.approx(295.15)  # SI in the file


def test_every_value_given_is_found_again_in_the_table(kept: Kept) -> None:
    frame = read_fleet_files(kept.run).units
    assert len(frame) == sum(len(unit.parameters) for unit in kept.known.fitted)
    for unit in kept.known.fitted:
        own = frame[frame["unit"] == unit.unit].set_index("symbol")
        assert own["value"].to_dict() == {symbol: known.value for symbol, known in unit.parameters.items()}
        assert own.loc["J_m", "status"] == "not identifiable"
        assert np.isnan(own.loc["J_m", "stderr"])  # pyright: ignore[reportArgumentType, reportCallIssue]


def test_a_unit_is_drawn_towards_the_population_by_the_closed_form(kept: Kept) -> None:
    found = kept.known.population
    # own errors are an eighth of the spread: what a unit keeps of its distance from the mean is s^2 / (s^2 + e^2)
    for symbol in ("K_s", "R_a", "T_f"):
        k = found.symbols.index(symbol)
        value = np.array([unit.parameters[symbol].value for unit in kept.known.fitted])
        keeps = found.sd[k] ** 2 / (found.sd[k] ** 2 + (KNOWN * DESIGN[symbol]) ** 2)
        drawn = kept.known.shrunk.estimate[:, kept.known.shrunk.symbols.index(symbol)]
        # correlations as estimated move it beside: by less than the error of the unit itself
        assert np.abs(drawn - found.mean[k] - keeps * (value - found.mean[k])).max() < KNOWN * DESIGN[symbol]
        low, high = found.mean_interval[k]
        assert low < value.mean() < high


def test_parts_of_a_sum_add_up_to_what_the_fleet_tells_of_it(kept: Kept) -> None:
    values, shrunk = kept.known.model.values, kept.known.shrunk
    for motor, plate, whole in (("J_m", "J_L", "J_eq"), ("B_m", "B_L", "B_eq")):
        told = shrunk.estimate[:, shrunk.symbols.index(whole)]
        np.testing.assert_allclose(N**2 * values[motor] + values[plate], told, rtol=1e-9)
        np.testing.assert_allclose(values[plate] / told, 0.5, rtol=1e-9)  # their shares stay those of the units


def test_the_model_read_back_is_the_model_saved(kept: Kept) -> None:
    again, model = Fleet.in_run(kept.run).model, kept.known.model
    assert again.units == model.units
    assert set(again.values) == set(model.values)
    for symbol, value in model.values.items():
        np.testing.assert_allclose(again.values[symbol], value, rtol=1e-12)


def test_the_population_read_back_is_the_law_of_a_unit_not_made_yet(kept: Kept) -> None:
    law, found = Fleet.in_run(kept.run).model.law, kept.known.population
    assert law.symbols == found.symbols
    assert law.units == len(found.units)
    np.testing.assert_allclose(law.mean, found.mean)
    np.testing.assert_allclose(law.sd, found.sd)
    np.testing.assert_allclose(law.correlation, found.correlation)
    # degrees of freedom of the interval are the units less one where all are known alike
    np.testing.assert_allclose(law.stderr, found.mean_stderr, rtol=0.02)
    assert [s for s, positive in zip(law.symbols, law.positive, strict=True) if not positive] == ["T_PL"]


def test_parts_are_the_units_that_can_be_trusted_and_the_others_are_named(kept: Kept) -> None:
    parts = parts_of(kept.run)
    assert (parts.where, parts.name) == (str(kept.run), "by hand")
    no_result = "no result: wrong/response: no trace. <Record> one."
    assert parts.left_out == {"u03": "did not converge: made by hand", "wrong": no_result}
    assert parts.model.units == tuple(unit for unit in kept.known.model.units if unit != "u03")
    assert {"J_m", "J_L", "B_m", "B_L", "K_m", "R_a"} <= set(parts.model.identifiable_symbols)


def spoilt(kept: Kept, run: Path, **changes: object) -> Path:
    """A copy of the fleet's run with some keys of fleet.json replaced."""
    shutil.copytree(kept.run, run)
    written = json.loads((run / FLEET).read_text(encoding="utf-8")) | changes
    (run / FLEET).write_text(json.dumps(written), encoding="utf-8")
    return run


def test_an_odd_unit_is_no_part_of_the_design(kept: Kept, tmp_path: Path) -> None:
    odd = [{"unit": "u07", "why": "its K_s is 9 sd off"}]
    parts = parts_of(spoilt(kept, tmp_path / "run", odd=odd, left_out=["u07"]))
    assert parts.left_out["u07"] == "odd: its K_s is 9 sd off"
    assert "u07" not in parts.model.units
    assert parts.model.law.units == UNITS_MADE - 1


def test_a_mean_without_an_interval_is_taken_to_be_exact(kept: Kept, tmp_path: Path) -> None:
    population = json.loads((kept.run / FLEET).read_text(encoding="utf-8"))["population"]
    population["R_a"]["mean_ci95"] = [None, None]
    law = parts_of(spoilt(kept, tmp_path / "run", population=population)).model.law
    assert law.stderr[law.symbols.index("R_a")] == 0.0
    assert np.all(np.delete(law.stderr, law.symbols.index("R_a")) > 0.0)


def test_too_few_units_are_no_source_of_parts(kept: Kept, tmp_path: Path) -> None:
    few = spoilt(kept, tmp_path / "run", left_out=[f"u{k:02d}" for k in range(8)])
    with pytest.raises(UsageError, match=r"known from 4 units, too few to say how parts scatter. Measure 5 at least"):
        parts_of(few)


def test_a_folder_without_a_fleet_is_no_source_of_parts(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"holds no fleet .* Run `etcfit fleet FLEET"):
        parts_of(tmp_path)


def test_frames_hold_what_the_file_holds(kept: Kept) -> None:
    fleet = Fleet.in_run(kept.run)
    assert list(fleet.members.index) == [unit.unit for unit in kept.known.fitted]
    assert list(fleet.population.index) == list(kept.known.population.symbols)
    np.testing.assert_allclose(fleet.population["sd"].to_numpy(dtype=float), kept.known.population.sd)
    assert fleet.correlation.shape == (len(DESIGN), len(DESIGN))
    assert list(fleet.failed.index) == ["wrong"]
    assert fleet.charts.groupby("symbol").size().to_dict() == dict.fromkeys(DESIGN, UNITS_MADE)
    assert set(fleet.figures.index) == set(kept.known.figures)
    assert "by hand" in repr(fleet)
    assert "SYNTHETIC" in repr(fleet)
    assert "u03" in fleet.summary()
    for frame in (fleet.odd, fleet.drift, fleet.gauge, fleet.effects, fleet.predictions):
        assert frame.notna().any().any() or frame.empty


def test_limits_come_in_any_unit_and_are_kept_in_that_of_the_symbol(kept: Kept) -> None:
    table = Fleet.in_run(kept.run).capability
    assert list(table.index) == ["K_s", "opening_time"]
    assert table.loc["K_s", "low"] == pytest.approx(0.1)
    assert table.loc["opening_time", "high"] == pytest.approx(0.5)
    assert table.loc["opening_time", "unit"] == "s"


@pytest.mark.parametrize(
    ("there", "wrong", "line"), [("K_s = {", "K_spring = {", 10), ('name = "by hand"', 'shared = ["K_bb"]', 2)]
)
def test_what_the_model_does_not_have_is_refused_with_the_line(
    tmp_path: Path, there: str, wrong: str, line: int
) -> None:
    config = fleet_folder(tmp_path, FLEET_TOML.replace(there, wrong))
    with pytest.raises(MeasurementError, match=rf"fleet.toml:{line}\b.*this fleet's model has no"):
        refuse_wrong_limits(config, config_of(rig_of_one(config), "fleet"))


@pytest.mark.parametrize("given", ["mm", "N*m", "V*s/rad"])
def test_a_limit_in_a_unit_of_something_else_is_refused_with_the_line(tmp_path: Path, given: str) -> None:
    config = fleet_folder(tmp_path, FLEET_TOML.replace("mN*m/rad", given))
    with pytest.raises(MeasurementError, match=rf"fleet.toml:10\b.*'{re.escape(given)}'.*K_s is in N\*m/rad"):
        refuse_wrong_limits(config, config_of(rig_of_one(config), "fleet"))


@pytest.mark.parametrize(
    ("name", "given"),
    [("K_s", "mN*m/deg"), ("J_eq", "g*cm^2"), ("J_eq", "kg*m2"), ("R_a", "mohm"), ("opening_time", "ms"),
     ("supply_response", "1")],
)  # fmt: skip
def test_a_limit_in_any_unit_of_its_own_kind_is_taken(tmp_path: Path, name: str, given: str) -> None:
    text = FLEET_TOML.replace("K_s = {", f"{name} = {{").replace("mN*m/rad", given)
    config = fleet_folder(tmp_path, text if name != "opening_time" else FLEET_TOML)
    refuse_wrong_limits(config, config_of(rig_of_one(config), "fleet"))


def test_another_versions_run_is_refused(kept: Kept, tmp_path: Path) -> None:
    content = json.loads((kept.run / FLEET).read_text(encoding="utf-8")) | {"version": "0.1.0"}
    (tmp_path / FLEET).write_text(json.dumps(content), encoding="utf-8")
    (tmp_path / UNITS).write_bytes((kept.run / UNITS).read_bytes())
    with pytest.raises(etcfit.UsageError, match=r"was written by etcfit 0\.1\.0"):
        read_fleet_files(tmp_path)
