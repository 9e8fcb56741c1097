"""The whitening filter against dense generalised least squares, and its residuals over many seeds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import bodies
from etcfit.estimation.goodness import autocorrelation
from etcfit.model.effects import PAPER
from etcfit.model.stepper import simulate
from etcfit.model.throttle import Throttle
from etcfit.problem.free_parameters import FreeParameters, free_parameters
from etcfit.problem.input_signal import InputSignal
from etcfit.problem.prediction_error import columns
from etcfit.problem.problem import EstimationProblem
from etcfit.problem.trace import InitialState, Trace, prepare
from etcfit.problem.weights import farthest, free_running
from etcfit.rig.base import Fixed
from measurements import CONFIG, N, measurement, noisy, prepared, released

VALUES = bodies.values(B_L=1e-3)
DT = 1e-3
SHAPE = (1024, 60, 2)  # of every batch here, as of the largest, with room for SLIDING: JAX compiles the model once
SLIDING = ("R_a", "L_a", "K_b", "J_L", "B_L", "T_f", "T_PL")  # free where the plate slides


def knowing(*free: str) -> FreeParameters:
    """Only these are free, everything else is what it is."""
    fixed = {s: Fixed(v) for s, v in VALUES.items() if s not in free and s != "K_m"}
    known = free_parameters(replace(CONFIG, parameters=fixed))
    return replace(known, layout=replace(known.layout, room=len(SLIDING)))


def problem_of(
    traces: Sequence[Trace], free: tuple[str, ...], substeps: int = 1
) -> tuple[EstimationProblem, np.ndarray]:
    """The problem and the coordinates of the truth."""
    known = knowing(*free)
    steps = [np.full(t.instants.size - 1, substeps) for t in traces]
    return EstimationProblem.of_traces(CONFIG, known, tuple(traces), steps, SHAPE), known.layout.coordinates(VALUES)


# ---- a held plate, by its closed form


def held(volts: np.ndarray, shift: np.ndarray, current: float, dt: float = DT) -> np.ndarray:
    """Current at each sample while v is linear between samples and off by `shift` within each interval."""
    a, R = VALUES["R_a"] / VALUES["L_a"], VALUES["R_a"]
    decay = np.exp(-a * dt)
    out = [current]
    for v0, v1, e in zip(volts[:-1], volts[1:], shift, strict=True):
        ramp = (v1 - v0) / dt * (dt - (1.0 - decay) / a)
        out.append(decay * out[-1] + ((v0 + e) * (1.0 - decay) + ramp) / R)
    return np.array(out)


def volts_at(t: np.ndarray) -> np.ndarray:
    return 1.5 + np.sin(2 * np.pi * 7.0 * t) + 0.7 * np.sin(2 * np.pi * 31.0 * t)


def coloured(rng: np.random.Generator, n: int, sd: float, memory: float) -> np.ndarray:
    """Stationary AR(1)."""
    out = [sd * rng.standard_normal()]
    for w in sd * np.sqrt(1.0 - memory**2) * rng.standard_normal(n - 1):
        out.append(memory * out[-1] + w)
    return np.array(out)


def held_trace(seed: int, memory: float, n: int = 250, sd: float = 0.02) -> Trace:
    """A held plate whose input is known but for an error as stated, from a current known to 5 %."""
    rng = np.random.default_rng(seed)
    t = np.arange(n) * DT
    first, spread = volts_at(t)[0] / VALUES["R_a"], 0.05
    current = held(volts_at(t), coloured(rng, n - 1, sd, memory), first + spread * rng.standard_normal())
    m = measurement("resistance", t, {"voltage": volts_at(t), "current": current})
    m = noisy(m, seed + 1000)
    trace = prepared(m)
    signal = InputSignal(volts_at(t), np.full(n, sd), np.full(n, memory), np.zeros(n - 1, dtype=bool))
    return replace(trace, input=signal, start=InitialState((first, 0.0, 0.0), (spread, 0.0, 0.0)))


@pytest.fixture(scope="module", params=[0.0, 0.9], ids=["white input noise", "correlated input noise"])
def many_held(request: pytest.FixtureRequest) -> tuple[EstimationProblem, np.ndarray]:
    return problem_of([held_trace(seed, request.param) for seed in range(60)], ("R_a", "L_a"), substeps=4)


def test_a_sample_is_forgiven_what_its_neighbours_are_away_from_it() -> None:
    """By hand; where nothing was logged nothing is."""
    data = np.array([0.0, 1.0, 3.0, np.nan, 7.0])[:, None]
    assert_array_equal(farthest(data, 1)[:, 0], [1.0, 2.0, 2.0, 0.0, 0.0])
    assert_array_equal(farthest(data, 2)[:, 0], [3.0, 2.0, 4.0, 0.0, 4.0])


@pytest.mark.parametrize("reach", [1, 3, 6, 40])
def test_neighbours_are_all_those_within_reach(reach: int) -> None:
    data = np.random.default_rng(reach).standard_normal((50, 2))
    near = [data[max(0, k - reach) : k + reach + 1] for k in range(50)]
    assert_array_equal(farthest(data, reach), [np.abs(each - data[k]).max(axis=0) for k, each in enumerate(near)])


@pytest.mark.slow
def test_residuals_of_a_held_plate_are_standard_normal(many_held: tuple[EstimationProblem, np.ndarray]) -> None:
    """60 seeds of 250 samples: the mean square is known to 1.2 %, each lag's correlation to 0.8 %."""
    problem, x = many_held
    r = problem.linearise(x, problem.weighted(problem.kalman(x))).r
    each = np.stack([part[:, 0] for part in columns(problem.batch, r)])
    assert abs(np.mean(each)) < 0.033
    assert abs(np.mean(each**2) - 1.0) < 0.05
    assert abs(np.mean(each[:, :10] ** 2) - 1.0) < 0.25  # right from the start, whose current is uncertain
    assert np.mean(np.abs(each) > 1.96) == pytest.approx(0.05, abs=0.01)
    correlation = np.mean([autocorrelation(row, 10) for row in each], axis=0)
    assert np.max(np.abs(correlation)) < 0.04


