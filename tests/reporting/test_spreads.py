"""How sure each way of asking is, in one picture."""

from __future__ import annotations

import numpy as np

from etcfit.reporting.posterior.pictures import Spread, draw_spreads


def spread(symbol: str, stderr: float | None) -> Spread:
    return Spread(symbol, "ohm", 1.6, stderr, 1.61, 0.02, 1.57, 1.65, None, None, None, False)


def test_a_parameter_of_a_compromise_has_a_row_by_its_posterior_alone() -> None:
    (panel,) = draw_spreads("rig", [spread("R_a", None), spread("K_b", None)], True).axes
    assert [label.get_text() for label in panel.get_yticklabels()] == ["R_a", "K_b"]
    labels = {str(line.get_label()) for line in panel.lines}
    assert {label for label in labels if not label.startswith("_")} == {"posterior, 95 %"}
    assert "standard deviations" in panel.get_xlabel()


def test_a_standard_error_is_the_unit_where_each_has_one() -> None:
    (panel,) = draw_spreads("rig", [spread("R_a", 0.01)], True).axes
    (bar,) = (line for line in panel.lines if line.get_label() == "Laplace, 95 %")
    assert np.asarray(bar.get_xdata()).round(2).tolist() == [-1.96, 1.96]
    assert "standard errors of the fit" in panel.get_xlabel()
