"""The page's printed plant and ECU, run in node, against etcfit's stepper and loop."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import results
import rigs
from bodies import OPEN, N
from effect_samples import Tabled
from etcfit.backend import compiled_quickly
from etcfit.control.loop_figures import judge
from etcfit.control.pid import Gains
from etcfit.control.pid.feedforward import Sliding
from etcfit.control.setpoint import trapezoid
from etcfit.estimation.ready import ready
from etcfit.estimation.result import FitResult
from etcfit.files import plain
from etcfit.model.ecu import Ecu
from etcfit.model.effects import EFFECTS, PAPER, AbstractEffect, State
from etcfit.model.effects.electrical import ActuationDelay
from etcfit.model.effects.friction import PreslidingFriction
from etcfit.model.effects.gear import Backlash, StopBounce
from etcfit.model.effects.sensors import ChannelDelay, PositionSensorLag
from etcfit.model.effects.springs import LimpHomeSpring
from etcfit.model.parameters import parameters_of
from etcfit.model.smooth import UNKNOWNS
from etcfit.model.smooth.curves import FrictionOverTime
from etcfit.model.stepper import Step, step
from etcfit.model.throttle import Throttle
from etcfit.problem.free_parameters import free_parameters
from etcfit.problem.problem import EstimationProblem
from etcfit.problem.trace import Trace
from etcfit.reporting.interactive.plant import CHANNELS, Types, plant_json, script, simulation
from etcfit.reporting.interactive.traces import TraceSources, traces_json
from etcfit.rig.reader import read_folder

NODE = shutil.which("node")
pytestmark = pytest.mark.skipif(
    NODE is None, reason="no node on PATH: the page's scripts run in the browser's test only"
)
TWIN = Path(__file__).resolve().parents[3] / "measurements" / "bench_twin"
FINE = 240  # steps of our own stepper between two samples: an impact on a stop is seen to within one of them
CLOSE = 1e-3  # of a channel's range, as a chart of data and model spans it
EXACT = 1e-8  # of the travel and V: the loop runs in the same steps

# factors on fitted values
CHANGES: dict[str, Mapping[str, float]] = {
    "as fitted": {},
    "stiffer and drier": {"R_a": 1.3, "T_f": 0.6, "K_s": 1.4, "B_L": 3.0},
    "heavier, quicker coil": {"J_L": 2.0, "L_a": 0.5, "T_lh": 1.5, "K_b": 0.8, "B_m": 4.0},
}
HANDLED = (ActuationDelay, ChannelDelay, PositionSensorLag, PreslidingFriction, Backlash, StopBounce, FrictionOverTime)
# values at which they show; others at half their scale
SHOWS: dict[str, Mapping[str, float]] = {
    "backlash": {"g_b": 0.02, "t_b": 0.01, "T_PL": 0.0, "K_s": 0.05},  # a load that changes sign
    "stop_bounce": {"e_r": 0.3},
}


def in_node(types: Types, *asked: Mapping[str, Any]) -> list[Any]:
    """What the page computes of a throttle of these effects."""
    words = [NODE or "node", str(Path(__file__).with_name("in_node.js"))]
    given = json.dumps({"script": script(types), "asked": plain(list(asked))})
    done = subprocess.run(words, input=given, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def twin() -> FitResult:
    return results.bench_twin(TWIN)


def finely(result: FitResult, traces: tuple[Trace, ...]) -> EstimationProblem:
    steps = [np.full(trace.instants.size - 1, FINE) for trace in traces]
    return EstimationProblem.of_traces(result.rig.config, result.free_parameters, traces, steps)


def worst(result: FitResult, values: Mapping[str, float]) -> dict[tuple[str, str], float]:
    """Largest distance of the page's path from our own stepper's, over the range of each channel, by file and
    channel."""
    layout, traces = result.problem.layout, result.problem.batch.traces
    simulated, carried = simulation(result), traces_json(TraceSources(None, result, None))
    assert not simulated.left_out
    plant = plant_json(result, simulated)
    problem = finely(result, traces)
    path = problem.free_run(layout.coordinates(values))
    told = {symbol: float(value) for symbol, value in values.items() if symbol in plant["values"]}
    asked = [
        {"kind": "trace", "sim": each["sim"], "values": told, "instants": trace.instants}
        for each, trace in zip(carried, traces, strict=True)
    ]
    out = {}
    for trace, y, seen in zip(traces, path, in_node(simulated.effects, *asked), strict=True):
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


COUNT = 60  # states and inputs
CURRENT, ANGLE, SPEED = 0, 1, 2
MODELS: dict[str, Types] = {
    "Eqs. 1-2": PAPER,
    "every effect": EFFECTS,
    "without play, and curves without a name": (*(e for e in EFFECTS if e is not Backlash), *UNKNOWNS),
}


class Rows(NamedTuple):
    """Parameters by symbol, states with memories, and inputs by name, shape (COUNT, ...) each."""

    p: dict[str, np.ndarray]
    x: np.ndarray
    u: dict[str, np.ndarray]


def rows(types: Types) -> Rows:
    """States off, on and beyond the stops, plates held and free, motors alone, open terminals, steps of no length."""
    rng = np.random.default_rng(2)
    memories = sum(len(effect.z0) for effect in types)
    x = rng.uniform(-1.0, 1.0, (COUNT, 3 + memories)) * np.array([8.0, 0.0, 30.0, *[0.7] * memories])
    x[::3] *= 0.01
    x[:, ANGLE] = rng.uniform(-0.01, OPEN + 0.01, COUNT)
    x[::7, ANGLE], x[::14, SPEED] = 0.0, 0.0
    x[1::7, ANGLE], x[1::7, SPEED] = 1e-4, -40.0  # about to land
    ones, some = np.ones(COUNT), rng.uniform(size=(5, COUNT))
    u = {
        "dt": np.where(some[0] < 0.1, 0.0, 10.0 ** rng.uniform(-5.0, -2.3, COUNT)),
        "time": rng.uniform(0.0, 50.0, COUNT),
    }
    u |= {name: rng.uniform(-12.0, 12.0, COUNT) for name in ("voltage0", "voltage1")}
    u |= {name: rng.uniform(-0.5, 0.5, COUNT) for name in ("torque0", "torque1")}
    u |= {name: 1.0 * (some[k] > 0.2) for k, name in enumerate(("mobile", "circuit", "plate"), 1)}
    u |= {"series": some[4], "gear_ratio": N * ones, "lower": 0.0 * ones, "upper": OPEN * ones}
    u["lower"][5::11], u["upper"][5::11] = -np.inf, np.inf
    p = {each.symbol: np.full(COUNT, 0.5 * each.domain.scale) for effect in types for each in parameters_of(effect)}
    return Rows({symbol: value * rng.uniform(0.5, 1.5, COUNT) for symbol, value in p.items()}, x, u)


def variants(types: Types, at: Rows) -> Rows:
    """The rows with all effects, with none beyond Eqs. 1-2, and with each of the others alone, one after the other."""
    off = at.p | {symbol: np.full(COUNT, value) for effect in types for symbol, value in (effect.off or {}).items()}
    alone = [off | {symbol: at.p[symbol] for symbol in effect.off} for effect in types if effect.off is not None]
    every = [at._replace(p=p) for p in (at.p, off, *alone)]
    return jax.tree.map(lambda *each: np.concatenate(each), *every)


def printed(types: Types, at: Rows) -> np.ndarray:
    """State and memories after a step, readings and delays as the page computes them, a row each."""
    p, u = ([dict(zip(of, row, strict=True)) for row in zip(*of.values(), strict=True)] for of in (at.p, at.u))
    return np.asarray(in_node(types, {"kind": "steps", "p": p, "x": at.x, "u": u})[0], dtype=float)


def stepped(types: Types, at: Rows) -> np.ndarray:
    """The same by etcfit."""

    def one(p: Any, x: Any, u: Any) -> Any:
        throttle = Throttle.build(types, p)
        s = Step(**u, guide_stiffness=0.0, target0=0.0, target1=0.0, lever=0.0)
        after = step(throttle, State(*x[:3]), tuple(x[3:]), s)
        seen, late = throttle.observe(*after, s.inputs(1.0)), throttle.delays()
        readings = [seen[channel] for channel in CHANNELS]
        every = (after, readings, late.input, late.channels["position"], late.channels["current"])
        return jnp.stack([jnp.asarray(each, float) for each in jax.tree.leaves(every)])

    return np.asarray(compiled_quickly(jax.vmap(one))(*at))


@pytest.mark.parametrize("types", MODELS.values(), ids=MODELS)
def test_a_printed_step_is_the_steppers_own(types: Types) -> None:
    at = variants(types, rows(types))
    wanted = stepped(types, at)
    off = np.abs(printed(types, at) - wanted) / np.maximum(np.abs(wanted), np.median(np.abs(wanted), axis=0) + 1e-6)
    assert np.max(off) < 1e-9
    _, bare, *alone = np.split(wanted, wanted.shape[0] // COUNT)
    for effect, each in zip((effect for effect in types if effect.off is not None), alone, strict=True):
        assert np.max(np.abs(each - bare)) > 1e-6, effect.name


@pytest.mark.slow
@pytest.mark.parametrize("effect", HANDLED, ids=lambda effect: effect.name)
def test_what_the_page_does_around_a_step_agrees(effect: type[AbstractEffect]) -> None:
    """A response with an effect for which the page must delay, shorten its steps or know the time."""
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
    problem = EstimationProblem.of_traces(rig.config, known, (response,))
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
AHEAD = ("late and filtered", "weights")


@pytest.mark.slow
@pytest.mark.parametrize("name", ECUS)
def test_the_loop_is_our_own_tick_by_tick(name: str) -> None:
    """What dry friction takes is put ahead by every second of them."""
    ecu, sliding = ECUS[name], Sliding(0.9, 0.5, 0.08, 0.41) if name in AHEAD else None
    spring = {"T_lh": 0.5, "K_lh": 0.7, "theta_lh": 0.16, "d_lh": 0.01}
    loop, course, gains = (
        replace(rigs.loop(LimpHomeSpring, ecu=ecu, body=rigs.QUARTER_TURN, **spring), sliding=sliding),
        trapezoid(),
        Gains(25.0, 260.0, 0.35),
    )
    ours = loop.respond(rigs.one(*gains), course)
    share = np.asarray(loop.share(np.asarray(ours.position)))[0, 0]
    asked = {
        "kind": "loop", "values": rigs.values(**spring),
        "gains": gains._asdict(), "until": course.duration,
        "loop": {"ecu": ecu._asdict(), "body": loop.body._asdict(), "longest_step": loop.settings.longest_step,
                 "setpoint": {"times": course.times, "shares": course.shares}, "bias": None,
                 "sliding": None if sliding is None else vars(sliding),
                 "levels": [vars(level) for level in course.levels]},
    }  # fmt: skip
    (seen,) = in_node((*PAPER, LimpHomeSpring), asked)
    assert np.ptp(share) > 0.3
    assert np.max(np.abs(np.asarray(seen["share"]) - share)) < EXACT
    assert np.max(np.abs(np.asarray(seen["volts"]) - np.asarray(ours.voltage)[0, 0])) < EXACT
    told = judge(course, course.instants(ecu.period), share).known()
    for name, value in told.items():
        there = np.inf if seen["figures"][name] is None else seen["figures"][name]
        assert there == pytest.approx(float(value), rel=1e-6, abs=1e-6)


def test_an_effect_that_cannot_be_printed_is_left_out_by_name(tmp_path: Path) -> None:
    result = results.result(results.rig(tmp_path))
    config = replace(result.rig.config, effects=())
    result = replace(result, free_parameters=free_parameters(config, (StopBounce, Tabled)))
    simulated = simulation(result)
    carried = plant_json(replace(result, values={**result.values, "e_r": 0.0}), simulated)
    assert carried["left_out"] == ["tabled"]
    assert "tabled" not in carried["effects"] + carried["others"]
    assert StopBounce in simulated.effects
    assert simulated.script == script(simulated.effects)


def test_a_rig_without_stops_has_none_on_the_page() -> None:
    pack = {"from": 0.0, "f32": ""}
    sim = {"t": pack, "v": pack, "release": None, "boundary": {"lower": -np.inf, "upper": np.inf}}
    assert in_node(PAPER, {"kind": "stops", "sim": sim}) == [["-Infinity", "Infinity"]]
