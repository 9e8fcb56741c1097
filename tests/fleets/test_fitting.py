"""One unit fitted: what it leaves behind says of the truth no more and no less than its own data do."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from etcfit.fleets.fitting import Fitted, fit_unit, own_estimate
from etcfit.rig.reader import read_folder
from independent.fleet import make_fleet
from independent.line import Line

pytestmark = pytest.mark.slow
SEED = 8140


@dataclass(frozen=True)
class Made:
    """A unit: its truth by symbol, and its fit."""

    truth: dict[str, float]
    fitted: Fitted


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    folder = tmp_path_factory.mktemp("fleet")
    (unit,) = make_fleet(folder, Line(), 1, SEED, own_rig_toml=True).units
    return Made(dict(unit.values), fit_unit(read_folder(folder / unit.name), unit.name))


def test_the_estimate_is_near_the_truth_for_every_symbol_told(made: Made) -> None:
    own = made.fitted.left.own
    stderr = np.sqrt(np.diag(np.linalg.inv(own.information)))
    off = (own.estimate - np.array([made.truth[symbol] for symbol in own.symbols])) / stderr
    assert {"R_a", "K_b", "J_eq", "K_s", "T_PL", "T_f"} <= set(own.symbols)
    assert np.abs(off).max() < 4.0, dict(zip(own.symbols, off, strict=True))


def test_the_information_is_that_of_the_stated_standard_errors(made: Made) -> None:
    left = made.fitted.left
    stderr = np.sqrt(np.diag(np.linalg.inv(left.own.information)))
    for symbol, error in zip(left.own.symbols, stderr.tolist(), strict=True):
        assert left.parameters[symbol].stderr == pytest.approx(error * left.widening[symbol], rel=0.05), symbol


def test_what_the_user_believes_is_not_counted(made: Made) -> None:
    # at one optimum: a fit with the belief in it ends elsewhere, and sees its filter and its impacts from there
    result = made.fitted.result
    k = result.free_parameters.layout.free.index("K_s")
    mean, sd = np.array(result.weighted.prior_mean), np.array(result.weighted.prior_sd)
    mean[k], sd[k] = result.x[k], np.sqrt(result.covariance[k, k])  # as sharp as the data, which say the same
    believing = replace(result, weighted=result.weighted._replace(prior_mean=mean, prior_sd=sd))
    own, without = own_estimate(believing, "u")[0], made.fitted.left.own
    np.testing.assert_array_equal(own.information, without.information)
    np.testing.assert_array_equal(own.estimate, without.estimate)


def test_another_start_ends_within_the_stated_error(made: Made, tmp_path: Path) -> None:
    # not at the same point: where edges of the voltage fell between samples is found near the start, and L_a, whose
    # time constant is half a sample interval here, goes with it
    (unit,) = make_fleet(tmp_path, Line(), 1, SEED, own_rig_toml=True).units
    off = {symbol: 1.05 * value for symbol, value in made.truth.items() if symbol not in ("J_eq", "B_eq")}
    again = fit_unit(read_folder(tmp_path / unit.name), unit.name, off)
    assert [start.name for start in again.result.starts] == ["a like body"]
    assert again.result.starts[0].chi2_before > 10.0 * again.result.starts[0].chi2_after
    own, there = made.fitted.left, again.left
    stderr = np.sqrt(np.diag(np.linalg.inv(own.own.information)))
    stated = stderr * [max(own.widening[s], there.widening[s]) for s in own.own.symbols]
    assert np.abs((there.own.estimate - own.own.estimate) / stated).max() < 1.0
