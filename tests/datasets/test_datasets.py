"""Each public data set as it is converted: nothing lost, right way up, right units, and what the reader makes of it."""

from __future__ import annotations

import io
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.signal import butter, cheby1, filtfilt

from etcfit.datasets import DATASETS, fetch
from etcfit.datasets.bam_xl330 import signed_duty
from etcfit.datasets.emps import on_schedule
from etcfit.errors import MeasurementError
from etcfit.problem.free_parameters import free_parameters
from etcfit.rig.reader import read_folder


@dataclass(frozen=True)
class Fetched:
    """A measurement folder as a person would read it: without the package's own reader."""

    folder: Path

    @property
    def rig(self) -> dict[str, Any]:
        return tomllib.loads((self.folder / "rig.toml").read_text(encoding="utf-8"))

    @property
    def traces(self) -> set[str]:
        return {path.relative_to(self.folder).as_posix() for path in self.folder.rglob("*.csv")}

    def trace(self, path: str) -> pd.DataFrame:
        return pd.read_csv(self.folder / path, comment="#")


@pytest.fixture(scope="session")
def fetched(measured: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Fetched]:
    done: dict[str, Fetched] = {}

    def get(name: str) -> Fetched:
        if lacking := [s.local for s in DATASETS[name].sources if not (measured / s.local).is_file()]:
            pytest.skip(f"no copy of {', '.join(lacking)} among the measured data")
        if name not in done:
            done[name] = Fetched(fetch(name, tmp_path_factory.mktemp("fetched") / name, measured))
        return done[name]

    return get


@pytest.fixture(scope="module")
def kassel(fetched):
    return fetched("kassel-throttle")


@pytest.fixture(scope="module")
def record(kassel) -> pd.DataFrame:
    return pd.concat([kassel.trace("response/fit.csv"), kassel.trace("response/holdout.csv")], ignore_index=True)


def test_split_at_60_percent_and_the_rest_held_out(kassel) -> None:
    assert kassel.traces == {"response/fit.csv", "response/holdout.csv"}
    assert kassel.rig["holdout"]["files"] == ["response/holdout.csv"]
    assert len(kassel.trace("response/fit.csv")) == int(0.6 * 2498)


def test_whole_record_at_10_ms(record) -> None:
    assert len(record) == 2498
    assert np.allclose(np.diff(record["time [s]"]), 0.010, atol=1e-9, rtol=0)
    assert record["duty [%]"].min() == -20.0
    assert record["duty [%]"].max() == 45.0


def test_duty_opens(kassel, record) -> None:
    tps = kassel.rig["tps"]
    opening = (record["tps [V]"] - tps["closed_V"]) / (tps["open_V"] - tps["closed_V"])
    assert np.corrcoef(record["duty [%]"], np.gradient(opening))[0, 1] > 0.5
    # no more than noise and the give of the stop outside the calibration: 0.1 % of the travel
    assert opening.min() > -0.001
    assert opening.max() < 1.001


