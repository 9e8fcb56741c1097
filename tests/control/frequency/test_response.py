"""One sine trace: what of it counts, the response in it, and what a trace that says nothing is told."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from typer.testing import CliRunner

import control
import results
from etcfit.cli import app
from etcfit.control.frequency import response as response_module
from etcfit.control.frequency import wave
from etcfit.control.frequency.response import point_of
from etcfit.control.settings import FrequencySettings
from etcfit.errors import MeasurementError
from etcfit.rig.base import Channel, Measurement, RigConfig
from etcfit.run_folder.state import save_fit
from independent.bench_twin import TRUTH, UNDECLARED
from independent.control import follow
from independent.instruments import Bench
from independent.simulate import throttle
from independent.sines import COMPUTER, write_sines
from independent.truth import OPEN

CONFIG = RigConfig("bench", supply_V=12.0)
POLES = (8.0, 25.0)  # 1/s
DELAY = 0.01
LEAD = 0.3  # s before the sine begins
SIGMA = 1e-4


def response(frequency: float) -> complex:
    """Two lags and a delay."""
    s = 2j * np.pi * frequency
    return complex(np.exp(-DELAY * s) / np.prod([1.0 + s / p for p in POLES]))


def trace(frequency: float, cycles: float = 7.6, rate: float = 500.0, seed: int = 0) -> Measurement:
    """A loop of two lags and a delay, at rest until the sine begins, by python-control; with its transient."""
    time = np.arange(int((LEAD + cycles / frequency) * rate)) / rate
    setpoint = 0.6 + 0.2 * np.sin(2.0 * np.pi * frequency * np.maximum(time - LEAD, 0.0))
    loop: Any = control.tf([1.0], np.poly([-p for p in POLES]) / np.prod(POLES))
    late = 0.2 * np.sin(2.0 * np.pi * frequency * np.maximum(time - LEAD - DELAY, 0.0))
    position = 0.6 + _outputs(loop, time, late)
    noise = SIGMA * np.random.default_rng(seed).standard_normal(time.size)
    return measurement(time, setpoint=setpoint, position=position + noise, duty=0.3 + 0.5 * (setpoint - position))


def _outputs(loop: Any, time: np.ndarray, wanted: Any) -> np.ndarray:
    return np.asarray(control.forced_response(loop, time, wanted).outputs)


def measurement(time: np.ndarray, **values: np.ndarray) -> Measurement:
    channels = {name: Channel(time, value, SIGMA, False, f"{name} [1]", "1", 1.0) for name, value in values.items()}
    return Measurement("sine/2.csv", "sine", time, channels)


def without(whole: Measurement, name: str) -> Measurement:
    return replace(whole, channels={n: c for n, c in whole.channels.items() if n != name})


def with_setpoint(whole: Measurement, value: np.ndarray) -> Measurement:
    return replace(whole, channels={**whole.channels, "setpoint": replace(whole.channels["setpoint"], value=value)})


def thinned(whole: Measurement, keep: np.ndarray) -> Measurement:
    channels = {n: replace(c, time=c.time[keep], value=c.value[keep]) for n, c in whole.channels.items()}
    return replace(whole, time=whole.time[keep], channels=channels)


@pytest.mark.parametrize("frequency", [0.5, 2.0, 10.0])
def test_the_settled_part_has_the_true_response(frequency: float) -> None:
    point = point_of(trace(frequency, cycles=max(7.6, 3.0 * frequency), rate=max(200.0, 100.0 * frequency)), CONFIG)
    assert point.frequency == pytest.approx(frequency, rel=1e-4)
    low, high = point.closed_loop.magnitude_ci95
    truth = response(frequency)
    assert_allclose(point.closed_loop.value, truth, rtol=2e-3)
    assert low < abs(truth) * 1.001
    assert high > abs(truth) * 0.999
    assert point.window.begin > LEAD
    assert point.window.cycles >= 3
    assert point.noise == pytest.approx(SIGMA**2 / (0.5 * abs(0.2 * truth) ** 2), rel=0.05)


def test_the_ecu_and_the_plant_in_it_close_to_the_loop_that_was_measured() -> None:
    point = point_of(trace(2.0), CONFIG)
    plant, ecu = point.plant, point.controller
    assert plant is not None
    assert ecu is not None
    assert_allclose(ecu.value * plant.value / (1.0 + ecu.value * plant.value), point.closed_loop.value, rtol=1e-9)
    # duty acts half a sample later than logged: 0.5 V/V of 12 V, and that delay
    assert_allclose(ecu.value, 0.5 * 12.0 * np.exp(-2j * np.pi * 2.0 * 0.001), rtol=1e-3)


def test_without_a_drive_the_loop_alone_is_known() -> None:
    point = point_of(without(trace(2.0), "duty"), CONFIG)
    assert (point.plant, point.controller) == (None, None)
    assert_allclose(point.closed_loop.value, response(2.0), rtol=2e-3)


def test_jitter_and_gaps_are_borne() -> None:
    whole, rng = trace(2.0, cycles=12.0), np.random.default_rng(1)
    keep = (rng.uniform(size=whole.time.size) < 0.6) & ~((whole.time > 3.0) & (whole.time < 3.7))
    assert_allclose(point_of(thinned(whole, keep), CONFIG).closed_loop.value, response(2.0), rtol=2e-3)


SPOILT = {
    "no setpoint": (lambda: without(trace(2.0), "setpoint"), r"no setpoint among position, duty.*'setpoint \[deg\]'"),
    "no position": (lambda: without(trace(2.0), "position"), "no position among"),
    "short": (lambda: trace(2.0, cycles=2.4), "2.4 cycles of 2 Hz.*Log it for 1.5 s or longer"),
    "coarse": (lambda: thinned(trace(10.0), np.arange(530) % 13 == 0), "samples a cycle"),
    "still": (lambda: with_setpoint(trace(2.0), np.full(trace(2.0).time.size, 0.6)), "moves in 0 samples"),
}


@pytest.mark.parametrize("name", SPOILT)
def test_a_trace_that_says_nothing_is_told_why(name: str) -> None:
    make, said = SPOILT[name]
    with pytest.raises(MeasurementError, match=said) as caught:
        point_of(make(), CONFIG)
    assert str(caught.value).startswith("sine/2.csv: ")
    assert "needs setpoint and position over 3 cycles or more" in str(caught.value)


@pytest.mark.parametrize(
    ("shape", "least"), [("triangle", 1.0), ("square", 15.0), ("chirp", 20.0), ("three sines", 50.0)]
)
def test_a_setpoint_that_is_no_sine_is_told_how_far_it_is(shape: str, least: float) -> None:
    whole = trace(2.0)
    phase = 2.0 * 2.0 * np.pi * whole.time
    shapes = {
        "triangle": np.arcsin(np.sin(phase)),
        "square": np.sign(np.sin(phase)),
        "chirp": np.sin(phase * (1.0 + 0.4 * whole.time)),
        "three sines": np.sin(phase) + np.sin(1.3 * phase) + np.sin(0.8 * phase),
    }
    with pytest.raises(MeasurementError, match="no sine") as caught:
        point_of(with_setpoint(whole, 0.6 + 0.1 * shapes[shape]), CONFIG)
    outside = float(caught.value.found.split("sine: ")[1].split(" %")[0])
    assert least < outside <= 100.0


def test_a_setpoint_in_steps_is_a_sine_still() -> None:
    """An ECU that works out its setpoint ten times a cycle."""
    whole = trace(2.0)
    steps = np.floor(whole.time * 20.0 + 1e-9) / 20.0
    stepped = 0.6 + 0.2 * np.sin(2.0 * np.pi * 2.0 * np.maximum(steps - LEAD, 0.0))
    point = point_of(with_setpoint(whole, stepped), CONFIG)
    assert point.waves.outside["setpoint"] == pytest.approx(1.0 - np.sinc(0.1) ** 2, rel=0.1)


STRICTER: dict[str, tuple[dict[str, Any], str]] = {
    "cycles": ({"fewest_cycles": 9}, "7.6 cycles of 2 Hz.*over 9 cycles or more"),
    "density": ({"samples_a_cycle": 300.0}, "samples a cycle of the setpoint.*300 samples a cycle"),
    "power": ({"outside": 0.0}, "no sine.*at most 0 % of its power outside"),
}


@pytest.mark.parametrize("name", STRICTER)
def test_the_settings_decide_which_traces_count(name: str) -> None:
    stricter, said = STRICTER[name]
    with pytest.raises(MeasurementError, match=said):
        point_of(trace(2.0), CONFIG, FrequencySettings(**stricter))


def test_a_setpoint_with_low_harmonics_is_no_sine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(response_module, "OUTSIDE_LOW", 0.0)
    with pytest.raises(MeasurementError, match=r"no sine.*0 % in its 2nd to 5th"):
        point_of(trace(2.0), CONFIG)


def test_more_cycles_stray_where_they_must_be_more_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = trace(2.0)
    assert point_of(whole, CONFIG).window.cycles == 6
    monkeypatch.setattr(wave, "STRAYS", 0.0)
    monkeypatch.setattr(wave, "SAME", 1e-5)
    assert point_of(whole, CONFIG).window.cycles < 6


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