@pytest.mark.slow
def test_without_the_filter_they_are_not(many_held: tuple[EstimationProblem, np.ndarray]) -> None:
    """The same data, each sample by its own noise: the input's noise shows."""
    problem, x = many_held
    r = problem.linearise(x, problem.weighted(free_running(problem))).r
    each = np.stack([part[:, 0] for part in columns(problem.batch, r)])
    assert np.mean(each**2) > 1.3
    assert np.mean([autocorrelation(row, 1)[0] for row in each]) > 0.1


def scatter(problem: EstimationProblem, x: np.ndarray) -> float:
    """Mean over traces of d^T C^-1 d, d the error of a least squares step from the truth; P if C is honest."""
    here = problem.linearise(x, problem.weighted(problem.kalman(x)))
    out = []
    for k, part in enumerate(columns(problem.batch, here.r)):
        lane, _, marks = problem.batch.places[k]
        J = here.jacobian[marks, lane, : part.shape[1]].reshape(-1, x.size)
        gradient = J.T @ part.ravel()
        out.append(gradient @ np.linalg.solve(J.T @ J, gradient))
    return float(np.mean(out))


@pytest.mark.slow
def test_estimates_scatter_as_their_covariance_says(many_held: tuple[EstimationProblem, np.ndarray]) -> None:
    """chi2 of 2 degrees over 60 seeds: 2 +- 0.26."""
    assert 1.2 < scatter(*many_held) < 2.8


