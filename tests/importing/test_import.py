"""A pile of foreign files becomes the folder that the independent generator's own CSVs are: tests, units, values."""

from __future__ import annotations

import hashlib
import json
import os
import pty
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner, Result

import etcfit
import foreign
from etcfit.cli import app
from etcfit.errors import MeasurementError, UsageError
from etcfit.importing import Answers, import_files
from etcfit.importing.answers import accept_all, parsed, refuse
from etcfit.rig.checks import refuse as refuse_impossible
from etcfit.rig.reader import read_folder
from independent import CONSISTENT, NONE, Truth, draw_truth, make_folder
from independent.control import Computer, Score, noisy, score, trapezoids
from independent.simulate import throttle

TO_SI = {"V": 1.0, "mV": 1e-3, "A": 1.0, "mA": 1e-3, "s": 1.0, "ms": 1e-3, "rpm": np.pi / 30}
CLOSED, OPEN = 0.45, 4.73
RIG = f"""[rig]
gear_ratio = 20.68
supply_V = 12.0
[tps]
closed_V = {CLOSED}
open_V = {OPEN}
travel_deg = 90.0
[tests.inductance]
series_ohm = "free"
"""


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The generator's own folder."""
    path = tmp_path_factory.mktemp("bench")
    make_folder(path, CONSISTENT, 7, size="small")
    return path


def trace(bench: Path, file: str) -> dict[str, np.ndarray]:
    """Its columns in SI, by quantity; the sensor in volts."""
    lines = (bench / file).read_text().splitlines()[1:]
    cells = np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]])
    out = {}
    for name, column in zip(lines[0].split(","), cells.T, strict=True):
        quantity, _, unit = name[:-1].partition(" [")
        out[quantity] = column * TO_SI[unit]
    return out


def degrees(sensor: np.ndarray) -> np.ndarray:
    return 90.0 * (sensor - CLOSED) / (OPEN - CLOSED)


