"""The curve without a name: how well it is known, over which range, and which names it puts in doubt."""

from __future__ import annotations

import importlib
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from etcfit.model.effects import EFFECT_BY_NAME
from etcfit.model.parameters import Parameter, parameters_of
from etcfit.model.smooth import UNKNOWNS, K

# by its name: the package's own `unexplained` is the function
module = importlib.import_module("etcfit.diagnosis.unexplained")
BY_NAME = {unknown.name: unknown for unknown in UNKNOWNS}
TORQUE = BY_NAME["unknown_torque_over_angle"]
LIMP, STRIBECK = EFFECT_BY_NAME["limp_home_spring"], EFFECT_BY_NAME["stribeck_friction"]


# ---- how well the curve is known


def linear(seen: int, size: float, entries: int = 4000) -> tuple[Any, np.ndarray]:
    """A standing whose residual is linear in a curve's amplitudes, of rms `size`, and its information, (K, K).

    Only `seen` of the entries of its tape hold a sample: integration steps, lanes and slots leave most of them empty.
    """
    rng = np.random.default_rng(0)
    shape = (entries, 1, 1)
    full = np.zeros(shape, dtype=bool)
    full[rng.permutation(entries)[:seen]] = True
    J = np.where(full[..., None], rng.normal(size=(*shape, K)), 0.0)
    r = np.where(full, size * rng.normal(size=shape), 0.0)
    parameters: dict[str, Parameter] = {p.symbol: p for p in parameters_of(TORQUE)}
    layout = SimpleNamespace(free=TORQUE.symbols, parameter=parameters.__getitem__)
    problem = SimpleNamespace(layout=layout, linearise=lambda x, weighted: (r, np.zeros(K), J))
    weighted = SimpleNamespace(samples=float(seen), prior_sd=np.full(K, np.inf))
    flat = J.reshape(-1, K)
    return SimpleNamespace(problem=problem, x=np.zeros(K), weighted=weighted), flat.T @ flat


@pytest.mark.parametrize(("size", "unit"), [(0.5, 1.0), (1.0, 1.0), (3.0, 9.0)])
@pytest.mark.parametrize("seen", [1000, 4000])
def test_a_curve_is_known_as_well_as_least_squares_says(seen: int, size: float, unit: float) -> None:
    """sd^2 = s^2 h^T (J^T J)^-1 h, s^2 = chi2 of a sample, at least 1, scale of the amplitudes 0.05 N m: at the knots
    that of the amplitudes, however many entries of the tape hold no sample."""
    s, information = linear(seen, size)
    sd = module._sd(s, TORQUE, np.array(TORQUE.knots))
    expected = 0.05 * np.sqrt(unit * np.diag(np.linalg.inv(information)))
    assert_allclose(sd, expected, rtol=0.06)  # chi2 of 1000 samples is known to 5 %, its root to 2 %


def test_between_knots_both_amplitudes_count() -> None:
    s, information = linear(4000, 1.0)
    middle = 0.5 * (TORQUE.knots[3] + TORQUE.knots[4])
    h = np.zeros(K)
    h[3:5] = 0.5
    expected = 0.05 * math.sqrt(h @ np.linalg.solve(information, h))
    assert_allclose(module._sd(s, TORQUE, np.array([middle])), expected, rtol=0.05)


# ---- over which range


def ranged(monkeypatch: pytest.MonkeyPatch, name: str, *along: dict[str, np.ndarray]) -> tuple[float, float]:
    monkeypatch.setattr(module, "signals", lambda problem, x, guide_stiffness: list(along))
    monkeypatch.setattr(module, "pull_of", lambda problem, x: 1.0)
    s: Any = SimpleNamespace(problem=SimpleNamespace(config=SimpleNamespace(travel=(0.0, 2.0))), x=None)
    return module._range(s, BY_NAME[name])


def moving(**signals: list[float]) -> dict[str, np.ndarray]:
    """A plate that rests at the first instant."""
    n = len(next(iter(signals.values())))
    return {name: np.array(v) for name, v in signals.items()} | {"torque": np.where(np.arange(n) == 0, np.nan, 0.1)}


def test_a_curve_is_drawn_over_what_was_measured_while_the_plate_moved(monkeypatch: pytest.MonkeyPatch) -> None:
    two = moving(angle=[0.0, 0.4, 1.2]), moving(angle=[2.0, 1.6, 1.0])
    assert ranged(monkeypatch, "unknown_torque_over_angle", *two) == pytest.approx((0.2, 0.8))
    speeds = moving(speed=[0.0, -3.0, 2.0])
    assert ranged(monkeypatch, "unknown_torque_over_speed", speeds) == (-3.0, 2.0)
    assert ranged(monkeypatch, "unknown_friction_over_speed", speeds) == (2.0, 3.0)


