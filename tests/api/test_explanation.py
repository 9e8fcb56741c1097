"""What a notebook sees of a diagnosis and of a posterior."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import diagnoses
import folders
from etcfit.api import verbs
from etcfit.api.explanation import Diagnosed, Sampled
from etcfit.api.fit import Fit
from etcfit.errors import UsageError
from etcfit.estimation.result import FitResult
from etcfit.rig.base import Rig


def test_the_ledger_has_before_and_after_for_every_file_and_channel(found: Diagnosed) -> None:
    frame, d = found.ledger, found.diagnosis
    was = (*d.before.score_fit, *d.before.score_holdout)
    now = {(r.file, r.channel): r.rms for r in (*d.after.score_fit, *d.after.score_holdout)}
    assert list(frame.index) == [(r.file, r.channel) for r in was]
    assert frame.index.names == ["file", "channel"]
    assert list(frame["before"]) == [r.rms for r in was]
    assert list(frame["after"]) == [now[key] for key in frame.index]
    assert int(np.sum(frame["held_out"])) == len(d.before.score_holdout)
    np.testing.assert_allclose(frame["after_in_sigma"], frame["after"] / frame["sigma"])
    assert {name: str(kind) for name, kind in frame.dtypes.items()} == {
        "test": "str", "held_out": "bool", "unit": "str", "n": "int64", "sigma": "float64",
        "before": "float64", "after": "float64", "before_in_sigma": "float64", "after_in_sigma": "float64",
    }  # fmt: skip


def test_candidates_have_a_row_a_round_and_effect(found: Diagnosed) -> None:
    frame = found.candidates
    assert list(frame[frame["added"]].index) == [(1, diagnoses.FOUND)]
    assert np.isnan(frame.loc[(1, "backlash"), "bic_change"])


def test_it_leads_to_the_final_model(found: Diagnosed) -> None:
    assert found.final.result is found.diagnosis.after
    assert found.before.result is found.diagnosis.before
    assert found.added == (diagnoses.FOUND,)
    assert diagnoses.FOUND in found.final.effects
    assert found.verdict.startswith("Eqs. 1-2 lack the limp-home spring. With it")


def test_repr_and_html_are_short_escaped_and_say_what_matters(found: Diagnosed) -> None:
    d = found.diagnosis
    config = replace(d.after.rig.config, name="<b>rig</b>")
    after = replace(d.after, rig=replace(d.after.rig, config=config), converged=False, reason="it wandered")
    spoilt = Diagnosed(replace(d, after=after))
    page = spoilt._repr_html_()
    assert "<b>rig" not in page
    assert "&lt;b&gt;rig" in page
    for text in (page, repr(spoilt)):
        assert "SYNTHETIC" in text
        assert "NOT CONVERGED" in text
        assert diagnoses.FOUND in text
    assert len(repr(spoilt)) < 1500
    assert "NOT CONVERGED" not in repr(found) + found._repr_html_()


def test_a_diagnosis_that_found_nothing_says_so(rig: Rig) -> None:
    nothing = Diagnosed(diagnoses.explained(rig))
    assert "found nothing" in repr(nothing)
    assert "no effect added" in nothing._repr_html_()
    assert nothing.candidates.empty
    assert nothing.unexplained is None


STEPS = 120
VOLTS, OHM, SIGMA = 2.0, 1.513, 0.01
FIXED = {"L_a": 1e-9, "K_b": 0.0189, "J_m": 1e-6, "J_L": 1e-3, "B_m": 1e-5, "B_L": 1e-3, "K_s": 0.15, "T_PL": 0.36}
TOML = "\n".join([
    folders.TOML.replace("[rig]", "[rig]\nsynthetic = true"),
    f"[noise]\ncurrent_A = {SIGMA}\nvoltage_V = 1e-6\n[parameters]",
    *(f"{symbol} = {{ fixed = {value} }}" for symbol, value in FIXED.items()),
])  # fmt: skip


@pytest.fixture(scope="module")
def held(tmp_path_factory: pytest.TempPathFactory) -> Fit:
    """A real fit of a plate held at 2 V: R_a is known, the dry friction T_f is not."""
    rng = np.random.default_rng(2)
    time = 0.01 * np.arange(40)
    current = VOLTS / OHM + SIGMA * rng.standard_normal(40)
    sheet = folders.sheet("time [s]", "voltage [V]", "current [A]", columns=(time, VOLTS + 0.0 * time, current))
    folder = folders.write(tmp_path_factory.mktemp("held"), {"rig.toml": TOML, "resistance/1.csv": sheet.text()})
    return verbs.fit(folder)


@pytest.fixture(scope="module")
def sampled(held: Fit) -> Sampled:
    return verbs.sample(held, steps=STEPS)


def test_a_fit_of_a_folder_is_a_real_one(held: Fit) -> None:
    assert isinstance(held.result, FitResult)
    known = held.parameters.loc["R_a"]
    assert abs(known["value"] - OHM) < 4.0 * known["stderr"]
    assert held.parameters.loc["T_f", "status"] == "not identifiable"


def test_draws_are_a_row_a_step_and_walker(sampled: Sampled) -> None:
    draws, here = sampled.draws, sampled.posterior.convergence
    assert draws.index.names == ["ensemble", "step", "walker"]
    assert len(draws) == np.prod(sampled.posterior.points.shape[:3])
    assert set(draws.index.get_level_values("step")) == set(range(here.steps + 1 - here.burn))
    assert draws.loc[(1, 0, 2), "R_a"] == sampled.posterior.draws["R_a"][1, 0, 2]


def test_parameters_say_nothing_of_what_is_not_identifiable(sampled: Sampled) -> None:
    frame = sampled.parameters
    known = frame.loc["R_a"]
    assert known["mean"] == pytest.approx(np.mean(sampled.draws["R_a"]))
    assert known["low"] < known["median"] < known["high"]
    assert known["unit"] == "ohm"
    assert frame.loc["T_f", ["mean", "sd", "median", "low", "high"]].isna().all()
    assert frame.loc["T_f", "status"] == "not identifiable"


def test_a_chain_too_short_is_called_no_posterior(sampled: Sampled) -> None:
    assert not sampled.converged
    for text in (repr(sampled), sampled._repr_html_()):
        assert "NOT CONVERGED" in text
        assert "SYNTHETIC" in text
    assert len(repr(sampled)) < 1500


def test_corner_plot(sampled: Sampled) -> None:
    size = len(sampled.posterior.chain.symbols)
    panels = sampled.plot.corner()
    assert panels.shape == (size, size)
    assert panels[-1, 0].get_xlabel() == "R_a [%]"


def test_a_chain_is_kept_where_it_was_asked_for_and_taken_up_again(held: Fit, tmp_path: Path) -> None:
    run = tmp_path / "new" / "run"
    first = verbs.sample(held, steps=50, keep=run)
    assert [path.name for path in run.iterdir()] == ["posterior_chain.npz"]
    later = verbs.sample(held, steps=100, keep=run)
    before, after = (s.posterior.chain.ensembles[0].points for s in (first, later))
    np.testing.assert_array_equal(after[: len(before)], before)


def test_a_design_does_not_take_the_posterior_of_another_model(fitted: Fit, sampled: Sampled) -> None:
    with pytest.raises(UsageError, match="another model"):
        verbs.design(fitted, posterior=sampled)
