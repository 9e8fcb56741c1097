"""The ledger of before and after; what of it tests/golden/ does not show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import diagnoses
from etcfit.diagnosis.findings import Diagnosis
from etcfit.reporting.blocks import render
from etcfit.reporting.diagnosis import diagnosis_table
from etcfit.reporting.diagnosis.ledger import Entry, headline, ledger


def entry(d: Diagnosis, test: str, channel: str, held_out: bool) -> Entry:
    (one,) = (e for e in ledger(d) if (e.test, e.channel, e.held_out) == (test, channel, held_out))
    return one


def test_every_test_and_channel_has_an_entry_held_out_ones_first(found: Diagnosis) -> None:
    entries = ledger(found)
    assert [e.held_out for e in entries] == sorted((e.held_out for e in entries), reverse=True)
    assert sum(e.before.samples for e in entries) == sum(
        row.n for row in (*found.before.score_fit, *found.before.score_holdout)
    )


def test_positions_are_in_degrees_whatever_the_sensor_and_other_channels_as_logged(found: Diagnosis) -> None:
    (row,) = (r for r in found.before.score_holdout if r.channel == "position")
    one = entry(found, "response", "position", True)
    assert row.unit == "V"
    assert one.unit == "deg"
    assert one.before.rms == pytest.approx(row.rms * 90.0 / (4.73 - 0.45))
    assert one.before.ratio == pytest.approx(row.rms / row.sigma)
    in_degrees = entry(found, "back_emf", "position", False)
    (row,) = (r for r in found.after.score_fit if (r.test, r.channel) == ("back_emf", "position"))
    assert (row.unit, in_degrees.after.rms) == ("deg", pytest.approx(row.rms))
    (row,) = (r for r in found.after.score_holdout if r.channel == "current")
    one = entry(found, "response", "current", True)
    assert (one.unit, one.after.rms) == ("mA", pytest.approx(row.rms))


def test_the_unexplained_has_a_column_of_its_own(found: Diagnosis) -> None:
    one = entry(found, "response", "position", True)
    assert one.unknown is not None
    assert one.unknown.rms == pytest.approx(0.9 * one.after.rms)
    assert entry(replace(found, unexplained=None), "response", "position", True).unknown is None


def test_the_headline_is_the_largest_held_out_error(found: Diagnosis) -> None:
    text = headline(found)
    worst = max((e for e in ledger(found) if e.held_out), key=lambda e: e.before.ratio)
    assert text.startswith(f"With limp_home_spring the held-out {worst.channel} error (response) falls:")
    assert f"{worst.before.ratio:.0f} →" in text


def test_the_headline_does_not_claim_what_is_not_so(found: Diagnosis, tmp_path) -> None:
    assert "does not fall" in headline(replace(found, after=found.before))
    assert headline(diagnoses.explained(found.before.rig)).startswith("The start model explains the data")
    missing = headline(replace(found, added=(), after=found.before))
    assert missing.startswith("No effect of the catalogue explains what is missing")


def test_a_model_that_cannot_be_simulated_has_no_headline(found: Diagnosis) -> None:
    def lost(rows: tuple) -> tuple:
        return tuple(replace(row, rms=np.nan) for row in rows)

    before = replace(
        found.before, score_fit=lost(found.before.score_fit), score_holdout=lost(found.before.score_holdout)
    )
    assert headline(replace(found, before=before)) == "The model cannot be simulated"


def test_without_an_unknown_there_is_no_column_for_it(found: Diagnosis) -> None:
    plain = render(diagnosis_table(replace(found, unexplained=None)), 160)
    assert "with unknown" not in plain
    assert "What no effect explains" not in plain


def test_a_final_fit_that_did_not_converge_says_so(found: Diagnosis) -> None:
    failed = replace(found, after=replace(found.after, converged=False, reason="still [so] far"))
    assert "DID NOT CONVERGE: still [so] far" in render(diagnosis_table(failed))
