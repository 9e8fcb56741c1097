"""Capability: formulas, intervals that hold, open sides. Gauge R and R: known answers, what cannot be told apart."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from etcfit.fleets.statistics.capability import Line, capability, gauge


def test_many_units_give_the_indices_of_the_book() -> None:
    found = capability(Line(10.0, 1e-3, 1e6, 1.0, (0.999, 1.001)), 7.0, 14.0)
    assert found.cp == pytest.approx(7.0 / 6.0)
    assert found.cpk == pytest.approx(1.0)
    assert found.outside == pytest.approx(stats.norm.cdf(-3.0) + stats.norm.sf(4.0))
    assert found.cpk_ci95 == pytest.approx((1.0, 1.0), abs=3e-3)


def test_one_limit_has_no_cp() -> None:
    found = capability(Line(10.0, 0.1, 50.0, 1.0, (0.8, 1.25)), -math.inf, 13.0)
    assert found.cp is None
    assert found.cp_ci95 is None
    assert found.cpk == pytest.approx(1.0)
    assert found.outside == pytest.approx(stats.norm.sf(3.0))
    assert found.cpk_ci95[0] < 1.0 < found.cpk_ci95[1]
    assert found.outside_ci95[0] < found.outside < found.outside_ci95[1]


def test_units_that_are_not_seen_to_differ_have_no_upper_bound() -> None:
    found = capability(Line(10.0, 0.1, 11.0, 0.0, (0.0, 0.5)), 8.0, 12.0)
    assert found.cp == math.inf
    assert found.cp_ci95 == pytest.approx((4.0 / 3.0, math.inf))
    assert 1.0 < found.cpk_ci95[0] < 4.0 / 3.0
    assert found.outside == 0.0


def test_a_figure_without_error_has_the_sample_sd_and_its_own_uncertainty_is_taken_off() -> None:
    value = stats.norm.ppf((np.arange(25) + 0.5) / 25, 0.1, 0.01)  # no draw: one in some seeds is far enough to be odd
    line = Line.from_values(value, np.zeros(25))
    assert line.sd == pytest.approx(value.std(ddof=1), rel=1e-3)
    assert line.mean == pytest.approx(value.mean())
    less = Line.from_values(np.append(value, np.nan), np.full(26, 0.008))
    assert less.sd == pytest.approx(math.sqrt(value.var(ddof=1) - 0.008**2), rel=1e-2)


def test_a_shared_symbol_has_no_capability() -> None:
    with pytest.raises(ValueError, match="no shared symbol"):
        capability(Line(1.0, 0.1, 10.0, 0.0, (math.nan, math.nan)), 0.0, 2.0)


@pytest.mark.slow
def test_the_ci95_of_cpk_holds_with_a_dozen_units_that_are_measured_badly() -> None:
    fleets, inside = 300, 0
    for seed in range(fleets):
        rng = np.random.default_rng(seed)
        value = rng.normal(0.0, 1.0, 12) + rng.normal(0.0, 0.7, 12)
        low, high = capability(Line.from_values(value, np.full(12, 0.7)), -4.0, 3.0).cpk_ci95
        inside += low <= 1.0 <= high
    assert stats.binom.ppf(0.0005, fleets, 0.92) <= inside <= stats.binom.ppf(0.9995, fleets, 0.98)


def study(
    rng: np.random.Generator, parts: int, rigs: int, operators: int, repeats: int, sd: dict[str, float]
) -> tuple[np.ndarray, list[tuple[str, ...]]]:
    """Every part on every rig by every operator."""
    effect = {
        name: sd[name] * rng.standard_normal(n) for name, n in (("part", parts), ("rig", rigs), ("operator", operators))
    }
    rows = [(p, r, o) for p in range(parts) for r in range(rigs) for o in range(operators) for _ in range(repeats)]
    value = [0.13 + effect["part"][p] + effect["rig"][r] + effect["operator"][o] + sd["e"] * rng.standard_normal()
             for p, r, o in rows]  # fmt: skip
    labels = [tuple(f"{name} {row[k]}" for row in rows) for k, name in enumerate(("part", "rig", "operator"))]
    return np.array(value), labels


def test_a_balanced_study_of_one_rig_is_the_analysis_of_variance() -> None:
    value, labels = study(np.random.default_rng(1), 10, 1, 1, 3, {"part": 2.0, "rig": 0.0, "operator": 0.0, "e": 0.5})
    table = value.reshape(10, 3)
    within = table.var(axis=1, ddof=1).mean()
    between = table.mean(axis=1).var(ddof=1) - within / 3
    found = gauge(value, *labels)
    assert found is not None
    assert found.repeatability == pytest.approx(np.sqrt(within), rel=1e-3)
    assert found.part == pytest.approx(np.sqrt(between), rel=1e-3)
    assert found.rr_percent == pytest.approx(100.0 * np.sqrt(within / (within + between)), rel=1e-3)
    assert found.ndc == int(1.41 * np.sqrt(between / within))
    assert found.rig is None
    assert found.reproducibility is None
    assert any("only one rig (rig 0)" in each for each in found.untold)


def test_components_are_unbiased_over_many_unbalanced_studies() -> None:
    sd = {"part": 2.0, "rig": 1.0, "operator": 0.6, "e": 0.5}
    seen = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        value, labels = study(rng, 8, 4, 3, 1, sd)
        value[rng.choice(len(value), 30, replace=False)] = np.nan
        found = gauge(value, *labels)
        assert found is not None
        assert found.untold == ()
        seen.append([(sd or 0.0) ** 2 for sd in (found.repeatability, found.rig, found.operator, found.part)])
    mean, error = np.mean(seen, axis=0), np.std(seen, axis=0, ddof=1) / np.sqrt(12.0)
    assert np.all(np.abs(mean - np.array([0.25, 1.0, 0.36, 4.0])) < 4.5 * error)


def test_nothing_measured_twice_is_no_study() -> None:
    assert gauge(np.arange(5.0), tuple("abcde"), ("r",) * 5, ("o",) * 5) is None
    assert gauge(np.arange(5.0), (None,) * 5, ("r",) * 5, ("o",) * 5) is None
    assert gauge(np.arange(5.0), ("a",) * 5, ("r",) * 5, ("o",) * 5) is None


def test_what_changes_together_is_said() -> None:
    rng = np.random.default_rng(3)
    value, labels = study(rng, 8, 3, 1, 2, {"part": 2.0, "rig": 1.0, "operator": 0.0, "e": 0.5})
    part, rig, _ = labels
    together = gauge(value, part, rig, rig)
    assert together is not None
    assert together.operator is None
    assert any("operator and rig change together" in each for each in together.untold)
    own = tuple(f"rig {int(p.split()[1]) % 2}" for p in part)
    nested = gauge(value, part, own, (None,) * len(own))
    assert nested is not None
    assert nested.rig is None
    assert any("rig and part cannot be told apart" in each for each in nested.untold)
    assert any("no operator is named" in each for each in nested.untold)
