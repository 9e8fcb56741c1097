"""What guesses rest on: names, units, what follows from what, cuts; over throttles that the generator draws."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from etcfit.errors import MeasurementError
from etcfit.importing.answers import Answers, Target, accept_all, target
from etcfit.importing.draft import Draft, Trace, drafted
from etcfit.importing.guesses import rig_test_of
from etcfit.importing.names import quantity_named
from etcfit.importing.sheet import Column, Sheet, column, split, time_base, with_common_peaks
from etcfit.rig.base import CHANNELS
from independent import MEDIUM, NONE, Effects, draw_truth, make_folder
from independent import Bench as Instruments

TWINS = {"back_emf", "inertia"}  # one rig test under two names: only the operator knows which instrument logged it
TO_SI = {"ms": 1e-3, "s": 1.0}


@pytest.mark.parametrize(
    ("label", "name", "unit"),
    [
        ("Strom (mA)", "Strom", "mA"), ("U_mot [V]", "U_mot", "V"), ("Zeit in ms", "Zeit", "ms"), ("U / V", "U", "V"),
        ("pos_deg", "pos", "deg"), ("CH1V", "CH1", "V"), ("TP (Main) (V)", "TP (Main)", "V"), ("n [1/min]", "n", "rpm"),
        ("Voltage (motor)", "Voltage (motor)", ""), ("Winkel [°]", "Winkel", "deg"), ("omega_rad_s", "omega", "rad/s"),
        ("Time(s)", "Time", "s"), ("throttle [%]", "throttle", "%"), ("Channel A", "Channel A", ""),
    ],
)  # fmt: skip
def test_a_label_gives_its_name_and_its_unit(label: str, name: str, unit: str) -> None:
    assert split(label) == (name, unit)


@pytest.mark.parametrize(
    ("name", "quantity"),
    [
        ("Motorspannung", "voltage"), ("u", "voltage"), ("V_mot", "voltage"), ("Vbat", "supply"), ("PWM", "duty"),
        ("MotorCurrent", "current"), ("i_a", "current"), ("Stromzange", "current"), ("back-EMF", "emf"),
        ("Klappenwinkel", "position"), ("TPS1", "position"), ("ETB: position target", "setpoint"),
        ("Drosselklappe Soll", "setpoint"), ("n_mot", "motor_speed"), ("Drehzahl", "motor_speed"),
        ("X_Value", "time"), ("Timestamp", "time"), ("Accelerator pedal", ""), ("Untitled 1", None),
        ("Channel A", None), ("CH1", None), ("ai0", None), ("Voltage_0", None), ("Value", None),
    ],
)  # fmt: skip
def test_a_name_says_what_it_is_or_nothing(name: str, quantity: str | None) -> None:
    assert quantity_named(name) == quantity


@pytest.mark.parametrize(
    ("text", "wanted"),
    [("position [deg]", Target("position", "deg")), ("position_deg", Target("position", "deg")),
     ("motor_speed_rpm", Target("motor_speed", "rpm")), ("tps", Target("tps")), ("ignore", Target("ignore")),
     ("current [-1 mA]", Target("current", "-1 mA")), ("motor_speed", Target("motor_speed"))],
)  # fmt: skip
def test_what_an_answer_may_be(text: str, wanted: Target) -> None:
    assert target(text, "here") == wanted


def test_every_quantity_of_a_folder_can_be_answered() -> None:
    assert [target(quantity, "here").quantity for quantity in CHANNELS] == list(CHANNELS)


class Bench:
    """A generator's folder as sheets whose columns have lost their names, or units, or signs."""

    def __init__(
        self, folder: Path, seed: int, effects: Effects = NONE, instruments: Instruments | None = None
    ) -> None:
        truth = draw_truth(np.random.default_rng(seed))
        make_folder(folder, truth, seed, effects, size="small", bench=instruments)
        self.rng = np.random.default_rng(seed)
        self.files = sorted(folder.rglob("*.csv"))

    def sheet(self, file: Path, way: str) -> tuple[Sheet, dict[str, tuple[str, int]]]:
        """One trace; and label -> quantity and sign, as they should be found."""
        lines = file.read_text().splitlines()[1:]
        cells = np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]])
        clock, columns, truth = [], [], {}
        for k, (header, values) in enumerate(zip(lines[0].split(","), cells.T, strict=True)):
            quantity, _, unit = header[:-1].partition(" [")
            if quantity == "time":
                clock = [time_base(TO_SI[unit] * values)]
                continue
            if "angle" in way and quantity == "tps":
                quantity, unit, values = "position", "deg", 90.0 * (values - 0.45) / 4.28
            turned = -1 if "turned" in way and quantity != "voltage" and quantity != "tps" else 1
            label = (
                f"CH{k} ({unit})" if "nameless" in way else quantity if "unitless" in way else f"{quantity} ({unit})"
            )
            columns.append(column(label, turned * values))
            truth[label] = quantity, turned
        order = self.rng.permutation(len(columns)) if "nameless" in way else range(len(columns))
        return Sheet(f"{file.parent.name[0]}{file.stem[-1]}.csv", "", (*clock, *(columns[k] for k in order))), truth


