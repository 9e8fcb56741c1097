"""A model at its optimum: its values, how well it is known, and draws from that."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import kstest, t

import fleets
import results
from etcfit.estimation.fitted_model import Fitted, FleetModel, PopulationLaw, split_sums
from independent.line import SYMBOLS, Population


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> Fitted:
    """Nominal values, every coordinate known to 0.02."""
    return results.result(results.rig(tmp_path_factory.mktemp("rig"))).fitted()


def place(of: Fitted, symbol: str) -> int:
    return of.free_parameters.layout.free.index(symbol)


def test_its_values_are_those_of_its_coordinates_held_ones_and_ties_among_them(fitted: Fitted) -> None:
    layout = fitted.free_parameters.layout
    assert fitted.values["R_a"] == pytest.approx(layout.parameter("R_a").nominal)
    assert fitted.values["B_m"] == 2e-5  # fixed in rig.toml
    assert fitted.values["K_m"] == fitted.values["K_b"]
    moved = replace(fitted, x=fitted.x + 0.1 * np.eye(fitted.x.size)[place(fitted, "R_a")])
    assert moved.values["R_a"] / fitted.values["R_a"] == pytest.approx(np.exp(0.1), rel=2e-3)
    assert moved.throttle.parameter("R_a") == pytest.approx(moved.values["R_a"])
    assert moved.values["K_s"] == fitted.values["K_s"]


def test_coordinates_and_values_are_inverse_to_each_other(fitted: Fitted) -> None:
    x = fitted.x + 0.05 * np.abs(np.random.default_rng(0).standard_normal((7, fitted.x.size)))  # off the bounds
    free = fitted.free_parameters.layout.free
    each = [replace(fitted, x=row).values for row in x]
    assert_allclose(fitted.coordinates({s: np.array([v[s] for v in each]) for s in free}), x, atol=1e-8)


def test_many_models_at_once_are_each_what_they_are_alone(fitted: Fitted) -> None:
    x = fitted.x + 0.05 * np.random.default_rng(1).standard_normal((3, fitted.x.size))
    many = fitted.throttles(x)
    for symbol in ("R_a", "K_m", "T_f", "B_m"):
        alone = [replace(fitted, x=row).values[symbol] for row in x]
        assert_allclose(np.broadcast_to(np.asarray(many.parameter(symbol)), (3,)), alone, rtol=1e-12)


def test_draws_have_the_covariance_of_the_fit(fitted: Fitted) -> None:
    a, b = place(fitted, "R_a"), place(fitted, "K_b")
    covariance = fitted.covariance.copy()
    covariance[a, b] = covariance[b, a] = 0.8 * 0.02**2
    drawn = replace(fitted, covariance=covariance).laplace(20_000, np.random.default_rng(2))
    assert drawn.shape == (20_000, fitted.x.size)
    assert_allclose(drawn.mean(axis=0), fitted.x, atol=4.0 * 0.02 / np.sqrt(20_000) + 1e-12)
    assert_allclose(drawn.std(axis=0), 0.02, rtol=0.03)
    assert np.corrcoef(drawn[:, a], drawn[:, b])[0, 1] == pytest.approx(0.8, abs=0.02)


@pytest.mark.parametrize("variance", [9.0, np.inf, np.nan])
def test_a_direction_that_is_open_is_drawn_no_wider_than_a_hundred_percent(fitted: Fitted, variance: float) -> None:
    k = place(fitted, "R_a")
    covariance = fitted.covariance.copy()
    covariance[k, k] = variance
    drawn = replace(fitted, covariance=covariance).laplace(20_000, np.random.default_rng(3))
    reach = fitted.free_parameters.layout.reach(fitted.x)[k]
    assert np.isfinite(drawn).all()
    assert drawn[:, k].std() == pytest.approx(0.0 if np.isnan(variance) else reach, rel=0.03)


def test_doubt_is_the_standard_deviation_over_the_reach(fitted: Fitted) -> None:
    k = place(fitted, "K_s")
    x, covariance = fitted.x.copy(), fitted.covariance.copy()
    x[k], covariance[k, k] = 5.0, 0.25
    of = replace(fitted, x=x, covariance=covariance)
    assert of.doubt("K_s") == pytest.approx(0.5 / 5.0)
    assert of.doubt("R_a") == pytest.approx(0.02)
    assert of.doubt("B_m") == 0.0  # fixed
    covariance[k, k] = np.nan
    assert replace(fitted, covariance=covariance).doubt("K_s") == np.inf


def test_gradients_are_those_of_differences(fitted: Fitted) -> None:
    def of(values):  # J_eq
        return 20.68**2 * values["J_m"] + values["J_L"]

    h = 1e-5
    value, slopes = fitted.value_and_gradient(of)
    assert value == pytest.approx(of(fitted.values), rel=1e-12)
    assert slopes.shape == (fitted.x.size,)
    for k in range(fitted.x.size):
        up, down = (of(replace(fitted, x=fitted.x + way * h * np.eye(fitted.x.size)[k]).values) for way in (1, -1))
        assert slopes[k] == pytest.approx((up - down) / (2 * h), rel=1e-5, abs=1e-12)


# ---- Units not made yet: their means, spreads and correlation, and what of a model the population does not speak of

DRAWS = 20_000
GEAR = fleets.CONFIG.gear_ratio


def law_of(line: Population, units: int = 10**6, symbols: tuple[str, ...] = SYMBOLS) -> PopulationLaw:
    """As a fleet of so many units would know the line exactly."""
    kept = [SYMBOLS.index(symbol) for symbol in symbols]
    return PopulationLaw(symbols, line.mean[kept], line.sd[kept], np.zeros(len(kept)), line.matrix[np.ix_(kept, kept)],
                         np.ones(len(kept), dtype=bool), units)  # fmt: skip


def test_units_drawn_are_those_of_the_line() -> None:
    line = Population()
    drawn = law_of(line).drawn(DRAWS, np.random.default_rng(1))
    theirs = [line.unit(np.random.default_rng([2, k]).standard_normal(len(SYMBOLS))) for k in range(4000)]
    ours = np.array([drawn[symbol] for symbol in SYMBOLS])
    made = np.array([[unit[symbol] for unit in theirs] for symbol in SYMBOLS])
    # means, spreads and correlations of 4000: 5 standard errors
    np.testing.assert_allclose(ours.mean(axis=1), made.mean(axis=1), rtol=5.0 * 0.08 / np.sqrt(4000))
    np.testing.assert_allclose(ours.std(axis=1), made.std(axis=1), rtol=5.0 / np.sqrt(8000))
    np.testing.assert_allclose(np.corrcoef(ours), np.corrcoef(made), atol=5.0 / np.sqrt(4000))


def test_few_units_and_an_uncertain_mean_make_the_draws_wider() -> None:
    """The law of one symbol is Student's, of scale sqrt(sd^2 + stderr^2) and 3 degrees of freedom."""
    exact = law_of(Population(), 4, ("T_f",))
    wide = replace(exact, stderr=exact.sd / 2.0, positive=np.array([False]))
    drawn = wide.drawn(DRAWS, np.random.default_rng(3))["T_f"]
    scale = float(exact.sd[0]) * np.sqrt(5.0 / 4.0)
    assert kstest((drawn - wide.mean[0]) / scale, t(3).cdf).pvalue > 1e-3
    assert kstest((drawn - wide.mean[0]) / exact.sd[0], t(3).cdf).pvalue < 1e-6