def test_they_also_do_when_the_input_was_logged_with_noise_and_denoised() -> None:
    """The whole way: 10 mV of white noise on the logged voltage, averaged as the log permits."""
    t = np.arange(250) * DT
    clean = measurement("resistance", t, {"voltage": volts_at(t), "current": held(volts_at(t), 0 * t[1:], 0.0)})
    traces = [prepare(noisy(clean, seed), CONFIG) for seed in range(60)]
    problem, x = problem_of([trace for trace in traces if trace], ("R_a", "L_a"), substeps=4)
    r = problem.linearise(x, problem.weighted(problem.kalman(x))).r
    each = np.stack([part[:, 0] for part in columns(problem.batch, r)])
    assert 0.85 < np.mean(each**2) < 1.2
    assert np.max(np.abs(np.mean([autocorrelation(row, 5) for row in each], axis=0))) < 0.1
    assert 1.0 < scatter(problem, x) < 3.2


# ---- dense matrices


def responses(trace: Trace, problem: EstimationProblem) -> tuple[np.ndarray, np.ndarray]:
    """Of all samples, stacked (n M,): to a volt more in each interval, (n M, n - 1), and to the start, (n M, 3)."""
    lane, first, marks = problem.batch.places[-1]
    part = slice(first, int(marks[-1]) + 1)
    steps, resets = jax.tree.map(
        lambda c: jnp.asarray(c[part, lane : lane + 1]), (problem.batch.steps, problem.batch.resets)
    )
    throttle = Throttle.build(PAPER, VALUES)
    interval = np.concatenate(([-1], np.repeat(np.arange(marks.size - 1), np.diff(marks))))

    @jax.jit
    @jax.vmap
    def samples(shift: jax.Array, start: jax.Array) -> jax.Array:
        moved = steps._replace(voltage0=steps.voltage0 + shift[:, None], voltage1=steps.voltage1 + shift[:, None])
        from_there = resets._replace(
            **{n: getattr(resets, n) + resets.begins * start[k] for k, n in enumerate(("i", "theta", "omega"))}
        )
        x, z = simulate(throttle, moved, from_there)
        seen = throttle.observe(x, z, moved.inputs(1.0))
        return jnp.stack([seen[name][marks - first, 0] for name in trace.channels], axis=-1).ravel()

    h = 1e-5
    shifts = h * (interval[None, :] == np.arange(marks.size - 1)[:, None])
    rest = np.zeros((1, interval.size))
    shifted = np.concatenate((rest, shifts, np.repeat(rest, 3, axis=0)))
    started = np.concatenate((np.zeros((marks.size, 3)), h * np.eye(3)))
    y = np.asarray(samples(shifted, started))
    moved = (y[1:] - y[0]).T / h
    return moved[:, :-3], moved[:, -3:]


def dense(trace: Trace, problem: EstimationProblem) -> np.ndarray:
    """Sigma = sigma_y^2 I + S E S^T + s0 P0 s0^T of the samples that were logged."""
    assert trace.input is not None
    to_input, to_start = responses(trace, problem)
    sd, log = trace.input.error[:-1], np.cumsum(np.log(np.maximum(trace.input.memory[:-1], 1e-300)))
    stated = np.outer(sd, sd) * np.exp(-np.abs(log[:, None] - log[None, :]))
    start = np.diag(np.square(trace.start.sd))
    noise = np.diag(np.tile(np.square(trace.sigma), trace.instants.size))
    seen = np.flatnonzero(np.isfinite(trace.data))
    whole = noise + to_input @ stated @ to_input.T + to_start @ start @ to_start.T
    return whole[seen][:, seen]


def sliding(memory: float) -> Trace:
    """A plate that slides open in mid-travel, with gaps in its angle and a current missing here and there."""
    n = 60
    rng = np.random.default_rng(4)
    t = np.arange(n) * DT
    values = {"voltage": 2.6 + 0 * t, "current": 1.2 + 0.1 * rng.standard_normal(n), "position": 0.3 + 3.0 * t}
    trace = prepared(measurement("response", t, values))
    data = trace.data.copy()
    data[20:30, 1], data[::7, 0] = np.nan, np.nan
    signal = InputSignal(
        values["voltage"], 0.05 * (1 + t / t[-1] * (memory == 0.0)), 0 * t + memory, np.zeros(n - 1, bool)
    )
    start = InitialState((1.2, 0.3, 4.0), (0.1, 2e-3, 0.2))
    return replace(trace, input=signal, start=start, data=data)