WAYS = ["named", "nameless", "turned", "nameless turned", "angle turned", "nameless angle turned", "unitless"]


def mistakes(bench: Bench, way: str) -> list[str]:
    """Everything that is guessed wrong."""
    made = [bench.sheet(file, way) for file in bench.files]
    sheets = with_common_peaks([Sheet(f"r{k}.csv", "", sheet.columns) for k, (sheet, _) in enumerate(made)])
    draft = drafted(sheets, Answers(), None)
    wrong = []
    for k, (file, (_, truth)) in enumerate(zip(bench.files, made, strict=True)):
        mine = [trace for trace in draft.traces if trace.record.sheet.file == f"r{k}.csv"]
        test = file.parent.name
        if len(mine) != 1 or not (mine[0].test == test or {mine[0].test, test} <= TWINS):
            wrong.append(f"{file.parent.name}/{file.name}: {[trace.test for trace in mine]}")
        for take in (take for trace in mine for take in trace.record.takes if take.column.label in truth):
            sign = -1 if take.unit.startswith("-") else 1
            if (take.quantity, sign) != truth[take.column.label]:
                wrong.append(f"{test}/{file.name}: {take.column.label} as {take.header}: {take.reason}")
    return wrong


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    return Bench(tmp_path_factory.mktemp("bench"), 5)


@pytest.mark.parametrize("way", WAYS)
def test_tests_quantities_and_signs_are_found_whatever_was_lost(bench: Bench, way: str) -> None:
    assert mistakes(bench, way) == []


def test_a_duty_that_nobody_named_is_what_the_current_follows(tmp_path: Path) -> None:
    bench = Bench(tmp_path, 200, instruments=Instruments(supply_ohm=0.2))  # a bridge whose duty is logged, no voltage
    assert {way: mistakes(bench, way) for way in ("named", "nameless", "nameless angle")} == {
        "named": [], "nameless": [], "nameless angle": []}  # fmt: skip


@pytest.mark.parametrize("effect", sorted(MEDIUM))
@pytest.mark.slow
def test_and_so_they_are_with_what_the_model_lacks(tmp_path: Path, effect: str) -> None:
    bench = Bench(tmp_path, 100, MEDIUM[effect])
    assert {way: found for way in WAYS if (found := mistakes(bench, way))} == {}


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(20, 23))
def test_and_so_they_are_on_other_throttles(tmp_path: Path, seed: int) -> None:
    bench = Bench(tmp_path, seed)
    assert {way: found for way in WAYS if (found := mistakes(bench, way))} == {}


def columns_of(bench: Bench, file: str) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    path = next(each for each in bench.files if f"{each.parent.name}/{each.name}" == file)
    sheet, truth = bench.sheet(path, "named")
    return sheet.columns[0].values, {truth[c.label][0]: c.values for c in sheet.columns[1:]}


def sheet_of(time: np.ndarray, named: dict[str, np.ndarray], units: dict[str, str], file: str = "long.csv") -> Sheet:
    return Sheet(file, "", (time_base(time), *(column(f"{name} ({units[name]})", x) for name, x in named.items())))


def drafted_alone(sheet: Sheet) -> Draft:
    return drafted([sheet], Answers(), None)


def rows(trace: Trace) -> tuple[float, float]:
    time = trace.record.time
    return float(time[0]), float(time[-1])


UNITS = {"voltage": "V", "current": "A", "tps": "V", "emf": "V"}


