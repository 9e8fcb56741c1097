"""Moves keep the density they are asked to sample; emcee's own snooker does not."""

from __future__ import annotations

from typing import Any

import emcee
import numpy as np
import pytest

from etcfit.posterior.moves import Leap, Snooker

SIZE = 5


def variances(move: Any, scale: float = 1.0, steps: int = 2000) -> np.ndarray:
    """Of each coordinate of a normal density of sd `scale`, sampled by one move alone."""
    sampler = emcee.EnsembleSampler(
        8 * SIZE, SIZE, lambda u: -0.5 * np.sum((u / scale) ** 2, axis=1), moves=move, vectorize=True
    )
    start = scale * np.random.RandomState(3).standard_normal((8 * SIZE, SIZE))
    sampler.run_mcmc(emcee.State(start, random_state=np.random.RandomState(4).get_state()), steps)
    return np.var(np.asarray(sampler.get_chain(discard=200, flat=True)), axis=0) / scale**2


@pytest.mark.parametrize("move", [Snooker(), Leap()], ids=["snooker", "leap"])
@pytest.mark.parametrize("scale", [0.6, pytest.param(1.0, marks=pytest.mark.slow)])
def test_a_move_keeps_the_variance_of_a_normal_density(move: Any, scale: float) -> None:
    # 72 000 draws, the slowest of them with tau of about 30: standard error 0.03 each, 0.013 for their mean
    assert np.mean(variances(move, scale)) == pytest.approx(1.0, abs=0.04)


@pytest.mark.slow
def test_the_snooker_of_emcee_does_not_which_is_why_there_is_one_of_our_own() -> None:
    assert np.mean(variances(emcee.moves.DESnookerMove())) < 0.85
