"""What is known of a mistake before the data: its usual size, and whether the checks found it."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

import diagnoses
from etcfit.diagnosis.choice import alike
from etcfit.diagnosis.composition import Effect
from etcfit.diagnosis.findings import Candidate, Evidence, RoundReport
from etcfit.diagnosis.probabilities import probabilities, questions
from etcfit.diagnosis.settings import DEFAULT
from etcfit.diagnosis.trial import surprise
from etcfit.model.effects import EFFECT_BY_NAME
from etcfit.model.rig_effects import rig_effect


def effect(name: str) -> Effect:
    found = rig_effect(name)
    assert found is not None
    return found


GAIN, RESISTOR = effect("channel_gain[inductance.voltage]"), effect("series_resistance[inductance]")
VALUES = {"gain.inductance.voltage": 0.74, "series_ohm.inductance": 1.2}


def test_a_mistake_of_an_unusual_size_pays_for_it() -> None:
    assert surprise(GAIN, VALUES, ()) == pytest.approx(2.0 * math.log(1.0 + (0.74 / 0.02) ** 2))
    assert surprise(RESISTOR, VALUES, ()) == pytest.approx(2.0 * math.log(1.0 + 1.2**2))
    assert surprise(GAIN, VALUES | {"gain.inductance.voltage": 0.0}, ()) == 0.0


def test_what_the_checks_found_is_ten_times_as_probable() -> None:
    assert surprise(RESISTOR, VALUES, (RESISTOR,)) - surprise(RESISTOR, VALUES, ()) == pytest.approx(-2 * math.log(10))


def test_one_channel_of_one_trace_is_25_times_less_probable_than_that_of_its_test() -> None:
    test, trace = effect("channel_gain[static_load.current]"), effect("channel_gain[static_load/ramp_1.csv.current]")
    values = {"gain.static_load.current": 0.05, "gain.static_load/ramp_1.csv.current": 0.05}
    assert surprise(trace, values, ()) - surprise(test, values, ()) == pytest.approx(2.0 * math.log(25.0))


def test_an_effect_of_the_throttle_pays_nothing_of_any_size() -> None:
    limp = EFFECT_BY_NAME["limp_home_spring"]
    assert surprise(limp, dict.fromkeys(limp.off or {}, 99.0), ()) == 0.0


def test_a_mistake_far_less_usual_is_no_tie_however_alike_the_fits() -> None:
    best = replace(diagnoses.verdict(RESISTOR, -1000.0), prior=0.0)
    for prior, tied in ((4.0, True), (20.0, False)):
        other = replace(diagnoses.verdict(GAIN, -1000.0 + prior), prior=prior)
        assert alike(other, best, DEFAULT) is tied


def test_the_prior_is_not_tempered() -> None:
    candidates = tuple(Candidate(name, 1.0, 1.0, True, bic_change=b, prior=q)
                       for name, b, q in (("a", -1000.0, 0.0), ("b", -988.0, 12.0)))  # fmt: skip
    turned = RoundReport((), Evidence((), True, (), ()), 1.0, 1.0, candidates, "a", (), "")
    of_round = [turned], ["a"], False, DEFAULT
    p = probabilities(questions(*of_round), *of_round)
    assert p["b"] / p["a"] == pytest.approx(math.exp(-6.0))
