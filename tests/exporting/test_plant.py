"""The plant in C and the FMU do what our own stepper does, open and in the loop."""

from __future__ import annotations

import subprocess
import zipfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as Xml

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import exports
import results
from etcfit.control.pid.loop import Body, Loop
from etcfit.control.setpoint import Setpoint
from etcfit.exporting import Export, ExportSettings, Source, fmu
from etcfit.exporting.plant import C
from etcfit.model.ecu import Ecu
from etcfit.model.pid import Gains, Memory, tick

SETPOINT = Setpoint((0.0, 0.05, 0.06, 0.3, 0.5, 0.7, 0.71, 1.0), (0.2, 0.2, 0.6, 0.6, 0.05, 0.05, 0.95, 0.95), ())
GAINS = Gains(12.0, 60.0, 0.25)
ECU = Ecu(period=2e-3)
WITHIN = 1e-3  # of the travel: the loop is reproduced to 0.1 %
STEPS = 4  # of the plant in a tick, 0.5 ms each


def twin() -> Source:
    """The bench twin as fitted, its limp-home spring included."""
    return Source(results.bench_twin(Path("measurements/bench_twin")).fitted())


MODELS: dict[str, Callable[[], Source]] = {"twin": twin, "several": lambda: exports.source(exports.SEVERAL)}
every_model = pytest.mark.parametrize("model", MODELS)


@cache
def source_of(model: str) -> Source:
    return MODELS[model]()


@cache
def ours(model: str, gains: Gains = GAINS) -> np.ndarray:
    """Angle at each tick of our own closed loop, rad."""
    source = source_of(model)
    throttles = jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype=float)[None], source.throttle)
    loop = Loop(throttles, Body(**{("gear_ratio" if k == "N" else k): v for k, v in source.body.items()}), ECU)
    path = loop.respond(Gains.stacked(gains), SETPOINT)
    return np.asarray(path.position)[0, 0]


def closed(source: Source, read: float, drive: Callable[[float], tuple[float, float]]) -> np.ndarray:
    """Angle at each tick of our discrete PID around another plant, rad.

    Args:
        source: for the travel.
        read: angle that its sensor shows at the begin, rad.
        drive: a tick of it under a voltage: true angle at its end, and the one that the sensor shows then.
    """
    lower, upper = source.travel
    wanted = lower + np.asarray(SETPOINT.at(SETPOINT.instants(ECU.period))) * (upper - lower)
    memory, controller, true, path = Memory.at_rest(GAINS, ECU, wanted[0]), jax.jit(tick), wanted[0], []
    for setpoint in wanted:
        volts, memory = controller(GAINS, ECU, memory, setpoint, read, 0.0)
        path.append(true)
        true, read = drive(float(volts))
    return np.array(path)


def begins(source: Source) -> float:
    lower, upper = source.travel
    return lower + SETPOINT.shares[0] * (upper - lower)


def apart(source: Source, one: np.ndarray, other: np.ndarray) -> float:
    """Largest distance of two responses, over the travel."""
    assert np.ptp(one) > 0.8 * (source.travel[1] - source.travel[0]), "a loop at rest would compare nothing"
    return float(np.max(np.abs(one - other))) / (source.travel[1] - source.travel[0])


@exports.needs_a_compiler
@pytest.mark.slow
@every_model
def test_the_loop_around_the_c_plant_is_ours(tmp_path: Path, model: str) -> None:
    source = source_of(model)
    plant = exports.CPlant(C.export(source), tmp_path / "c")
    seen = plant.begin(begins(source))

    def drive(volts: float) -> tuple[float, float]:
        _, angle, _, shown, *_ = plant.drive(volts, STEPS)
        return angle, shown

    found = apart(source, ours(model), closed(source, seen[3], drive))
    print(f"{model}: C plant in the loop within {found:.2e} of the travel")
    assert found < WITHIN
    assert apart(source, ours(model), ours(model, Gains(12.0, 60.0, 0.27))) > WITHIN  # it would have been seen


@exports.needs_a_compiler
@pytest.mark.slow
@every_model
def test_the_loop_around_the_fmu_is_ours(tmp_path: Path, model: str) -> None:
    fmpy = pytest.importorskip("fmpy", reason="fmpy is not installed: pip install '.[test]'")
    from fmpy.fmi3 import FMU3Slave
    from fmpy.validation import validate_fmu

    source = source_of(model)
    (archive,) = written(fmu.FMU.export(source), tmp_path)
    assert validate_fmu(str(archive)) == []
    description = fmpy.read_model_description(str(archive))
    number = {v.name: v.valueReference for v in description.modelVariables}
    slave = FMU3Slave(guid=description.guid, unzipDirectory=fmpy.extract(str(archive), unzipdir=str(tmp_path / "x")),
                      modelIdentifier="etcfit_plant", instanceName="plant")  # fmt: skip
    slave.instantiate()
    slave.enterInitializationMode(startTime=0.0)
    slave.setFloat64([number["start_angle"]], [begins(source)])
    slave.exitInitializationMode()
    asked = [number["angle"], number["sensor_angle"]]
    time = 0.0

    def drive(volts: float) -> tuple[float, float]:
        nonlocal time
        slave.setFloat64([number["voltage"]], [volts])
        slave.doStep(currentCommunicationPoint=time, communicationStepSize=ECU.period)
        time += ECU.period
        angle, shown = slave.getFloat64(asked)
        return angle, shown

    found = apart(source, ours(model), closed(source, slave.getFloat64(asked)[1], drive))
    slave.terminate()
    slave.freeInstance()
    print(f"{model}: FMU in the loop within {found:.2e} of the travel")
    assert found < WITHIN


