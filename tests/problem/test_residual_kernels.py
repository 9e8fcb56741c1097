"""Machine code against JAX: the residual, its sums and its slopes of every effect, with and without the others."""

from __future__ import annotations

import weakref
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import results
from etcfit.estimation.ready import ready
from etcfit.kernels.machine import available
from etcfit.model.ecu import Ecu
from etcfit.model.effects import EFFECT_BY_NAME, EFFECTS, AbstractEffect, Contribution, Inputs, State
from etcfit.model.parameters import NonNegative, Positive, Real, Scalar, parameter
from etcfit.model.rig_effects import RIG_EFFECTS, Place, at_places
from etcfit.model.smooth import UNKNOWNS
from etcfit.problem import batch, lanes, lateness, records
from etcfit.problem import problem as module
from etcfit.problem.chi2 import chi2_of
from etcfit.problem.free_parameters import free_parameters
from etcfit.problem.lanes import shared_out
from etcfit.problem.normal_equations import linearised, normal_equations
from etcfit.problem.problem import EstimationProblem
from etcfit.problem.records import MAKING
from etcfit.problem.residual import WeightedData, residual
from etcfit.rig.base import Fixed, Measurement, Rig
from measurements import channel, prepared

Effect = type[AbstractEffect]
ADDED = [e for e in EFFECTS if e.off is not None and not e.commands]


def around(rig: Rig) -> list[Effect]:
    """Effects of the rig, one place of each family, and one channel of one trace where it may have such a place."""
    logged = {m.test: frozenset(m.channels) for m in rig.measurements}
    every = {e.kind: e for e in at_places(logged)}
    file = next(m.file for m in rig.measurements if "current" in m.channels)
    single = Place.named(f"{file}.current")
    return [*every.values(), *(family.at(single) for family in RIG_EFFECTS if "current" in family.acts_on)]


