"""The picture of all parameters."""

from __future__ import annotations

import numpy as np
import pytest

from etcfit.estimation.intervals import Interval
from etcfit.reporting import pictures, style

KNOWN = {
    "R_a": Interval(2.0, 0.01, 1.98, 2.02, "estimated"),
    "B_L": Interval(1e-3, 1e-4, 8e-4, 1.2e-3, "estimated", "at its bound"),
    "J_m": Interval.bare(1e-6, "not identifiable"),
    "N": Interval.bare(20.68, "fixed"),
    "edge_phase.response": Interval(0.04, 0.01, 0.02, 0.06, "estimated"),  # a share: per cents of it mean nothing
}
UNITS = {"R_a": "ohm", "B_L": "N*m*s/rad", "J_m": "kg*m2", "N": "1", "edge_phase.response": ""}


ELSEWHERE = {"R_a": 1.8, "B_L": 5e-3, "J_m": 1e-4}


def drawn(**changes):
    given = {"readings": {"R_a": 2.1, "B_L": 0.0}, "table_2": ELSEWHERE} | changes
    return pictures.draw_parameters(
        pictures.ParameterPicture("bench", "Eqs. 1-2", KNOWN, UNITS, **given, synthetic=True)
    )


@pytest.fixture(scope="module")
def panel():
    return drawn().axes[0]


def marks(panel, colour: str) -> list[tuple[float, str]]:
    """Distance and marker of every point of a colour that was drawn, the legend's own aside."""
    lines = [line for line in panel.lines if line.get_linestyle() == "None" and line.get_color() == colour]
    return [(line.get_xdata()[0], line.get_marker()) for line in lines if len(line.get_xdata())]


def test_each_free_parameter_has_a_row(panel) -> None:
    assert [label.get_text() for label in panel.get_yticklabels()] == ["R_a", "B_L", "J_m"]
    assert panel.get_xlabel() == "distance from the fitted value [%]"


def test_interval_and_reading_stand_at_their_distance(panel) -> None:
    bars = [line for line in panel.lines if line.get_label() == "fit, 95 % interval"]
    assert list(bars[0].get_xdata()) == pytest.approx([-1.0, 1.0])
    # a reading of zero lies on the edge
    assert marks(panel, style.READING) == [(pytest.approx(5.0), "o"), (pytest.approx(-100.0), "<")]


def test_table_2_stands_beside_what_has_a_number_and_widens_no_axis(panel) -> None:
    assert marks(panel, style.MEASURED) == [(pytest.approx(-10.0), "s"), (pytest.approx(100.0), ">")]  # none for J_m
    assert panel.get_xlim() == (-100.0, 100.0)


def test_the_legend_calls_table_2_another_rigs_and_names_only_what_is_drawn() -> None:
    def words(**changes) -> list[str]:
        (legend,) = drawn(**changes).legends
        return [text.get_text() for text in legend.get_texts()]

    assert words() == ["fit, 95 % interval", "graph reading", "the paper's Table 2: another rig"]
    assert words(table_2={"J_m": 1e-4}, readings={}) == ["fit, 95 % interval"]


def test_a_compromise_is_a_range_and_called_so() -> None:
    known = {"R_a": Interval(2.0, None, 1.5, 3.0, "compromise")}
    picture = pictures.ParameterPicture("bench", "Eqs. 1-2", known, UNITS, {}, {}, synthetic=True)
    panel = pictures.draw_parameters(picture).axes[0]
    (bar,) = [line for line in panel.lines if str(line.get_label()).startswith("compromise")]
    assert np.asarray(bar.get_xdata()).tolist() == pytest.approx([-25.0, 50.0])
    assert [text.get_text() for text in panel.texts] == ["2.00 ohm, compromise"]


def test_the_words_beside_the_rows(panel) -> None:
    words = [text.get_text() for text in panel.texts]
    assert words == ["2.000 ± 0.010 ohm", "0.00100 ± 0.00010 N*m*s/rad, at its bound", "not identifiable"]
