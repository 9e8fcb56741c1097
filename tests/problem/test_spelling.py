"""Equal arguments are spelled alike in every process, different ones differently, and others not at all."""

from __future__ import annotations

import os
import subprocess
import sys
from functools import partial
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import pytest

from etcfit.model.effects import EFFECT_BY_NAME, PAPER
from etcfit.model.rig_effects import Place, SeriesResistance
from etcfit.problem.free_parameters import Form
from etcfit.problem.normal_equations import NormalEquations, linearise
from etcfit.problem.spelling import UnspeakableError, constant, shape

FORM = Form((*PAPER, SeriesResistance.at(Place("inductance"))), (), (("K_m", "K_b"),))
SHOW = (
    "import etcfit.backend; from etcfit.model.effects import PAPER; from etcfit.model.rig_effects import *;"
    "from etcfit.problem.free_parameters import Form; from etcfit.problem.spelling import constant;"
    "print(constant(Form((*PAPER, SeriesResistance.at(Place('inductance'))), (), (('K_m', 'K_b'),))))"
)


class Pair(NamedTuple):
    a: Any
    b: Any


@pytest.mark.slow
def test_another_process_spells_it_alike_whatever_its_hashes() -> None:
    for seed in ("1", "2"):
        said = subprocess.run([sys.executable, "-c", SHOW], capture_output=True, text=True, check=True,
                              env=os.environ | {"PYTHONHASHSEED": seed})  # fmt: skip
        assert said.stdout.strip() == constant(FORM)


@pytest.mark.parametrize(
    "others",
    [
        (1, 1.0, True, "1", None, b"1", (1,), ((1,),), {"a": 1}, {"a": 2}),
        (0.1, np.nextafter(0.1, 1.0).item()),
        tuple(Form(FORM.types, (), tie) for tie in ((), (("K_m", "K_b"),))),
        tuple(SeriesResistance.at(Place(test)) for test in ("inductance", "response", "")),
        tuple(EFFECT_BY_NAME.values()),
        (partial(constant, 1), partial(constant, 2), partial(shape, 1), constant, shape),
    ],
)
def test_what_differs_is_spelled_differently(others: tuple[Any, ...]) -> None:
    assert len({constant(each) for each in others}) == len(others)


def test_arrays_are_spelled_by_their_shape_alone() -> None:
    one = NormalEquations(np.float64(1.0), np.zeros(3), np.zeros((3, 3)))
    other = NormalEquations(jnp.float64(2.0), jnp.ones(3), jnp.ones((3, 3)))
    assert shape(one) == shape(other)
    assert shape(one) != shape(one._replace(gradient=np.zeros(4)))
    assert shape(one) != shape(one._replace(gradient=np.zeros(3, np.float32)))
    assert shape(one) != shape(tuple(one))
    assert shape(1.0) == shape(2.0) != shape(1)


def test_a_function_is_found_under_its_name_in_what_decorates_it() -> None:
    assert constant(linearise.__wrapped__) == "function etcfit.problem.normal_equations.linearise"


def test_what_another_process_could_not_find_is_refused() -> None:
    class Local:
        pass

    for value in (lambda x: x, np.zeros(2), [1], {1, 2}, Local, Local(), Pair(1, 2), Pair, print):
        with pytest.raises(UnspeakableError):
            constant(value)
    for value in ("text", {1}, Local(), Pair(1, 2)):
        with pytest.raises(UnspeakableError):
            shape(value)