def assert_dense(problem: EstimationProblem, x: np.ndarray) -> None:
    """Of the last trace: J^T Sigma^-1 J, e^T Sigma^-1 e and log det Sigma, each to 1e-6."""
    trace, (lane, _, marks) = problem.batch.traces[-1], problem.batch.places[-1]
    sigma = np.linalg.inv(dense(trace, problem))
    seen = np.isfinite(trace.data).ravel()
    channels = slice(0, len(trace.channels))

    plain = problem.linearise(x, problem.weighted(free_running(problem)))
    scale = np.tile(trace.sigma, trace.instants.size)[seen]
    error = plain.r[marks, lane, channels].ravel()[seen] * scale
    slope = plain.jacobian[marks, lane, channels].reshape(-1, x.size)[seen] * scale[:, None]
    weighted = problem.weighted(problem.kalman(x))
    here = problem.linearise(x, weighted)
    r, J = here.r[marks, lane, channels], here.jacobian[marks, lane, channels].reshape(-1, x.size)

    wanted = slope.T @ sigma @ slope
    size = np.sqrt(np.diag(wanted))
    assert_allclose(J.T @ J / np.outer(size, size), wanted / np.outer(size, size), atol=1e-6)
    assert_allclose(np.sum(r**2), error @ sigma @ error, rtol=1e-6)
    weight = np.asarray(weighted.whitening.weight)[marks, lane, channels]
    assert_allclose(-2.0 * np.sum(np.log(weight[weight > 0.0])), -np.linalg.slogdet(sigma)[1], rtol=1e-6)


@pytest.mark.slow
def test_the_filter_is_dense_generalised_least_squares_on_a_held_plate(
    many_held: tuple[EstimationProblem, np.ndarray],
) -> None:
    assert_dense(*many_held)


def after_another(memory: float) -> tuple[EstimationProblem, np.ndarray]:
    """A sliding plate, second in its lane: it must know nothing of the trace before."""
    others = held_trace(7, 0.5, n=130), held_trace(8, 0.5, n=60)
    problem, x = problem_of([*others, sliding(memory)], SLIDING, substeps=2)
    _, (before, _, _), (lane, _, _) = problem.batch.places
    assert before == lane
    return problem, x


@pytest.mark.slow
@pytest.mark.parametrize("memory", [0.0, 0.8], ids=["white", "correlated"])
def test_the_filter_is_dense_generalised_least_squares_on_a_sliding_plate(memory: float) -> None:
    assert_dense(*after_another(memory))


def test_a_sample_that_is_missing_changes_nothing() -> None:
    problem, x = after_another(0.0)
    here = problem.linearise(x, problem.weighted(problem.kalman(x)))
    lane, _, marks = problem.batch.places[-1]
    missing = ~np.isfinite(problem.batch.traces[-1].data)
    assert missing.any()
    assert np.all(here.r[marks, lane][missing] == 0.0)
    assert np.all(here.jacobian[marks, lane][missing] == 0.0)


# ---- instants nobody logged

BEFORE = np.arange(20, 240, 40)  # the last sample before each jump


def stepped(seed: int, rise: float = 2.0) -> Trace:
    """A held plate, the voltage jumping up and down in turn, each time somewhere within an interval."""
    rng = np.random.default_rng(seed)
    t = np.arange(250) * DT
    current, volts = np.zeros(t.size), np.zeros(t.size)
    tau = VALUES["L_a"] / VALUES["R_a"]
    for k, before in enumerate(BEFORE):
        since = t - (before + rng.uniform()) * DT
        step = rise * (-1.0) ** k * (since > 0.0)
        volts += step
        current += step / VALUES["R_a"] * (1.0 - np.exp(-np.maximum(since, 0.0) / tau))
    return prepared(noisy(measurement("resistance", t, {"voltage": volts, "current": current}), seed + 500))


