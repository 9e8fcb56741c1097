"""The picture of all parameters."""

from __future__ import annotations

import pytest

from etcfit.intervals import Interval
from etcfit.report import overview

KNOWN = {
    "R_a": Interval(2.0, 0.01, 1.98, 2.02, "estimated"),
    "B_L": Interval(1e-3, 1e-4, 8e-4, 1.2e-3, "estimated", "at its bound"),
    "J_m": Interval.bare(1e-6, "not identifiable"),
    "N": Interval.bare(20.68, "fixed"),
}
UNITS = {"R_a": "ohm", "B_L": "N*m*s/rad", "J_m": "kg*m2", "N": "1"}


@pytest.fixture(scope="module")
def panel():
    picture = overview.ParameterPicture("bench", "Eqs. 1-2", KNOWN, UNITS, {"R_a": 2.1, "B_L": 0.0}, True)
    return overview.draw(picture).axes[0]


def test_each_free_parameter_has_a_row(panel) -> None:
    assert [label.get_text() for label in panel.get_yticklabels()] == ["R_a", "B_L", "J_m"]
    assert panel.get_xlabel() == "distance from the fitted value [%]"


def test_interval_and_reading_stand_at_their_distance(panel) -> None:
    bars = [line for line in panel.lines if line.get_label() == "fit, 95 % interval"]
    dots = [line for line in panel.lines if line.get_label() == "graph reading"]
    assert list(bars[0].get_xdata()) == pytest.approx([-1.0, 1.0])
    assert list(dots[0].get_xdata()) == pytest.approx([5.0])
    assert [dot.get_marker() for dot in dots] == ["o", "<"]  # a reading of zero lies on the edge


def test_the_words_beside_the_rows(panel) -> None:
    words = [text.get_text() for text in panel.texts]
    assert words == ["2.000 ± 0.010 ohm", "0.00100 ± 0.00010 N*m*s/rad, at its bound", "not identifiable"]
