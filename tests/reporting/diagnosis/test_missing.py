"""Missing torque over what it depends on."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

import diagnoses
from etcfit.diagnosis.findings import Diagnosis, Motion, Share
from etcfit.reporting.diagnosis import missing
from etcfit.reporting.diagnosis.missing import Bins, MissingPicture, Samples, curve_rms, ways


def torque(d: Diagnosis) -> MissingPicture:
    picture = MissingPicture.of_diagnosis(d, "torque")
    assert picture is not None
    return picture


def rubbing(motion: Motion) -> Motion:
    """The same motion, but what is missing is dry friction."""
    friction = np.where(np.isnan(motion.torque), np.nan, -0.1 * np.sign(motion.axes["speed"]))
    return replace(
        motion, torque=friction + motion.after["torque"], effects={"stribeck_friction": {"torque": friction}}
    )


def with_shares(d: Diagnosis, *shares: Share) -> Diagnosis:
    evidence = replace(d.rounds[0].evidence, shares=shares)
    return replace(d, rounds=(replace(d.rounds[0], evidence=evidence), *d.rounds[1:]))


def test_only_what_moves_is_counted(found: Diagnosis) -> None:
    samples = Samples.of_motions(found.motions, "torque")
    known = sum(int(np.isfinite(m.torque).sum()) for m in found.motions)
    assert samples.before.size == samples.axes["angle"].size == samples.effects[diagnoses.FOUND].size == known
    assert known < sum(m.torque.size for m in found.motions)


def test_an_effect_that_contributes_nothing_is_left_out(found: Diagnosis) -> None:
    assert set(Samples.of_motions(found.motions, "torque").effects) == {diagnoses.FOUND}
    assert Samples.of_motions(found.motions, "voltage").effects == {}


def test_the_median_of_a_bin() -> None:
    axis = np.repeat(np.arange(40.0) + 0.5, 50)
    bins = Bins.along(axis)
    every = np.ones(axis.size, dtype=bool)
    np.testing.assert_allclose(bins.quartiles(3.0 * axis, every)[1][1:-1], 3.0 * (np.arange(1, 39) + 0.5), atol=3.1)
    assert curve_rms(bins, np.full(axis.size, -2.0), (every,)) == pytest.approx(2.0)
    assert np.isnan(bins.quartiles(axis, axis < 0.0)).all()


def test_directions_are_told_apart_where_they_differ(found: Diagnosis) -> None:
    assert len(ways(Samples.of_motions(found.motions, "torque"), "angle")) == 1
    rubs = Samples.of_motions([rubbing(m) for m in found.motions], "torque")
    opening, closing = ways(rubs, "angle")
    assert not (opening & closing).any()
    assert rubs.before[opening].mean() < -0.05 < 0.05 < rubs.before[closing].mean()
    assert len(ways(rubs, "speed")) == 1


def test_the_most_telling_axes_two_at_least_three_at_most(found: Diagnosis) -> None:
    assert torque(found).telling == ("angle", "load", "speed")
    one = with_shares(found, Share("torque", "load", 0.4), Share("voltage", "current", 0.9))
    assert torque(one).telling == ("load", "angle")
    assert torque(with_shares(found)).telling == ("angle", "speed")


def test_the_title_is_the_finding(found: Diagnosis) -> None:
    assert missing.finding(torque(found)) == "The missing torque depends on the angle: limp_home_spring takes it away"
    useless = replace(found, motions=tuple(replace(m, after={**m.after, "torque": m.torque}) for m in found.motions))
    assert missing.finding(torque(useless)).endswith("limp_home_spring takes nothing of it away")
    assert missing.finding(torque(replace(found, added=()))).endswith("no effect of the catalogue takes it away")
    assert "follows nothing" in missing.finding(torque(with_shares(found, Share("torque", "angle", 0.01))))
    assert "what is left is noise" in missing.finding(torque(diagnoses.explained(found.before.rig)))


def test_panels_have_units_and_one_scale(found: Diagnosis) -> None:
    fig = missing.draw(torque(found))
    above, below = fig.axes[:3], fig.axes[3:]
    assert [p.get_xlabel() for p in below] == [
        "plate angle [deg]", "torque through the gear [N m]", "plate speed [rad/s]"
    ]  # fmt: skip
    assert above[0].get_ylabel() == "missing torque, BEFORE [N m]"
    assert below[0].get_ylabel() == "missing torque, AFTER [N m]"
    assert len({p.get_ylim() for p in fig.axes}) == 1
    assert 80.0 < above[0].get_xlim()[1] < 95.0
    assert diagnoses.FOUND in [line.get_label() for line in above[0].lines]
    assert diagnoses.FOUND not in [line.get_label() for line in below[0].lines]
    assert any("SYNTHETIC" in text.get_text() for text in fig.texts)
    figures = [text.get_text() for panel in fig.axes for text in panel.texts]
    assert figures
    assert all(re.fullmatch(r"median curve: \S+ m?N m rms", each) for each in figures)


def test_the_effects_line_is_the_effect(found: Diagnosis) -> None:
    line = next(line for line in missing.draw(torque(found)).axes[0].lines if line.get_label() == diagnoses.FOUND)
    x, y = np.asarray(line.get_xdata()), np.asarray(line.get_ydata())
    assert y[x < 7.0] == pytest.approx(0.28, abs=0.04)
    assert y[x > 14.0] == pytest.approx(0.0, abs=1e-3)


def test_points_are_thinned(found: Diagnosis) -> None:
    panel = missing.draw(torque(found)).axes[0]
    assert 500 < sum(np.asarray(line.get_xdata()).size for line in panel.lines if line.get_marker() == ".") <= 4000


def test_without_a_position_there_is_no_picture(found: Diagnosis) -> None:
    nothing = tuple(replace(m, torque=np.full_like(m.torque, np.nan)) for m in found.motions)
    assert MissingPicture.of_diagnosis(replace(found, motions=nothing), "torque") is None
    assert MissingPicture.of_diagnosis(replace(found, motions=()), "torque") is None


def test_a_large_torque_that_is_only_negative_is_not_shown_in_thousandths(found: Diagnosis) -> None:
    pulling = tuple(replace(m, torque=-5.0 - np.abs(m.torque), effects={}) for m in found.motions)
    panel = missing.draw(torque(replace(found, motions=pulling))).axes[0]
    assert panel.get_ylabel().endswith("[N m]")
    assert panel.get_ylim()[0] < -5.0