def test_what_is_positive_stays_so_and_keeps_its_mean() -> None:
    wide = replace(law_of(Population(), symbols=("T_f", "B_eq")), sd=0.7 * law_of(Population()).mean[[5, 7]])
    drawn = wide.drawn(DRAWS, np.random.default_rng(4))
    for symbol, mean in zip(wide.symbols, wide.mean, strict=True):
        assert drawn[symbol].min() > 0.0
        assert drawn[symbol].mean() == pytest.approx(mean, rel=0.03)
    assert replace(wide, positive=np.zeros(2, dtype=bool)).drawn(DRAWS, np.random.default_rng(4))["T_f"].min() < 0.0


def test_the_law_of_units_is_their_scatter() -> None:
    values = {"a": np.array([1.0, 2.0, 4.0, 5.0]), "b": np.array([2.0, 4.0, 8.0, 10.0]), "c": np.full(4, 7.0)}
    law = PopulationLaw.of_units(values, dict.fromkeys(values, True))
    np.testing.assert_allclose(law.mean, (3.0, 6.0, 7.0))
    np.testing.assert_allclose(law.sd, [np.std(v, ddof=1) for v in values.values()])
    np.testing.assert_allclose(law.stderr, law.sd / 2.0)
    np.testing.assert_allclose(law.correlation, [[1, 1, 0], [1, 1, 0], [0, 0, 1]], atol=1e-12)
    drawn = law.drawn(50, np.random.default_rng(5))
    np.testing.assert_allclose(drawn["c"], 7.0)  # what does not differ is drawn as it is


def test_of_a_sum_motor_and_plate_keep_their_shares() -> None:
    own = {"J_m": np.array([1.0, 1.0, 3.0]) / GEAR**2, "J_L": np.array([1.0, 3.0, 1.0]), "R_a": np.ones(3)}
    values = split_sums({"J_eq": np.array([10.0, 20.0]), "R_a": np.array([2.0, 3.0]), "V_f": np.ones(2)}, own, GEAR)
    assert set(values) == {"J_m", "J_L", "R_a"}  # another sum has no parts in the model
    np.testing.assert_allclose(values["J_L"], (5.0, 10.0))  # half: the middle one of 1/2, 3/4, 1/4
    np.testing.assert_allclose(GEAR**2 * values["J_m"] + values["J_L"], (10.0, 20.0))


@pytest.fixture(scope="module")
def model() -> FleetModel:
    """Twelve units, of whose population R_a, K_b and J_eq are told."""
    whole = fleets.of(fleets.truths(12, 21))
    return replace(whole, population=law_of(Population(), 12, ("R_a", "K_b", "J_eq")))


def test_parts_of_a_sum_and_what_is_tied_are_told_with_it(model: FleetModel) -> None:
    assert set(model.identifiable_symbols) == {"R_a", "K_b", "K_m", "J_m", "J_L"}
    assert "B_m" in fleets.of(fleets.truths(4, 21)).identifiable_symbols  # held, but of a sum with B_L, which is free


def test_a_future_unit_is_drawn_where_it_is_told_and_the_mean_unit_elsewhere(model: FleetModel) -> None:
    made = model.future(500, np.random.default_rng(6))
    assert made.units[:2] == ("future 1", "future 2")
    for symbol in model.values:
        differs = np.ptp(made.values[symbol]) > 0.0
        assert differs == (symbol in model.identifiable_symbols), symbol
    np.testing.assert_allclose(made.values["K_m"], made.values["K_b"])
    np.testing.assert_allclose(made.values["T_f"], model.mean["T_f"])
    inertia = GEAR**2 * made.values["J_m"] + made.values["J_L"]
    assert inertia.mean() == pytest.approx(model.law.mean[2], rel=0.01)
