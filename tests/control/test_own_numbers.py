"""Gains of an ECU that publishes no unit: against the gains that it has, and against the one that swings on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import results
import rigs
from etcfit.control.design import ecu_of, gains_as_found, task_of
from etcfit.control.own_numbers import checked, sentences, shares
from etcfit.control.pid import Gains, Refusal, Requirements, Task
from etcfit.control.pid.linear_loop import closed, sampled
from etcfit.errors import UsageError
from etcfit.estimation.fitted_model import Fitted
from etcfit.model.ecu import Ecu, Terms
from etcfit.model.ecus import ECUS
from etcfit.reporting.blocks import render
from etcfit.reporting.control.gains import design_table, gains_table, pasted, settings_table
from etcfit.reporting.control.sentence import sentence
from etcfit.reporting.table import Notes
from etcfit.run_folder.pid import PID
from schemas import written_valid

PROPOSED = Gains(60.0, 300.0, 0.6)
NOT_KNOWN = Refusal("not known")
ECU = Ecu(period=1e-3, supply=12.0, filter=2e-3)


def task(now: Gains | Refusal = NOT_KNOWN, present: Mapping[str, float] | None = None) -> Task:
    around = rigs.loop(ecu=ECU)
    return Task(rigs.plant(around), ECU, Requirements(), around, as_found=now, profile=ECUS["maxxecu"],
                present=present or {})  # fmt: skip


def test_the_gain_at_which_p_alone_becomes_unstable_is_that_of_the_sampled_loop() -> None:
    """By the eigenvalues of the loop tick by tick, which know no ultimate gain: more grows, less dies."""
    around = task()
    P, _, _ = shares(around, PROPOSED)
    assert P.of_ultimate is not None
    limit = PROPOSED.Kp / P.of_ultimate
    less, more = (closed(Gains(over * limit, 0.0, 0.0), sampled(around.plant, ECU), ECU).spectral_radius
                  for over in (0.97, 1.03))  # fmt: skip
    assert less < 1.0 < more


def test_shares_of_present_gains_in_the_ecus_own_numbers() -> None:
    """The fit found yours in SI; the ECU shows 60, 80 and 120: what it means by one is their ratio."""
    now = Gains(120.0, 150.0, 1.2)
    P, I, D = shares(task(now, {"P": 60.0, "I": 80.0, "D": 120.0}), PROPOSED)  # noqa: E741
    assert (P.of_present, I.of_present, D.of_present) == pytest.approx((0.5, 2.0, 0.5))
    assert (P.value, I.value, D.value) == pytest.approx((30.0, 160.0, 60.0))
    assert P.shown == (pytest.approx(30.0), "in its own number")
    alone = shares(task(now), PROPOSED)
    assert [each.shown[1] for each in alone] == ["times yours"] * 3


def test_where_p_alone_swings_tells_what_a_number_of_p_means_and_of_p_alone() -> None:
    plain = shares(task(), PROPOSED)[0]
    assert plain.of_ultimate is not None
    P, I, D = shares(task(present={"swings_at": 120.0, "P": 60.0}), PROPOSED)  # noqa: E741
    assert P.value == pytest.approx(120.0 * plain.of_ultimate)
    assert P.of_present == pytest.approx(2.0 * plain.of_ultimate)
    assert I.shown == (pytest.approx(60.0 / 300.0), "s (P over I)")
    assert D.shown == (pytest.approx(0.6 / 60.0), "s (D over P)")


def test_nothing_known_is_no_number_with_a_unit() -> None:
    P, I, D = shares(task(), PROPOSED)  # noqa: E741
    assert [each.value for each in (P, I, D)] == [None] * 3
    assert P.shown[1] == "times the P at which P alone becomes unstable"
    assert "--swings-at" in " ".join(sentences(task(), PROPOSED, "MaxxECU"))


def test_it_says_how_far_yours_is_from_instability() -> None:
    limit = PROPOSED.Kp / (shares(task(), PROPOSED)[0].of_ultimate or np.nan)
    now = Gains(0.5 * limit, 100.0, 1.0)
    words = list(sentences(task(now), PROPOSED, "MaxxECU"))
    assert "P alone becomes unstable at about 2 times yours" in words[1]
    words = list(sentences(task(now, {"P": 60.0, "I": 1.0, "D": 1.0, "swings_at": 150.0}), PROPOSED, "MaxxECU"))
    assert any("at a P of 120; you found 150" in each for each in words)


def test_a_gain_of_none_now_has_no_ratio() -> None:
    D = shares(task(Gains(60.0, 300.0, 0.0), {"P": 1.0, "I": 2.0, "D": 0.0}), PROPOSED)[2]
    assert D.of_present is None
    assert D.shown == (pytest.approx(0.01), "s (D over P)")


@pytest.mark.parametrize(("given", "told"), [({"Q": 1.0}, "Q is none of P, I, D, swings_at"), ({"P": -1.0}, "P -1")])
def test_what_is_no_gain_is_refused(given: dict[str, float], told: str) -> None:
    with pytest.raises(UsageError, match=told):
        checked(given)


def test_present_gains_of_an_ecu_with_a_known_unit_are_judged_as_found(fitted: Fitted) -> None:
    unit = Terms(2.0, 3.0, 4.0)
    assert gains_as_found(fitted, unit, {"P": 1.0, "I": 2.0, "D": 3.0}) == Gains(2.0, 6.0, 12.0)
    assert isinstance(gains_as_found(fitted, None, {"P": 1.0, "I": 2.0, "D": 3.0}), Refusal)


def test_terminal_file_page_and_sentence_have_the_same_shares(fitted: Fitted, tmp_path: Path) -> None:
    make = ECUS["maxxecu"]
    ecu, brief = ecu_of(fitted, **make.completed({"compensated": 1.0})), replace(results.BRIEF, draws=2)
    given = task_of(fitted, ecu, settings=brief, profile=make,
                    feed_forward=True, present={"P": 60.0, "I": 80.0, "D": 120.0, "swings_at": 120.0})  # fmt: skip
    found = results.proposed(fitted, replace(given, as_found=Gains(100.0, 200.0, 1.0)), "manual")
    pid = PID.json(found)
    written_valid(tmp_path, "pid", pid)
    gain = pid["profile"]["gains"]["P gain"]
    assert gain["value"] == pytest.approx(0.6 * found.proposed.Kp)
    assert pid["profile"]["gains"]["I gain"]["value"] == pytest.approx(80.0 * found.proposed.Ki / 200.0)
    assert not any("battery" in each for each in pid["profile"]["assumed"])
    assert pid["ecu"]["divides_by_battery"] is True
    table = pid["profile"]["bias"]
    assert table["target"][0] == 0.0
    assert table["target"][-1] == 100.0
    assert any(table["feed forward"])
    text = render(design_table(found), 120)
    assert "P alone becomes unstable at about" in text
    assert "divided by the battery voltage" in text
    assert "%/%" not in text.split("For MaxxECU")[1].split("Assumed of it")[0]
    assert "its own number" in sentence(pid)
    assert settings_table(pid) is not None
    notes = [each for part in pasted(pid) if isinstance(part, Notes) for each in part.texts]
    assert any("P alone becomes unstable" in each for each in notes)
    gains = gains_table(pid)
    assert gains is not None
    assert [row[0] for row in gains.rows] == ["continuous time"]  # none in ticks
