"""Gauge R and R: known answers, unbalanced studies, and what cannot be told apart."""

from __future__ import annotations

import numpy as np
import pytest

from etcfit.fleets.statistics.gauge import gauge


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
