"""What kernels read: no filter where samples are independent."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from etcfit.kernels.machine import available
from etcfit.problem import one_pass_kernels as kernels
from etcfit.problem import weights
from held_plate import held_plate, problem_of

pytestmark = pytest.mark.skipif(not available(), reason="no llvmlite here")


def test_samples_that_are_independent_go_through_no_filter(tmp_path: Path) -> None:
    problem = problem_of(held_plate(tmp_path))
    x = problem.layout.coordinates({"R_a": 1.5, "T_f": 0.2})
    plain, whitened = problem.weighted(weights.free_running(problem)), problem.weighted(problem.filter_and_timing(x)[0])
    form = problem.layout.form

    def matrices_read(weighted: kernels.WeightedData) -> int:
        filter_ = kernels.numbered(kernels.data_of(weighted))[-1]
        columns = kernels.entry(*kernels.packed_records(form, weighted)[1]).traced.columns
        return sum(column.leaf in filter_[:3] for record in columns for column in record)

    assert matrices_read(plain) == 0
    assert matrices_read(whitened) > 0
    full = form.full(problem.layout.padded(x), plain.pick)
    compared = kernels.compared(form, full, plain)
    slots, weight = plain.slots, np.asarray(plain.whitening.weight)
    by_hand = weight * np.asarray(slots.weight) * (np.asarray(slots.value) - compared.seen)
    assert_allclose(compared.r, by_hand, rtol=1e-12)
    assert_allclose(kernels.chi2(form, full, plain), np.sum(by_hand**2), rtol=1e-12)