def test_a_jump_at_an_unknown_instant_is_neither_believed_nor_thrown_away() -> None:
    """The first sample after it scatters by 0.3 A, forty times its noise; whitened it is standard, in mean and square,
    and so are all samples after it. 360 jumps: a mean is known to 0.05, a mean square to 0.08."""
    problem, x = problem_of([stepped(seed) for seed in range(60)], ("R_a", "L_a"), substeps=4)
    free = problem.linearise(x, problem.weighted(free_running(problem))).r
    r = problem.linearise(x, problem.weighted(problem.kalman(x))).r
    raw, each = (np.stack([part[:, 0] for part in columns(problem.batch, a)]) for a in (free, r))
    sign = (-1.0) ** np.arange(BEFORE.size)
    assert np.sqrt(np.mean(raw[:, BEFORE + 1] ** 2)) > 10.0
    for later in range(1, 8):
        after = sign * each[:, BEFORE + later]
        assert abs(np.mean(after)) < 0.25
        assert np.mean(after**2) == pytest.approx(1.0, abs=0.35)
    assert np.mean(each**2) == pytest.approx(1.0, abs=0.05)


@pytest.fixture(scope="module")
def releases() -> tuple[EstimationProblem, np.ndarray, np.ndarray]:
    """40 plates let go 0.5 ms rms off the stated instant, and the sample at which each meets the closed stop."""
    rng = np.random.default_rng(0)
    traces, hits = [], []
    for seed in range(40):
        motion = released(0.05 + 5e-4 * rng.standard_normal(), duration=0.25)
        values = {"emf": N * VALUES["K_b"] * motion.speed, "position": motion.angle}
        trace = prepared(noisy(measurement("back_emf", motion.time, values), seed))
        traces.append(trace.released_at(0.05, 5e-4))
        hits.append(np.flatnonzero((motion.speed[1:] == 0.0) & (motion.speed[:-1] < -1.0))[0] + 1)
    problem, x = problem_of(traces, ("K_b", "B_L", "T_PL"))
    return problem, x, np.array(hits)


@pytest.mark.slow
def test_a_release_at_an_instant_not_known_exactly(releases: tuple[EstimationProblem, np.ndarray, np.ndarray]) -> None:
    """At first the EMF is wrong by several times its noise; whitened nothing of it is left until the impact."""
    problem, x, hits = releases
    free = problem.linearise(x, problem.weighted(free_running(problem))).r
    r = problem.linearise(x, problem.weighted(problem.kalman(x))).r
    falls = slice(0, int(hits.min()) - 10)
    raw, each = (np.concatenate([part[falls] for part in columns(problem.batch, a)]) for a in (free, r))
    assert np.mean(raw**2) > 2.0
    assert np.mean(each**2) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("preload", [0.97, 1.0, 1.03])
def test_an_impact_does_not_steer_the_fit(
    releases: tuple[EstimationProblem, np.ndarray, np.ndarray], preload: float
) -> None:
    """There the EMF drops by volts within a sample: wrong by a sample is wrong by hundreds of standard deviations. Its
    weight is frozen before the parameters move, and must still be small where 3 % of preload move the impact to."""
    problem, x, hits = releases
    there = problem.layout.coordinates(VALUES | {"T_PL": preload * VALUES["T_PL"]})
    around = [np.arange(hit - 2, hit + 3) for hit in hits]

    def worst(r: np.ndarray) -> float:
        parts = zip(columns(problem.batch, r), around, strict=True)
        return float(np.max([np.abs(part[rows, 0]) for part, rows in parts]))

    free = problem.linearise(there, problem.weighted(free_running(problem))).r
    r = problem.linearise(there, problem.weighted(problem.kalman(x))).r
    assert worst(free) > 300.0
    assert worst(r) < 5.0
