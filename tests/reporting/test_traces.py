"""Pictures of a trace and of a rig test: panels, units, what is said, the model read as the paper reads."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from etcfit.estimation.joint_fit import FitResult
from etcfit.reporting import traces
from etcfit.reporting.pictures import all_traces
from etcfit.rig import TEST_BY_NAME
from etcfit.rig.paper_readings import known


def picture(result: FitResult, file: str) -> traces.TracePicture:
    trace = next(t for t in all_traces(result) if t.measurement.file == file)
    every = (*result.score_fit, *result.score_holdout)
    residual = np.random.default_rng(0).standard_normal(trace.data.shape)
    rows = tuple(row for row in every if row.file == file)
    return traces.TracePicture(trace, result.predicted[file], residual, "error [σ]", rows, True)


def test_panels_have_the_logged_units(fit: FitResult) -> None:
    fig = traces.draw_trace(picture(fit, "response/2.csv"))
    labels = [panel.get_ylabel() for panel in fig.axes]
    assert labels == ["current [mA]", "error [σ]", "TPS [V]", "error [σ]", "voltage [V]"]
    assert fig.axes[-1].get_xlabel() == "time [s]"
    said = [text.get_text() for text in (*fig.texts, fig.axes[0].title)]
    assert any("SYNTHETIC" in text for text in said)
    assert "response/2.csv  ·  held out" in fig.get_suptitle()
    assert any("rms error: current" in text and "mA" in text for text in said)


def test_a_position_is_shown_in_sensor_volts(fit: FitResult) -> None:
    shown = traces.draw_trace(picture(fit, "response/1.csv")).axes[2].lines[0].get_ydata()
    volts = [float(row.split(",")[3]) for row in _csv(fit, "response/1.csv")]
    np.testing.assert_allclose(np.asarray(shown), volts, atol=1e-9)


def test_open_terminals_have_no_drive(fit: FitResult) -> None:
    fig = traces.draw_trace(picture(fit, "back_emf/1.csv"))
    assert [panel.get_ylabel() for panel in fig.axes] == ["emf [V]", "error [σ]", "position [deg]", "error [σ]"]


def test_a_few_wild_residuals_are_counted_not_shown_to_scale(fit: FitResult) -> None:
    plain = picture(fit, "response/1.csv")
    wild = plain.residual.copy()
    wild[30, 0] = 500.0
    panel = traces.draw_trace(replace(plain, residual=wild)).axes[1]
    assert panel.get_ylim()[1] < 100.0
    assert [text.get_text() for text in panel.texts] == ["1 beyond, to 500 σ"]


def test_a_sensor_that_falls_as_the_plate_opens_turns_its_residual(fit: FitResult) -> None:
    plain = picture(fit, "response/1.csv")
    channels = dict(plain.trace.measurement.channels)
    channels["position"] = replace(channels["position"], scale=-channels["position"].scale)
    trace = replace(plain.trace, measurement=replace(plain.trace.measurement, channels=channels))
    up, down = (traces.draw_trace(p).axes[3].lines[0].get_ydata() for p in (plain, replace(plain, trace=trace)))
    np.testing.assert_allclose(np.asarray(up), -np.asarray(down))


def _csv(result: FitResult, file: str) -> list[str]:
    from pathlib import Path

    return (Path(result.rig.folder) / file).read_text().splitlines()[1:]


def picture_of_test(result: FitResult, name: str, graphs_: tuple, model: tuple = ()) -> traces.TestPicture:
    every = tuple(t for t in all_traces(result) if t.test.name == name)
    return traces.TestPicture(TEST_BY_NAME[name], graphs_, model, every, result.predicted, ("R_a: reading 1",), True)


def test_the_models_line_has_the_models_slope(fit: FitResult) -> None:
    """Currents of a winding of twice the resistance, put through the resistance test's reading."""
    test, config = TEST_BY_NAME["resistance"], fit.rig.config
    measured = [t for t in all_traces(fit) if t.test.name == "resistance"]
    predicted = {t.measurement.file: t.input.value[:, None] / 3.0 for t in measured if t.input is not None}
    (graph,) = traces.read_model(test, measured, predicted, config, known(config, fit.readings.values))
    slope = np.ptp(graph.line_y) / np.ptp(graph.line_x)
    assert slope == pytest.approx(1.0 / 3.0, rel=1e-3)


def test_a_model_that_cannot_be_simulated_has_no_line(fit: FitResult) -> None:
    test, config = TEST_BY_NAME["resistance"], fit.rig.config
    measured = [t for t in all_traces(fit) if t.test.name == "resistance"]
    predicted = {t.measurement.file: np.full_like(t.data, np.nan) for t in measured}
    assert traces.read_model(test, measured, predicted, config, {}) == ()


def test_points_reading_and_model_are_told_apart(fit: FitResult) -> None:
    read = fit.readings.graphs["resistance"]
    fig = traces.draw_test(picture_of_test(fit, "resistance", read, read))
    labels = [text.get_text() for text in fig.legends[0].get_texts()]
    assert labels == ["measured", "graph reading", "fitted model, read the same way"]
    assert fig.axes[0].get_xlabel() == "voltage [V]"
    assert fig.axes[0].get_ylabel() == "steady current [A]"
    assert any("SYNTHETIC" in text.get_text() for text in fig.texts)


def test_graphs_of_one_title_are_paired_in_order(fit: FitResult) -> None:
    (graph,) = fit.readings.graphs["resistance"]
    fig = traces.draw_test(picture_of_test(fit, "resistance", (graph, graph), (graph, graph)))
    assert [len(panel.lines) for panel in fig.axes] == [3, 3]


def test_a_test_without_graphs_shows_its_traces(fit: FitResult) -> None:
    fig = traces.draw_test(picture_of_test(fit, "response", ()))
    assert [panel.get_ylabel() for panel in fig.axes if panel.axison] == ["TPS [V]", "TPS [V]"]
    assert [panel.get_title(loc="left") for panel in fig.axes if panel.axison] == ["1.csv", "2.csv, held out"]
