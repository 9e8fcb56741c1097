"""Gains for a fleet and for the parts of a design: what is counted and refused, and whether the share promised is met
by plants that share no code."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from scipy.stats import beta, binomtest, fisher_exact

import fleets
import results
from benchmarks.parts import on_plant
from etcfit.control import fleet, on_units
from etcfit.control.design import Design, design, design_for_fleet, ecu_of, task_of
from etcfit.control.fleet import Parts, future_units, one_by_one, representatives
from etcfit.control.loop_figures import FIGURES, LoopFigures
from etcfit.control.on_units import FleetVerdict, OneByOne, Share
from etcfit.control.pid import RULES, Gains, Requirements
from etcfit.control.settings import DesignSettings, FleetDesignSettings, FrontSettings, OptimumSettings
from etcfit.errors import UsageError
from etcfit.estimation.fitted_model import Fitted
from etcfit.reporting.blocks import render
from etcfit.reporting.control.gains import design_table
from etcfit.reporting.control.pictures import draw_responses
from etcfit.run_folder.pid import PID
from independent.truth import CONSISTENT, Truth
from schemas import written_valid

NOISE = 1e-4  # rad
SPREAD = 0.22  # so wide that no gains please all units: a promise of 100 % would be easy to keep
QUICK = DesignSettings(
    draws=40,
    front=FrontSettings(rounds=1),
    optimum=OptimumSettings(searches=1, sweeps=3, population=24, elite=6, rounds=10, last_rounds=6),
)


def invented(count: int = 50) -> OneByOne:
    """Three units overshoot, one of them is unstable too."""
    figures = {symbol: np.full(count, 0.1) for symbol in FIGURES}
    figures["settling_s"] = np.linspace(0.1, 0.19, count)
    figures["overshoot_pct"][[3, 7, 9]] = (25.0, 40.0, 21.0)
    figures["gain_margin_db"] = np.where(np.arange(count) == 9, -1.0, 8.0)
    return OneByOne(tuple(f"u{k}" for k in range(count)), LoopFigures(**figures), Requirements())


def test_what_fails_on_which_unit_is_counted_and_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(on_units, "NAMED", 4)
    found = FleetVerdict(FleetDesignSettings(), invented(), None, 2)
    assert (found.share.met, found.share.of) == (47, 50)
    assert found.fails == {"overshoot_pct": ("u3", "u7", "u9"), "stable": ("u9",)}
    assert [(odd.unit, odd.requirement, odd.meets) for odd in found.worst] == [
        ("u9", "stable", False), ("u7", "overshoot_pct", False), ("u3", "overshoot_pct", False),
        ("u49", "settling_s", True)]  # fmt: skip
    assert not found.reached
    assert "47 of 50 units meet every requirement: FEWER than the required 99%" in found.says
    assert FleetVerdict(FleetDesignSettings(share=0.94), invented(), None, 1).reached


def test_the_interval_of_a_share_is_clopper_and_pearsons() -> None:
    share = Share.counted(invented().met)
    ends = beta.ppf(0.025, 47, 4), beta.ppf(0.975, 48, 3)
    assert (share.low, share.high) == pytest.approx(ends, rel=1e-9)
    everyone = Share.counted(np.ones(100, dtype=bool))
    assert (everyone.low, everyone.high) == pytest.approx((0.025 ** (1.0 / 100.0), 1.0))


def test_a_unit_without_a_number_meets_nothing() -> None:
    found = invented()
    found.figures.settling_s[0] = np.nan
    assert not found.met[0]
    assert set(found.worst_first[:2].tolist()) == {0, 9}


def test_the_extremes_of_the_fleet_are_among_those_that_the_search_sees(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fleet, "DIRECTIONS", 2)
    rng = np.random.default_rng(0)
    x = rng.standard_normal((500, 3)) * (1.0, 0.3, 0.1)
    some = representatives(x, 20, FleetDesignSettings())
    assert len(set(some.tolist())) == 20
    assert {int(np.argmax(x[:, 0])), int(np.argmin(x[:, 0]))} <= set(some[:4].tolist())
    assert len(representatives(x[:5], 20, FleetDesignSettings())) == 5


def test_future_units_scatter_as_the_population_and_wider_where_it_is_known_from_few() -> None:
    many, few = (fleets.of(fleets.truths(count, 8)) for count in (200, 8))
    asked = FleetDesignSettings(future=3000)
    for model, wider in ((many, 1.0), (few, np.sqrt(9.0 / 8.0 * 7.0 / 5.0))):
        drawn = future_units(model, settings=asked)
        assert drawn is not None
        k = model.free_parameters.layout.free.index("R_a")
        ours, theirs = (each.coordinates[:, k].std(ddof=1) for each in (model, drawn))
        # standard error of the standard deviation of 3000 draws of t with 7 degrees of freedom: about 2 %
        assert theirs / ours == pytest.approx(wider, rel=0.07)
        assert drawn.values["K_m"] == pytest.approx(drawn.values["K_b"])
    assert future_units(fleets.of(fleets.truths(4, 8))) is None


def test_a_rule_that_nobody_knows_is_refused() -> None:
    model = fleets.of(fleets.truths(3, 1))
    with pytest.raises(UsageError, match="no tuning rule is called 'magic'"):
        design_for_fleet(model, ecu_of(model.nominal), rule="magic")


@pytest.mark.slow
def test_every_unit_is_judged_as_it_is_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("etcfit.control.fleet.AT_ONCE", 4)
    model = fleets.of(fleets.truths(7, 9, spread=0.2))
    fitted, gains = model.nominal, Gains(20.0, 100.0, 0.5)
    task = task_of(fitted, ecu_of(fitted), drawn=model.coordinates[:1])
    plants = replace(task.loop, throttles=fitted.throttles(model.coordinates))
    together = one_by_one(task, plants.throttles, model.units, gains)
    for k in (0, 3, 6):
        alone = one_by_one(task, plants.taking(np.array([k])).throttles, model.units[k : k + 1], gains)
        # the noise of the sensor is another sequence for each place
        assert together.figures.rmse_pct[k] == pytest.approx(alone.figures.rmse_pct[0], rel=1e-6)
        assert together.figures.gain_margin_db[k] == pytest.approx(alone.figures.gain_margin_db[0], rel=1e-9)


@pytest.fixture(scope="module")
def designed() -> Design:
    model = fleets.of(fleets.truths(60, 11, spread=SPREAD), position_noise=NOISE)
    rules = {name: RULES[name] for name in ("optimal", "simc")}
    future = future_units(model, settings=FleetDesignSettings(future=400))
    with results.limits_unsought():
        return design_for_fleet(model, ecu_of(model.nominal), future=future, settings=QUICK, rules=rules)


@pytest.mark.slow
def test_the_share_promised_is_met_by_fresh_units_of_an_independent_simulation(designed: Design) -> None:
    found = designed.fleet
    assert found is not None
    assert found.future is not None
    assert found.share.of == 60
    assert 0.5 < found.future.value < 1.0
    fresh = fleets.truths(200, 12, spread=SPREAD)
    met = sum(on_plant(designed.task, designed.proposed, truth, 100 + k).meets for k, truth in enumerate(fresh))
    # both shares are counted over units of their own
    promised = found.future
    table = [[met, len(fresh) - met], [promised.met, promised.of - promised.met]]
    assert float(np.asarray(fisher_exact(table))[1]) > 0.01
    assert found.reached == (found.share.value >= 0.99)


@pytest.mark.slow
def test_the_files_and_the_table_say_how_the_fleet_fares(designed: Design, tmp_path: Path) -> None:
    assert designed.fleet is not None
    written = written_valid(tmp_path, "pid", PID.json(designed))
    fleet = written["fleet"]
    assert fleet["units"] == 60
    assert fleet["share_met"] == designed.fleet.share.value
    assert fleet["fails"] == {k: list(v) for k, v in designed.fleet.fails.items()}
    assert [each["unit"] for each in fleet["worst"]] == [each.unit for each in designed.fleet.worst]
    assert written["posterior"]["origin"] == "fleet"
    said = render(design_table(designed))
    assert "on every unit of the fleet" in said
    assert designed.fleet.worst[0].unit in said
    legend = draw_responses(designed).legends[0]
    assert "95 % of the units" in [text.get_text() for text in legend.get_texts()]


@pytest.mark.slow
def test_what_no_gains_reach_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    """One unit has a spring that no supply overcomes."""
    units = fleets.truths(12, 13)
    units[5] = replace(units[5], T_PL=6.0)
    model = fleets.of(units, position_noise=NOISE)
    rules = {"optimal": RULES["optimal"]}
    monkeypatch.setattr(fleet, "REFINEMENTS", 1)
    settings = replace(results.BRIEF, draws=40)
    with results.limits_unsought():
        found = design_for_fleet(model, ecu_of(model.nominal), settings=settings, rules=rules).fleet
    assert found is not None
    assert not found.reached
    assert found.future is None
    assert found.worst[0].unit == "u005"
    assert "FEWER" in found.says


def run_of(truth: Truth, known: float = 0.01, **config: object) -> Fitted:
    """The fit of one unit that knows it to so much."""
    one = fleets.of([truth], position_noise=NOISE).nominal
    return replace(one, covariance=known**2 * np.eye(one.x.size), config=replace(one.config, **config))  # pyright: ignore[reportArgumentType]


def parts_of(units: list[Truth], effects: tuple[str, ...] = (), **further: np.ndarray) -> Parts:
    return Parts("runs/line", "line 4", fleets.of(units, effects, NOISE, **further), {"u100": "odd: a stiff spring"})


def test_a_measured_unit_is_itself_where_the_fleet_tells_it_and_the_run_elsewhere() -> None:
    units, mine = fleets.truths(6, 31), replace(CONSISTENT, K_s=0.2, L_a=5e-3)
    whole = fleets.of(units, position_noise=NOISE)
    told = [k for k, symbol in enumerate(whole.law.symbols) if symbol != "L_a"]
    law = replace(whole.law, **{name: getattr(whole.law, name)[told] for name in ("mean", "sd", "stderr", "positive")},
                  symbols=tuple(whole.law.symbols[k] for k in told),
                  correlation=whole.law.correlation[np.ix_(told, told)])  # fmt: skip
    parts = Parts("runs/line", "line 4", replace(whole, population=law), {})
    fitted = run_of(mine)
    assert parts.of_run(fitted) == ("L_a",)
    plants = parts.measured(fitted)
    for symbol in ("R_a", "K_b", "K_m", "K_s", "T_PL", "T_f", "J_m", "J_L", "B_L"):
        theirs = [getattr(unit, symbol) for unit in units]
        np.testing.assert_allclose(np.asarray(plants.parameter(symbol)), theirs, rtol=1e-9, err_msg=symbol)
    np.testing.assert_allclose(np.asarray(plants.parameter("L_a")), 5e-3, rtol=1e-9)


def test_what_the_fleet_does_not_tell_of_a_drawn_unit_is_as_sure_as_the_run() -> None:
    whole = fleets.of(fleets.truths(6, 31))
    law = replace(whole.law, symbols=("R_a",), mean=np.array([3.0]), sd=np.array([0.1]), stderr=np.zeros(1),
                  correlation=np.eye(1), positive=np.ones(1, dtype=bool))  # fmt: skip
    parts, fitted = Parts("runs/line", "line 4", replace(whole, population=law), {}), run_of(CONSISTENT, 0.05)
    rest = fitted.laplace(400, np.random.default_rng(1))
    drawn, own = parts.drawn(fitted, rest, 2), fitted.throttles(rest)
    np.testing.assert_allclose(np.asarray(drawn.parameter("T_f")), np.asarray(own.parameter("T_f")))
    assert np.asarray(drawn.parameter("R_a")).mean() == pytest.approx(3.0, rel=0.02)
    assert np.std(np.asarray(drawn.parameter("T_f"))) > 0.0


def test_parts_with_other_effects_are_refused_with_both_lists() -> None:
    units = fleets.truths(6, 31)
    spring = {s: np.full(6, v) for s, v in {"T_lh": 0.1, "K_lh": 0.5, "theta_lh": 0.15, "d_lh": 0.01}.items()}
    other = parts_of(units, ("limp_home_spring",), **spring)
    with pytest.raises(UsageError, match=r"runs/line: the fleet has alone limp_home_spring\. Both must have the same"):
        other.must_be_of(run_of(CONSISTENT))
    with pytest.raises(UsageError, match=r"the run has alone limp_home_spring\."):
        parts_of(units).must_be_of(other.model.nominal)
    parts_of(units).must_be_of(run_of(CONSISTENT))


def test_parts_with_another_gear_are_refused() -> None:
    with pytest.raises(UsageError, match=r"gear_ratio is 20\.68 in the fleet and 18 in the run"):
        parts_of(fleets.truths(6, 31)).must_be_of(run_of(CONSISTENT, gear_ratio=18.0))


class Compared(NamedTuple):
    """Designs for one unit's model: over the parts, and the gains of the same search over its own draws."""

    design: Design
    parts: Parts
    alone: Gains


