"""Pictures in a notebook: Axes of figures that pyplot knows, units on them, made-up data called so."""

from __future__ import annotations

from collections.abc import Callable

import matplotlib.pyplot as plt
import pytest
from matplotlib.axes import Axes

from etcfit.api.explanation import Diagnosed
from etcfit.api.fit import Fit
from etcfit.errors import UsageError


def test_a_trace_has_a_panel_for_signal_and_residual_of_each_channel_and_the_drive(fitted: Fit) -> None:
    panels = fitted.plot.trace("response/1.csv")
    assert all(isinstance(panel, Axes) for panel in panels)
    assert [panel.get_ylabel() for panel in panels] == [
        "current [mA]", "whitened\nresidual [σ]", "TPS [V]", "whitened\nresidual [σ]", "voltage [V]",
    ]  # fmt: skip
    assert panels[-1].get_xlabel() == "time [s]"
    assert plt.gcf() is panels[0].figure
    assert any("SYNTHETIC" in text.get_text() for text in panels[0].figure.texts)


def test_the_overview_shows_every_trace_with_units(fitted: Fit) -> None:
    panels = fitted.plot.overview()
    assert len(panels) == len(fitted.traces)
    titles = " ".join(panel.get_title(loc="left") for panel in panels)
    for file in fitted.traces:
        assert file.removesuffix(".csv") in titles
    for panel in panels:
        assert panel.get_ylabel().endswith("]")
        assert panel.get_xlabel() in ("time [s]", "time [ms]")


def test_an_overview_of_very_many_traces_shows_the_worst(fitted: Fit) -> None:
    panels = fitted.plot.overview(most=2)
    assert len(panels) == 2
    assert "held out" in panels[0].get_title(loc="left")
    assert "worst 2 of 5" in panels[0].figure.get_suptitle()


def test_single_panels_are_axes(fitted: Fit, found: Diagnosed) -> None:
    assert fitted.plot.parameters().get_xlabel() == "distance from the fitted value [%]"
    assert isinstance(found.plot.ledger(), Axes)
    assert isinstance(found.plot.parameters(), Axes)


def test_pictures_of_a_diagnosis(found: Diagnosed) -> None:
    for file in found.final.traces:
        assert len(found.plot.trace(file)) >= 2
    for draw in (found.plot.missing_torque, found.plot.missing_voltage, found.plot.rounds, found.plot.unexplained):
        panels = draw()
        assert len(panels) > 0
        assert all(panel.has_data() for panel in panels)


@pytest.mark.parametrize(
    ("draw", "named"),
    [(lambda fit: fit.plot.trace("response/9.csv"), "response/2.csv"), (lambda fit: fit.plot.test("sine"), "back_emf")],
)
def test_a_picture_that_is_not_there_is_answered_with_those_that_are(
    fitted: Fit, draw: Callable[[Fit], object], named: str
) -> None:
    with pytest.raises(UsageError, match=named):
        draw(fitted)


def test_the_users_style_is_left_alone(fitted: Fit) -> None:
    before = dict(plt.rcParams)
    fitted.plot.parameters()
    assert dict(plt.rcParams) == before
