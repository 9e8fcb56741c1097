"""A rig test's picture: the paper's graph, and the fitted model read the same way."""

from __future__ import annotations

import numpy as np
import pytest

import results
from etcfit.estimation.joint_fit import FitResult
from etcfit.reporting import traces
from etcfit.reporting.pictures import all_traces
from etcfit.rig import TEST_BY_NAME
from etcfit.rig.paper_readings import known


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> FitResult:
    return results.result(results.rig(tmp_path_factory.mktemp("rig")))


def picture(result: FitResult, name: str, graphs_: tuple, model: tuple = ()) -> traces.TestPicture:
    every = tuple(t for t in all_traces(result) if t.test.name == name)
    return traces.TestPicture(TEST_BY_NAME[name], graphs_, model, every, result.predicted, ("R_a: reading 1",), True)


def test_the_models_line_has_the_models_slope(fitted: FitResult) -> None:
    """Currents of a winding of twice the resistance, put through the resistance test's reading."""
    test, config = TEST_BY_NAME["resistance"], fitted.rig.config
    measured = [t for t in all_traces(fitted) if t.test.name == "resistance"]
    predicted = {t.measurement.file: t.input.value[:, None] / 3.0 for t in measured if t.input is not None}
    (graph,) = traces.read_model(test, measured, predicted, config, known(config, fitted.readings.values))
    slope = np.ptp(graph.line_y) / np.ptp(graph.line_x)
    assert slope == pytest.approx(1.0 / 3.0, rel=1e-3)


def test_a_model_that_cannot_be_simulated_has_no_line(fitted: FitResult) -> None:
    test, config = TEST_BY_NAME["resistance"], fitted.rig.config
    measured = [t for t in all_traces(fitted) if t.test.name == "resistance"]
    predicted = {t.measurement.file: np.full_like(t.data, np.nan) for t in measured}
    assert traces.read_model(test, measured, predicted, config, {}) == ()


def test_points_reading_and_model_are_told_apart(fitted: FitResult) -> None:
    read = fitted.readings.graphs["resistance"]
    fig = traces.draw_test(picture(fitted, "resistance", read, read))
    labels = [text.get_text() for text in fig.legends[0].get_texts()]
    assert labels == ["measured", "graph reading", "fitted model, read the same way"]
    assert fig.axes[0].get_xlabel() == "voltage [V]"
    assert fig.axes[0].get_ylabel() == "steady current [A]"
    assert any("SYNTHETIC" in text.get_text() for text in fig.texts)


def test_graphs_of_one_title_are_paired_in_order(fitted: FitResult) -> None:
    (graph,) = fitted.readings.graphs["resistance"]
    fig = traces.draw_test(picture(fitted, "resistance", (graph, graph), (graph, graph)))
    assert [len(panel.lines) for panel in fig.axes] == [3, 3]


def test_a_test_without_graphs_shows_its_traces(fitted: FitResult) -> None:
    fig = traces.draw_test(picture(fitted, "response", ()))
    assert [panel.get_ylabel() for panel in fig.axes if panel.axison] == ["TPS [V]", "TPS [V]"]
    assert [panel.get_title(loc="left") for panel in fig.axes if panel.axison] == ["1.csv", "2.csv, held out"]