@pytest.fixture(scope="module")
def compared() -> Compared:
    units = fleets.truths(24, 11, spread=SPREAD)
    fitted, parts = run_of(units[0]), parts_of(units)
    rules = {name: RULES[name] for name in ("optimal", "simc", "as_found")}
    with results.limits_unsought():
        found = design(fitted, ecu_of(fitted), settings=QUICK, rules=rules, parts=parts)
    alone = RULES["optimal"](task_of(fitted, ecu_of(fitted), settings=QUICK))
    assert isinstance(alone, Gains)
    return Compared(found, parts, alone)


@pytest.mark.slow
def test_every_rule_is_judged_on_every_unit_as_it_is_alone(compared: Compared) -> None:
    found, model = compared.design.parts, compared.parts.model
    assert found is not None
    assert set(found.rules) == {"optimal", "simc"}  # as_found has no gains
    for name, each in found.rules.items():
        gains = compared.design.tuned[name].gains
        assert gains is not None
        alone = one_by_one(compared.design.task, model.throttles, model.units, gains)
        assert each.measured.units == model.units
        # the noise of the sensor is another sequence for each place
        np.testing.assert_allclose(each.measured.figures.rmse_pct, alone.figures.rmse_pct, rtol=4e-2)
        np.testing.assert_allclose(each.measured.figures.gain_margin_db, alone.figures.gain_margin_db, rtol=1e-6)
        assert each.drawn.share.of == QUICK.draws - 1
        assert each.worst.unit == each.measured.units[int(each.measured.worst_first[0])]


