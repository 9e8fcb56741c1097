"""Every settings object: documented field by field, refused where wrong, and the same again after JSON."""

from __future__ import annotations

import inspect
import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

import etcfit
from etcfit import cli, stages
from etcfit.api import verbs
from etcfit.control.settings import ManualSettings, OptimumSettings, SafetySettings
from etcfit.diagnosis.settings import DiagnosisSettings
from etcfit.estimation.settings import FitSettings
from etcfit.experiment.settings import CampaignSettings, PlanSettings
from etcfit.exporting.base import ExportSettings
from etcfit.files import plain
from etcfit.posterior.settings import SamplingSettings
from etcfit.ranges import Range, check_ranges, from_json, real, reals, whole

ROOMS = [file.parent.name for file in sorted(Path(etcfit.__file__).parent.glob("*/settings.py"))]
KINDS: list[Any] = [
    *(each for room in ROOMS for each in vars(import_module(f"etcfit.{room}.settings")).values()
      if isinstance(each, type) and is_dataclass(each) and each.__module__ == f"etcfit.{room}.settings"),
    ExportSettings,
]  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_every_field_is_documented_and_has_a_range(kind: Any) -> None:
    documented = re.findall(r"^ {8}([a-z_0-9, ]+): \S", kind.__doc__, flags=re.MULTILINE)
    if kind is not DiagnosisSettings:  # its fields are explained in place
        assert {each.name for each in fields(kind)} <= {*", ".join(documented).split(", ")}
    assert [each.name for each in fields(kind) if not (each.metadata or is_dataclass(each.default))] == []


@pytest.mark.parametrize("kind", KINDS)
def test_a_value_outside_the_range_is_refused_with_field_value_and_range(kind: Any) -> None:
    for each in fields(kind):
        if not is_dataclass(getattr(kind(), each.name)):
            refuses(kind, each.name, each.metadata)


def refuses(kind: Any, name: str, allowed: Mapping[str, Any]) -> None:
    """What lies outside of a field's range."""
    inside = allowed["range"]
    beyond = (inside.high + 1, inside.low - 1, *([inside.low] * inside.open_low), *([inside.high] * inside.open_high))
    for wrong in (*beyond, float("nan"), "much", True):
        value = (wrong,) if allowed["many"] else wrong
        said = f"{kind.__name__}.{name} = {value!r}: it must be "
        with pytest.raises(ValueError, match=f"^{re.escape(said)}.*{allowed['kind']}, {re.escape(str(inside))}\\.$"):
            replace(kind(), **{name: value})
    if allowed["many"]:
        for wrong in ((), 1.0):
            with pytest.raises(ValueError, match="one or more numbers"):
                replace(kind(), **{name: wrong})


@dataclass(frozen=True)
class Example:
    rounds: int = whole(3, 1, 100)
    least: int = whole(3, 1)
    share: float = real(0.5, above=0.0, below=1.0)
    fall: float = real(-1.0, high=0.0)
    tolerance: float = real(1e-3, above=0.0)
    late: tuple[float, ...] = reals((1.0, 2.0), 0.0, 10.0)
    any: float = real(0.0)

    __post_init__ = check_ranges


@pytest.mark.parametrize(
    ("name", "value", "required"),
    [
        ("rounds", 0, "a whole number, from 1 to 100"),
        ("rounds", 2.0, "a whole number, from 1 to 100"),
        ("least", 0, "a whole number, 1 or more"),
        ("share", 1.0, "a number, greater than 0 and less than 1"),
        ("fall", 0.1, "a number, 0 or less"),
        ("tolerance", 0.0, "a number, greater than 0"),
        ("late", (1.0, 11.0), "a tuple of one or more numbers, each a number, from 0 to 10"),
        ("any", float("inf"), "a number, finite"),
    ],
)
def test_an_error_says_class_field_value_and_range_in_the_same_words_everywhere(
    name: str, value: Any, required: str
) -> None:
    with pytest.raises(ValueError, match=f"^{re.escape(f'Example.{name} = {value!r}: it must be {required}.')}$"):
        Example(**{name: value})


def test_the_ends_of_a_range_are_in_it_unless_they_are_open() -> None:
    assert all(value in Range(0.0, 1.0) for value in (0.0, 0.5, 1.0))
    assert 0.5 in Range(0.0, 1.0, open_low=True, open_high=True)
    assert not any(value in Range(0.0, 1.0, open_low=True, open_high=True) for value in (0.0, 1.0))
    assert not any(value in Range() for value in (float("nan"), float("inf"), -float("inf")))


@pytest.mark.parametrize("kind", KINDS)
def test_what_json_holds_is_the_settings_again(kind: Any) -> None:
    written = json.loads(json.dumps(plain(kind())))
    assert from_json(kind, written) == kind()
    assert from_json(kind, {}) == kind()
    with pytest.raises(ValueError, match=f"{kind.__name__} has no field nonsense"):
        from_json(kind, {"nonsense": 1})


def test_changed_settings_within_settings_survive_json_too() -> None:
    changed = CampaignSettings(tests=2, durations=(3.0,), plan=PlanSettings(supply=14.0, bands=(5.0,)))
    assert from_json(CampaignSettings, json.loads(json.dumps(plain(changed)))) == changed
    assert from_json(FitSettings, {"misfit": 10}).misfit == 10.0


@pytest.mark.parametrize("sample", [cli.sample, stages.sample_run, verbs.sample], ids=lambda f: f.__module__)
def test_the_steps_that_the_command_line_shows_are_those_of_the_settings(sample: Callable[..., Any]) -> None:
    assert inspect.signature(sample).parameters["steps"].default == SamplingSettings().most_steps


TWO, FALLING = {"lowest": (1.0, 1.0), "highest": (2.0, 2.0)}, {"lowest": (0.3, 0.3, 50.0)}


@pytest.mark.parametrize(
    ("kind", "values", "said"),
    [
        *((kind, TWO, "three gains, Kp, Ki and Kd") for kind in (OptimumSettings, ManualSettings)),
        *((kind, FALLING, "must have an entry above each of lowest") for kind in (OptimumSettings, ManualSettings)),
        (OptimumSettings, {"population": 8, "elite": 9}, "at most the population, 8"),
        (PlanSettings, {"lowest": 2.0}, r"PlanSettings.bands = .*: each must be greater than lowest, 2"),
        (SafetySettings, {"most": 0.004}, "most"),
        (SafetySettings, {"crank": (6.0,)}, "as many parts"),
    ],
)
def test_settings_that_contradict_each_other_are_refused(kind: Any, values: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        kind(**values)


@pytest.mark.parametrize(
    "value", [10**400, -(10**400), 10**5000], ids=["401 digits", "negative", "more than are printed"]
)
@pytest.mark.parametrize(("kind", "name"), [(SamplingSettings, "still"), (OptimumSettings, "spares")])
def test_a_whole_number_that_no_float_can_hold_is_out_of_range(kind: Any, name: str, value: int) -> None:
    with pytest.raises(ValueError, match=rf"{kind.__name__}\.{name} = .*it must be"):
        kind(**{name: (value,) if name == "spares" else value})