def pile(bench: Path, to: Path) -> dict[str, tuple[str, Sequence[str]]]:
    """Files of ten programs, named after nothing; file -> the generator's trace, and what of it was exported."""
    r1, r2, r3 = (trace(bench, f"resistance/volts_{k}.csv") for k in (1, 2, 3))
    l1, l2 = (trace(bench, f"inductance/step_{k}.csv") for k in (1, 2))
    s1, s2 = (trace(bench, f"static_load/ramp_{k}.csv") for k in (1, 2))
    v1, v2 = (trace(bench, f"viscous/volts_{k}.csv") for k in (1, 2))
    d1, d2, d3 = (trace(bench, f"response/drive_{k}.csv") for k in (1, 2, 3))
    e, j = trace(bench, "back_emf/release_1.csv"), trace(bench, "inertia/release_1.csv")
    foreign.rigol_ds1000z(to / "NewFile1.csv", {"t": ("s", r1["time"]), "CH1": ("V", r1["voltage"]),
                                                "CH2": ("A", r1["current"])})  # fmt: skip
    foreign.rigol_mso5000(to / "NewFile2.csv", {"t": ("s", r2["time"]), "CH1": ("V", r2["voltage"]),
                                                "CH2": ("A", r2["current"])})  # fmt: skip
    foreign.tektronix_tds(to, 3, {"t": ("s", r3["time"]), "CH1": ("V", r3["voltage"]), "CH2": ("A", r3["current"])})
    foreign.picoscope(to / "pico1.csv", {"Time": ("ms", 1e3 * l1["time"]), "Channel A": ("mV", 1e3 * l1["voltage"]),
                                         "Channel B": ("mA", -1e3 * l1["current"])})  # fmt: skip
    foreign.picoscope(to / "pico2.csv", {"Zeit": ("ms", 1e3 * l2["time"]), "Kanal A": ("mV", 1e3 * l2["voltage"]),
                                         "Kanal B": ("mA", -1e3 * l2["current"])}, ";", ",")  # fmt: skip
    foreign.saleae(to / "analog.csv", {"Time": ("s", e["time"]), "Channel 0": ("V", e["tps"]),
                                       "Channel 1": ("V", -e["emf"])})  # fmt: skip
    foreign.parquet(to / "a17.parquet", {"t": ("s", j["time"]), "Winkel": ("deg", degrees(j["tps"]))})
    foreign.labview(to / "x1.lvm", {"t": ("s", s1["time"]), "Motorspannung": ("V", s1["voltage"]), "Motorstrom":
                                    ("A", s1["current"]), "Poti": ("V", s1["tps"])})  # fmt: skip
    foreign.tdms(to / "x2.tdms", {"t": ("s", s2["time"]), "ai0": ("V", s2["tps"]), "ai1": ("V", s2["voltage"]),
                                  "ai2": ("A", -s2["current"])})  # fmt: skip
    foreign.matlab_5(to / "m1.mat", {"t": ("s", v1["time"]), "u": ("V", v1["voltage"]),
                                     "i": ("mA", 1e3 * v1["current"]),
                                     "n_mot": ("rpm", v1["motor_speed"] / TO_SI["rpm"])})  # fmt: skip
    foreign.matlab_73(to / "m2.mat", {"t": ("s", v2["time"]), "u": ("V", v2["voltage"]), "i": ("A", v2["current"]),
                                      "n_mot": ("rpm", -v2["motor_speed"] / TO_SI["rpm"])}, "run")  # fmt: skip
    foreign.mdf4(to / "log.mf4", {"t": ("s", d1["time"]), "MotorVoltage": ("V", d1["voltage"]),
                                  "MotorCurrent": ("A", d1["current"]), "ThrottlePos": ("V", d1["tps"])})  # fmt: skip
    foreign.semicolons(to / "blatt.csv", {"Zeit": ("s", d2["time"]), "Spannung": ("V", d2["voltage"]),
                                          "Strom": ("mA", -1e3 * d2["current"]), "Poti": ("V", d2["tps"])})  # fmt: skip
    foreign.tektronix_mso(to / "tek.csv", {"t": ("s", d3["time"]), "CH1": ("V", d3["voltage"]),
                                           "CH2": ("A", d3["current"]), "CH3": ("V", d3["tps"])})  # fmt: skip
    driven, circuit = ("voltage", "current", "tps"), ("voltage", "current")
    return {
        "NewFile1.csv": ("resistance/volts_1.csv", circuit),
        "NewFile2.csv": ("resistance/volts_2.csv", circuit),
        "F0003CH1.CSV": ("resistance/volts_3.csv", circuit),
        "pico1.csv": ("inductance/step_1.csv", circuit),
        "pico2.csv": ("inductance/step_2.csv", circuit),
        "analog.csv": ("back_emf/release_1.csv", ("emf", "tps")),
        "a17.parquet": ("inertia/release_1.csv", ("tps",)),
        "x1.lvm": ("static_load/ramp_1.csv", driven),
        "x2.tdms": ("static_load/ramp_2.csv", driven),
        "m1.mat": ("viscous/volts_1.csv", (*circuit, "motor_speed")),
        "m2.mat": ("viscous/volts_2.csv", (*circuit, "motor_speed")),
        "log.mf4": ("response/drive_1.csv", driven),
        "blatt.csv": ("response/drive_2.csv", driven),
        "tek.csv": ("response/drive_3.csv", driven),
    }


@pytest.fixture(scope="module")
def piled(bench: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, tuple[str, Sequence[str]]]]:
    folder = tmp_path_factory.mktemp("pile")
    return folder, pile(bench, folder)


def known_rig(folder: Path) -> Path:
    path = folder / "known.toml"
    path.write_text(RIG)
    return path


def test_a_pile_of_ten_programs_becomes_what_was_measured(
    bench: Path, piled: tuple[Path, Mapping[str, tuple[str, Sequence[str]]]], tmp_path: Path
) -> None:
    folder, expected = piled
    done = import_files(sorted(folder.iterdir()), tmp_path / "rig", Answers(), accept_all, rig=known_rig(tmp_path))
    rig = read_folder(done.folder)
    refuse_impossible("rig", rig.findings)  # as `etcfit check` would
    source = {file: Path(where.partition(",")[0]).name for file, where, _ in done.traces}
    assert len(rig.measurements) == len(expected) == 14
    for found in rig.measurements:
        original, exported = expected[source[found.file]]
        assert found.test == original.partition("/")[0]
        true = trace(bench, original)
        assert set(found.channels) == {"position" if name == "tps" else name for name in exported}
        assert found.time == pytest.approx(true["time"], abs=2e-6)
        for name in exported:
            shown = found.channels["position" if name == "tps" else name]
            value = np.radians(degrees(true[name])) if name == "tps" else true[name]
            assert shown.value == pytest.approx(value, abs=1e-5 * max(1.0, float(np.max(np.abs(value)))))


