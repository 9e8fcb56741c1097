"""Derivatives of every registered effect: those of finite differences, also where it is off or its law bends."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import jax
import numpy as np
import pytest
from numpy.testing import assert_allclose

from effect_samples import COUNT, PARTS, every_effect, names, parts, rows, table
from etcfit.model.effects import EFFECTS, AbstractEffect
from etcfit.model.parameters import parameters_of

AMPLITUDES = [(effect, symbol) for effect in EFFECTS for symbol in effect.off or {}]
every_amplitude = pytest.mark.parametrize(
    ("effect", "symbol"), AMPLITUDES, ids=[f"{e.name}-{s}" for e, s in AMPLITUDES]
)
QUALIFYING = ("tooth_damping", "tooth_restitution")  # how impacts within a play go: nothing at all without one
TINY = 1e-7  # of a scale: an amplitude just above its off value


def jacobian(effect: type[AbstractEffect], at: np.ndarray) -> np.ndarray:
    """d parts / d row at every row, shape (COUNT, parts, entries of a row)."""
    return np.asarray(_compiled(effect)(at))


@cache
def _compiled(effect: type[AbstractEffect]) -> Callable[[Any], jax.Array]:
    return jax.jit(jax.vmap(jax.jacfwd(lambda row: parts(effect, row))))


def differences(effect: type[AbstractEffect], at: np.ndarray) -> np.ndarray:
    """The same by central differences."""
    columns = []
    for k in range(at.shape[1]):
        nudge = np.zeros_like(at)
        nudge[:, k] = 1e-6 * np.maximum(np.abs(at[:, k]), 1e-9)
        columns.append((table(effect, at + nudge) - table(effect, at - nudge)) / (2.0 * nudge[:, [k]]))
    return np.stack(columns, axis=-1)


@every_effect
def test_forward_mode_is_finite_differences(effect: type[AbstractEffect]) -> None:
    """Of every part and every rate of memory, with respect to state, inputs, memory and parameters; as elasticities."""
    at = rows(effect)
    scale = np.abs(at)[:, None, :] / (1e-3 + np.abs(table(effect, at)))[:, :, None]
    exact = jacobian(effect, at)
    assert_allclose(exact * scale, differences(effect, at) * scale, rtol=1e-6, atol=1e-7)


@every_effect
def test_a_derivative_is_a_number_where_laws_bend(effect: type[AbstractEffect]) -> None:
    """At rest, without current and without load, at either stop, on and off."""
    at = rows(effect)[:4]
    at[:, : names(effect).index("external") + 1] = 0.0
    at[1::2, names(effect).index("theta")] = np.pi / 2
    for symbol in effect.off or {}:
        at[2:, names(effect).index(symbol)] = 0.0
    at = np.tile(at, (COUNT // 4, 1))  # as many as elsewhere: nothing is compiled for them
    assert np.all(np.isfinite(table(effect, at)))
    assert np.all(np.isfinite(jacobian(effect, at)))


@every_amplitude
def test_an_effect_that_is_off_can_be_sensed(effect: type[AbstractEffect], symbol: str) -> None:
    """The slope along an amplitude at its off value is that of the difference just above it, and not all zero.

    A score test asks for exactly this; without it a fit that begins at the off value would never leave.
    """
    silent = rows(effect, **dict(effect.off or {}))
    k = names(effect).index(symbol)
    step = TINY * next(getattr(p.domain, "scale", 1.0) for p in parameters_of(effect) if p.symbol == symbol)
    above = silent.copy()
    above[:, k] = step
    said = [n for n, part in enumerate(PARTS) if part not in QUALIFYING]
    slope = jacobian(effect, silent)[:, said, k]
    assert_allclose(slope, table(effect, above)[:, said] / step, rtol=1e-5, atol=1e-12)
    assert np.any(slope != 0.0)
