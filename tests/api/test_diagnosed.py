"""A diagnosis in a notebook."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import diagnoses
from etcfit.api.explanation import Diagnosed
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