def test_each_guess_stands_in_rig_toml_with_its_reason_and_each_file_with_its_hash(
    piled: tuple[Path, Mapping[str, tuple[str, Sequence[str]]]], tmp_path: Path
) -> None:
    folder, _ = piled
    done = import_files(sorted(folder.iterdir()), tmp_path / "rig", Answers(), accept_all)
    text = (done.folder / "rig.toml").read_text(encoding="utf-8")
    for file in folder.iterdir():
        assert hashlib.sha256(file.read_bytes()).hexdigest() in text
    assert (
        "'Kanal B' -> current [-1 mA]: by its unit: only current is logged in mA; sign turned: it runs against" in text
    )
    assert "'Channel 1' -> emf [-1 V]: no current, and it follows the speed of the plate" in text
    assert "-> static_load/x1.csv: voltage rises slowly once and falls slowly once" in text
    assert "# guessed: lowest and highest reading of 6 records, it rises while the plate opens" in text
    sensor = read_folder(done.folder).config.tps
    assert sensor is not None
    assert (sensor.closed_V, sensor.open_V) == pytest.approx((CLOSED, OPEN), abs=0.03)


def test_a_label_that_hides_characters_is_shown_in_the_comments_with_their_numbers(bench: Path, tmp_path: Path) -> None:
    step, label = trace(bench, "inductance/step_1.csv"), "tra\u202ect"
    log = foreign.picoscope(tmp_path / "a.csv", {"Time": ("s", step["time"]), "Channel A": ("V", step["voltage"]),
                                                 "Channel B": ("A", step["current"]),
                                                 label: ("V", step["current"])})  # fmt: skip
    answers = parsed([f"{label}=ignore"], [], [str(log)])
    text = (import_files([log], tmp_path / "rig", answers, accept_all).folder / "rig.toml").read_text("utf-8")
    assert "#      'tra(U+202E)ct' left out: " in text


def test_a_guess_in_doubt_stops_without_a_word_from_the_user_and_nothing_is_written(
    bench: Path, tmp_path: Path
) -> None:
    e = trace(bench, "back_emf/release_1.csv")
    log = foreign.saleae(tmp_path / "analog.csv", {"Time": ("s", e["time"]), "Channel 0": ("V", e["tps"]),
                                                   "Channel 1": ("V", e["emf"])})  # fmt: skip
    with pytest.raises(MeasurementError, match=r"taken as \[tps\] 0\.4\d* V closed.*--yes takes every guess.*--rig"):
        import_files([log], tmp_path / "rig", Answers(), refuse)
    assert not (tmp_path / "rig").exists()
    assert import_files([log], tmp_path / "rig", Answers(), refuse, rig=known_rig(tmp_path)).folder.is_dir()


def inductance(bench: Path, folder: Path, unit: str = "A") -> Path:
    step = trace(bench, "inductance/step_1.csv")
    return foreign.picoscope(folder / "scope.csv", {"Time": ("s", step["time"]), "Channel A": ("V", step["voltage"]),
                                                    "Channel B": (unit, step["current"])})  # fmt: skip


@pytest.mark.parametrize(
    ("columns", "tests", "message"),
    [
        (["Channel A=current [A]", "Channel B=voltage [V]"], ["scope.csv=inductance"], "current leads voltage"),
        (["Channel A=current [A]", "Channel B=voltage [V]"], ["scope.csv=viscous"], "no motor_speed among"),
        (["Channel B=current [1000 A]"], [], "beyond|do not belong together|must lie between"),
        (["Channel B=current [-1 A]"], [], "current has the opposite sign of the voltage"),
    ],
)
def test_a_wrong_answer_is_refused_with_file_and_option(
    bench: Path, tmp_path: Path, columns: list[str], tests: list[str], message: str
) -> None:
    log = inductance(bench, tmp_path)
    with pytest.raises(MeasurementError, match=message) as caught:
        import_files([log], tmp_path / "rig", parsed(columns, tests, [str(log)]), accept_all)
    assert "scope.csv" in str(caught.value) or "inductance" in caught.value.where
    assert "Correct the guess: --column" in caught.value.mend
    assert not (tmp_path / "rig").exists()


