"""Every table that a command prints, in a terminal of 80, 100 and 160 columns: names and figures whole, lines fit.

At 160 columns each is kept in tests/golden/.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Group, RenderableType
from rich.padding import Padding

import campaigns
import car_logs
import diagnoses
import fleet_pages
import folders
import results
from etcfit import read_folder
from etcfit.car_log import DriveLog, Series, study
from etcfit.control.design import PAPERS, ecu_of, task_of
from etcfit.control.frequency import frequency_response
from etcfit.control.linearise import reduce
from etcfit.control.loop_figures import FIGURES, LoopFigures
from etcfit.control.on_units import FleetVerdict, OneByOne, OnParts, PartsVerdict, Share
from etcfit.control.settings import FleetDesignSettings
from etcfit.estimation.agreement import Influence, Pull
from etcfit.estimation.identifiability import Identifiability
from etcfit.estimation.joint_fit import FitResult
from etcfit.estimation.result import Budget
from etcfit.experiment.advice import Advice, Option, Pair
from etcfit.experiment.check import ChannelCheck, CheckResult, Clock, TraceCheck
from etcfit.reporting.blocks import PlainTable, render
from etcfit.reporting.car_log import compared_table, drive_table
from etcfit.reporting.check_table import advice_table, check_table
from etcfit.reporting.control.gains import design_table
from etcfit.reporting.control.plant import reduction_table, sine_table
from etcfit.reporting.diagnosis import diagnosis_table
from etcfit.reporting.fleet import fleet_table
from etcfit.reporting.plan_sheet import plan_table
from etcfit.reporting.posterior import posterior_table
from etcfit.reporting.tables import fit_table
from etcfit.rig.base import Finding, RigConfig
from golden import check_view
from independent import hunting

WIDTHS = (80, 100, 160)
LONG = "response/second_day_with_the_new_harness/chirp_from_1_to_20_hertz.csv"


@pytest.fixture(scope="module")
def fit(tmp_path_factory: pytest.TempPathFactory) -> FitResult:
    """With all that a table of a fit may hold."""
    made = results.result(results.rig(tmp_path_factory.mktemp("rig")), lost=("J_m", "J_L"))
    sources = ("scale of current", "zero of position", "gear ratio")
    pulls = (Pull("response", None, "series_ohm.inductance", -34.0, -0.6),
             Pull("response", LONG, "series_ohm.inductance", -20.0, -0.4))  # fmt: skip
    return replace(
        made,
        budget=Budget(sources, np.full((3, made.x.size), 0.02), made.covariance),
        influence=Influence(pulls, {"B_m": "viscous"}),
    )


def of_check(fit: FitResult) -> RenderableType:
    channels = (ChannelCheck("motor_speed", "rad/s", -1234.5, 1234.5, 0.003, True, 0.00122, 3, 120, False),
                ChannelCheck("current", "mA", 7.0, 7.0, 0.1, False, 0.0, 0, 0, True))  # fmt: skip
    clock = Clock(123456, 1000.5, 1000.0, 0.012, 2, 0.02)
    traces = tuple(TraceCheck(file, "response", True, clock, channels) for file in (LONG, "response/1.csv"))
    rig = replace(fit.rig, findings=(Finding("series_resistance", 0.12, "ohm", 1e-6, "It is larger.", "Write it.",
                                             "response", LONG, "motor_speed", True),))  # fmt: skip
    verdict = Identifiability(("R_a",), np.array([12.0]), (), np.eye(1), ("R_a",))
    return check_table(CheckResult(rig, traces, verdict, ("R_a is hardly seen.",), None, ("a stray file",)))


def of_advice(fit: FitResult) -> RenderableType:
    symbols = fit.free_parameters.layout.free
    shrinks = np.linspace(0.1234, 1.0, len(symbols))
    pair = Pair(("T_PL", "series_ohm.inductance"), 0.999, 0.123)
    says = "a step of 6 V for 0.5 s, a sweep from 1 to 20 Hz, and a slow ramp over the whole travel"
    tests = ("viscous", "static_load", "closed_loop", "back_emf", "inductance", "resistance", "response")
    options = tuple(Option(test, says, "noise assumed", shrinks, pair, None) for test in tests)
    return advice_table(Advice(fit.rig, symbols, shrinks, options, (("sine", "no ECU"),)))


def of_drive(fit: FitResult) -> RenderableType:
    log = car_logs.drive()
    position, setpoint = (Series(log["time"], log[name]) for name in ("position", "setpoint"))
    name = "2026-07-14_motorway_and_town_warm_engine.csv"
    rng = np.random.default_rng(2)
    plate, pid = hunting.drawn("stick-slip", rng)
    wanted = np.concatenate((hunting.staircase(rng, 16.0, 8.0), hunting.staircase(rng, 20.0, 0.8)))
    more = hunting.logged(rng, wanted, *hunting.run(plate, pid, wanted, 0.02, rng), 100.0, 0.05, 0.1)
    shown = {name: Series(more["time"], more[name]) for name in ("position", "setpoint", "duty")}
    volts = {"sensor 1": 0.6 + 0.037 * shown["position"].value, "sensor 2": 4.5 - 0.06 * shown["position"].value}
    others = {"duty": shown["duty"]} | {key: Series(more["time"], np.maximum(each, 0.5)) for key, each in volts.items()}
    bare, full = (
        DriveLog(name, position, setpoint),
        DriveLog("b.csv", shown["position"], shown["setpoint"], others=others),
    )
    every = [study(bare), study(full)]
    return Group(drive_table(RigConfig("car"), every), compared_table(RigConfig("car"), *every))


def of_sines(fit: FitResult, folder: Path) -> RenderableType:
    time = np.arange(0.0, 12.0, 0.002)
    rng = np.random.default_rng(3)
    columns = [f(2.0 * np.pi * 2.0 * time) for f in (np.sin, lambda phase: 0.9 * np.sin(phase - 0.4), np.cos)]
    wanted, angle, volts = (middle + size * column for middle, size, column in
                            zip((40.0, 40.0, 4.0), (9.0, 9.0, 2.0), columns, strict=True))  # fmt: skip
    angle = angle + 0.02 * rng.standard_normal(time.size)
    sheet = folders.sheet("time [s]", "setpoint [deg]", "position [deg]", "voltage [V]",
                          columns=(time, wanted, angle, volts))  # fmt: skip
    rig = read_folder(folders.write(folder, folders.good() | {"sine/2_Hz.csv": sheet.text()}))
    traces = [trace for trace in rig.measurements if trace.test == "sine"]
    response = frequency_response(fit.fitted(), traces)
    assert response.points, response.warnings
    return Group(reduction_table(fit.fitted(), reduce(fit.fitted()), 0), sine_table(fit.fitted(), response))


def of_design(fit: FitResult) -> RenderableType:
    """By quick rules, on a fleet and on the parts of one as well, judged by hand."""
    fitted = fit.fitted()
    task = task_of(fitted, ecu_of(fitted), PAPERS, settings=results.BRIEF)
    design = results.proposed(fitted, task, "manual", "damping_optimum")
    units = tuple(f"serial_{k}_of_line_4_week_31" for k in range(3))
    figures = LoopFigures(**{symbol: np.array([1.0, 2.0, 1234.5]) for symbol in FIGURES})
    each = OneByOne(units, figures, PAPERS)
    on = OnParts(each, each)
    parts = PartsVerdict("runs/line", "line 4", ("J_m",), {"u100": "odd"}, {"manual": on, "damping_optimum": on}, each,
                         each)  # fmt: skip
    fleet = FleetVerdict(FleetDesignSettings(), each, Share(2, 3, 0.1, 0.9), 1)
    return design_table(replace(design, fleet=fleet, parts=parts))


def of_fleet(fit: FitResult) -> RenderableType:
    return fleet_table(fleet_pages.fleet(synthetic=fit.rig.config.synthetic).content)


TABLES: dict[str, Callable[[FitResult], RenderableType]] = {
    "fit": fit_table,
    "fit of a compromise": lambda fit: fit_table(results.compromised(fit)),
    "check": of_check,
    "check --advise": of_advice,
    "plan": lambda fit: plan_table(campaigns.campaign(fit.rig)),
    "diagnose": lambda fit: diagnosis_table(diagnoses.diagnosis(fit.rig)),
    "sample": lambda fit: posterior_table(results.posterior_of(fit, 60), results.profiles_of(fit)),
    "drive": of_drive,
    "fleet": of_fleet,
    "design": of_design,
}


def tables_in(part: Any) -> list[PlainTable]:
    """All of them, however deep."""
    if isinstance(part, Group):
        return [table for each in part.renderables for table in tables_in(each)]
    return tables_in(part.renderable) if isinstance(part, Padding) else [part] if isinstance(part, PlainTable) else []


def check_whole(table: PlainTable, width: int) -> None:
    """Each cell on one line; sentences fold at spaces, file names at "/"; what is missing is said to be."""
    text = render(table, width)
    lines, said = text.splitlines(), " ".join(text.split()).rpartition("Left out at a width of ")[2]
    assert max(map(len, lines)) <= width
    for k, column in enumerate(table.columns):
        if column.head in table.spare and column.head in said:
            continue
        assert all(any(word in line for line in lines) for word in column.head.split())
        for row in table.rows:
            cell = row[k].plain
            parts = (
                cell.split()
                if column.kind == "prose"
                else cell.replace("/", "/\0").split("\0")
                if column.kind == "path"
                else [cell]
            )
            for part in parts:
                assert any(part in line for line in lines), (column.head, part, width)


def check_fits(part: RenderableType, width: int) -> None:
    tables = tables_in(part)
    assert tables
    for table in tables:
        assert table.columns[0].head not in table.spare, "it says what a row is of"
        check_whole(table, width)
    text = render(part, width)
    assert max(map(len, text.splitlines())) <= width
    assert "…" not in text


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize(
    "command", [pytest.param(name, marks=pytest.mark.slow if name == "design" else ()) for name in TABLES]
)
def test_nothing_is_cut(command: str, width: int, fit: FitResult, made: dict[str, RenderableType]) -> None:
    if command not in made:
        made[command] = TABLES[command](fit)
    check_fits(made[command], width)
    if width == max(WIDTHS) and command not in ("sample", "design"):  # digits of a chain are those of one machine
        check_view(f"tables/{command}.txt", render(made[command], width), Path(fit.rig.folder))


@pytest.fixture(scope="module")
def made() -> dict[str, RenderableType]:
    """What was built, by command: each is built once for all widths."""
    return {}


def test_nothing_of_sines_is_cut(fit: FitResult, tmp_path: Path) -> None:
    part = of_sines(fit, tmp_path / "sines")
    for width in WIDTHS:
        check_fits(part, width)


@pytest.mark.parametrize("command", sorted(TABLES.keys() - {"sample", "design", "drive"}))
def test_measured_data_are_not_called_made_up(command: str, fit: FitResult) -> None:
    """Made-up data are called so in tests/golden/."""
    measured = replace(fit, rig=replace(fit.rig, config=replace(fit.rig.config, synthetic=False)))
    assert "SYNTHETIC" not in render(TABLES[command](measured), 160)


def test_what_is_spared_first_in_a_fit_is_the_meaning(fit: FitResult) -> None:
    first, *_ = tables_in(fit_table(fit))
    assert first.spare[0] == "meaning"
    assert "meaning" not in render(fit_table(fit), 80).splitlines()[1]
