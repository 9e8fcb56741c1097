"""What effects inside the throttle do to a residual: along the path of the model, or in models that have them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from etcfit.diagnosis.candidate_model import CandidateModel
from etcfit.diagnosis.composition import compose
from etcfit.diagnosis.tangents import Variant, serves, tangents, tangents_inside, variants
from etcfit.model.effects import COMMANDING, EFFECT_BY_NAME, AbstractEffect
from etcfit.rig.base import Rig


def columns(variant: Variant, each: np.ndarray) -> np.ndarray:
    return each


def with_candidates(s: CandidateModel, rig: Rig, *names: str) -> CandidateModel:
    little = replace(rig, config=s.problem.config)
    composition = compose(little, s.problem.batch.traces, only=tuple(EFFECT_BY_NAME[name] for name in names))
    return replace(s, composition=composition)


def test_where_an_ecu_in_the_model_reads_the_sensor_none_goes_along_the_path(small: CandidateModel) -> None:
    layout = small.problem.layout
    commanded = replace(layout, types=(*layout.types, *COMMANDING))
    driven = replace(small.problem, free_parameters=replace(small.problem.free_parameters, layout=commanded))
    gravity = EFFECT_BY_NAME["gravity_load"]
    assert serves(small.problem, gravity)
    assert not serves(driven, gravity)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "apart"),
    [
        ("gravity_load", 1e-9),
        ("cogging_torque", 1e-9),
        ("current_sensor_offset", 1e-9),
        ("asymmetric_friction", 1e-9),
        ("channel_delay", 1e-9),
        ("actuation_delay", 2e-3),  # a thousandth off zero a jump of the input comes within a step: another path
    ],
)
def test_along_the_path_a_tangent_is_that_of_a_model_with_the_effect(
    small: CandidateModel, rig: Rig, name: str, apart: float
) -> None:
    """To rounding, but where an amplitude that cannot be negative is taken a thousandth off zero there."""
    s = with_candidates(small, rig, name)
    effect: type[AbstractEffect] = EFFECT_BY_NAME[name]
    every = variants(effect)
    whole = s.composed((effect,))
    ours, theirs = tangents_inside(s, every, columns), tangents(whole.problem, whole.x, whole.weighted, every)
    assert serves(s.problem, effect)
    for mine, its in zip(ours, theirs, strict=True):
        assert np.max(np.abs(its)) > 0.0
        assert_allclose(mine, its, atol=apart * np.max(np.abs(its)))


@pytest.mark.slow
def test_each_variant_gets_its_own_columns_whichever_way_they_come(small: CandidateModel, rig: Rig) -> None:
    """A rebound is tried at values, gravity and a delay along the path; asked in any order."""
    names = ("stop_bounce", "gravity_load", "actuation_delay")
    s = with_candidates(small, rig, *names)
    every = [variant for name in names for variant in variants(EFFECT_BY_NAME[name])]
    asked = [*every[::2], *every[1::2]]
    found = dict(zip(asked, tangents_inside(s, asked, columns), strict=True))
    for variant in every:
        (alone,) = tangents_inside(s, [variant], columns)
        assert alone.shape == (int(s.weighted.samples), len(variant.amplitudes))
        assert_allclose(found[variant], alone, rtol=1e-9, atol=1e-9 * np.max(np.abs(alone)))