def test_a_probe_whose_scale_nobody_gave_stops_and_says_how_to_give_it(bench: Path, tmp_path: Path) -> None:
    step = trace(bench, "inductance/step_1.csv")
    log = foreign.picoscope(tmp_path / "a.csv", {"Time": ("s", step["time"]), "Voltage": ("V", step["voltage"]),
                                                 "Current": ("mV", 100.0 * step["current"])})  # fmt: skip
    with pytest.raises(MeasurementError, match=r"a\.csv: column 'Current' is named as current, but in mV") as caught:
        import_files([log], tmp_path / "rig", Answers(), accept_all)
    assert "--column 'Current=current [10 A]'" in caught.value.mend
    answers = parsed(["Current=current [0.01 A]"], [], [str(log)])
    rig = read_folder(import_files([log], tmp_path / "rig", answers, refuse).folder)
    assert rig.measurements[0].channels["current"].value == pytest.approx(step["current"], abs=1e-6)


def test_a_folder_that_holds_something_is_left_alone(bench: Path, tmp_path: Path) -> None:
    log = inductance(bench, tmp_path)
    import_files([log], tmp_path / "rig", Answers(), refuse)
    before = {path: path.read_bytes() for path in (tmp_path / "rig").rglob("*") if path.is_file()}
    with pytest.raises(UsageError, match="already there and not an empty folder"):
        import_files([log], tmp_path / "rig", Answers(), refuse)
    assert {path: path.read_bytes() for path in (tmp_path / "rig").rglob("*") if path.is_file()} == before


def test_a_recording_given_twice_is_refused_as_it_would_be_in_a_folder(bench: Path, tmp_path: Path) -> None:
    log = inductance(bench, tmp_path)
    (tmp_path / "copy.csv").write_bytes(log.read_bytes())
    with pytest.raises(MeasurementError):
        import_files([log, tmp_path / "copy.csv"], tmp_path / "rig", Answers(), accept_all)


def test_a_file_without_a_time_needs_its_period(bench: Path, tmp_path: Path) -> None:
    import scipy.io

    d = trace(bench, "response/drive_1.csv")
    scipy.io.savemat(tmp_path / "a.mat", {"u": d["voltage"], "i": d["current"], "pos_deg": degrees(d["tps"])})
    with pytest.raises(MeasurementError, match=r"no time among its columns 'u', 'i', 'pos_deg'.*--period 1ms"):
        import_files([tmp_path / "a.mat"], tmp_path / "rig", Answers(), accept_all)
    done = import_files([tmp_path / "a.mat"], tmp_path / "rig", Answers(period=0.001), accept_all)
    (found,) = read_folder(done.folder).measurements
    assert found.time == pytest.approx(0.001 * np.arange(found.time.size))


def test_a_bus_log_with_its_dbc(bench: Path, tmp_path: Path) -> None:
    d = trace(bench, "response/drive_1.csv")
    log = foreign.bus_log(tmp_path / "bus.mf4", tmp_path / "bus.dbc", {
        "t": ("s", d["time"]), "MotorVoltage": ("V", d["voltage"]), "MotorCurrent": ("A", d["current"]),
        "ThrottlePos": ("V", d["tps"])})  # fmt: skip
    done = import_files([log, tmp_path / "bus.dbc"], tmp_path / "rig", Answers(), refuse, rig=known_rig(tmp_path))
    (found,) = read_folder(done.folder).measurements
    assert found.test == "response"
    assert found.channels["voltage"].value == pytest.approx(d["voltage"], abs=0.0006)