def test_stated_noise_is_what_the_plate_shows_at_its_far_stop(kassel, record) -> None:
    # holds of one duty of at least 20 samples that end on the stop; the first half is the way there
    hold = (record["duty [%]"].diff() != 0).cumsum()
    ends = [group["tps [V]"].to_numpy()[len(group) // 2 :] for _, group in record.groupby(hold) if len(group) >= 20]
    at_rest = [np.std(end, ddof=1) for end in ends if abs(end.mean() - 0.7035) < 0.002]
    assert len(at_rest) >= 4
    assert np.median(at_rest) == pytest.approx(kassel.rig["noise"]["tps_V"], rel=0.15)


def test_licence_and_source_travel_along(kassel) -> None:
    assert "Redistribution and use" in (kassel.folder / "LICENSE").read_text(encoding="utf-8")
    readme = (kassel.folder / "README.md").read_text(encoding="utf-8")
    assert "50938d18ccf2b84959d90fe7a424c4e3ac998096" in readme
    assert "BSD-3-Clause" in readme


def test_the_duty_of_wintec_is_rebuilt_from_where_the_sensors_cross(tmp_path: Path) -> None:
    """In rows of the recording's own layout: cut from the crossing until the next step, at each frequency by itself."""
    rows = [(5, 0.5, 3.7, 4000, 98), (16, 2.2, 2.1, 4000, 99), (16, 2.3, 2.0, 4000, 99), (27, 2.0, 2.2, 4000, 99),
            (38, 1.5, 2.7, 4000, 100), (60, 0.5, 3.7, 5000, 99), (71, 0.6, 3.6, 5000, 99)]  # fmt: skip
    text = "\n".join(f"2024/04/03/ 16:38:59::767,{','.join(map(str, row))},0" + "," * 26 for row in rows)
    recording = tmp_path / "calibration.csv"
    recording.write_text(f"RX Date/Time,{','.join(f'New dataset(field {k})' for k in range(1, 34))}\n{text}\n")
    (source,) = DATASETS["wintec-throttle"].sources
    files = DATASETS["wintec-throttle"].convert({source.local: recording})
    slow, fast = (pd.read_csv(io.StringIO(files[f"response/0{f}_kHz.csv"]), comment="#") for f in (4, 5))
    assert slow.to_numpy().tolist() == [[0.0, 98, 0.5], [0.011, 0, 2.2], [0.022, 0, 2.0], [0.033, 100, 1.5]]
    assert fast.to_numpy().tolist() == [[0.0, 99, 0.5], [0.011, 99, 0.6]]


@pytest.fixture(scope="module")
def bam(fetched):
    return fetched("bam-xl330")


def test_duty_is_a_signed_count_logged_unsigned() -> None:
    load = np.array([0.0, 885.0, 65535.0, 65536.0 - 885.0])
    assert signed_duty(load) == pytest.approx([0.0, 1.0, -1 / 885, -1.0])


def test_eight_runs_of_which_two_are_let_go(bam) -> None:
    trajectories = "sin_sin", "lift_and_drop", "up_and_down", "sin_time_square"
    driven = {f"response/kp{kp}_{name}.csv" for kp in (100, 400) for name in trajectories}
    assert bam.traces == driven | {"inertia/kp100_lift_and_drop.csv", "inertia/kp400_lift_and_drop.csv"}


def test_one_run_of_each_gain_is_held_out(bam) -> None:
    held_out = bam.rig["holdout"]["files"]
    assert set(held_out) <= bam.traces
    assert sorted(file[:14] for file in held_out) == ["response/kp100", "response/kp400"]


@pytest.mark.parametrize("kp", [100, 400])
def test_positive_duty_raises_the_position(bam, kp: int) -> None:
    # held still against gravity, the motor pushes up the side the arm is on
    trace = bam.trace(f"response/kp{kp}_up_and_down.csv")
    up = trace[trace["position [rad]"] > 0.1]
    assert (up["duty [%]"] > 0).mean() > 0.95
    assert trace["duty [%]"].abs().max() <= 100.0
    assert trace["supply [V]"].between(5.5, 9.5).all()


@pytest.mark.parametrize("kp", [100, 400])
def test_open_terminals_are_cut_off_where_the_torque_goes_off(bam, kp: int) -> None:
    driven, free = (bam.trace(f"{test}/kp{kp}_lift_and_drop.csv") for test in ("response", "inertia"))
    assert list(free) == ["time [s]", "position [rad]"]
    assert driven["time [s]"].iloc[-1] < 2.0 < free["time [s]"].iloc[0] < 2.01
    assert driven["duty [%]"].iloc[-1] < -30.0  # still held up
    assert abs(free["position [rad]"].iloc[-1]) < 0.05  # fallen, and hanging down


def test_time_rises_everywhere(bam) -> None:
    assert all((np.diff(bam.trace(file)["time [s]"]) > 0).all() for file in bam.traces)


@pytest.fixture(scope="module")
def emps(fetched):
    return fetched("emps")


def _filter(design: Any, x: np.ndarray, padlen: int) -> np.ndarray:
    """Zero phase, with as many reflected samples at the edges as MATLAB's `filtfilt` takes."""
    b, a = design
    return filtfilt(b, a, x, padlen=padlen)


def _decimate(x: np.ndarray, factor: int = 10) -> np.ndarray:
    """Every tenth sample after a Chebyshev filter, with the edges and the phase of MATLAB's `decimate`."""
    return _filter(cheby1(8, 0.05, 0.8 / factor), x, padlen=24)[(x.size - 1) % factor :: factor]


def _inverse_model(trace: pd.DataFrame) -> tuple[np.ndarray, np.ndarray]:
    """Regressors (acceleration, speed, its sign, 1) and force, as in the authors' script.

    Source: Janot, Gautier, Brunot 2019, Script_IDIM_LS. Differs from source: no, its uncut end included.
    """
    q = _filter(butter(4, 100.0, fs=1000.0), trace["position [rad]"].to_numpy(), padlen=12)
    speed = np.gradient(q, 1e-3)
    columns = np.gradient(speed, 1e-3), speed, np.sign(speed), np.ones_like(q), trace["torque [N*m]"].to_numpy()
    *regressors, force = (_decimate(column[49:]) for column in columns)
    return np.column_stack(regressors), force


def _error_percent(regressors: np.ndarray, force: np.ndarray, parameters: np.ndarray) -> float:
    return float(100 * np.linalg.norm(force - regressors @ parameters) / np.linalg.norm(force))


def test_published_inverse_model_to_the_last_printed_digit(emps) -> None:
    regressors, force = _inverse_model(emps.trace("response/training.csv"))
    found, *_ = np.linalg.lstsq(regressors, force, rcond=None)
    assert found == pytest.approx([95.1089, 203.5034, 20.3935, -3.1648], abs=6e-5)
    assert _error_percent(regressors, force, found) == pytest.approx(4.0834, abs=6e-5)
    # the held-out pulses, by the authors' cross-test
    crossed = _error_percent(*_inverse_model(emps.trace("response/pulses.csv")), found)
    assert crossed == pytest.approx(5.9824, abs=6e-5)
    assert emps.rig["holdout"]["files"] == ["response/pulses.csv"]


def test_stated_noise_is_the_encoders(emps) -> None:
    # third differences of a smooth motion leave the noise, times sqrt(20)
    position = emps.trace("response/training.csv")["position [rad]"].to_numpy()
    noise = np.median(np.abs(np.diff(position, 3))) / 0.6745 / np.sqrt(20)
    assert noise == pytest.approx(emps.rig["noise"]["position_rad"], rel=0.1)


def test_only_the_sled_is_free(emps) -> None:
    fixed = {symbol: known["fixed"] for symbol, known in emps.rig["parameters"].items() if isinstance(known, dict)}
    assert fixed == {"K_s": 0.0, "J_m": pytest.approx(0.0, abs=1e-8), "B_m": 0.0}
    assert emps.rig["rig"]["travel_deg"] == [-np.inf, np.inf]


def test_a_file_with_another_clock_is_refused() -> None:
    with pytest.raises(MeasurementError, match=r"0\.001 s apart"):
        on_schedule(Path("DATA_EMPS.mat"), np.array([0.0, 0.001, 0.003]))


@pytest.mark.parametrize("name", DATASETS)
def test_a_fit_takes_what_its_rig_toml_says_of_the_parameters(fetched: Callable[[str], Any], name: str) -> None:
    assert free_parameters(read_folder(fetched(name).folder).config).layout.free


@pytest.mark.parametrize("name", DATASETS)
def test_reader_takes_it(fetched: Callable[[str], Any], name: str) -> None:
    rig = read_folder(fetched(name).folder)
    assert rig.warnings == ()
    assert not rig.config.synthetic
    assert {m.file for m in rig.measurements if m.held_out} == set(rig.config.holdout) != set()
    assert all(not m.channels["position"].sigma_estimated for m in rig.measurements)