@pytest.mark.slow
def test_outside_the_bench_a_unit_meets_everything_only_if_it_does_at_each_corner(compared: Compared) -> None:
    found = compared.design.parts
    assert found is not None
    corners, chosen = found.corners, found.rules["optimal"].measured
    assert len(corners.units) == 8 * len(found.units)
    assert corners.units[0] == "u000 at 9 V, -20 degrees Celsius, friction 0.5"
    assert corners.units[-1] == "u023 at 15 V, 130 degrees Celsius, friction 1.5"
    every = [all(corners.met[8 * k : 8 * k + 8]) for k in range(len(found.units))]
    assert (found.share_at_corners.met, found.share_at_corners.of) == (sum(every), 24)
    # a weak battery, a hot winding and much friction: every unit follows less closely than on the bench
    hardest = [k for k, name in enumerate(corners.units) if name.endswith("at 9 V, 130 degrees Celsius, friction 1.5")]
    assert len(hardest) == 24
    assert np.all(corners.figures.rmse_pct[hardest] > chosen.figures.rmse_pct)


@pytest.mark.slow
def test_gains_sought_over_the_parts_hold_on_more_fresh_units_and_as_many_as_promised(compared: Compared) -> None:
    """By plates of an independent simulation, which share nothing with the model."""
    design = compared.design
    assert design.parts is not None
    fresh = fleets.truths(150, 12, spread=SPREAD)
    over, alone = (
        np.array([on_plant(design.task, gains, truth, 100 + k).meets for k, truth in enumerate(fresh)])
        for gains in (design.proposed, compared.alone)
    )
    assert over.sum() > alone.sum()
    only = int(np.sum(over & ~alone)), int(np.sum(over != alone))
    assert binomtest(*only, alternative="greater").pvalue < 0.01  # unit by unit, McNemar's
    promised = design.parts.rules["optimal"].drawn.share
    table = [[int(over.sum()), int(np.sum(~over))], [promised.met, promised.of - promised.met]]
    assert float(np.asarray(fisher_exact(table))[1]) > 0.01