def test_an_ecu_log_leaves_out_the_engine(tmp_path: Path) -> None:
    time = 0.01 * np.arange(800)
    setpoint = 20.0 + 15.0 * (np.sin(0.8 * time) > 0.0)
    position = np.convolve(setpoint, np.ones(10) / 10.0, "same") + 0.1 * np.sin(40.0 * time)
    names = ["Time", "RPM", "TPS", "ETB: position target", "Accelerator pedal", "Lua gauge"]
    units = ["s", "RPM", "%", "%", "%", ""]
    values = [time, 900.0 + 5.0 * np.sin(time), position, setpoint, 0.5 * setpoint, 0.0 * time]
    rows = ["\t".join(f"{x:.4f}" for x in row) for row in np.column_stack(values)]
    log = tmp_path / "log.msl"
    log.write_text("\n".join(['"rusEFI"', "\t".join(names), "\t".join(units), *rows, ""]))
    done = import_files([log], tmp_path / "rig", Answers(), accept_all)
    (found,) = read_folder(done.folder).measurements
    assert (found.test, set(found.channels)) == ("closed_loop", {"position", "setpoint"})
    assert "'RPM' left out: by its name the engine's, not the throttle's" in (done.folder / "rig.toml").read_text()


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    return lambda *words: CliRunner().invoke(app, [str(word) for word in words])


def test_the_command_prints_what_it_made_and_the_status_of_a_refusal_is_1(bench: Path, tmp_path: Path, run) -> None:
    log = inductance(bench, tmp_path)
    done: Result = run("import", log.name, "--to", "rig", "--quiet")
    assert (done.exit_code, done.stderr) == (0, "")
    assert done.stdout.startswith("rig/inductance/scope.csv  from scope.csv: no plate, and the current rises over ")
    assert run("import", log.name, "--to", "rig", "--quiet").exit_code == 2
    refused = run("import", log.name, "--to", "other", "--test", "scope.csv=viscous", "--quiet")
    assert (refused.exit_code, refused.stdout) == (1, "")
    assert "no motor_speed" in refused.stderr


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--column", "Channel X=voltage"), "no file has it. There are: 'Time', 'Channel A', 'Channel B'"),
        (("--column", "Channel A=volts [V]"), "is not known"),
        (("--column", "Channel A"), "no header and no ="),
        (("--test", "scope.csv=resistence"), "Did you mean 'resistance'"),
        (("--test", "other.csv=resistance"), "no such file among those to import"),
    ],
)
def test_an_option_that_is_none_is_a_mistake_of_usage(
    bench: Path, tmp_path: Path, run, options: tuple[str, str], message: str
) -> None:
    log = inductance(bench, tmp_path)
    done = run("import", log.name, "--to", "rig", "--quiet", *options)
    assert done.exit_code == 2
    assert message in " ".join(done.stderr.split())


@pytest.mark.slow  # a process of its own, seconds until it has imported all
def test_on_a_terminal_it_asks_and_enter_takes_the_guess(bench: Path, tmp_path: Path) -> None:
    e = trace(bench, "back_emf/release_1.csv")
    foreign.saleae(tmp_path / "analog.csv", {"Time": ("s", e["time"]), "Channel 0": ("V", e["tps"]),
                                             "Channel 1": ("V", e["emf"])})  # fmt: skip
    ours, theirs = pty.openpty()
    command = [sys.executable, "-m", "etcfit.cli", "import", "analog.csv", "--to", "rig"]
    with subprocess.Popen(command, cwd=tmp_path, stdin=theirs, stderr=theirs, stdout=subprocess.PIPE) as asked:
        os.write(ours, b"\n")
        told, _ = asked.communicate(timeout=60)
    os.close(theirs)
    shown = os.read(ours, 10_000).decode()
    os.close(ours)
    assert asked.returncode == 0
    assert "Enter takes it, anything else stops" in shown
    assert told.decode().startswith("rig/back_emf/analog.csv")


SEED = 7801  # a training seed
DIALECTS: tuple[tuple[str, Callable[[Path, foreign.Columns], Path]], ...] = (
    ("mat", foreign.matlab_5), ("mf4", foreign.mdf4), ("tdms", foreign.tdms), ("parquet", foreign.parquet),
    ("lvm", foreign.labview),
)  # fmt: skip
TRAVEL = np.pi / 2


def in_five_dialects(folder: Path, bench: Path) -> list[str]:
    """Each trace as another program wrote it, its columns as the bench calls them; five dialects in turn."""
    files = sorted(bench.rglob("*.csv"))
    for k, file in enumerate(files):
        header, *rows = file.read_text().splitlines()[1:]
        cells = np.array([[float(cell) for cell in row.split(",")] for row in rows])
        named = [name[:-1].partition(" [") for name in header.split(",")]
        columns = {name: (unit, values) for (name, _, unit), values in zip(named, cells.T, strict=True)}
        columns["time"] = ("s", {"s": 1.0, "ms": 1e-3}[columns["time"][0]] * columns["time"][1])
        ending, write = DIALECTS[k % len(DIALECTS)]
        write(folder / f"{file.parent.name}_{file.stem}.{ending}", columns)
    return [str(path) for path in sorted(folder.iterdir())]