def driven(bench: Bench) -> tuple[tuple[np.ndarray, dict[str, np.ndarray]], tuple[np.ndarray, dict[str, np.ndarray]]]:
    """A ramp and a response; the response's current, which the bench logs in mA, in A."""
    ramp, response = columns_of(bench, "static_load/ramp_1.csv"), columns_of(bench, "response/drive_1.csv")
    response[1]["current"] = 1e-3 * response[1]["current"]
    return ramp, response


def test_a_long_record_is_cut_where_the_rig_rests(bench: Bench) -> None:
    (t1, ramp), (t2, response) = driven(bench)
    rest = np.arange(1, 751) / 250.0
    still = {name: np.full(750, values[-1]) for name, values in ramp.items()} | {"voltage": np.zeros(750)}
    time = np.concatenate([t1, t1[-1] + rest, t1[-1] + rest[-1] + 0.001 + t2])
    named = {name: np.concatenate([ramp[name], still[name], response[name]]) for name in ramp}
    traces = drafted_alone(sheet_of(time, named, UNITS)).traces
    assert [trace.file for trace in traces] == ["static_load/long_1.csv", "response/long_2.csv"]
    assert rows(traces[0])[0] == time[0]
    assert t1[-1] < rows(traces[0])[1] < rows(traces[1])[0] < t1[-1] + 3.0
    assert rows(traces[1])[1] == time[-1]


def test_a_record_whose_clock_begins_anew_holds_two(bench: Bench) -> None:
    (t1, ramp), (t2, response) = driven(bench)
    named = {name: np.concatenate([ramp[name], response[name]]) for name in ramp}
    traces = drafted_alone(sheet_of(np.concatenate([t1, t2]), named, UNITS)).traces
    assert [trace.test for trace in traces] == ["static_load", "response"]
    assert [trace.record.time.size for trace in traces] == [t1.size, t2.size]
    assert "its clock begins anew" in traces[0].reason


def test_a_pause_without_samples_parts_two(bench: Bench) -> None:
    (t1, ramp), (t2, response) = driven(bench)
    named = {name: np.concatenate([ramp[name], response[name]]) for name in ramp}
    traces = drafted_alone(sheet_of(np.concatenate([t1, t1[-1] + 30.0 + t2]), named, UNITS)).traces
    assert [trace.record.time.size for trace in traces] == [t1.size, t2.size]


def test_each_fall_of_a_plate_let_go_again_and_again_is_a_trace_and_lifting_it_is_none(bench: Bench) -> None:
    time, one = columns_of(bench, "back_emf/release_1.csv")
    lift = np.linspace(one["tps"][-1], one["tps"][0], 400)
    step = time[1] - time[0]
    noise = np.random.default_rng(0).normal(0.0, 0.003, 400)
    tps = np.concatenate([one["tps"], lift + noise, one["tps"], lift + noise, one["tps"]])
    emf = np.concatenate([one["emf"], 5.0 * noise + 0.5, one["emf"], 5.0 * noise + 0.5, one["emf"]])
    traces = drafted_alone(sheet_of(step * np.arange(tps.size), {"emf": emf, "tps": tps}, UNITS)).traces
    assert [trace.test for trace in traces] == ["back_emf"] * 3
    for k, trace in enumerate(traces):
        begin, end = rows(trace)
        fall = k * (time.size + 400) * step
        assert fall - 0.15 < begin < fall + 0.15
        assert fall + 0.05 < end < fall + (time.size + 60) * step
        sensor = trace.record.signals["tps"]
        assert sensor[:5].mean() - sensor[-5:].mean() > 0.9 * np.ptp(one["tps"])


def test_a_position_that_somebody_drives_unlogged_is_no_release() -> None:
    time = 0.01 * np.arange(3000)
    position = 30.0 + 25.0 * np.sin(0.9 * time) * np.sin(0.11 * time)
    (trace,) = drafted_alone(sheet_of(time, {"TPS": position}, {"TPS": "%"})).traces
    assert trace.test == "unknown"
    with pytest.raises(MeasurementError, match=r"nothing that drives it.*Settle it with --test 'long\.csv=response'"):
        accept_all(drafted_alone(trace.record.sheet).doubts, Answers())


def test_what_was_said_is_not_turned(bench: Bench) -> None:
    _, (time, response) = driven(bench)
    sheet = sheet_of(time, response, UNITS)
    (trace,) = drafted([sheet], Answers({("", "current"): Target("current", "-1 A")}), None).traces
    take = trace.record.take("current")
    assert take is not None
    assert take.unit == "-1 A"