def written(export: Export, folder: Path) -> list[Path]:
    """The files of an export on the disk."""
    paths = []
    for name, content in export.files.items():
        (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
        paths.append(folder / name)
    return paths


@exports.needs_a_compiler
@pytest.mark.slow
def test_an_importer_simulates_the_fmu_and_is_told_what_it_cannot_do(tmp_path: Path) -> None:
    fmpy = pytest.importorskip("fmpy", reason="fmpy is not installed: pip install '.[test]'")

    source = exports.source()
    (archive,) = written(fmu.FMU.export(source), tmp_path)
    step = np.array([(0.0, 8.0, 0.0), (0.5, 8.0, 0.0)], dtype=[("time", float), ("voltage", float), ("torque", float)])
    how: dict[str, Any] = {"stop_time": 0.5, "output_interval": 5e-3, "input": step, "output": ["angle", "current"]}
    path = fmpy.simulate_fmu(str(archive), step_size=5e-3, **how)
    assert path["angle"][-1] == pytest.approx(source.travel[1])  # at the stop
    assert path["current"][-1] == pytest.approx(8.0 / source.values["R_a"], rel=1e-3)
    stiffer = fmpy.simulate_fmu(str(archive), step_size=5e-3, start_values={"K_s": 10.0}, **how)
    assert stiffer["angle"][-1] < 0.2  # a parameter set by the importer counts
    with pytest.raises(fmpy.fmi1.FMICallException):
        fmpy.simulate_fmu(str(archive), step_size=7e-4, **(how | {"output_interval": 7e-4}))


@pytest.mark.slow
@exports.needs_a_compiler
def test_the_harness_finds_our_stepper_and_a_wrong_compiler(tmp_path: Path) -> None:
    made = C.export(exports.source(exports.SEVERAL))
    harness = exports.compiled(made, tmp_path, "etcfit_plant_test.c")
    done = subprocess.run([harness], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.splitlines()[-1]) == (0, "0 of 24 rows differ from etcfit")
    source = str(made.files["etcfit_plant.c"])
    bent = Export({**made.files, "etcfit_plant.c": source.replace("fmax(", "fmin(", 1)})
    assert source != bent.files["etcfit_plant.c"]
    done = subprocess.run([exports.compiled(bent, tmp_path, "etcfit_plant_test.c")], capture_output=True, check=False)
    assert done.returncode == 1


@exports.needs_a_compiler
@pytest.mark.slow
def test_the_sensors_are_late_by_what_the_model_says(tmp_path: Path) -> None:
    effects = {"channel_delay": {"t_c": 1.75e-3}, "current_sensor_offset": {"I_0": 0.1}}
    source = exports.source(effects, ExportSettings(step=1e-3))
    plant = exports.CPlant(C.export(source), tmp_path / "c")
    plant.begin(0.3)
    seen = np.array([plant.drive(6.0, 1) for _ in range(30)])
    true, shown = seen[:, 0], seen[:, 4] - source.values["I_0"]
    assert shown[2:] == pytest.approx(0.25 * true[1:-1] + 0.75 * true[:-2], rel=1e-3, abs=1e-9)
    tps = exports.TPS
    assert seen[:, 5] == pytest.approx(tps.closed_V + (tps.open_V - tps.closed_V) * seen[:, 1] / tps.travel)


@exports.needs_a_compiler
@pytest.mark.slow
def test_a_stuck_plate_stands_still_and_an_outer_torque_moves_it(tmp_path: Path) -> None:
    source = exports.source()
    plant = exports.CPlant(C.export(source), tmp_path / "c")
    at = 0.3
    plant.begin(at)
    v = source.values
    hold = v["K_s"] * at + v["T_PL"]
    assert plant.drive(0.0, 4000, torque=hold + 0.9 * v["T_f"])[1] == at  # to the last bit
    plant.begin(at)
    assert plant.drive(0.0, 100, torque=hold + 1.1 * v["T_f"])[1] > at


@exports.needs_a_compiler
@pytest.mark.slow
def test_the_fmu_holds_sources_that_compile_and_says_what_it_cannot_hold(tmp_path: Path) -> None:
    made = fmu.FMU.export(exports.source(exports.SEVERAL))
    (archive,) = written(made, tmp_path)
    with zipfile.ZipFile(archive) as packed:
        packed.extractall(tmp_path)
        names = packed.namelist()
    assert any(name.startswith("binaries/") for name in names)
    how = [*fmu.compiler(), *exports.STRICT, "-c", "fmi3.c", "etcfit_plant.c"]
    done = subprocess.run(how, cwd=tmp_path / "sources", capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    description = Xml.parse(tmp_path / "modelDescription.xml").getroot()
    assert description.find("CoSimulation") is not None
    assert description.find("ModelExchange") is None
    for sentence in made.cannot_hold[:-1]:
        assert sentence in description.attrib["description"]
    assert "SYNTHETIC" in description.attrib["description"]


@pytest.mark.slow
def test_the_same_model_is_the_same_c_and_another_step_is_another(tmp_path: Path) -> None:
    first, again = (C.export(exports.source()).files for _ in range(2))
    assert first == again
    other = C.export(exports.source(settings=ExportSettings(step=1e-3))).files
    assert "#define ETCFIT_PLANT_STEP 0.001" in str(other["etcfit_plant.h"])
