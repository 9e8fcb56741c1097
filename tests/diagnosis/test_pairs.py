"""Pairs scored together, against least squares with bounds on made-up problems."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from typing import ClassVar

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from etcfit.diagnosis.screen import Background, Signature
from etcfit.diagnosis.sets import Pair, pairs
from etcfit.diagnosis.tangents import Variant
from etcfit.model.effects import AbstractEffect
from etcfit.model.parameters import NonNegative, Positive, Real, Scalar, parameter, parameters_of

N = 200


class First(AbstractEffect):
    """One amplitude of either sign, of which two shapes are tried."""

    name = "first"
    off: ClassVar[Mapping[str, float] | None] = {"a": 0.0}
    scan: ClassVar[Mapping[str, tuple[float, ...]]] = {"p": (1.0, 2.0)}
    a: Scalar = parameter("N*m", Real(0.5), 0.0, "one", "a test")
    p: Scalar = parameter("1", Positive(1.0), 1.0, "shape", "a test")


class Second(AbstractEffect):
    """Two amplitudes that cannot be negative."""

    name = "second"
    off: ClassVar[Mapping[str, float] | None] = {"c": 0.0, "d": 0.0}
    c: Scalar = parameter("N*m", NonNegative(0.1), 0.0, "one", "a test")
    d: Scalar = parameter("N*m", NonNegative(3.0), 0.0, "another", "a test")


class Third(AbstractEffect):
    """One amplitude that does a little of what the two others do."""

    name = "third"
    off: ClassVar[Mapping[str, float] | None] = {"e": 0.0}
    e: Scalar = parameter("N*m", Real(2.0), 0.0, "one", "a test")


class Tried(AbstractEffect):
    """An amplitude that shows nothing while it is small: it is tried at one value."""

    name = "tried"
    off: ClassVar[Mapping[str, float] | None] = {"f": 0.0}
    scan: ClassVar[Mapping[str, tuple[float, ...]]] = {"f": (0.6,)}
    f: Scalar = parameter("1", NonNegative(0.3), 0.0, "one", "a test")


PARAMETERS = {p.symbol: p for e in (First, Second, Third, Tried) for p in parameters_of(e)}
VARIANTS = (
    Variant(First, {"p": 1.0}, ("a",)),
    Variant(First, {"p": 2.0}, ("a",)),
    Variant(Second, {}, ("c", "d")),
    Variant(Third, {}, ("e",)),
    Variant(Tried, {"f": 0.6}, ("f",)),
)


@pytest.fixture(params=range(6))
def case(request: pytest.FixtureRequest) -> tuple[Background, list[Signature]]:
    """The residual lacks First at its second shape and Second; Third is half of each."""
    rng = np.random.default_rng(request.param)
    columns = [rng.normal(size=(N, len(v.amplitudes))) for v in VARIANTS]
    columns[3] = columns[1] + columns[2][:, :1] + 0.1 * rng.normal(size=(N, 1))
    r = 0.1 * rng.normal(size=N) - columns[1][:, 0] - columns[2] @ [1.0, 0.4]
    background = Background.spanned(r, rng.normal(size=(N, 3)))
    return background, [background.signature(v, c, PARAMETERS) for v, c in zip(VARIANTS, columns, strict=True)]


def gain(a: Signature, b: Signature, r: np.ndarray) -> float:
    """By least squares with bounds over all samples; what is tried at one value stays there."""
    target, free, low = -r, [], []
    for s in (a, b):
        domains = [PARAMETERS[symbol].domain for symbol in s.variant.amplitudes]
        if s.variant.effect is Tried:
            target = target - s.columns @ np.array([0.6 / domains[0].scale])
        else:
            free.append(s.columns)
            low += [0.0 if isinstance(d, NonNegative) else -np.inf for d in domains]
    columns = np.concatenate(free, axis=1)
    left = lsq_linear(columns, target, bounds=(low, np.inf)).x
    return float(r @ r - np.sum((columns @ left - target) ** 2))


def test_every_pair_is_what_bounded_least_squares_gives_at_its_best_shapes(
    case: tuple[Background, list[Signature]],
) -> None:
    background, signatures = case
    expected: dict[frozenset[type], float] = {}
    for a, b in combinations(signatures, 2):
        if a.variant.effect is not b.variant.effect:
            key = frozenset((a.variant.effect, b.variant.effect))
            expected[key] = max(expected.get(key, 0.0), gain(a, b, background.r))
    found = pairs(signatures, background.r, 100)
    assert {frozenset(p.effects): p.gain for p in found} == pytest.approx(expected, rel=1e-6, abs=1e-9)
    assert [p.gain for p in found] == sorted((p.gain for p in found), reverse=True)


def best(case: tuple[Background, list[Signature]]) -> Pair:
    return pairs(case[1], case[0].r, 1)[0]


def test_two_that_are_missing_come_before_one_that_does_half_of_each(case: tuple[Background, list[Signature]]) -> None:
    """Alone, the third explains most: round by round it would be the first."""
    assert max(case[1], key=lambda s: s.gain).variant.effect is Third
    found = best(case)
    assert set(found.effects) == {First, Second}
    assert found.values["p"] == 2.0
    told = [found.values[s] / PARAMETERS[s].domain.scale for s in ("a", "c", "d")]
    assert told == pytest.approx([1.0, 1.0, 0.4], abs=0.05)


def test_only_as_many_as_asked_and_those_are_the_best(case: tuple[Background, list[Signature]]) -> None:
    background, signatures = case
    every = pairs(signatures, background.r, 100)
    assert [frozenset(p.effects) for p in pairs(signatures, background.r, 2)] == [
        frozenset(p.effects) for p in every[:2]
    ]


def test_what_parameters_imitate_wholly_makes_no_pair(case: tuple[Background, list[Signature]]) -> None:
    background, signatures = case
    hidden = background.signature(VARIANTS[3], background.basis[:, :1], PARAMETERS)
    assert hidden.own == 0.0
    assert not any(Third in p.effects for p in pairs([*signatures[:3], hidden], background.r, 9))
    assert pairs([hidden], background.r, 9) == ()
