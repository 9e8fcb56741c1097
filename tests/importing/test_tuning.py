"""From logs of a car to a folder that a fit takes: which input, what is held out, and what stops it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from etcfit.datasets.base import write_folder
from etcfit.errors import MeasurementError
from etcfit.importing import tuning
from etcfit.importing.tuning import DUTY, ECU, HELD_AT_NOMINAL, KnownEcu, TuneInput, TuneSettings, tune_input
from etcfit.model.ecu import Ecu, Terms
from etcfit.model.ecus import RUSEFI
from etcfit.rig.base import Measurement, Rig
from etcfit.rig.paper_readings import read_graphs
from etcfit.rig.reader import read_folder
from independent.cars import Car, draw_car, log_of

DEFAULT = TuneSettings()
GAINS = Terms(6.2, 40.0, 0.05)


def known(gains: Terms | None = None) -> KnownEcu:
    assert RUSEFI.notation is not None
    return KnownEcu("rusEFI", Ecu(**RUSEFI.completed({})), True, RUSEFI.notation, gains)


def log(rate: float, amplitude: float = 30.0, at_limit: float = 0.0, duration: float = 10.0) -> Rig:
    """A plate that follows a sine of 1 Hz, its duty with some noise, and at the limit for a share of the time."""
    time = np.arange(0.0, duration, 1.0 / rate)
    rng = np.random.default_rng(1)
    position = 40.0 + amplitude * np.sin(2 * np.pi * time) + 0.02 * rng.standard_normal(time.size)
    duty = 30.0 + 20.0 * np.sin(2 * np.pi * time + 0.5) + 0.5 * rng.standard_normal(time.size)
    duty[: round(at_limit * time.size)] = 90.0
    columns = {"time [s]": time, "position [%]": position, "setpoint [%]": 40.0 + amplitude * np.sin(2 * np.pi * time),
               "duty [%]": duty, "supply [V]": np.full(time.size, 13.2)}  # fmt: skip
    return Rig.from_frames({"drive/lap": pd.DataFrame(columns)}, {"rig": {"supply_V": 12.0}})


def made(
    rig: Rig, gains: Terms | None = None, settings: TuneSettings = DEFAULT, of_logs: tuple[Terms, ...] = ()
) -> TuneInput:
    return tune_input(rig, "car", replace(known(gains), of_logs=of_logs), settings)


def stops(found: TuneInput) -> set[str]:
    return {check.name for check in found.stopped_by}


def test_a_log_with_a_row_for_every_tick_is_driven_by_its_duty() -> None:
    found = made(log(500.0), GAINS)
    assert (found.model, stops(found), found.supply) == (DUTY, set(), 13.2)
    assert "every 2 ms" in found.why


def test_a_slower_log_takes_the_ecu_into_the_model_where_its_gains_are_known() -> None:
    found = made(log(100.0), GAINS)
    assert (found.model, stops(found)) == (ECU, set())
    assert "misses duties" in found.why
    assert "duty" not in found.files["drive/lap_1.csv"].splitlines()[1]
    assert "duty" in found.duty_files["drive/lap_1.csv"].splitlines()[1]
    assert made(log(500.0), GAINS).duty_files == {}


def test_logs_under_different_gains_are_one_model_where_the_duty_drives_it_and_refused_where_the_ecu_does() -> None:
    other = GAINS._replace(P=2.0 * GAINS.P)
    fast, slow = (replace(log(rate), measurements=(*log(rate).measurements, *renamed(log(rate), "drive/lap2.csv")))
                  for rate in (500.0, 100.0))  # fmt: skip
    found = made(fast, other, of_logs=(GAINS, other))
    assert (found.model, stops(found)) == (DUTY, set())
    assert "under which gains each log was made does not matter" in found.why
    assert {name for name in found.files if "lap2" in name}
    found = made(slow, other, of_logs=(GAINS, other))
    assert stops(found) == {"fast enough"}
    assert "made under different gains" in found.stopped_by[0].says
    assert "Give only the logs that were made under one set of gains" in found.stopped_by[0].cure
    found = made(slow, other, of_logs=(other, other))
    assert (found.model, stops(found)) == (ECU, set())
    assert "taken for those of all 2 logs" in found.why


def renamed(rig: Rig, file: str) -> list[Measurement]:
    return [replace(measurement, file=file) for measurement in rig.measurements]


def test_a_slow_log_of_unknown_gains_tells_nothing_and_says_what_would() -> None:
    found = made(log(100.0))
    assert stops(found) == {"fast enough"}
    assert "400 Hz" in found.stopped_by[0].cure
    assert "--present" in found.stopped_by[0].cure
    assert "target" not in found.stopped_by[0].cure  # it is logged


@pytest.mark.parametrize(("rig", "name"), [(log(500.0, amplitude=1.0), "moves over the travel"),
                                           (log(500.0, at_limit=0.7), "duty within its limit"),
                                           (log(500.0, duration=1.0), "moves often enough")])  # fmt: skip
def test_a_log_that_cannot_tell_gains_is_stopped_with_a_cure(rig: Rig, name: str) -> None:
    found = made(rig)
    assert name in stops(found)
    assert all(check.cure for check in found.stopped_by)


def test_some_saturation_is_doubtful_and_does_not_stop() -> None:
    found = made(log(500.0, at_limit=0.3))
    assert {check.name for check in found.checks if not check.passed} == {"duty within its limit"}
    assert stops(found) == set()


def test_the_folder_is_one_and_its_end_is_held_out(tmp_path: Path) -> None:
    found = made(log(100.0), GAINS)
    for file, text in found.files.items():
        (tmp_path / file).parent.mkdir(exist_ok=True)
        (tmp_path / file).write_text(text, encoding="utf-8")
    rig = read_folder(tmp_path)
    parts = {measurement.file: measurement for measurement in rig.measurements}
    assert {file for file, part in parts.items() if part.held_out} == {found.held_out}
    assert set(parts) == {"drive/lap_1.csv", found.held_out}  # an ECU in the model drives the log in one piece
    assert parts[found.held_out].time[0] == pytest.approx(0.6 * 9.99, abs=0.02)
    assert rig.config.ecu is not None
    assert rig.config.ecu.period == pytest.approx(2e-3)
    # P of 6.2 % of duty for one % of a travel of 90 degrees
    assert rig.config.parameters["K_p"].value == pytest.approx(6.2 * 13.2 / (np.pi / 2))  # pyright: ignore


def test_of_a_long_log_the_busiest_stretch_is_fitted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tuning, "PIECE", 0.5)
    rig = log(500.0)
    found = made(rig, settings=TuneSettings(most_samples=1000))
    rows = [len(text.splitlines()) - 2 for file, text in found.files.items() if file.endswith(".csv")]
    assert max(rows) <= 1001
    assert sum(rows) <= 2 * 1300  # of the fitted pieces and of what is held out


def test_rows_that_may_be_a_tick_old_are_believed_less() -> None:
    """Sigma of 1/12 T^2 v^2: a sine of 30 % of 90 degrees at 1 Hz has speeds up to 170 degrees a second. Rows in step
    with the clock are brought to their ticks instead, and believed as the sensor is."""

    def sigma(rate: float) -> float:
        line = next(each for each in made(log(rate)).files["rig.toml"].splitlines() if each.startswith("position_deg"))
        return float(line.split("=")[1])

    fastest = 2 * np.pi * 27.0
    assert 0.5 * fastest < sigma(737.0) / (2e-3 / np.sqrt(12.0)) < fastest
    assert sigma(500.0) < 0.5 * sigma(737.0)


def test_what_such_a_log_cannot_tell_is_held_and_the_duty_acts_a_tick_later() -> None:
    text = made(log(500.0)).files["rig.toml"]
    assert "actuation_delay" in text
    assert "t_a = { fixed = 0 }" in text  # of an ECU whose delay is said to be none
    assert "R_a = { fixed" in text
    assert "actuation_delay" not in made(log(100.0), GAINS).files["rig.toml"]


def of_car(seed: int) -> tuple[Car, Rig]:
    """A car of the independent generator, and its log."""
    car = draw_car(seed)
    seen = log_of(car, seed)
    columns = {"time [s]": seen["Time (s)"], "position [%]": seen["TPS (%)"], "setpoint [%]": seen["ETB Target (%)"],
               "duty [%]": seen["ETB Duty (%)"], "supply [V]": seen["Battery (V)"]}  # fmt: skip
    return car, Rig.from_frames({"drive/lap": pd.DataFrame(columns)}, {"rig": {"supply_V": 12.0}})


@pytest.mark.parametrize("seed", [9101, 9109, 9112])
def test_of_a_log_with_an_ecu_in_the_model_the_duty_still_tells_where_the_fit_begins(seed: int, tmp_path: Path) -> None:
    """100 and 200 rows a second; all torques in the scale that position and volts tell, within a factor of 2.3."""
    car, rig = of_car(seed)
    truth = car.truth
    found = made(rig, Terms(*car.gains))
    assert found.model == ECU
    read = read_graphs(read_folder(write_folder(tmp_path / "duty", found.duty_files))).values
    speed = truth.K_b + truth.B_eq * truth.R_a / (truth.N**2 * truth.K_m)
    scale = speed / HELD_AT_NOMINAL["R_a"] / (truth.K_m / truth.R_a)
    told = {"K_s": scale * truth.K_s, "T_f": scale * truth.T_f, "J_L": scale * truth.J_eq, "K_b": truth.N * speed}
    for symbol, value in told.items():
        assert abs(np.log(read[symbol] / value)) < np.log(2.3), symbol


@pytest.mark.parametrize("seed", [9200, 9201, 9206])
def test_the_fit_starts_at_the_angle_where_the_springs_hold_the_plate_alone(seed: int) -> None:
    """Cars of the independent generator, of 100, 200 and 500 rows a second; read to half a degree."""
    car, rig = of_car(seed)
    lines = made(rig, GAINS).files["rig.toml"].splitlines()
    (start,) = (float(line.split()[2]) for line in lines if line.startswith("theta_lh"))
    assert start == pytest.approx(car.effects.limp_home_spring.angle, abs=0.009)


def test_a_plate_that_no_duty_pulls_down_tells_no_such_angle() -> None:
    assert "theta_lh" not in made(log(500.0)).files["rig.toml"]


def test_pieces_are_cut_where_the_plate_rests() -> None:
    """A step of 30 % each second, its move over in 0.1 s: no cut within 0.05 s of a move."""
    time = np.arange(0.0, 20.0, 2e-3)
    position = 30.0 + 30.0 * (np.clip((time + 0.5) % 2.0, 0.0, 0.1) - np.clip((time + 0.5) % 2.0 - 1.0, 0.0, 0.1)) / 0.1
    duty = position + 1e-3 * np.random.default_rng(1).standard_normal(time.size)
    columns = {"time [s]": time, "position [%]": position, "duty [%]": duty}
    rig = Rig.from_frames({"drive/lap": pd.DataFrame(columns)}, {"rig": {"supply_V": 12.0}})
    found = made(rig)
    begins = [float(text.splitlines()[2].split(",")[0]) for file, text in found.files.items()
              if file.endswith(".csv") and file != found.held_out]  # fmt: skip
    assert len(begins) > 3
    since = (np.array(begins[1:]) + 0.5) % 1.0
    assert np.all((since > 0.1) & (since < 1.0 - 0.02))


def test_a_log_without_duty_and_target_is_refused_with_what_it_has() -> None:
    time = np.arange(0.0, 2.0, 0.01)
    frame = pd.DataFrame({"time [s]": time, "position [%]": 40.0 + 10.0 * np.sin(time)})
    rig = Rig.from_frames({"drive/lap": frame}, {})
    with pytest.raises(MeasurementError, match="found were position"):
        made(rig)