def together(effects: Sequence[Effect]) -> list[tuple[Effect, ...]]:
    """All of them, and halves of them: every two are in one model, and many are also in one without the others."""
    return [
        tuple(effects),
        *(tuple(e for k, e in enumerate(effects) if k // 2**d % 2 == s) for d in (0, 1) for s in (0, 1)),
    ]


@cache
def rig_in(folder: Path) -> Rig:
    return results.rig(folder)


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Rig:
    return rig_in(tmp_path_factory.mktemp("rig"))


def case(
    rig: Rig, added: Sequence[Effect], whitened: bool = True, guide: float = 0.0, size: float = 0.3
) -> tuple[EstimationProblem, np.ndarray, WeightedData]:
    """Eqs. 1-2 and some effects, every parameter off its bound and off its usual size."""
    known = free_parameters(rig.config, tuple(added))
    layout = known.layout
    problem = EstimationProblem.of_traces(rig.config, known, ready(rig)[0]).guided(guide)
    values = {p.symbol: p.nominal for p in layout.parameters}
    for effect in added:
        for symbol in effect.off or {}:
            domain = layout.parameter(symbol).domain
            values[symbol] = size * domain.scale if isinstance(domain, (NonNegative, Real)) else domain.scale
    x = layout.off_bounds(layout.coordinates(values)) + 0.01 * np.cos(np.arange(len(layout.free)))
    from etcfit.problem.weights import free_running

    filter_ = problem.kalman(x) if whitened else free_running(problem)
    return problem, x, problem.weighted(filter_)


def agrees(problem: EstimationProblem, x: np.ndarray, weighted: WeightedData) -> None:
    """Kernels and JAX, to 1e-9 of each column."""
    form, padded = problem.layout.form, problem.layout.padded(x)
    assert available()
    whole = partial(residual, form, weighted=weighted)
    quick = partial(jax.jit, compiler_options={"xla_backend_optimization_level": 0})
    r, J = (np.asarray(each) for each in quick(lambda x: (whole(x), jax.jacfwd(whole)(x)))(padded))
    found, columns = linearised(form, padded, weighted)
    size = max(1.0, float(np.max(np.abs(r))))
    assert_allclose(found, r, rtol=0.0, atol=1e-9 * size)
    assert_allclose(problem.residual(x, weighted), r, rtol=0.0, atol=1e-9 * size)
    norm = np.linalg.norm(J.reshape(-1, padded.size), axis=0)
    apart = np.linalg.norm((columns - J).reshape(-1, padded.size), axis=0)
    assert np.all(apart <= 1e-9 * np.maximum(norm, 1e-6 * norm.max()))
    chi2, flat = float(np.sum(r**2)), J.reshape(-1, padded.size)
    e = normal_equations(form, weighted, padded.size)(padded)
    assert e.chi2 == pytest.approx(chi2, rel=1e-9)
    assert_allclose(e.gradient, flat.T @ r.ravel(), atol=1e-9 * float(norm.max()) * chi2**0.5)
    assert_allclose(e.information, flat.T @ flat, atol=1e-9 * float(norm.max()) ** 2)
    assert problem.chi2(x, weighted) == pytest.approx(chi2, rel=1e-9)
    many = chi2_of(problem, np.stack([x, x + 0.01, x]), weighted)
    assert many[0] == many[2] == pytest.approx(chi2, rel=1e-9)
    assert many[1] == pytest.approx(float(np.sum(np.asarray(quick(whole)(problem.layout.padded(x + 0.01))) ** 2)))


def test_models_that_read_the_same_samples_share_one_packing(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    problem, x, weighted = case(rig, [], guide=0.3)
    problem.chi2(x, weighted)
    other = problem.with_parameters(free_parameters(rig.config, (EFFECT_BY_NAME["gravity_load"],)))
    tried, made = other.weighted(weighted.whitening), []
    once = records.record_of

    def counted(*args: Any, **kwargs: Any) -> np.ndarray:
        made.append(args)
        return once(*args, **kwargs)

    monkeypatch.setattr(records, "record_of", counted)
    other.chi2(np.append(x, 0.1), tried)
    assert not made


SETS: dict[str, tuple[Effect, ...]] = {
    **dict(zip(("all", "even", "odd", "first of four", "last of four"), together(ADDED), strict=True)),
    **{curve.name: (curve,) for curve in {each.enters: each for each in UNKNOWNS}.values()},  # one for each place
}


@pytest.mark.slow  # compiles each model by JAX too
@pytest.mark.parametrize("added", SETS.values(), ids=SETS)
def test_effects_together_compute_as_jax_does(rig: Rig, added: tuple[Effect, ...]) -> None:
    agrees(*case(rig, added))


class Newcomer(AbstractEffect):
    """One formula in JAX, with a memory, and nothing else: torque of a magnet that follows the plate late."""

    name = "newcomer"
    scope = "throttle body"
    told_by = "nothing"
    off: ClassVar[Mapping[str, float] | None] = {"T_n": 0.0}
    z0: ClassVar[tuple[float, ...]] = (0.2,)
    T_n: Scalar = parameter("N m", Real(0.1), 0.0, "torque of the magnet", "invented")
    tau_n: Scalar = parameter("s", Positive(0.05), 0.05, "time constant of what it follows", "invented")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        torque = self.T_n * jnp.tanh(3.0 * (z[0] - x.theta)) * jnp.exp(-jnp.abs(x.omega))
        return Contribution(torque=torque, dz=((x.theta - z[0]) / self.tau_n,))


@pytest.mark.slow
def test_an_effect_that_nobody_knows_runs_in_a_kernel_without_another_line(rig: Rig) -> None:
    agrees(*case(rig, [Newcomer]))


@pytest.mark.slow
def test_every_effect_of_the_rig_computes_as_jax_does(rig: Rig) -> None:
    agrees(*case(rig, [*around(rig), *(e for e in ADDED if e.delays)]))


@pytest.mark.slow
def test_a_delay_of_exactly_nothing_computes_as_jax_does(rig: Rig) -> None:
    config = replace(rig.config, parameters={**rig.config.parameters, "t_a": Fixed(0.0)})
    late = [e for e in (*around(rig), *ADDED) if e.delays]
    agrees(*case(replace(rig, config=config), late))


@pytest.mark.slow
def test_channels_late_by_whole_samples_compute_as_jax_does(rig: Rig) -> None:
    problem, x, weighted = case(rig, [e for e in around(rig) if e.delays], size=9.0)
    assert weighted.whitening.moved is not None
    agrees(problem, x, weighted)
    plain, there, _ = case(rig, [])
    agrees(plain, there, plain.weighted(weighted.whitening))  # by the filter of the model that it was compared with


@pytest.mark.slow
@pytest.mark.parametrize(("whitened", "guide"), [(False, 0.0), (True, 20.0)], ids=["free running", "guided"])
def test_other_weights_and_a_guide_compute_as_jax_does(rig: Rig, whitened: bool, guide: float) -> None:
    agrees(*case(rig, [], whitened, guide))


@pytest.mark.slow
def test_under_an_ecu_it_computes_as_jax_does(rig: Rig) -> None:
    """A setpoint that rises, the ECU part of the model, its gains free."""
    t = 2e-3 * np.arange(120)
    logged = {"position": np.full(t.size, 0.5), "setpoint": 0.5 + np.maximum(t - 0.02, 0.0)}
    channels = {name: channel(t, each, 1e-3) for name, each in logged.items()}
    log = Measurement("closed_loop/a.csv", "closed_loop", t, channels)
    ecu = Ecu()
    gains = {s: Fixed(v) for s, v in ecu.constants.items() if s not in ("P_e", "I_e", "D_e")}
    config = replace(rig.config, ecu=ecu, parameters={**rig.config.parameters, **gains}, series_ohm={})
    known = free_parameters(config)
    trace = prepared(log, config)
    problem = EstimationProblem.of_traces(config, known, (trace,))
    x = known.layout.off_bounds(known.layout.coordinates({p.symbol: p.nominal for p in known.layout.parameters}))
    agrees(problem, x, problem.weighted(problem.kalman(x)))


# ---- the filter


@pytest.mark.slow
@pytest.mark.parametrize(
    "added",
    [(), ("backlash", "presliding_friction", "stop_bounce"), ("actuation_delay", "channel_late", "trace_late")],
    ids=["Eqs. 1-2", "more", "late"],
)
def test_filter_variance_and_error_of_integration_are_those_of_jax(
    rig: Rig, added: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, x, _ = case(rig, [e for e in (*ADDED, *around(rig)) if getattr(e, "kind", e.name) in added])
    problem = replace(problem, jitter=0.1)

    def every() -> list[np.ndarray]:
        filter_, timing = problem.filter_and_timing(x)
        return [*map(np.asarray, filter_[:4]), np.asarray(timing), *problem.free_run_variance(x), *steps()]

    def steps() -> Any:
        return problem.refined(x).substeps

    by_kernel = every()
    monkeypatch.setattr(module, "available", lambda: False)
    for found, wanted in zip(by_kernel, every(), strict=True):
        kept = np.broadcast_to(blank(problem), found.shape[:2]) if found.ndim > 2 else np.zeros(found.shape, bool)
        assert_allclose(np.where(_like(kept, found), 0.0, found), np.where(_like(kept, found), 0.0, wanted), rtol=1e-7,
                        atol=1e-9 * max(1e-300, float(np.nanmax(np.abs(wanted)))))  # fmt: skip


def blank(problem: EstimationProblem) -> np.ndarray:
    """Entries after the last trace of each lane, shape (T, L): kernels do not compute them."""
    length, lanes = problem.batch.steps.dt.shape
    rows = np.zeros(lanes, int)
    for lane, _, marks in problem.batch.places:
        rows[lane] = max(rows[lane], marks[-1] + 1)
    return np.arange(length)[:, None] >= rows


def _like(where: np.ndarray, array: np.ndarray) -> np.ndarray:
    return where.reshape(*where.shape, *(1,) * (array.ndim - where.ndim))


# ---- what runs away, and what is packed


def test_a_simulation_that_runs_away_ends_as_inf(rig: Rig) -> None:
    problem, x, weighted = case(rig, [], whitened=False)
    far = x.copy()
    far[problem.layout.free.index("K_b")] = 1e4  # K_b e^12 times its scale
    far[problem.layout.free.index("R_a")] = np.nan
    assert chi2_of(problem, np.stack([far, x]), weighted)[0] == np.inf
    assert np.isfinite(chi2_of(problem, np.stack([far, x]), weighted)[1])
    assert not np.isfinite(problem.chi2(far, weighted))
    assert not normal_equations(problem.layout.form, weighted, x.size)(problem.layout.padded(far)).finite


@pytest.mark.parametrize("late", [False, True])
def test_lanes_that_hold_nothing_and_entries_that_only_fill_up_count_for_nothing(
    rig: Rig, late: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, x, weighted = case(rig, [e for e in around(rig) if e.delays and late], whitened=False)
    monkeypatch.setattr(batch, "available", lambda: False)  # lanes and entries as JAX wants them, run by kernels
    wider = EstimationProblem.of_traces(
        problem.config, problem.free_parameters, problem.batch.traces, problem.substeps, (4096, 11, 3)
    )
    again = wider.weighted(residual_weights(wider))
    assert wider.batch.steps.dt.shape[1] > problem.batch.steps.dt.shape[1]
    assert wider.chi2(x, again) == pytest.approx(problem.chi2(x, weighted), rel=1e-12)
    r = wider.residual(x, again)
    assert_array_equal(r[np.broadcast_to(_like(blank(wider), r), r.shape)], 0.0)


def test_what_refers_to_its_arrays_is_kept_for_the_last_few_and_lets_the_others_go() -> None:
    latest = records.Latest(2)
    arrays = [np.zeros(k) for k in range(3)]
    alive = [weakref.ref(array) for array in arrays]
    made = [latest.made_once([array], "x", lambda array=array: [array]) for array in arrays]
    assert [latest.made_once([array], "x", list) is each for array, each in zip(arrays[1:], made[1:], strict=True)] == [
        True
    ] * 2
    assert latest.made_once([arrays[2]], "y", list) == []  # another key takes the place of the oldest
    arrays.clear()
    made.clear()
    assert [array() is None for array in alive] == [True, True, False]


def test_what_is_late_is_shifted_anew_only_where_it_may_have_changed(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    problem, x, weighted = case(rig, [EFFECT_BY_NAME["actuation_delay"]], whitened=False)
    made: list[Any] = []
    late_input = lateness.late_input
    monkeypatch.setattr(lateness, "late_input", lambda *given: made.append(given) or late_input(*given))
    moved = dict(zip(problem.layout.free, x + 0.1 * np.eye(x.size), strict=True))
    before = problem.chi2(x, weighted)
    some = len(made)
    assert problem.chi2(moved["K_s"], weighted) != before
    assert len(made) == some
    assert problem.chi2(moved["t_a"], weighted) != before
    assert len(made) > some
    assert problem.chi2(x, weighted) == before


def test_nothing_runs_while_the_lock_of_graphs_is_held(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    """What runs is shared out to threads, which may wait for that lock: each would wait for the other."""
    free: list[bool] = []

    def acquired() -> bool:
        got = MAKING.acquire(timeout=2.0)
        if got:
            MAKING.release()
        return got

    def watched(*given: Any) -> list[Any]:
        with ThreadPoolExecutor(1) as other:
            free.append(other.submit(acquired).result())
        return shared_out(*given)

    problem, x, weighted = case(rig, [e for e in around(rig) if e.delays], whitened=False)
    monkeypatch.setattr(lanes, "shared_out", watched)
    problem.chi2(x, weighted)
    normal_equations(problem.layout.form, weighted, x.size)(x)
    assert len(free) > 3
    assert all(free)


def residual_weights(problem: EstimationProblem) -> Any:
    from etcfit.problem.weights import free_running

    return free_running(problem)
