"""A run folder after a diagnosis, and what its pictures show."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from etcfit.api.progress import silent
from etcfit.api.work import keep_diagnosis, keep_fit
from etcfit.diagnosis.findings import Diagnosis, SetAside
from etcfit.estimation.result import FitResult
from etcfit.reporting import draw_others
from etcfit.reporting.diagnosis import pictures
from etcfit.reporting.diagnosis.ledger import headline, ledger
from etcfit.reporting.drawing import Job
from etcfit.reporting.pictures import all_traces
from etcfit.reporting.pictures import jobs as jobs_of_model
from etcfit.run_folder.folder import RunFolder


@pytest.fixture(scope="module")
def run(found: Diagnosis, tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = tmp_path_factory.mktemp("run") / "new"
    said: list[float] = []
    keep_diagnosis(RunFolder(run), found)
    assert {p.name for p in run.rglob("*.png")} == {"ledger.png", "parameters.png"}
    draw_others(RunFolder(run), lambda text, share: said.append(share))
    assert 2 + len(said) == len(list(run.rglob("*.png")))
    return run


def names(d: Diagnosis) -> list[str]:
    return [path.as_posix() for path, _ in pictures.jobs(d)]


def test_every_file_is_there(run: Path, found: Diagnosis) -> None:
    drawn = {p.relative_to(run).as_posix() for p in run.rglob("*") if p.is_file()}
    stories = ("ledger", "missing_torque", "missing_voltage", "unexplained", "rounds",
               "traces/response__2", "traces/response__1")  # fmt: skip
    assert drawn == {
        "run.json", "fit.json", "fit_state.npz", "diagnosis.json", "diagnosis_state.npz",
        *(f"pictures/diagnosis/{story}.png" for story in stories),
        *(f"pictures/{path.as_posix()}" for path, _ in jobs_of_model(found.after)),
        *(f"pictures/before/{path.as_posix()}" for path, _ in jobs_of_model(found.before)),
    }  # fmt: skip


def drawn_below(run: Path) -> dict[str, bytes]:
    base = run / "pictures"
    return {p.relative_to(base).as_posix(): p.read_bytes() for p in base.rglob("*.png")}


def some_jobs_of_model(result: FitResult) -> list[Job]:
    return [job for job in jobs_of_model(result) if job[0].stem in ("parameters", "resistance", "response__2")]


def test_pictures_of_the_first_fit_give_way_to_the_final_model_and_come_back(
    found: Diagnosis, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One of each folder."""
    monkeypatch.setattr("etcfit.reporting.pictures.jobs", some_jobs_of_model)
    few = replace(found, motions=(), unexplained=None)
    of_model = {path.as_posix() for path, _ in some_jobs_of_model(found.after)}
    assert len(of_model) == 3
    keep_fit(RunFolder(tmp_path), found.before)
    draw_others(RunFolder(tmp_path), silent)
    first = drawn_below(tmp_path)
    assert set(first) == of_model
    for _ in range(2):  # a second diagnosis must not take the final model's for the first fit's
        keep_diagnosis(RunFolder(tmp_path), few)
        draw_others(RunFolder(tmp_path), silent)
        seen = drawn_below(tmp_path)
        assert {name: seen[f"before/{name}"] for name in first} == first
        assert {name for name in of_model if seen[name] != first[name]} == of_model
    keep_diagnosis(RunFolder(tmp_path), replace(few, after=few.before, added=(), final=few.start))
    seen = drawn_below(tmp_path)
    assert {name: seen[name] for name in first} == first
    assert not (tmp_path / "pictures" / "before").exists()


def test_pictures_show_something(run: Path) -> None:
    pictures = [*run.rglob("*.png")]
    assert pictures
    for path in pictures:
        pixels = imread(path)
        assert pixels[..., :3].std() > 0.02, path
        assert min(pixels.shape[:2]) > 300, path


def test_what_is_not_there_is_not_drawn(found: Diagnosis) -> None:
    dark = replace(found, unexplained=None, motions=(), added=(), rounds=found.rounds[1:])
    dark = replace(dark, rounds=(replace(dark.rounds[0], candidates=()),))
    assert names(dark) == ["ledger.png", "traces/response__2.png", "traces/response__1.png"]


