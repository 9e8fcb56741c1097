"""`etcfit reduce` on sine traces of the independent generator: a plant with friction under an engine computer."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import results
from etcfit.cli import app
from etcfit.run_folder.state import save_fit
from independent.bench_twin import TRUTH, UNDECLARED
from independent.control import follow
from independent.instruments import Bench
from independent.simulate import throttle
from independent.sines import COMPUTER, write_sines
from independent.truth import OPEN

ROOT = Path(__file__).parents[3]
FREQUENCIES = (1.0, 2.0, 4.0, 7.0, 10.0)


def another_sine(folder: Path, seed: int) -> list[str]:
    """The lines of a sine of 2 Hz, logged once more."""
    folder.mkdir()
    write_sines(folder, seed, TRUTH, UNDECLARED, COMPUTER, Bench(), (2.0,))
    return (folder / "sine" / "2_Hz.csv").read_text(encoding="utf-8").splitlines()


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The committed fit of the bench twin, beside its measurements and five sines; two more files say nothing."""
    base = tmp_path_factory.mktemp("sines")
    folder = base / "measurements" / "bench_twin"
    shutil.copytree(ROOT / "measurements" / "bench_twin", folder)
    write_sines(folder, 1, TRUTH, UNDECLARED, COMPUTER, Bench(), FREQUENCIES)
    # records of their own: one record under two names is refused
    _, head, *rows = another_sine(base / "second", 2)
    (folder / "sine" / "nameless.csv").write_text("\n".join([head.replace("setpoint [deg]", "ignore"), *rows]), "utf-8")
    _, head, *rows = another_sine(base / "third", 3)
    (folder / "sine" / "short.csv").write_text("\n".join([head, *rows[: 400 + 900]]), "utf-8")
    with (folder / "rig.toml").open("a", encoding="utf-8") as toml:
        toml.write('\n[columns]\n"ignore" = "ignore"\n')
    save_fit(base / "run", results.bench_twin(folder))
    return base / "run"


@pytest.fixture(scope="module")
def reduced(run: Path) -> tuple[str, dict[str, Any]]:
    done = CliRunner().invoke(app, ["reduce", str(run), "--quiet"])
    assert done.exit_code == 0, done.output
    return done.stdout, json.loads((run / "frequency_response.json").read_text(encoding="utf-8"))


def truth(frequency: float) -> complex:
    """The loop itself, without sensors, over cycles that have settled."""
    ticks = np.arange(round(20.0 / frequency * 1000.0)) / 1000.0
    wanted = OPEN * (0.4 + 0.1 * np.sin(2.0 * np.pi * frequency * ticks))
    angle, _ = follow(throttle(TRUTH, UNDECLARED), COMPUTER, wanted)
    late = ticks >= 10.0 / frequency
    phase = 2.0 * np.pi * frequency * ticks[late]
    columns = np.column_stack([np.ones(phase.size), np.cos(phase), np.sin(phase)])
    (_, a, b), (_, c, d) = np.linalg.lstsq(columns, np.stack([angle, wanted], axis=1)[late], rcond=None)[0].T
    return complex((a - 1j * b) / (c - 1j * d))


@pytest.mark.slow
def test_the_loop_is_measured_as_it_is(reduced: tuple[str, dict[str, Any]]) -> None:
    points = reduced[1]["points"]
    assert [round(point["frequency_Hz"], 3) for point in points] == list(FREQUENCIES)
    for point in points:
        found = point["measured"]["closed_loop"]
        off = np.log(found["magnitude"]) + 1j * found["phase_rad"] - np.log(truth(point["frequency_Hz"]))
        assert abs(off.real) < 0.005
        assert abs(off.imag) < 0.005
        low, high = found["magnitude_ci95"]
        assert low < found["magnitude"] < high < 1.02 * low


@pytest.mark.slow
def test_the_fitted_model_describes_the_plant_and_the_linear_one_does_not(reduced: tuple[str, dict[str, Any]]) -> None:
    for point in reduced[1]["points"]:
        measured, modelled = point["measured"], point["modelled"]
        for name in ("plant", "closed_loop"):
            fitted, linear, seen = modelled[f"nonlinear_{name}"], modelled[f"linear_{name}"], measured[name]
            assert fitted["magnitude"] == pytest.approx(seen["magnitude"], rel=0.01)
            assert fitted["phase_rad"] == pytest.approx(seen["phase_rad"], abs=0.01)
            assert abs(np.log(linear["magnitude"] / seen["magnitude"])) > 0.02
        assert modelled["linear_plant"]["magnitude"] > 1.2 * measured["plant"]["magnitude"]  # friction takes its share
        assert point["outside_fundamental"]["position"] > 3.0 * point["position_noise"]  # and bends the sine


@pytest.mark.slow
def test_what_says_nothing_is_named_and_the_rest_is_shown(run: Path, reduced: tuple[str, dict[str, Any]]) -> None:
    table, response = reduced
    assert response["schema"] == "etcfit.frequency_response/1"
    assert response["synthetic"] is True
    nameless, short = response["warnings"]
    assert nameless.startswith("sine/nameless.csv: no setpoint among")
    assert short.startswith("sine/short.csv: 1.8 cycles of 2 Hz")
    assert "SYNTHETIC DATA" in table
    assert "sine/nameless.csv" in table
    assert response["order"]["closed_loop"]["says"][:40] in " ".join(table.split())
    assert (run / "pictures" / "control" / "sines.png").stat().st_size > 20_000


@pytest.mark.slow
def test_without_sines_no_response_is_left(run: Path, reduced: tuple[str, dict[str, Any]]) -> None:
    shutil.rmtree(run.parent / "measurements" / "bench_twin" / "sine")
    save_fit(run, results.bench_twin(run.parent / "measurements" / "bench_twin"))
    done = CliRunner().invoke(app, ["reduce", str(run), "--quiet"])
    assert done.exit_code == 0
    assert "Response to sines" not in done.stdout
    assert not (run / "frequency_response.json").exists()
    assert not (run / "pictures" / "control" / "sines.png").exists()
