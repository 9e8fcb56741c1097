"""What the rig's checks found is tried first, from the value that they state: before data are set aside."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

import results
from etcfit.diagnosis import Diagnosis, diagnose
from etcfit.diagnosis.composition import stated_effects
from etcfit.diagnosis.course import covers, reconciled
from etcfit.estimation.agreement import Compromise, in_words
from etcfit.estimation.contradiction import Contradiction
from etcfit.estimation.intervals import intervals
from etcfit.estimation.joint_fit import fit
from etcfit.estimation.result import FitResult
from etcfit.model.rig_effects import RIG_EFFECTS, at_places
from etcfit.rig.base import Finding, Rig
from etcfit.rig.checks import DETECTORS
from etcfit.rig.reader import read_folder
from independent import CONSISTENT, Truth, draw_truth, make_folder
from independent.instruments import Bench
from independent.mistakes import edited

SYMBOLS = ("R_a", "L_a", "K_b", "J_m", "J_L", "B_m", "B_L", "K_s", "T_PL", "T_f")
LOGGED = {
    "inductance": frozenset({"voltage", "current"}),
    "static_load": frozenset({"voltage", "current", "position"}),
    "inertia": frozenset({"emf", "position"}),
    "viscous": frozenset({"voltage", "current", "motor_speed"}),
}
CANDIDATES = at_places(LOGGED, {})


def finding(kind: str, size: float, test: str | None = None, channel: str | None = None) -> Finding:
    return Finding(kind, size, "", 0.0, "found", "mend", test, channel=channel)


# ---- which effect a finding states


@pytest.mark.parametrize(
    ("found", "effect", "value"),
    [
        (finding("gear_ratio", 2.0), "gear_ratio", 1.0),
        (finding("series_resistance", 1.22, "inductance"), "series_resistance[inductance]", 1.22),
        (finding("time_scale", 1.04, "inertia", "time"), "time_scale[inertia]", 1.0 / 1.04 - 1.0),
        (finding("unit_scale", 2.0, "viscous", "motor_speed"), None, None),  # no other test logged a motor's speed
        (finding("unit_scale", 1e-3, "static_load", "current"), "channel_gain[static_load.current]", -0.999),
        (finding("channel_offset", 40.0, "viscous", "current"), "channel_offset[viscous.current]", 0.0),
        (finding("hum", 0.01, "viscous", "current"), None, None),
    ],
)
def test_a_finding_states_an_effect_and_where_to_begin(found: Finding, effect: str | None, value: float | None) -> None:
    told = {e.name: v for e, v in stated_effects([found], CANDIDATES).items()}
    assert told == ({} if effect is None else {effect: pytest.approx(value)})


def test_every_kind_that_an_effect_is_stated_by_is_the_kind_of_a_check() -> None:
    kinds = {detector.kind for detector in DETECTORS}
    stated = {kind for family in RIG_EFFECTS for kind in family.stated}
    assert stated
    assert stated <= kinds


# ---- whole folders: each was called another rig, with P 0.90, when nothing was tried before that


@dataclass(frozen=True)
class Case:
    truth: Truth
    found: Diagnosis


def case(folder: Path, seed: int, spoil: Callable[[Path], None], bench: Bench = Bench()) -> Case:  # noqa: B008
    truth = draw_truth(np.random.default_rng(seed), CONSISTENT)
    make_folder(folder, truth, seed, size="small", bench=bench)
    spoil(folder)
    return Case(truth, diagnose(fit(read_folder(folder))))


def halved_gear_ratio(folder: Path) -> None:
    _rewritten(folder, lambda text: re.sub(r"gear_ratio = (\S+)", lambda m: f"gear_ratio = {0.5 * float(m[1])}", text))


def gear_ratio_upside_down(folder: Path) -> None:
    _rewritten(folder, lambda text: re.sub(r"gear_ratio = (\S+)", lambda m: f"gear_ratio = {1.0 / float(m[1])}", text))


def undeclared_resistor(folder: Path) -> None:
    _rewritten(folder, lambda text: text.replace('[tests.inductance]\nseries_ohm = "free"\n', ""))


def probe_5_per_cent_high(folder: Path) -> None:
    edited(folder, "static_load", lambda sheet: sheet.scaled("current", 1.05))


def _rewritten(folder: Path, change: Callable[[str], str]) -> None:
    toml = folder / "rig.toml"
    text = toml.read_text(encoding="utf-8")
    assert change(text) != text
    toml.write_text(change(text), encoding="utf-8")


FOLDERS = {
    "half the gear ratio": (7801, halved_gear_ratio, Bench(), "gear_ratio", 1.0),
    "gear ratio upside down": (7801, gear_ratio_upside_down, Bench(), "gear_ratio", 20.68**2 - 1.0),
    "resistor": (7803, undeclared_resistor, replace(Bench(), series_ohm=1.22), "series_resistance[inductance]", 1.22),
    "probe": (7805, probe_5_per_cent_high, Bench(), "channel_gain[static_load.current]", 0.05),
}


@pytest.mark.slow
@pytest.mark.parametrize("which", FOLDERS)
def test_one_mistake_that_explains_all_data_is_named_and_nothing_is_set_aside(which: str, tmp_path: Path) -> None:
    seed, spoil, bench, name, size = FOLDERS[which]
    made = case(tmp_path / "folder", seed, spoil, bench)
    assert made.found.before.chi2_per_dof > 2.0
    assert made.found.added == (name,)
    assert made.found.rig[0].size == pytest.approx(size, rel=0.05)
    assert made.found.probabilities[name] > 0.8
    assert made.found.after.chi2_per_dof < 1.2
    said = intervals(made.found.after)
    errors = {s: (said[s].value - getattr(made.truth, s)) / e for s in SYMBOLS if (e := said[s].stderr)}
    assert len(errors) > 8
    assert all(abs(z) < 4.0 for z in errors.values()), errors


# ---- Contradictions that the widened intervals of a final model hold are none

TEST = "static_load"


def contradicted(rig: Rig, moved: float) -> FitResult:
    """A fit whose every coordinate, known to 0.02, moves by so much where a test is left out."""
    found = results.result(rig)
    size, covariance = found.x.size, 0.02**2 * np.eye(found.x.size)
    subsets = Compromise(
        f"{TEST} contradicts the other tests",
        ("resistance", TEST),
        np.stack([found.x, found.x + moved]),
        np.stack([covariance, covariance]),
        np.full((2, size), np.nan),
    )
    each = Contradiction(TEST, "K_s", -3.5, found.values["K_s"], 1.01 * found.values["K_s"], 1e-7, 1.0)
    words = in_words(each, "N*m/rad")
    return replace(found, compromise=subsets, contradictions=(each,), warnings=("A word.", words))


@pytest.mark.parametrize(("moved", "held"), [(0.05, True), (-0.05, True), (0.06, False), (np.nan, False)])
def test_intervals_hold_what_lies_within_both_errors(moved: float, held: bool) -> None:
    """1.96 sqrt(2) 0.02 = 0.0554."""
    sd = np.array([0.02, 0.02])
    assert covers(np.array([0.0, moved]), sd, sd) is held


def test_parameters_whose_intervals_hold_what_a_test_pulls_are_estimates(rig: Rig) -> None:
    found = contradicted(rig, 0.05)
    assert intervals(found)["K_s"].status == "compromise"
    after = reconciled(found)
    assert (after.compromise, after.contradictions) == (None, ())
    assert intervals(after)["K_s"].status == "estimated"
    assert after.warnings[0] == "A word."
    (said,) = after.warnings[1:]
    assert said.startswith(f"Without {TEST} K_s would move by 3.5 standard errors of noise alone")


def test_a_contradiction_beyond_the_intervals_stays(rig: Rig) -> None:
    found = contradicted(rig, 0.06)
    assert reconciled(found) is found


def test_a_model_far_from_its_data_stays_a_compromise(rig: Rig) -> None:
    found = replace(contradicted(rig, 0.0), chi2_per_dof=2.5)
    assert reconciled(found) is found