def test_without_held_out_traces(found: Diagnosis) -> None:
    alone = [replace(result, holdout=None, score_holdout=()) for result in (found.before, found.after)]
    assert found.unexplained is not None
    turns = tuple(replace(each, holdout_rms=None) for each in found.rounds)
    left = replace(found.unexplained, holdout=())
    d = replace(found, before=alone[0], after=alone[1], rounds=turns, unexplained=left)
    assert not [name for name in names(d) if "response__2" in name]
    steps = pictures.steps(d)
    assert [step.holdout for step in steps] == [None, None, None]
    for _, draw in pickle.loads(pickle.dumps(pictures.jobs(d))):  # as a process beside this one is handed them
        draw()


def test_the_chart_shows_each_entry_before_and_after(found: Diagnosis) -> None:
    entries = ledger(found)
    (panel,) = pictures.draw_ledger(entries, headline(found), True).axes
    before = [float(np.asarray(line.get_xdata())[0]) for line in panel.lines if line.get_label() == "before"]
    after = [float(np.asarray(line.get_xdata())[0]) for line in panel.lines if line.get_label() == "after"]
    assert before == pytest.approx([e.before.ratio for e in entries])
    assert after == pytest.approx([e.after.ratio for e in entries])
    assert panel.get_xscale() == "log"
    assert panel.get_xlabel() == "free-running error [σ of one sample]"
    said = [text.get_text() for text in panel.texts]
    assert any(text.startswith(entries[0].change()) for text in said)
    rows = [tick.get_text() for tick in panel.get_yticklabels()]
    assert rows.index("HELD OUT, never fitted") == 0 < rows.index("FITTED") < len(rows) - 1


def test_the_error_falls_by_the_trials_ratio_and_ends_at_the_final_fit(found: Diagnosis) -> None:
    start, added, end = pictures.steps(found)
    assert added.label == "+ limp_home_spring"
    assert added.fit == pytest.approx(0.06 * start.fit)
    assert start.holdout is not None
    assert added.holdout == pytest.approx(0.05 * start.holdout)
    assert dict(added.others) == pytest.approx({"airflow_torque": 0.47 * start.holdout,
                                                "stribeck_friction": 0.93 * start.holdout})  # fmt: skip
    n = sum(row.n for row in found.after.score_fit)
    assert end.fit == pytest.approx(np.sqrt(sum(r.n * (r.rms / r.sigma) ** 2 for r in found.after.score_fit) / n))
    (panel,) = pictures.draw_rounds([start, added, end], found.added, True).axes
    assert [tick.get_text() for tick in panel.get_xticklabels()] == ["start", added.label, "nothing more:\nfinal fit"]


def test_the_unexplained_curve_and_its_band_in_degrees(found: Diagnosis) -> None:
    left = found.unexplained
    assert left is not None
    fig = pictures.draw_unexplained(left, (0.1, 1.1), True)
    (panel,) = fig.axes
    line = panel.lines[-1]
    np.testing.assert_allclose(np.asarray(line.get_xdata()), np.degrees(0.1 + left.axis))
    np.testing.assert_allclose(np.asarray(line.get_ydata()), 1e3 * left.curve)
    assert panel.get_xlabel() == "plate angle [deg]"
    assert panel.get_ylabel() == "unexplained torque [mN m]"
    speed = pictures.draw_unexplained(replace(left, depends_on="speed", axis_unit="rad/s"), (0.0, np.inf), False).axes[
        0
    ]
    assert speed.get_xlabel() == "plate speed [rad/s]"


def test_an_angle_without_stops_is_still_legible(found: Diagnosis) -> None:
    assert found.unexplained is not None
    panel = pictures.draw_unexplained(found.unexplained, (-np.inf, np.inf), False).axes[0]
    assert panel.get_xlim() == pytest.approx((-180.0, 180.0))