@pytest.mark.slow
def test_file_table_and_picture_say_how_the_parts_fare(compared: Compared, tmp_path: Path) -> None:
    design, found = compared.design, compared.design.parts
    assert found is not None
    written = written_valid(tmp_path, "pid", PID.json(design))
    parts, each = written["parts"], found.rules["optimal"]
    assert (parts["fleet"], parts["name"]) == ("runs/line", "line 4")
    assert parts["left_out"] == {"u100": "odd: a stiff spring"}
    assert parts["rules"]["optimal"]["measured"]["share_met"] == each.measured.share.value
    assert parts["rules"]["optimal"]["drawn"]["worst_rmse_pct"] == pytest.approx(each.drawn.figures.rmse_pct.max())
    assert parts["rules"]["optimal"]["worst"]["unit"] == each.worst.unit
    assert parts["conditions"]["corners"]["of"] == 24
    assert written["posterior"]["origin"] == "laplace"
    assert written["bias_curve"]["hold_V"] == pytest.approx(design.bias.hold.tolist())
    said = " ".join(render(design_table(design)).split())
    assert "On the parts of line 4" in said
    assert "not judged: u100, odd: a stiff spring" in said
    assert f"outside the bench: {found.share_at_corners.met} of 24 units" in said
    said = [text.get_text() for text in draw_responses(design).axes[0].texts]
    measured = each.measured.share
    share = f"{100.0 * each.drawn.share.value:.1f} %"
    assert f"met by {share} of drawn parts, {measured.met} of 24 measured" in said


def test_the_share_on_the_parts_does_not_depend_on_the_run_where_the_fleet_tells_everything() -> None:
    units = fleets.truths(8, 33)
    parts = parts_of(units)
    one, other = run_of(units[0]), run_of(replace(units[1], T_f=0.1))
    mine, theirs = (parts.measured(each) for each in (one, other))
    for symbol in asdict(CONSISTENT):
        if symbol not in ("N", *parts.of_run(one)):
            np.testing.assert_array_equal(np.asarray(mine.parameter(symbol)), np.asarray(theirs.parameter(symbol)))
