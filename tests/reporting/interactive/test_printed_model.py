"""The page's own plant and ECU, run in node, against etcfit's stepper and loop."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import results
import rigs
from etcfit.control.pid import Gains
from etcfit.control.pid.response import judge
from etcfit.control.pid.setpoint import trapezoid
from etcfit.control.pid.sliding import Sliding
from etcfit.estimation.joint_fit import ready
from etcfit.estimation.result import FitResult
from etcfit.files import plain
from etcfit.model.ecu import Ecu
from etcfit.model.effects import EFFECT_BY_NAME, EFFECTS, PAPER, AbstractEffect
from etcfit.model.effects.limp_home_spring import LimpHomeSpring
from etcfit.model.parameters import parameters_of
from etcfit.problem.free_parameters import free_parameters
from etcfit.problem.problem import EstimationProblem
from etcfit.problem.trace import Trace
from etcfit.reporting.interactive.plant import plant_json
from etcfit.reporting.interactive.traces import Shelf, traces_json
from etcfit.rig.reader import read_folder

NODE = shutil.which("node")
pytestmark = pytest.mark.skipif(
    NODE is None, reason="no node on PATH: the page's scripts run in the browser's test only"
)
TWIN = Path(__file__).resolve().parents[3] / "measurements" / "bench_twin"
FINE = 240  # steps of our own stepper between two samples: an impact on a stop is seen to within one of them
CLOSE = 1e-3  # of a channel's range, as a chart of data and model spans it

# factors on fitted values
CHANGES: dict[str, Mapping[str, float]] = {
    "as fitted": {},
    "stiffer and drier": {"R_a": 1.3, "T_f": 0.6, "K_s": 1.4, "B_L": 3.0},
    "heavier, quicker coil": {"J_L": 2.0, "L_a": 0.5, "T_lh": 1.5, "K_b": 0.8, "B_m": 4.0},
}
# of effects beyond Eqs. 1-2, values at which they show; others at half their scale
SHOWS: dict[str, Mapping[str, float]] = {
    "backlash": {"g_b": 0.02, "t_b": 0.01, "T_PL": 0.0, "K_s": 0.05},  # a load that changes sign
    "winding_heating": {"r_h": 0.05, "tau_h": 2.0},
    "limp_home_spring": {"T_lh": 0.4, "K_lh": 0.6, "theta_lh": 0.16, "d_lh": 0.01},
    "cogging_torque": {"A_c": 0.02, "A_s": 0.01, "n_c": 3.0},
    "stop_bounce": {"e_r": 0.3},
}


def in_node(*asked: Mapping[str, Any]) -> list[dict[str, Any]]:
    words = [NODE or "node", str(Path(__file__).with_name("port.js"))]
    done = subprocess.run(words, input=json.dumps(plain(list(asked))), capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def twin() -> FitResult:
    return results.bench_twin(TWIN)


def finely(result: FitResult, traces: tuple[Trace, ...]) -> EstimationProblem:
    steps = [np.full(trace.instants.size - 1, FINE) for trace in traces]
    return EstimationProblem.of(result.rig.config, result.free_parameters, traces, steps)


def worst(result: FitResult, values: Mapping[str, float]) -> dict[tuple[str, str], float]:
    """Largest distance of the page's path from our own stepper's, over the range of each channel, by file and
    channel."""
    layout, traces = result.problem.layout, result.problem.batch.traces
    plant, carried = plant_json(result), traces_json(Shelf(None, result, None))
    problem = finely(result, traces)
    path = problem.free_run(layout.coordinates(values))
    told = {symbol: float(value) for symbol, value in values.items() if symbol in plant["values"]}
    asked = [
        {"kind": "trace", "sim": each["sim"], "effects": plant["effects"], "values": told, "instants": trace.instants}
        for each, trace in zip(carried, traces, strict=True)
    ]
    out = {}
    for trace, y, seen in zip(traces, path, in_node(*asked), strict=True):
        for m, channel in enumerate(trace.channels):
            both = np.concatenate((y[:, m], trace.data[np.isfinite(trace.data[:, m]), m]))
            off = np.max(np.abs(np.asarray(seen[channel]) - y[:, m])) / np.ptp(both)
            out[trace.measurement.file, channel] = float(off)
    return out


def changed(result: FitResult, factors: Mapping[str, float]) -> dict[str, float]:
    layout = result.problem.layout
    values = {s: v * factors.get(s, 1.0) for s, v in result.values.items()}
    values |= {s: values[other] for s, other in layout.ties}
    # what coordinates can hold: their values again, through the domain's own curve
    return {s: float(v) for s, v in layout.values(layout.coordinates(values), result.free_parameters.held).items()}


@pytest.mark.slow
def test_a_response_a_release_and_held_plates_agree(tmp_path: Path) -> None:
    some = replace(results.result(results.rig(tmp_path)), holdout=None)
    assert max(worst(some, changed(some, CHANGES["stiffer and drier"])).values()) < CLOSE


@pytest.mark.slow
@pytest.mark.parametrize("factors", CHANGES.values(), ids=CHANGES)
def test_every_trace_of_the_twin_agrees_with_our_own_stepper(twin: FitResult, factors: Mapping[str, float]) -> None:
    off = worst(replace(twin, holdout=None), changed(twin, factors))
    where = max(off, key=lambda at: off[at])
    print(f"largest distance: {100.0 * off[where]:.4f} % of the range, in {where}")
    assert len(off) > 25
    assert off[where] < CLOSE


def test_the_port_knows_no_effect_that_we_do_not() -> None:
    assert set(in_node({"kind": "effects"})[0]) <= EFFECT_BY_NAME.keys()


@pytest.mark.slow
@pytest.mark.parametrize("effect", [e for e in EFFECTS if e not in PAPER], ids=lambda effect: effect.name)
def test_each_effect_of_the_port_is_ours(effect: type[AbstractEffect]) -> None:
    """A response with each effect of the catalogue, large enough to show: without it the two must differ."""
    rig = read_folder(TWIN)
    rig = replace(rig, config=replace(rig.config, effects=()))
    known = free_parameters(rig.config, (effect,))
    response = next(trace for trace in ready(rig)[0] if trace.measurement.file == "response/drive_2.csv")
    layout = known.layout
    values = {p.symbol: p.nominal for p in layout.parameters} | {
        p.symbol: 0.5 * p.domain.scale for p in parameters_of(effect)
    }
    values |= SHOWS.get(effect.name, {})
    x = layout.coordinates(values)
    values = {s: float(v) for s, v in layout.values(x, known.held).items()}
    problem = EstimationProblem.of(rig.config, known, (response,))
    some = replace(
        results.bench_twin(TWIN), rig=rig, free_parameters=known, x=x, values=values, problem=problem, holdout=None,
        whitened=(np.zeros(response.data.shape),), predicted={response.measurement.file: response.data},
    )  # fmt: skip
    off = worst(some, values)
    print(f"{effect.name}: {100.0 * max(off.values()):.4f} % of the range")
    assert max(off.values()) < CLOSE
    zero = values | dict(effect.off or {})
    bare, with_it = (finely(some, (response,)).free_run(at)[0] for at in (layout.coordinates(zero), x))
    assert np.max(np.abs(with_it - bare) / np.ptp(with_it, axis=0)) > 3.0 * CLOSE


ECUS = {
    "plain": Ecu(),
    "late and filtered": Ecu(delay=2.3e-3, lag=1.5e-3, resolution=4e-4, pwm=0.01),
    "slew, dead band, clamp": Ecu(slew=300.0, dead_band=2e-3, integral=0.3, duty=0.8, period=2e-3),
    "weights": Ecu(setpoint_weight=0.4, derivative_weight=0.0, filter=5e-3),
}


@pytest.mark.slow
@pytest.mark.parametrize("sliding", [None, Sliding(0.9, 0.5, 0.08, 0.41)], ids=["", "ahead"])
@pytest.mark.parametrize("ecu", ECUS.values(), ids=ECUS)
def test_the_loop_is_our_own_tick_by_tick(ecu: Ecu, sliding: Sliding | None) -> None:
    spring = {"T_lh": 0.5, "K_lh": 0.7, "theta_lh": 0.16, "d_lh": 0.01}
    loop, course, gains = (
        replace(rigs.loop(LimpHomeSpring, ecu=ecu, body=rigs.QUARTER_TURN, **spring), sliding=sliding),
        trapezoid(),
        Gains(25.0, 260.0, 0.35),
    )
    ours = loop.respond(rigs.one(*gains), course)
    share = np.asarray(loop.share(np.asarray(ours.position)))[0, 0]
    values = rigs.values(**spring)
    asked = {
        "kind": "loop", "effects": [e.name for e in (*PAPER, LimpHomeSpring)], "values": values,
        "gains": gains._asdict(), "until": course.duration,
        "loop": {"ecu": ecu._asdict(), "body": loop.body._asdict(), "longest_step": loop.settings.longest_step,
                 "setpoint": {"times": course.times, "shares": course.shares}, "bias": None,
                 "sliding": None if sliding is None else vars(sliding),
                 "levels": [vars(level) for level in course.levels]},
    }  # fmt: skip
    (seen,) = in_node(asked)
    assert np.ptp(share) > 0.3
    assert np.max(np.abs(np.asarray(seen["share"]) - share)) < CLOSE * np.ptp(share)
    assert np.max(np.abs(np.asarray(seen["volts"]) - np.asarray(ours.voltage)[0, 0])) < CLOSE * 24.0
    told = judge(course, course.instants(ecu.period), share)._asdict()
    for name, value in told.items():
        there = np.inf if seen["figures"][name] is None else seen["figures"][name]
        assert there == pytest.approx(float(value), rel=1e-3, abs=1e-3)