@pytest.mark.slow
def test_thirty_recordings_become_gains_that_hold_by_four_commands(tmp_path: Path) -> None:
    truth = draw_truth(np.random.default_rng(SEED))
    make_folder(tmp_path / "bench", truth, SEED, NONE, declare_noise=False, holdout=False)
    (tmp_path / "pile").mkdir()
    files = in_five_dialects(tmp_path / "pile", tmp_path / "bench")
    assert len(files) == 30
    folder, run = str(tmp_path / "mine"), str(tmp_path / "run")
    commands = [
        ["import", *files, "--to", folder, "--rig", str(tmp_path / "bench" / "rig.toml"), "--yes"],
        ["fit", folder, "--out", run],
        ["design", run, "--ecu", "rusefi"],
        ["export", run, "--to", "c", "--out", str(tmp_path / "c")],
    ]
    for command in commands:
        begun = time.perf_counter()
        done = subprocess.run([sys.executable, "-m", "etcfit.cli", *command, "--quiet"], text=True, capture_output=True,
                              check=False)  # fmt: skip
        assert done.returncode == 0, done.stderr
        print(f"{command[0]}: {time.perf_counter() - begun:.0f} s")
    found = json.loads((tmp_path / "run" / "pid.json").read_text())
    assert all(found["met"].values())
    real = on_the_throttle(truth, found)
    promised = found["scenarios"]["trapezoid"]
    assert real.rmse == pytest.approx(promised["rmse_pct"], rel=0.03)
    assert real.overshoot == pytest.approx(promised["overshoot_pct"], abs=1.0)
    assert real.settling == pytest.approx(promised["settling_s"], abs=0.01)


def on_the_throttle(truth: Truth, found: Mapping[str, Any]) -> Score:
    """The paper's trapezoid with the proposed gains, on the throttle itself under a computer of the generator's own."""
    ecu, gains = found["ecu"], found["gains"]
    limits = {"supply": ecu["duty_limit"] * ecu["supply_V"], "hold": ecu["integral_limit"] * ecu["supply_V"]}
    habits = {"filter": ecu["derivative_filter_s"], "delay": ecu["delay_s"], "noise": ecu["noise_rad"]}
    computer = Computer(gains["Kp"], gains["Ki"], gains["Kd"], period=ecu["period_s"], grain=ecu["resolution_rad"],
                        **limits, **habits)  # fmt: skip
    wanted = trapezoids(0.05 * TRAVEL, 0.45 * TRAVEL, ecu["period_s"])
    path = noisy(throttle(truth, NONE), computer, wanted, np.random.default_rng(SEED))
    return score(path[:, 0], wanted, ecu["period_s"], TRAVEL)


K_S, K_V, K_A = 0.25, 0.12, 0.02
R, L, K = 0.3, 2e-4, 0.1  # ohm, H, V s/rad
B, J, T_F = (K_V - K) * K / R, K_A * K / R, K_S * K / R
STEP, EVERY = 1e-4, 50  # s, steps of a sample
WHEEL = """[rig]
name = "wheel"
gear_ratio = 1.0
supply_V = 12.0
travel_deg = [-inf, inf]

[parameters]
K_s = { fixed = 0.0 }
T_PL = { fixed = 0.0 }
J_L = { fixed = 0.0 }
B_L = { fixed = 0.0 }
"""


def wheel(volts: Callable[[float], float], seconds: float) -> np.ndarray:
    """Rows of t, v, angle, speed, current; explicit steps, a wheel that sticks."""
    i = speed = angle = 0.0
    rows = []
    for k in range(round(seconds / STEP) + 1):
        t = k * STEP
        v = volts(t)
        if k % EVERY == 0:
            rows.append((t, v, angle, speed, i))
        turning = K * i - B * speed
        rate = 0.0
        if speed != 0.0 or abs(turning) > T_F:
            rate = (turning - T_F * np.sign(speed or turning)) / J
        stops = speed * (speed + STEP * rate) < 0.0 and abs(turning) < T_F
        i, angle, speed = (i + STEP * (v - R * i - K * speed) / L, angle + STEP * speed,
                           0.0 if stops else speed + STEP * rate)  # fmt: skip
    return np.array(rows)


