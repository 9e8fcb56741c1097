"""kS, kV and kA: by hand from Eqs. 1-2, from a plate pushed by the independent simulation, with errors as of draws."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from etcfit.control.linearise import SYMBOLS, MotorConstants, linear_plant, motor_constants, reduce
from etcfit.estimation.fitted_model import Fitted
from etcfit.reporting.blocks import render
from etcfit.reporting.control.plant import constants_table, reduction_table
from etcfit.run_folder.plant import reduction_json
from schemas import written_valid

N = 20.68


@pytest.fixture(scope="module")
def found(fitted: Fitted) -> MotorConstants:
    return motor_constants(fitted, *fitted.config.stops)


def by_hand(values: Mapping[str, Any]) -> np.ndarray:
    R, K_b, K_m, T_f = (np.asarray(values[s]) for s in ("R_a", "K_b", "K_m", "T_f"))
    B, J = (N**2 * np.asarray(values[f"{s}_m"]) + np.asarray(values[f"{s}_L"]) for s in "BJ")
    return np.stack([R * T_f / (N * K_m), N * K_b + R * B / (N * K_m), R * J / (N * K_m)])


def test_they_are_those_of_the_equations(fitted: Fitted, found: MotorConstants) -> None:
    assert found.values == pytest.approx(by_hand(dict(fitted.values)), rel=1e-6)


def test_the_plant_alone_is_the_reductions(fitted: Fitted) -> None:
    for share in (0.25, 0.6):
        assert linear_plant(fitted, share) == reduce(fitted, share=share).plant


def test_their_errors_are_those_of_many_draws(fitted: Fitted, found: MotorConstants) -> None:
    throttles = fitted.throttles(fitted.laplace(4000, np.random.default_rng(1)))
    drawn = by_hand({s: np.asarray(throttles.parameter(s)) for s in fitted.values if s != "series_ohm.inductance"})
    assert found.stderr == pytest.approx(drawn.reshape(3, -1).std(axis=1), rel=0.06)


def test_terminal_file_and_page_have_them(fitted: Fitted, found: MotorConstants, tmp_path: Path) -> None:
    reduction = replace(reduce(fitted), constants=found)
    made = reduction_json(fitted, reduction, 0)
    written = written_valid(tmp_path, "transfer_function", made)
    assert [written["feedforward"][name] for name in SYMBOLS] == found.values.tolist()
    text = render(reduction_table(fitted, reduction, 0), 120)
    assert all(name in text for name in SYMBOLS)
    assert f"{2.0 * np.pi * found.values[1]:.4g}" in text
    page = constants_table(written)
    assert page is not None
    assert [row["constant"] for row in page.rows] == list(SYMBOLS)
