"""Odd units: found, named by what makes them odd, and none in a healthy fleet whose covariances are not exact."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.fleet_statistics import NO_PROFILES, Design, draw, false_odd
from etcfit.fleets.settings import DEFAULT
from etcfit.fleets.statistics.odd import effects_in, misfits, odd_units
from etcfit.fleets.statistics.population import holm, null_scale, population
from etcfit.fleets.statistics.stack import Stack
from etcfit.fleets.unit import TraceMisfit, UnitEstimate, UnitResult


def results(stack: Stack, misfit: np.ndarray) -> list[UnitResult]:
    """One result a unit, its traces with the misfits of a row."""
    names = ("ramp/1.csv", "response/1.csv", "response/2.csv")
    out = []
    for u, unit in enumerate(stack.units):
        traces = tuple(TraceMisfit(n, n.split("/")[0], float(m)) for n, m in zip(names, misfit[u], strict=True))
        own = UnitEstimate(unit, stack.symbols, stack.estimate[u], stack.information[u])
        out.append(UnitResult(own, {}, traces, float(np.mean(misfit[u] ** 2)), True, "", True, "", 1.0))
    return out


def test_holm_by_hand() -> None:
    np.testing.assert_allclose(holm(np.array([0.04, 0.01, 0.03])), [0.06, 0.03, 0.06])


@pytest.mark.parametrize(("draws", "low", "high"), [("normal", 1.0, 1.05), ("half", 1.0, 1.0), ("t", 1.05, 1.5)])
def test_the_scale_of_the_null_is_the_fleets_own_and_never_below_one(draws: str, low: float, high: float) -> None:
    rng = np.random.default_rng(2)
    z = {"normal": rng.standard_normal(4000), "half": 0.5 * rng.standard_normal(4000), "t": rng.standard_t(3, 4000)}
    assert low <= null_scale(z[draws]) <= high


def test_odd_units_are_found_with_the_symbols_that_make_them_odd() -> None:
    drawn = draw(Design(300, 5, 0.5), 3)
    estimate = drawn.stack.estimate.copy()
    estimate[7, 2] += 12.0 * drawn.sd[2]
    # against the correlation of the two: farther together than either by itself
    estimate[9, :2] = drawn.mean[:2] + np.array([5.0, -5.0]) * drawn.sd[:2]
    stack = replace(drawn.stack, estimate=estimate)
    odd = odd_units(stack, population(stack, settings=NO_PROFILES))
    assert [each.unit for each in odd] == [stack.units[7], stack.units[9]]
    assert odd[0].symbols[0] == "s_2"
    assert set(odd[1].symbols) >= {"s_0", "s_1"}
    assert sum(d**2 for d in odd[0].drives.values()) == pytest.approx(odd[0].distance ** 2, rel=0.05)
    assert "s_2 +" in odd[0].why
    assert odd[0].p < odd[1].p < 1e-3
    assert odd[0].rate <= DEFAULT.odd_rate


def test_a_symbol_that_a_unit_does_not_tell_has_no_score() -> None:
    drawn = draw(Design(60, 3, 0.5), 4)
    information, estimate = drawn.stack.information.copy(), drawn.stack.estimate.copy()
    information[5] = 0.0
    information[5, 0, 0] = 1.0 / (0.3 * drawn.sd[0]) ** 2
    estimate[5] = [drawn.mean[0] + 15.0 * drawn.sd[0], 1e9, -1e9]
    stack = replace(drawn.stack, estimate=estimate, information=information)
    odd = odd_units(stack, population(stack, settings=NO_PROFILES))
    assert [(each.unit, each.rank, tuple(each.scores)) for each in odd] == [(stack.units[5], 1, ("s_0",))]


def test_a_unit_whose_traces_are_not_explained_is_odd_though_its_parameters_are_not() -> None:
    drawn, rng = draw(Design(80, 3, 0.5), 5), np.random.default_rng(5)
    misfit = np.exp(0.1 * rng.standard_normal((80, 3)))
    misfit[11, 1] *= 4.0
    odd = odd_units(drawn.stack, population(drawn.stack, settings=NO_PROFILES), results(drawn.stack, misfit))
    assert [each.unit for each in odd] == [drawn.stack.units[11]]
    assert odd[0].traces[0].file == "response/1.csv"
    assert odd[0].symbols == ()
    assert "response/1.csv" in odd[0].why


def test_misfits_that_hardly_differ_are_alike() -> None:
    drawn = draw(Design(50, 2, 0.5), 6)
    misfit = np.ones((50, 3))
    misfit[3] = 1.01
    assert misfits(results(drawn.stack, misfit)).p.min() > 0.1


def test_results_of_other_units_are_refused() -> None:
    drawn = draw(Design(10, 2, 0.5), 7)
    other = results(drawn.stack, np.ones((10, 3)))[::-1]
    with pytest.raises(ValueError, match="same units in the same order"):
        odd_units(drawn.stack, population(drawn.stack, settings=NO_PROFILES), other)


@pytest.mark.slow
@pytest.mark.parametrize(
    "design",
    [Design(1000, 10, 0.5), Design(1000, 10, 2.0, tails=5), Design(1000, 10, 2.0, stated=0.5), Design(12, 8, 0.5)],
)
def test_a_healthy_fleet_has_next_to_no_odd_unit(design: Design) -> None:
    units, _ = false_odd(design, 5 if design.units > 100 else 60, 2000)
    assert units <= 0.01


def test_an_effect_is_found_in_the_units_that_have_it() -> None:
    rng, n = np.random.default_rng(1), 200
    strength = np.where(np.arange(n) < 30, 1e-3, 0.0)
    estimate = np.column_stack([0.13 + 0.01 * rng.standard_normal(n), strength + 1e-4 * rng.standard_normal(n)])
    information = np.tile(np.diag([1e6, 1e8]), (n, 1, 1))
    information[199, 1, 1] = 0.0
    stack = Stack(tuple(f"u{u}" for u in range(n)), ("K_s", "D_q"), estimate, information)
    (found,) = effects_in(stack, ["quadratic_drag", "backlash", "return_spring"])
    assert found.effect == "quadratic_drag"
    assert found.symbol == "D_q"
    assert set(found.units) >= {f"u{u}" for u in range(30)}
    assert len(found.units) <= 33
    assert found.of == 199
    assert "u199" not in found.strength
    assert found.strength["u3"] == pytest.approx(1e-3, abs=5e-4)
    assert abs(found.median) < 1e-4


def test_an_effect_that_does_not_exist_is_refused() -> None:
    with pytest.raises(ValueError, match="no effect is called friction_of_the_mind"):
        effects_in(Stack(("a",), ("x",), np.ones((1, 1)), np.ones((1, 1, 1))), ["friction_of_the_mind"])