def test_a_voltage_is_drawn_over_the_current_though_no_angle_was_logged(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without an angle there is no guide, and no torque is read anywhere."""
    blind = {"current": np.array([-1.0, 0.5, 3.0]), "torque": np.full(3, np.nan)}
    assert ranged(monkeypatch, "unknown_voltage_over_current", blind) == (-1.0, 3.0)


# ---- a name in doubt


def doubted(monkeypatch: pytest.MonkeyPatch, bare: float, named: float, curve: float | None) -> bool:
    """Is an effect in doubt that lowers chi2 from `bare` to `named` where the best curve lowers it to `curve`?"""
    less = SimpleNamespace(lean=lambda: SimpleNamespace(optimised=lambda: SimpleNamespace()))
    asked: list[Any] = []
    monkeypatch.setattr(module, "score", lambda s: SimpleNamespace(chi2=bare))
    best = None if curve is None else SimpleNamespace(score=SimpleNamespace(chi2=curve))
    monkeypatch.setattr(module, "_best", lambda s, before: best)
    s: Any = SimpleNamespace(without=lambda effect: asked.append(effect) or less)
    here: Any = SimpleNamespace(chi2=named)
    doubt = module._in_doubt(s, STRIBECK, here)
    assert asked == [STRIBECK]
    return doubt


@pytest.mark.parametrize(
    ("named", "curve", "doubt"),
    [
        (100.0, 100.0, False),  # as well
        (100.0, 300.0, False),  # better than the curve
        (100.0, 80.0, False),  # a little less well: 0.91 of its logarithm
        (100.0, 50.0, True),  # clearly less well
        (950.0, 100.0, True),  # hardly anything
        (100.0, None, False),  # no curve is worth its parameters
    ],
)
def test_a_name_is_in_doubt_where_a_curve_explains_clearly_more(
    monkeypatch: pytest.MonkeyPatch, named: float, curve: float | None, doubt: bool
) -> None:
    assert doubted(monkeypatch, 1000.0, named, curve) is doubt


# ---- what is tried in its place


def test_only_curves_are_tried_and_the_best_that_helps_elsewhere_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []
    signatures = [SimpleNamespace(effect=e) for e in UNKNOWNS]

    def screened(s: Any, candidates: Any) -> Any:
        asked.extend(candidates)
        return signatures

    verdicts = iter([(-40.0, True), (-900.0, False), (-50.0, True)])

    def tried(s: Any, g: Any, before: Any) -> Any:
        bic, helps = next(verdicts)
        return SimpleNamespace(bic_change=bic, effect=g.effect, helps_elsewhere=lambda: helps)

    monkeypatch.setattr(module, "screened", screened)
    monkeypatch.setattr(module, "promises", lambda g, before: True)
    monkeypatch.setattr(module, "_tried", tried)
    composition = SimpleNamespace(candidates=(LIMP, *UNKNOWNS, STRIBECK))
    s: Any = SimpleNamespace(composition=composition, problem=None, x=None, weighted=None)
    best = module._best(s, None)
    assert set(asked) == set(UNKNOWNS)
    assert best is not None
    assert best.effect is UNKNOWNS[0]


def test_a_curve_that_is_not_worth_its_parameters_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "screened", lambda *a: [SimpleNamespace(effect=TORQUE)])
    monkeypatch.setattr(module, "promises", lambda g, before: True)
    monkeypatch.setattr(module, "_tried", lambda *a: SimpleNamespace(bic_change=-9.0, helps_elsewhere=lambda: True))
    s: Any = SimpleNamespace(composition=SimpleNamespace(candidates=UNKNOWNS), problem=None, x=None, weighted=None)
    assert module._best(s, None) is None


def test_a_curve_that_promises_little_is_not_refitted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "screened", lambda *a: [SimpleNamespace(effect=TORQUE)])
    monkeypatch.setattr(module, "promises", lambda g, before: False)
    monkeypatch.setattr(module, "_tried", lambda *a: pytest.fail("it was refitted"))
    s: Any = SimpleNamespace(composition=SimpleNamespace(candidates=UNKNOWNS), problem=None, x=None, weighted=None)
    assert module._best(s, None) is None


@pytest.mark.parametrize(("worth", "asked"), [(9.1 * 50.0, False), (8.9 * 50.0, True)])
def test_only_an_effect_that_explained_less_than_nine_times_what_a_curve_adds_is_put_in_doubt(
    worth: float, asked: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The curve beside it lowers BIC by 50; what the effect keeps its name for is 90 % of what both explain."""
    questioned: list[Any] = []
    monkeypatch.setattr(module, "widened", lambda result, s: s)
    monkeypatch.setattr(module, "score", lambda s: None)
    monkeypatch.setattr(module, "_best", lambda s, before: SimpleNamespace(bic_change=-50.0))
    monkeypatch.setattr(module, "_in_doubt", lambda s, e, before: questioned.append(e) or True)
    monkeypatch.setattr(module, "_told", lambda best, doubts: doubts)
    s: Any = SimpleNamespace(added=(LIMP,))
    doubts: Any = module.unexplained(SimpleNamespace(), s, {LIMP: worth}, lambda text, share: None)
    assert questioned == ([LIMP] if asked else [])
    assert doubts == ((LIMP.name,) if asked else ())


# ---- one curve against all names together


def chain(left: float, named: float, far: bool = False) -> tuple[Any, Any]:
    """A first model whose chi2 is 1000, or `named` with the effects found; and the last one, that leaves `left`."""
    refitted = SimpleNamespace(chi2=named)
    refitted.lean = refitted.optimised = lambda: refitted
    first = SimpleNamespace(with_effects=lambda added, values: refitted, far=False)
    layout = SimpleNamespace(values=lambda x, held: {})
    problem = SimpleNamespace(layout=layout, free_parameters=SimpleNamespace(held=None))
    return first, SimpleNamespace(added=(LIMP, STRIBECK), far=far, left=left, problem=problem, x=None)


@pytest.mark.parametrize(
    ("left", "far", "named", "kept"),
    [
        (1.4, False, 900.0, True),  # little is left: nobody asks
        (1.6, False, 900.0, False),
        (1.0, True, 900.0, False),  # far from the data chi2 says nothing of what is left
        (1.6, False, 10.0 ** (3 - 0.81 * 2), True),  # 81 % of what the curve gains
        (1.6, False, 10.0 ** (3 - 0.79 * 2), False),
    ],
)
def test_names_that_do_less_together_than_one_curve_are_all_in_doubt(
    left: float, far: bool, named: float, kept: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The curve brings a chi2 of 1000 to 10."""
    first, last = chain(left, named, far)
    monkeypatch.setattr(module, "widened", lambda result, s: s)
    monkeypatch.setattr(module, "score", lambda s: SimpleNamespace(chi2=1000.0))
    monkeypatch.setattr(module, "_best", lambda s, before: SimpleNamespace(score=SimpleNamespace(chi2=10.0)))
    monkeypatch.setattr(module, "_told", lambda best, doubts: doubts)
    doubts: Any = module.outdone(SimpleNamespace(), first, last, lambda text, share: None)
    assert doubts == (None if kept else (LIMP.name, STRIBECK.name))


@pytest.mark.parametrize("spoilt", [True, False])
def test_names_that_came_near_the_data_give_way_only_to_a_curve_that_does_so_too(
    monkeypatch: pytest.MonkeyPatch, spoilt: bool
) -> None:
    first, last = chain(50.0, 900.0)
    first.far = True
    monkeypatch.setattr(module, "widened", lambda result, s: s)
    monkeypatch.setattr(module, "score", lambda s: SimpleNamespace(chi2=1000.0))
    curve = SimpleNamespace(score=SimpleNamespace(chi2=10.0), standing=None)
    monkeypatch.setattr(module, "_best", lambda s, before: curve)
    monkeypatch.setattr(module, "refit_fully", lambda s, report: SimpleNamespace(spoilt=lambda names: spoilt))
    monkeypatch.setattr(module, "_told", lambda best, doubts: doubts)
    doubts: Any = module.outdone(SimpleNamespace(), first, last, lambda text, share: None)
    assert doubts == (None if spoilt else (LIMP.name, STRIBECK.name))


def test_without_a_curve_worth_its_parameters_names_stand(monkeypatch: pytest.MonkeyPatch) -> None:
    first, last = chain(50.0, 900.0)
    monkeypatch.setattr(module, "widened", lambda result, s: s)
    monkeypatch.setattr(module, "score", lambda s: SimpleNamespace(chi2=1000.0))
    monkeypatch.setattr(module, "_best", lambda s, before: None)
    assert module.outdone(SimpleNamespace(), first, last, lambda text, share: None) is None
