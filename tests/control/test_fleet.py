"""Gains for a fleet: what is counted, and whether the share promised is met by plants that share no code."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from jsonschema import Draft202012Validator
from scipy.stats import beta, fisher_exact

import etcfit
import fleets
from benchmarks.parts import on_plant
from etcfit.control.design import Design, ecu_of, task_of
from etcfit.control.fleet import design_for_fleet, future_units, one_by_one, representatives
from etcfit.control.fleet_verdict import OneByOne, Share, verdict
from etcfit.control.loop_figures import FIGURES, LoopFigures
from etcfit.control.pid import RULES, Gains, Requirements
from etcfit.control.settings import DesignSettings, FleetDesignSettings, OptimumSettings
from etcfit.errors import UsageError
from etcfit.files import write_json
from etcfit.reporting.blocks import render
from etcfit.reporting.control.responses import draw
from etcfit.reporting.control.tables import design_table
from etcfit.run_folder.design import design_json

NOISE = 1e-4  # rad
SPREAD = 0.22  # so wide that no gains please all units: a promise of 100 % would be easy to keep
QUICK = DesignSettings(
    draws=40,
    optimum=OptimumSettings(searches=1, sweeps=3, population=24, elite=6, rounds=10, last_rounds=6),
)


def invented(count: int = 50) -> OneByOne:
    """Three units overshoot, one of them is unstable too."""
    figures = {symbol: np.full(count, 0.1) for symbol in FIGURES}
    figures["settling_s"] = np.linspace(0.1, 0.19, count)
    figures["overshoot_pct"][[3, 7, 9]] = (25.0, 40.0, 21.0)
    figures["gain_margin_db"] = np.where(np.arange(count) == 9, -1.0, 8.0)
    return OneByOne(tuple(f"u{k}" for k in range(count)), LoopFigures(**figures), Requirements())


def test_what_fails_on_which_unit_is_counted_and_named() -> None:
    found = verdict(invented(), None, FleetDesignSettings(named=4), 2)
    assert (found.share.met, found.share.of) == (47, 50)
    assert found.fails == {"overshoot_pct": ("u3", "u7", "u9"), "stable": ("u9",)}
    assert [(odd.unit, odd.requirement, odd.meets) for odd in found.worst] == [
        ("u9", "stable", False), ("u7", "overshoot_pct", False), ("u3", "overshoot_pct", False),
        ("u49", "settling_s", True)]  # fmt: skip
    assert not found.reached
    assert "47 of 50 units meet everything: FEWER than the 99%" in found.says
    assert verdict(invented(), None, FleetDesignSettings(share=0.94), 1).reached


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


def test_the_extremes_of_the_fleet_are_among_those_that_the_search_sees() -> None:
    rng = np.random.default_rng(0)
    x = rng.standard_normal((500, 3)) * (1.0, 0.3, 0.1)
    some = representatives(x, 20, FleetDesignSettings(directions=2))
    assert len(set(some.tolist())) == 20
    assert {int(np.argmax(x[:, 0])), int(np.argmin(x[:, 0]))} <= set(some[:4].tolist())
    assert len(representatives(x[:5], 20, FleetDesignSettings())) == 5


def test_future_units_scatter_as_the_population_and_wider_where_it_is_known_from_few() -> None:
    many, few = (fleets.of(fleets.truths(count, 8)) for count in (200, 8))
    asked = FleetDesignSettings(future=3000)
    for model, wider in ((many, 1.0), (few, np.sqrt(9.0 / 8.0 * 7.0 / 5.0))):
        drawn = future_units(model, asked=asked)
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
def test_every_unit_is_judged_as_it_is_alone() -> None:
    model = fleets.of(fleets.truths(7, 9, spread=0.2))
    fitted, gains = model.nominal, Gains(20.0, 100.0, 0.5)
    task = task_of(fitted, ecu_of(fitted), drawn=model.coordinates[:1])
    plants = replace(task.loop, throttles=fitted.throttles(model.coordinates))
    together = one_by_one(task, plants.throttles, model.units, gains, 4)
    for k in (0, 3, 6):
        alone = one_by_one(task, plants.taking(np.array([k])).throttles, model.units[k : k + 1], gains, 4)
        # the noise of the sensor is another sequence for each place
        assert together.figures.rmse_pct[k] == pytest.approx(alone.figures.rmse_pct[0], rel=1e-6)
        assert together.figures.gain_margin_db[k] == pytest.approx(alone.figures.gain_margin_db[0], rel=1e-9)


@pytest.fixture(scope="module")
def designed() -> Design:
    model = fleets.of(fleets.truths(60, 11, spread=SPREAD), position_noise=NOISE)
    rules = {name: RULES[name] for name in ("optimal", "simc")}
    future = future_units(model, asked=FleetDesignSettings(future=400))
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
    write_json(tmp_path / "pid.json", "pid", design_json(designed))
    written = json.loads((tmp_path / "pid.json").read_text(encoding="utf-8"))
    schema = Path(etcfit.__file__).parent / "run_folder" / "schemas" / "pid.schema.json"
    Draft202012Validator(json.loads(schema.read_text(encoding="utf-8"))).validate(written)
    fleet = written["fleet"]
    assert fleet["units"] == 60
    assert fleet["share_met"] == designed.fleet.share.value
    assert fleet["fails"] == {k: list(v) for k, v in designed.fleet.fails.items()}
    assert [each["unit"] for each in fleet["worst"]] == [each.unit for each in designed.fleet.worst]
    assert written["posterior"]["origin"] == "fleet"
    said = render(design_table(designed))
    assert "on every unit of the fleet" in said
    assert designed.fleet.worst[0].unit in said
    legend = draw(designed).legends[0]
    assert "95 % of the units" in [text.get_text() for text in legend.get_texts()]


@pytest.mark.slow
def test_what_no_gains_reach_is_said() -> None:
    """One unit has a spring that no supply overcomes."""
    units = fleets.truths(12, 13)
    units[5] = replace(units[5], T_PL=6.0)
    model = fleets.of(units, position_noise=NOISE)
    rules = {"optimal": RULES["optimal"]}
    brief = replace(
        QUICK, optimum=OptimumSettings(searches=1, sweeps=1, population=8, elite=4, rounds=1, last_rounds=1)
    )
    found = design_for_fleet(model, ecu_of(model.nominal), settings=brief, rules=rules,
                             asked=FleetDesignSettings(refinements=1)).fleet  # fmt: skip
    assert found is not None
    assert not found.reached
    assert found.future is None
    assert found.worst[0].unit == "u005"
    assert "FEWER" in found.says