def log(path: Path, left_out: tuple[str, ...] = ()) -> Path:
    tests = {"quasistatic-forward": (lambda t: t, 4.0), "quasistatic-reverse": (lambda t: -t, 4.0),
             "dynamic-forward": (lambda t: 7.0 * (t > 0.0999), 1.1),
             "dynamic-reverse": (lambda t: -7.0 * (t > 0.0999), 1.1)}  # fmt: skip
    rng, state, columns, at = np.random.default_rng(3), [], [[], [], [], []], 1_000_000
    for name, (volts, seconds) in tests.items():
        for row in wheel(volts, seconds):
            time = at + round(1e6 * row[0])
            state.append((time, name))
            noise = (0.0, 1e-3, 0.05, 0.02) * rng.standard_normal(4)
            scale = (1.0, 0.5 / np.pi, 0.5 / np.pi, 1.0)
            for column, value, error, of in zip(columns, row[1:], noise, scale, strict=True):
                column.append((time, of * float(value + error)))
        state.append((state[-1][0] + 20_000, "none"))
        at = state[-1][0] + 500_000
    names = {"voltage": "Volt", "position": "Rotation", "velocity": "Rotation per Second", "current": "Amp"}
    every = zip(names.items(), columns, strict=True)
    entries = {f"{name}-wheel-shooter": ("double", unit, column)
               for (name, unit), column in every if name not in left_out}  # fmt: skip
    return foreign.wpilog(path, {"sysid-test-state-shooter": ("string", "", state), **entries})


def test_a_wheels_log_without_a_current_is_driven_and_no_motor_let_go(tmp_path: Path) -> None:
    """As SysIdRoutine logs it: under a slow ramp the voltage follows the speed as an EMF would."""
    (tmp_path / "rig.toml").write_text(WHEEL, encoding="utf-8")
    folder = tmp_path / "rig"
    log(tmp_path / "robot.wpilog", left_out=("current",))
    import_files([tmp_path / "robot.wpilog"], folder, Answers(), accept_all, rig=tmp_path / "rig.toml")
    texts = [path.read_text(encoding="utf-8") for path in folder.glob("*/*.csv")]
    heads = [next(line for line in text.splitlines() if not line.startswith("#")) for text in texts]
    assert {path.parent.name for path in folder.glob("*/*.csv")} == {"response"}
    assert len(heads) == 4
    assert all("voltage" in head and "emf" not in head for head in heads), heads


def test_a_slow_ramp_of_voltage_is_no_emf_under_any_name(tmp_path: Path) -> None:
    rows = wheel(lambda t: t, 4.0)
    table = "\n".join(f"{t:.4f},{v:.4f},{angle:.5f}" for t, v, angle, *_ in rows)
    (tmp_path / "ramp.csv").write_text(f"time [s],CH1 [V],angle [rad]\n{table}\n", encoding="utf-8")
    (tmp_path / "rig.toml").write_text(WHEEL, encoding="utf-8")
    folder = tmp_path / "rig"
    import_files([tmp_path / "ramp.csv"], folder, Answers(), accept_all, rig=tmp_path / "rig.toml")
    assert [path.parent.name for path in folder.glob("*/*.csv")] == ["static_load"]  # driven


@pytest.mark.slow
def test_a_wheels_log_gives_the_constants_that_it_was_made_with(tmp_path: Path) -> None:
    (tmp_path / "rig.toml").write_text(WHEEL, encoding="utf-8")
    folder = tmp_path / "rig"
    import_files([log(tmp_path / "robot.wpilog")], folder, Answers(), accept_all, rig=tmp_path / "rig.toml")
    reduced = etcfit.reduce(etcfit.fit(folder, quiet=True), quiet=True)
    found = reduced.feedforward
    truth = np.array([K_S, K_V, K_A])
    assert np.all(np.abs(found["value"] - truth) < 3.0 * found["stderr"] + 5e-4 * truth)  # the steps' own error
    assert np.all(found["stderr"] < 0.01 * truth)
    assert reduced.plot.bode() is not None  # of a plant without a spring too
