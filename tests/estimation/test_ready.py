"""Effects of the rig that rig.toml names: at a place of this folder they are parameters, elsewhere they are refused."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from etcfit.diagnosis.composition import by_file
from etcfit.errors import MeasurementError
from etcfit.estimation.ready import ready
from etcfit.model.rig_effects import RIG_EFFECTS, at_places
from etcfit.problem.free_parameters import free_parameters
from etcfit.problem.trace import by_test
from etcfit.rig.base import Fixed, Rig
from etcfit.rig.config import parse_config

DOCS = Path(__file__).parents[2] / "docs"


def naming(rig: Rig, *effects: str) -> Rig:
    return replace(rig, config=replace(rig.config, effects=effects))


@pytest.mark.parametrize("name", [
    "channel_gain[nope]", "channel_gain[response.speed]", "channel_gain[response]", "channel_gain[response/1.csv]",
    "trace_late[../../etc/passwd]", "trace_late[response]", "time_scale[nope]", "gear_ratio[response]",
    "series_resistance[back_emf]", "other_rig[response/17.csv]", "supply_sag", "channel_drift[response.torque]",
    *(family.kind for family in RIG_EFFECTS if family.scope != "rig"),
])  # fmt: skip
def test_a_place_that_this_folder_does_not_have_is_refused_with_those_that_it_has(rig: Rig, name: str) -> None:
    found = re.escape(f"rig.toml: [model] effects: names {name!r}. ")
    kind = name.partition("[")[0]
    there = rf"In this folder it can be {kind}" if kind not in ("supply_sag", "channel_drift") else "change nothing"
    with pytest.raises(MeasurementError, match=rf"^{found}.*{there}"):
        ready(naming(rig, name))


def test_every_place_that_a_diagnosis_tries_is_one(rig: Rig) -> None:
    fitted = ready(rig).fitted
    every = at_places(by_test(fitted), by_file(fitted))
    assert len(every) > 20
    ready(naming(rig, *(effect.name for effect in every)))


def test_an_effect_of_a_trace_that_is_set_aside_keeps_its_place(rig: Rig) -> None:
    ready(naming(rig, "warm_start[response/1.csv]", "other_rig[response/1.csv]"))


def test_a_misspelt_place_is_answered_with_the_nearest(rig: Rig) -> None:
    with pytest.raises(MeasurementError, match=r"Did you mean 'response\.current'\?"):
        ready(naming(rig, "channel_gain[respnse.current]"))


def test_the_example_of_the_documentation_is_held_where_it_says() -> None:
    blocks = re.findall(r"```toml\n(.*?)```", (DOCS / "reference" / "effects.md").read_text("utf-8"), re.DOTALL)
    (example,) = (each for each in blocks if "[parameters]" in each)
    config = parse_config(f"[rig]\n{example}", "rig.toml")
    assert config.parameters == {"late.response.current": Fixed(0.002)}
    layout = free_parameters(config).layout
    assert layout.status("late.response.current") == "fixed"
    assert layout.status("late.response/3.csv") == "estimated"