@pytest.mark.parametrize(("file", "test", "sure"), [("ramp_3.csv", "static_load", True), ("x.csv", "response", True),
                                                    ("viscous_2.csv", "response", False)])  # fmt: skip
def test_a_name_settles_what_signals_leave_open_and_is_doubted_where_they_do_not(
    bench: Bench, file: str, test: str, sure: bool
) -> None:
    _, (time, response) = driven(bench)
    (trace,) = drafted_alone(sheet_of(time, response, UNITS, file)).traces
    shown = rig_test_of(trace.record)
    assert (shown.test, shown.sure) == (test, sure)


def test_a_setpoint_that_is_one_sine_is_a_sine_test() -> None:
    time = 0.002 * np.arange(5000)
    setpoint = 30.0 + 5.0 * np.sin(2 * np.pi * 2.0 * time)
    position = 30.0 + 4.0 * np.sin(2 * np.pi * 2.0 * time - 0.5)
    made = sheet_of(time, {"setpoint": setpoint, "position": position}, {"setpoint": "%", "position": "%"})
    (trace,) = drafted_alone(made).traces
    assert trace.test == "sine"


def test_angles_counted_from_the_open_stop_are_turned_and_the_travel_with_them(bench: Bench) -> None:
    time, ramp = columns_of(bench, "static_load/ramp_1.csv")
    ramp["position"] = 90.0 * (1.0 - (ramp.pop("tps") - 0.45) / 4.28)
    draft = drafted_alone(sheet_of(time, ramp, UNITS | {"position": "deg"}))
    take = draft.traces[0].record.take("position")
    assert take is not None
    assert take.unit == "-1 deg"
    assert "travel_deg = [-90" in draft.nameplate[0].text


def test_a_second_track_that_falls_while_the_plate_opens_is_told_from_the_first(bench: Bench) -> None:
    time, ramp = columns_of(bench, "static_load/ramp_1.csv")
    ramp["tps"] = 5.0 - ramp["tps"]
    (guess,) = drafted_alone(sheet_of(time, ramp, UNITS)).nameplate
    assert guess.text.startswith("[tps]\nclosed_V = 4.")
    assert "falls while the plate opens" in guess.reason


def test_columns_that_nothing_tells_are_doubted_and_constant_ones_are_left_out(bench: Bench) -> None:
    _, (time, response) = driven(bench)
    odd = {"Fred": np.sin(time), "Wilma": np.ones(time.size)}
    draft = drafted_alone(sheet_of(time, {**response, **odd}, UNITS | {"Fred": "1", "Wilma": "1"}))
    assert [doubt.where for doubt in draft.doubts if "column" in doubt.where] == ["long.csv, column 'Fred (1)'"]
    assert draft.doubts[0].mend == "--column 'Fred (1)=position [deg]'"


def test_of_two_columns_for_one_quantity_the_first_is_taken_and_doubted(bench: Bench) -> None:
    _, (time, response) = driven(bench)
    twice = {**response, "TPS2": 5.0 - response["tps"]}
    draft = drafted_alone(sheet_of(time, twice, UNITS | {"TPS2": "V"}))
    (doubt,) = [doubt for doubt in draft.doubts if "column" in doubt.where]
    assert doubt.taken == "tps [V]"
    assert "the first of several: 'TPS2 (V)'" in doubt.reason


@pytest.mark.parametrize("speed", ["motor rpm", "RPM", "Brake torque", "Throttle target"])
def test_one_signal_that_an_engine_has_too_makes_no_engines_log_of_a_bench(bench: Bench, speed: str) -> None:
    _, (time, response) = driven(bench)
    draft = drafted_alone(sheet_of(time, {**response, speed: 100.0 + np.sin(time)}, UNITS | {speed: "1"}))
    (trace,) = draft.traces
    assert {"voltage", "current", "tps"} <= set(trace.record.signals)


def test_without_a_time_or_anything_known_a_file_is_refused() -> None:
    values = np.random.default_rng(1).normal(size=50)
    with pytest.raises(MeasurementError, match=r"no time among its columns 'a', 'b'.*--column 'HEADER=time \[s\]'"):
        drafted_alone(Sheet("a.csv", "", (Column("a", "a", "", values), Column("b", "b", "", values))))
    with pytest.raises(MeasurementError, match="nothing says what 'Fred' is"):
        drafted_alone(Sheet("a.csv", "", (time_base(np.arange(50.0)), Column("Fred", "Fred", "", values))))
