"""Normal equations in one pass: in which pieces, and what is not computed in the loop. That they are those of the
residual differentiated by JAX as a whole: test_residual_kernels."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import results
from etcfit.estimation.ready import ready
from etcfit.problem.free_parameters import free_parameters
from etcfit.problem.normal_equations import NormalEquations, linearise, shared_out
from etcfit.problem.problem import EstimationProblem
from etcfit.problem.residual import WeightedData


class Case(NamedTuple):
    problem: EstimationProblem
    x: np.ndarray
    weighted: WeightedData


def _unwhitened(folder: Path) -> Case:
    from etcfit.problem.weights import free_running

    rig = results.rig(folder)
    known = free_parameters(rig.config)
    problem = EstimationProblem.of_traces(rig.config, known, ready(rig)[0])
    x = known.layout.coordinates({p.symbol: p.nominal for p in known.layout.parameters})
    return Case(problem, x, problem.weighted(free_running(problem)))


@pytest.mark.parametrize("cores", [1, 2, 3, 64])
def test_pieces_hold_every_lane_once_and_what_fills_them_up_counts_for_nothing(tmp_path: Path, cores: int) -> None:
    problem, x, weighted = _unwhitened(tmp_path)
    pieces = shared_out(weighted, x.size, cores, least_lanes=1)
    lanes = problem.slots.value.shape[1]
    assert len({piece.slots.value.shape for piece in pieces}) == 1
    assert min(cores, lanes) // 2 < len(pieces) <= max(cores, 1)
    joined = np.concatenate([np.asarray(piece.whitening.weight) for piece in pieces], axis=1)
    assert_array_equal(joined[:, :lanes], weighted.whitening.weight)
    assert_array_equal(joined[:, lanes:], 0.0)


def test_a_large_batch_is_cut_so_that_no_piece_of_its_jacobian_is_large(tmp_path: Path) -> None:
    _, x, weighted = _unwhitened(tmp_path)
    steps, lanes, slots = weighted.slots.value.shape
    assert lanes > 2
    pieces = shared_out(weighted, x.size, cores=1, most_bytes=8 * steps * slots * x.size)  # of one lane
    assert [piece.slots.value.shape[1] for piece in pieces] == [1] * lanes


def test_equations_with_a_number_that_is_none_are_not_finite() -> None:
    good = NormalEquations(np.float64(1.0), np.zeros(2), np.eye(2))
    assert good.finite
    assert not good._replace(chi2=np.float64(np.inf)).finite
    assert not good._replace(gradient=np.array([0.0, np.nan])).finite


def test_what_no_step_changes_is_computed_before_the_loop(tmp_path: Path) -> None:
    """XLA refuses to move anything out of a loop that holds a scatter, a sort, an FFT or a custom call: the map from
    coordinates to values, which scatters and has exponentials, must not be in it, nor any of those."""
    problem, x, weighted = _unwhitened(tmp_path)
    text = linearise.lower(problem.layout.form, x, weighted).compile().as_text() or ""
    parts = {part.split()[0].lstrip("%"): part for part in re.split(r"\n(?=%|ENTRY)", text)}
    inside = set(re.findall(r"body=%([\w.-]+)", text))
    assert inside
    while more := {name for k in inside for name in re.findall(r"calls=%([\w.-]+)", parts[k])} - inside:
        inside |= more
    assert len(inside) > 10  # the loop and what it calls
    for name in inside:
        assert not re.search(r" (scatter|sort|fft|custom-call|exponential|tanh)\(", parts[name])