def test_an_overlay_shows_both_models_in_degrees(found: Diagnosis) -> None:
    trace = next(t for t in all_traces(found.before) if t.measurement.file == "response/2.csv")
    before, after = (result.predicted["response/2.csv"] for result in (found.before, found.after))
    fig = pictures.draw_overlay(pictures.Overlay(trace, before, after, (), (), True))
    labels = [panel.get_ylabel() for panel in fig.axes]
    assert labels == ["position [deg]", "error [deg]", "current [mA]", "error [mA]", "voltage [V]"]
    assert trace.input is not None
    np.testing.assert_allclose(np.asarray(fig.axes[4].lines[-1].get_ydata()), trace.input.value)
    lines = {line.get_label(): np.asarray(line.get_ydata()) for line in fig.axes[0].lines}
    m = trace.channels.index("position")
    for name, values in (("measured", trace.data), ("before", before), ("after", after)):
        np.testing.assert_allclose(lines[name], np.degrees(values[:, m]))


@pytest.fixture(scope="module")
def mixed(found: Diagnosis) -> Diagnosis:
    """A fitted trace of another rig: the others' body is 0.1 rad off, its own is not."""
    trace = next(t for t in all_traces(found.before) if t.measurement.file == "response/1.csv")
    aside = SetAside(trace, trace.data + 0.1, trace.data)
    rest = replace(found.after, score_fit=tuple(row for row in found.after.score_fit if row.file != "response/1.csv"))
    return replace(found, after=rest, aside=(aside,))


def test_a_trace_of_another_rig_is_drawn_under_both_bodies(mixed: Diagnosis) -> None:
    assert names(mixed).index("traces/response__1.png") < names(mixed).index("traces/response__2.png")
    picture = pictures.Overlay.of_trace(mixed, mixed.aside[0].trace)
    fig = pictures.draw_overlay(picture)
    assert "response/1.csv, of another rig" in fig.get_suptitle().replace("\n", " ")
    lines = {line.get_label(): np.asarray(line.get_ydata()) for line in fig.axes[0].lines}
    own = lines["another throttle body"]
    np.testing.assert_allclose(lines["throttle body of the other traces"] - own, np.degrees(0.1))
    (position,) = (row for row in picture.rows_before if row.channel == "position")
    assert (position.rms, position.unit) == (pytest.approx(np.degrees(0.1)), "deg")


def test_the_ledger_and_the_rounds_are_of_the_other_traces(mixed: Diagnosis) -> None:
    of_before = [row for row in mixed.before.score_fit if row.file != "response/1.csv"]
    assert sum(entry.before.traces for entry in ledger(mixed) if not entry.held_out) == len(of_before)
    labels = [step.label for step in pictures.steps(mixed)]
    assert labels[:2] == ["start", "without\nresponse/1.csv"]


def test_a_long_trace_is_shown_where_the_first_model_is_worst(found: Diagnosis) -> None:
    trace = next(t for t in all_traces(found.before) if t.measurement.file == "response/2.csv")
    n = 1000
    t = np.linspace(0.0, 10.0, n)
    data = np.zeros((n, 2))
    before = np.where(np.abs(t - 7.0) < 0.3, 0.5, 0.0)[:, None] * np.ones(2)
    long = replace(trace, instants=t, data=data, input=None)
    fig = pictures.draw_overlay(pictures.Overlay(long, before, 0.1 * before, (), (), True))
    assert len(fig.axes) == 8
    begin, end = fig.axes[1].get_xlim()
    assert begin < 6.71 < 7.29 < end < begin + 1.0


def test_a_trials_error_is_of_the_model_that_it_began_with(found: Diagnosis) -> None:
    """Far from the data that one is guided along them, and its free run is not the first fit's."""
    far = replace(found.rounds[0], fit_rms=1000.0, holdout_rms=500.0)
    _, added, _ = pictures.steps(replace(found, rounds=(far, *found.rounds[1:])))
    assert (added.fit, added.holdout) == (pytest.approx(60.0), pytest.approx(25.0))
    assert dict(added.others)["airflow_torque"] == pytest.approx(0.47 * 500.0)


def test_names_that_would_lie_on_each_other_share_a_line() -> None:
    others = [("a", 100.0), ("b", 110.0), ("c", 134.0), ("d", 136.0), ("e", 400.0)]
    assert pictures.labels(others) == [(100.0, ["a", "b", "c"]), (136.0, ["d"]), (400.0, ["e"])]
