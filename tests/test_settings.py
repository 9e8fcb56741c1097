"""Every settings object: documented field by field, refused where wrong, and the same again after JSON."""

from __future__ import annotations

import inspect
import json
import re
from collections.abc import Callable
from dataclasses import fields, is_dataclass, replace
from typing import Any

import pytest

from etcfit import cli, stages
from etcfit.api import verbs
from etcfit.control.settings import DesignSettings, LoopSettings, ManualSettings, OptimumSettings, RelaySettings
from etcfit.estimation.bounded import from_json
from etcfit.estimation.settings import (
    ContradictionSettings,
    EdgesInStepSettings,
    FitSettings,
    GlobalSearchSettings,
    IdentifiabilitySettings,
    WhitenessSettings,
)
from etcfit.experiment.settings import AdviceSettings
from etcfit.files import plain
from etcfit.posterior.settings import SamplingSettings

KINDS: list[Any] = [
    AdviceSettings,
    ContradictionSettings,
    EdgesInStepSettings,
    FitSettings,
    GlobalSearchSettings,
    IdentifiabilitySettings,
    WhitenessSettings,
    SamplingSettings,
    DesignSettings,
    LoopSettings,
    ManualSettings,
    OptimumSettings,
    RelaySettings,
]
FIELDS = [(kind, each.name) for kind in KINDS for each in fields(kind)]


@pytest.mark.parametrize(("kind", "name"), FIELDS, ids=lambda v: getattr(v, "__name__", v))
def test_every_field_is_documented_and_has_a_range(kind: Any, name: str) -> None:
    documented = re.findall(r"^ {8}([a-z_0-9, ]+): \S", kind.__doc__, flags=re.MULTILINE)
    assert name in ", ".join(documented).split(", ")
    field = next(each for each in fields(kind) if each.name == name)
    assert field.metadata or is_dataclass(field.default)


@pytest.mark.parametrize(("kind", "name"), [(k, n) for k, n in FIELDS if not is_dataclass(getattr(k(), n))],
                         ids=lambda v: getattr(v, "__name__", v))  # fmt: skip
def test_a_value_outside_the_range_is_refused_with_field_value_and_range(kind: Any, name: str) -> None:
    allowed = next(each for each in fields(kind) if each.name == name).metadata
    for wrong in (allowed["high"] + 1, allowed["low"] - 1, float("nan"), "much", True):
        value = (wrong,) if allowed.get("many") else wrong
        with pytest.raises(ValueError, match=re.escape(f"{kind.__name__}.{name} = {value!r}: it must be ")):
            replace(kind(), **{name: value})
    if allowed.get("many"):
        for wrong in ((), 1.0):
            with pytest.raises(ValueError, match="one or more numbers"):
                replace(kind(), **{name: wrong})


@pytest.mark.parametrize("kind", KINDS)
def test_what_json_holds_is_the_settings_again(kind: Any) -> None:
    written = json.loads(json.dumps(plain(kind())))
    assert from_json(kind, written) == kind()
    assert from_json(kind, {}) == kind()
    with pytest.raises(ValueError, match=f"{kind.__name__} has no field nonsense"):
        from_json(kind, {"nonsense": 1})


def test_changed_settings_within_settings_survive_json_too() -> None:
    changed = FitSettings(starts=5, late=(0.01,), search=GlobalSearchSettings(points=32, radii=(1.0, 0.1)))
    assert from_json(FitSettings, json.loads(json.dumps(plain(changed)))) == changed
    assert from_json(FitSettings, {"misfit": 10}).misfit == 10.0


def test_points_must_share_among_the_radii() -> None:
    with pytest.raises(ValueError, match="multiple of the number of radii, 4"):
        GlobalSearchSettings(points=30)


@pytest.mark.parametrize("sample", [cli.sample, stages.sample_run, verbs.sample], ids=lambda f: f.__module__)
def test_the_steps_that_the_command_line_shows_are_those_of_the_settings(sample: Callable[..., Any]) -> None:
    assert inspect.signature(sample).parameters["steps"].default == SamplingSettings().most_steps


@pytest.mark.parametrize("kind", [OptimumSettings, ManualSettings])
def test_bounds_of_gains_must_be_three_that_rise(kind: Any) -> None:
    with pytest.raises(ValueError, match="three gains, Kp, Ki and Kd"):
        kind(lowest=(1.0, 1.0), highest=(2.0, 2.0))
    with pytest.raises(ValueError, match="must have an entry above each of lowest"):
        kind(lowest=(0.3, 0.3, 50.0))


def test_the_elite_is_part_of_the_population() -> None:
    with pytest.raises(ValueError, match="at most the population, 8"):
        OptimumSettings(population=8, elite=9)
