"""The page to work with: whole, self-contained, small; its data are those of the run."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import diagnoses
import interactive_runs as made
import results
from etcfit.diagnosis.findings import RigMistake
from etcfit.errors import UsageError
from etcfit.estimation.contradiction import Contradiction
from etcfit.estimation.goodness import Goodness, Left, warnings_of
from etcfit.estimation.result import FitResult
from etcfit.reporting.interactive import NAME, SCRIPTS, part, write_interactive
from etcfit.reporting.interactive.plant import loop_json, simulation
from etcfit.reporting.interactive.traces import Light, cures, lights
from etcfit.reporting.pictures import all_traces
from etcfit.run_folder.folder import RunFolder
from etcfit.run_folder.state import save_fit
from pages import Reader, assert_asks_for_nothing, unpacked

LIMIT = 8_000_000
TWIN = Path(__file__).resolve().parents[3] / "measurements" / "bench_twin"


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    run = made.run_folder(tmp_path_factory.mktemp("page"))
    write_interactive(run)
    return run


@pytest.fixture(scope="module")
def text(written: RunFolder) -> str:
    return (written.path / NAME).read_text(encoding="utf-8")


def test_it_is_one_file_that_asks_for_nothing(text: str) -> None:
    assert len(text.encode()) < LIMIT
    assert_asks_for_nothing(Reader(text), "".join(map(part, SCRIPTS)))
    # the library's own address is in its head, and nowhere else is one
    assert set(re.findall(r"https?://[^\s\"')]+", text)) == {"https://github.com/leeoniya/uPlot"}


def test_the_licence_of_the_library_is_in_it(text: str) -> None:
    assert "The MIT License (MIT)" in text
    assert "Permission is hereby granted" in text


def test_every_trace_is_there_with_its_samples(written: RunFolder, text: str) -> None:
    data, final, diagnosis = Reader(text).data, written.final(), written.diagnosis()
    assert data["schema"] == "etcfit.interactive/1"
    every = all_traces(final)
    assert [each["file"] for each in data["traces"]] == [trace.measurement.file for trace in every]
    assert diagnosis is not None
    for trace, carried in zip(every, data["traces"], strict=True):
        assert np.allclose(unpacked(carried["t"]), trace.instants, atol=1e-6 * np.ptp(trace.instants))
        for m, channel in enumerate(carried["channels"]):
            file = trace.measurement.file
            for name, values in (("measured", trace.data[:, m]), ("before", diagnosis.before.predicted[file][:, m]),
                                 ("after", final.predicted[file][:, m])):  # fmt: skip
                shown = channel["origin"] + channel["size"] * unpacked(channel[name])
                assert np.max(np.abs(shown - values)) <= 1e-4 * np.ptp(values)
            error = (trace.data[:, m] - final.predicted[file][:, m]) / trace.sigma[m]
            assert np.allclose(unpacked(channel["error_after"]), error, atol=1e-4 * np.ptp(error))


def test_missing_torque_stands_where_the_diagnosis_has_it(tmp_path: Path) -> None:
    run = made.kept(tmp_path / "run", made.many(tmp_path / "rig", 2, 500, 0))
    write_interactive(run)
    data = Reader((run.path / NAME).read_text(encoding="utf-8")).data
    motion = run.diagnosis().motions[0]  # pyright: ignore[reportOptionalMemberAccess]
    torque = next(each for each in data["traces"][0]["missing"] if each["name"] == "missing torque")
    seen = unpacked(torque["before"])
    assert np.array_equal(np.isnan(seen), np.isnan(motion.torque))
    assert np.nanmax(np.abs(seen - motion.torque)) < 1e-4 * np.nanmax(np.abs(motion.torque))


CURVE = {"angles_rad": [0.0, 0.31, 1.57], "hold_V": [1.1, 1.4, 2.5]}  # as an ECU's own table names its places


def test_gains_of_a_rig_without_stops_are_tried_over_a_quarter_turn(tmp_path: Path) -> None:
    result = results.result(results.rig(tmp_path))
    config = replace(result.rig.config, travel=(-np.inf, np.inf))
    loop = loop_json(replace(result, rig=replace(result.rig, config=config)), made.pid())
    assert loop is not None
    assert (loop["body"]["lower"], loop["body"]["upper"]) == (0.0, pytest.approx(np.pi / 2))


def test_the_page_simulates_by_the_script_of_its_model(written: RunFolder, text: str) -> None:
    page, simulated = Reader(text), simulation(written.final())
    assert simulated.script.strip() in [data.strip() for tag, _, data in page.inside if tag == "script"]
    assert page.data["plant"]["effects"] == [effect.name for effect in simulated.effects]
    assert set(re.findall(r"p\.(\w+)", simulated.script)) <= page.data["plant"]["values"].keys()


def test_feed_forward_runs_through_the_curve_that_the_gains_were_found_with(tmp_path: Path) -> None:
    result = results.result(results.rig(tmp_path))
    assert loop_json(result, made.pid())["bias"] is None  # pyright: ignore[reportOptionalSubscript]
    found = made.pid() | {"feed_forward": True, "bias_curve": CURVE}
    bias = loop_json(result, found)["bias"]  # pyright: ignore[reportOptionalSubscript]
    assert bias == {"angles": CURVE["angles_rad"], "volts": CURVE["hold_V"]}
    del found["bias_curve"]  # a file of before: another curve would be another loop
    assert loop_json(result, found) is None


def test_synthetic_data_are_called_so_and_measured_ones_are_not(text: str, tmp_path: Path) -> None:
    assert "SYNTHETIC DATA" in text
    run = made.run_folder(tmp_path, synthetic=False, gains=False)
    measured = write_interactive(run).path.read_text(encoding="utf-8")
    assert "SYNTHETIC" not in measured
    assert Reader(measured).data["loop"] is None


def test_a_fit_alone_is_enough_and_says_what_to_run_next(tmp_path: Path) -> None:
    result = results.result(results.rig(tmp_path / "rig"), off=20.0)
    save_fit(tmp_path / "run", result)
    data = Reader(write_interactive(RunFolder(tmp_path / "run")).path.read_text(encoding="utf-8")).data
    assert not data["diagnosed"]
    assert data["left_unexplained"] is None
    assert {each["light"] for each in data["traces"]} <= {"green", "yellow", "red"}
    bad = [each for each in data["traces"] if each["light"] != "green"]
    assert bad
    assert all("etcfit diagnose" in " ".join(each["cures"]) for each in bad)


@pytest.mark.parametrize(("chance", "said"), [(0.9, True), (0.4, False)])
def test_what_no_known_effect_explains_is_said_above_the_lights(tmp_path: Path, chance: float, said: bool) -> None:
    found = replace(diagnoses.diagnosis(results.rig(tmp_path / "rig")), probabilities={"unexplained": chance})
    page = write_interactive(made.kept(tmp_path / "run", found)).path.read_text(encoding="utf-8")
    words = "Something is left that no known effect explains, with probability 0.90"
    assert (words in re.sub(r"\s+", " ", page)) == said


def test_what_a_file_says_stays_text(tmp_path: Path) -> None:
    found = diagnoses.diagnosis(results.rig(tmp_path / "rig"))
    config = replace(found.after.rig.config, name="</script><script>alert(1)</script>")
    after = replace(found.after, rig=replace(found.after.rig, config=config))
    run = made.kept(tmp_path / "run", replace(found, after=after))
    page = write_interactive(run).path.read_text(encoding="utf-8")
    assert "<script>alert" not in page
    assert Reader(page).data["rig"] == config.name


def test_a_folder_without_a_fit_is_no_run(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="etcfit fit FOLDER"):
        write_interactive(RunFolder(tmp_path))


@pytest.mark.parametrize("off", [0.0, 0.6, 20.0])
def test_lights_and_the_warning_of_the_fit_count_the_same_residuals(tmp_path: Path, off: float) -> None:
    result = results.result(results.rig(tmp_path), off=off)
    fitted = result.problem.batch.traces
    odd = {each.file for each in result.goodness if each.left is not Left.FITS}
    shown = dict(zip((t.measurement.file for t in all_traces(result)), lights(result), strict=True))
    assert {t.measurement.file for t in fitted if shown[t.measurement.file].shown[0] != "green"} == odd
    warned = sum(each.left in (Left.MORE, Left.FAR) for each in result.goodness)
    assert (warned > 0) == (off > 0.0)
    said = [text for text in warnings_of(result.goodness, 1.0) if "not independent" in text]
    assert [text.split(" residuals")[0] for text in said] == ([f"{warned} of {len(result.goodness)}"] if warned else [])


def test_a_trace_whose_free_run_strays_is_not_called_noise(tmp_path: Path) -> None:
    result = results.result(results.rig(tmp_path))
    file = result.problem.batch.traces[0].measurement.file
    stray = replace(result, score_fit=tuple(
        replace(row, rms=10.0 * row.sigma) if row.file == file else row for row in result.score_fit
    ))  # fmt: skip
    fine, found = lights(result)[0], lights(stray)[0]
    assert (fine.shown[0], found.shown[0]) == ("green", "yellow")
    assert found.worst.off == pytest.approx(10.0)
    assert "nothing but noise" not in found.shown[1]
    assert "the free run is 10 times the noise off" in found.says[0]


def test_the_page_carries_the_words_of_each_light(written: RunFolder, text: str) -> None:
    carried = Reader(text).data["traces"]
    for trace, light in zip(carried, lights(written.final()), strict=True):
        assert (trace["light"], trace["word"], trace["says"]) == (*light.shown, light.says)


@pytest.mark.slow
def test_a_trace_held_out_is_judged_like_those_fitted() -> None:
    result = results.bench_twin(TWIN)
    wrong = replace(result, x=result.x + 0.1 * np.eye(result.x.size)[result.free_parameters.layout.free.index("K_s")])

    def held_out(of: FitResult) -> list[Light]:
        return [each for trace, each in zip(all_traces(of), lights(of), strict=True) if trace.measurement.held_out]

    assert [each.shown[0] for each in held_out(result)] == ["yellow", "green"]  # edges between samples of the drive
    assert [each.shown[0] for each in held_out(wrong)] == ["red", "red"]


def test_cures_are_those_of_fit_and_diagnosis_for_that_trace(tmp_path: Path) -> None:
    found = diagnoses.diagnosis(results.rig(tmp_path))
    trace = next(t for t in all_traces(found.after) if t.test.name == "response")
    mistake = RigMistake("channel_gain[response.current]", "channel_gain", "response", "current", 0.1, "",
                         '[model] effects = ["x"]', "the current is 10 % too large", None)  # fmt: skip
    contradiction = Contradiction("response", "R_a", 8.0, 1.5, 1.9, 1e-9, 0.7)
    found = replace(found, rig=(mistake, replace(mistake, test="inductance")),
                    after=replace(found.after, contradictions=(contradiction,)))  # fmt: skip
    red = Light((Goodness(trace.measurement.file, "current", Left.FAR, 7.0, False, 7.0),))
    said = cures(trace, red, found.after, found)
    assert sum(each == "the current is 10 % too large" for each in said) == 1
    assert any("contradicts the other tests: without it R_a is 1.9" in each for each in said)
    assert any(found.unexplained is not None and found.unexplained.sentence == each for each in said)
    assert any("a slow ramp" in each for each in said)
    fits, strays = (
        Goodness("", "current", left, 1.0, False, free) for left, free in ((Left.FITS, 1.0), (Left.STRAYS, 9.0))
    )
    assert cures(trace, Light((fits,)), found.after, found) == []
    assert [
        "each edge has its instant" in each for each in cures(trace, Light((fits, strays)), found.after, found)
    ] == [True]
