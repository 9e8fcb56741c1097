"""The shapes in the types of problem/ and model/ are checked in every test: see `conftest.py`."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import TypeCheckError

import bodies
from etcfit.model.delay import delayed
from etcfit.model.parameters import curves
from etcfit.problem.batch import SampleSlots
from etcfit.problem.innovations import plain, whiten
from etcfit.problem.input_signal import InputSignal, denoise
from etcfit.problem.weights import farthest


def test_a_wrong_shape_is_refused_in_the_model() -> None:
    steps, resets = bodies.batch(bodies.even(1.0, 5))
    delayed(jnp.zeros((6, 1)), steps, resets, 0.0)
    with pytest.raises(TypeCheckError, match="signal"):
        delayed(jnp.zeros(6), steps, resets, 0.0)
    with pytest.raises(TypeCheckError, match="x"):
        curves(np.zeros(3, dtype=int), np.zeros(2))  # as many kinds as coordinates


def test_a_wrong_shape_is_refused_in_the_problem() -> None:
    farthest(np.zeros((4, 2)), 1)
    with pytest.raises(TypeCheckError, match="data"):
        farthest(np.zeros(4), 1)
    with pytest.raises(TypeCheckError, match="value"):
        denoise(np.zeros((4, 2)), 0.1)


def test_a_wrong_shape_is_refused_by_a_dataclass() -> None:
    n = np.zeros(4)
    InputSignal(n, n, n, np.zeros(3, dtype=bool))
    with pytest.raises(TypeCheckError):
        InputSignal(n, n, n, np.zeros(4, dtype=bool))  # an edge lies between two instants


def test_a_wrong_shape_is_refused_inside_what_is_compiled() -> None:
    ones = jnp.ones((5, 2, 3))
    filter_ = plain(SampleSlots(ones, ones, ones, ones))
    assert whiten(filter_, ones).shape == ones.shape
    with pytest.raises(TypeCheckError, match="error"):
        whiten(filter_, ones[0])
