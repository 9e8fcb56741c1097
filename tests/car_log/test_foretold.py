"""Logs of second-order loops beside what their closed forms foretell."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import etcfit
from etcfit.car_log.foretold import Foretold, held_against
from etcfit.car_log.log import DriveLog
from etcfit.car_log.study import Study, study
from etcfit.cli import app
from etcfit.errors import MeasurementError
from independent.second_order import answer, overshoot, settled
from schemas import read_valid
from second_order import log

UP_AND_BACK = [30.0, 10.0, 70.0, 10.0, 70.0, 10.0, 40.0]
HOLD = 0.5


def studied(zeta: float, wn: float, levels: list[float] = UP_AND_BACK, noise: float = 0.03, seed: int = 1) -> Study:
    position, wanted = log(levels, zeta, wn, 500.0, noise, seed)
    return study(DriveLog("next.csv", position, wanted))


def told_of(zeta: float, wn: float, before: tuple[float, float] | None = None, off: float = 0.2) -> Foretold:
    """Half a per cent about the closed form."""

    def about(value: float) -> tuple[float, float, float]:
        return 0.995 * value, value, 1.005 * value

    def error(zeta: float, wn: float) -> float:
        t = np.linspace(0.0, HOLD, 20_001)
        return 60.0 * math.sqrt(float(np.mean((answer(t, zeta, wn) - 1.0) ** 2)))

    return Foretold(10.0, 70.0, HOLD, about(overshoot(zeta)), about(settled(zeta, wn, 0.02)), about(error(zeta, wn)),
                    None if before is None else about(error(*before)), off)  # fmt: skip


@pytest.mark.parametrize(("zeta", "wn"), [(0.456, 30.0), (0.6, 50.0), (0.8, 25.0), (1.5, 60.0)])
def test_the_loop_that_was_foretold_is_as_foretold(zeta: float, wn: float) -> None:
    found = held_against(studied(zeta, wn), told_of(zeta, wn, before=(zeta, 0.5 * wn)))
    assert found.steps == 4
    assert found.as_foretold
    assert (found.better, found.unchanged) == (True, False)
    error = found.figures[-1]
    assert error.found == pytest.approx(0.5 * (error.low + error.high), rel=0.03)  # far within what is allowed


@pytest.mark.parametrize(
    ("loop", "off"),
    [((0.25, 50.0), "overshoot"), ((0.6, 12.0), "settling"), ((0.6, 25.0), "error of the step (rms)"),
     ((0.6, 100.0), "error of the step (rms)")],
)  # fmt: skip
def test_another_loop_is_not(loop: tuple[float, float], off: str) -> None:
    found = held_against(studied(*loop), told_of(0.6, 50.0))
    assert not found.as_foretold
    assert off in {figure.name for figure in found.figures if not figure.as_foretold}


def test_a_calmer_loop_of_the_same_error_is_no_warning() -> None:
    """Less overshoot than foretold."""
    found = held_against(studied(0.7, 50.0), told_of(0.6, 50.0))
    assert found.figures[0].found < found.figures[0].low - 3.0
    assert found.as_foretold


def test_gains_that_nobody_typed_in_are_recognised() -> None:
    found = held_against(studied(0.6, 25.0), told_of(0.6, 50.0, before=(0.6, 25.0)))
    assert (found.as_foretold, found.unchanged) == (False, True)


def test_what_tracks_no_better_than_before_is_not_as_foretold_however_wide_the_range() -> None:
    told = told_of(0.6, 50.0, before=(0.6, 30.0), off=3.0)
    found = held_against(studied(0.6, 28.0), told)
    assert all(figure.as_foretold for figure in found.figures)
    assert (found.better, found.as_foretold) == (False, False)


def test_a_plate_that_needs_longer_than_the_step_is_held_never_settles() -> None:
    told = told_of(0.2, 30.0)
    forever = Foretold(**{**vars(told), "settling": (math.inf,) * 3})
    settling = held_against(studied(0.2, 30.0), forever).figures[1]
    assert settling.found == math.inf
    assert settling.as_foretold  # never was foretold


@pytest.mark.parametrize(("levels", "missing"), [([10.0, 70.0], "back"), ([20.0, 60.0, 20.0], "up or back")])
def test_a_log_without_such_steps_is_refused_with_what_to_record(levels: list[float], missing: str) -> None:
    with pytest.raises(MeasurementError, match=f"{missing}, held for 0.5 s.*Log steps of the target from 10 to 70 %"):
        held_against(studied(0.6, 50.0, levels), told_of(0.6, 50.0))


def ran(folder: Path, zeta: float, wn: float, why_not: str | None = None) -> Path:
    """A run of `etcfit tune`, as far as it matters here."""
    told = told_of(zeta, wn)
    step = {"overshoot_pct": told.overshoot, "settling_s": told.settling, "error_pct": told.error}
    present = {"overshoot_pct": [0.0] * 3, "settling_s": [None] * 3, "error_pct": [20.0, 20.1, 20.2]}
    gains = ((1.0, 5.0, 0.01), (2.0, 10.0, 0.02), (4.0, 20.0, 0.04))
    steps = [{"name": name, "gains": dict(zip("PID", each, strict=True)), **figures}
             for name, each, figures in zip(("present", "half_way", "proposed"), gains, (present, step, step),
                                            strict=True)]  # fmt: skip
    content = {"schema": "etcfit.tune/1", "why_not": why_not, "ecu": "rusefi", "steps": steps,
               "held_out": {"rms_pct": 0.2},
               "borne": [{"worst": 0.1}, {"worst": 0.2}], "options": ["--ecu", "rusefi", "--supply", "12.6"],
               "large_steps": {"low_pct": 10.0, "high_pct": 70.0, "hold_s": 0.5}}  # fmt: skip
    folder.mkdir(parents=True)
    (folder / "tune.json").write_text(json.dumps(content), encoding="utf-8")
    return folder


def written(path: Path, zeta: float, wn: float, levels: list[float] = UP_AND_BACK) -> Path:
    position, wanted = log(levels, zeta, wn, 500.0, 0.03, 1)
    rows = zip(position.time, position.value, wanted.value, strict=True)
    lines = ["time [s],position [%],setpoint [%]", *(",".join(f"{cell:.4f}" for cell in row) for row in rows)]
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return path


def test_the_command_leads_on_or_back_and_writes_it_down(tmp_path: Path) -> None:
    run = ran(tmp_path / "runs" / "car", 0.6, 50.0)
    good, bad = written(tmp_path / "next.csv", 0.6, 50.0), written(tmp_path / "bad.csv", 0.25, 30.0)
    done = CliRunner().invoke(app, ["drive", str(good), "--foretold", str(run), "--out", str(tmp_path / "out"), "-q"])
    assert done.exit_code == 0, done.output
    assert "Answer: As foretold for the half-way gains" in done.stdout
    assert f"etcfit drive NEXT_LOG --foretold {run} --made-with proposed" in done.stdout
    told = read_valid(tmp_path / "out" / "drive.json")
    assert (told["foretold"]["as_foretold"], told["foretold"]["steps"]) == (True, 4)
    done = CliRunner().invoke(app, ["drive", str(bad), "--foretold", str(run), "-q"])
    assert done.exit_code == 0  # an answer is no error
    assert "Answer: Not as foretold for the half-way gains: overshoot" in done.stdout
    again = f"etcfit tune {bad} --ecu rusefi --supply 12.6 --present 2.000,10.00,0.02000 --out {run}_2"
    assert done.stdout.strip().endswith(again)


def test_python_says_the_same(tmp_path: Path) -> None:
    found = etcfit.drive(
        written(tmp_path / "bad.csv", 0.25, 30.0), foretold=ran(tmp_path / "car", 0.6, 50.0), quiet=True
    )
    assert found.foretold is not None
    assert not found.foretold.found.as_foretold
    assert found.foretold.says.startswith("Not as foretold for the half-way gains: overshoot")


@pytest.mark.parametrize(
    ("words", "status", "said"),
    [
        ("small.csv --foretold run", 1, "no step from 10 to 70 % of the travel up or back"),
        ("next.csv --foretold empty", 2, "there is no tune.json"),
        ("next.csv --foretold withheld", 2, "it gave no gains, so nothing was foretold"),
        ("next.csv --foretold run --made-with third", 2, "foretells present, half_way, proposed"),
        (". --foretold run", 2, "--foretold takes one log"),
        ("next.csv --made-with proposed", 2, "--made-with goes with --foretold"),
        (". --foretold run --compare next.csv small.csv", 2, "exclude each other"),
    ],
)
def test_what_cannot_be_held_against_it_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: str, status: int, said: str
) -> None:
    ran(tmp_path / "run", 0.6, 50.0)
    ran(tmp_path / "withheld", 0.6, 50.0, "The parameters are a compromise.")
    (tmp_path / "empty").mkdir()
    written(tmp_path / "next.csv", 0.6, 50.0)
    written(tmp_path / "small.csv", 0.6, 50.0, [20.0, 60.0, 20.0])
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["drive", *words.split(), "-q"])
    assert (done.exit_code, done.stdout) == (status, "")
    assert said in done.stderr
