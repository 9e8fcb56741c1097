"""The page of a run: self-contained, small, and it says what the files say."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any

import pytest

import runs
from etcfit.errors import UsageError
from etcfit.reporting.page import read_run, write_page
from etcfit.reporting.page.pictures import caption, carried
from etcfit.reporting.page.render import render
from etcfit.reporting.page.verdict import residuals
from golden import check_view
from pages import Reader

LIMIT = 5_000_000


def read(run: Path) -> Reader:
    return Reader(write_page(run).path.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with everything in it, beside its measurements."""
    folder = tmp_path_factory.mktemp("made")
    runs.run_folder(folder, runs.LATER, lost=("B_L",))
    return folder


@pytest.fixture
def full(made: Path, tmp_path: Path) -> Path:
    """A copy of it, to be changed."""
    shutil.copytree(made, tmp_path, dirs_exist_ok=True)
    return tmp_path / "run"


def test_the_page_is_whole_and_asks_for_nothing(full: Path) -> None:
    page = read(full)
    assert page.open == []
    assert page.of("script") == []
    images = page.of("img")
    assert len(images) == 5
    assert all((image["src"] or "").startswith("data:image/png;base64,") and image["alt"] for image in images)
    loaded = [link["href"] for link in page.of("link")] + [a["href"] for a in page.of("a")]
    assert all(href and href.startswith(("data:", "#")) for href in loaded)
    css = (full / "report.html").read_text(encoding="utf-8").partition("<style>")[2].partition("</style>")[0]
    assert "url(" not in css
    assert "@import" not in css
    assert (full / "report.html").stat().st_size < LIMIT


def test_every_anchor_has_its_place(full: Path) -> None:
    page = read(full)
    places = {attributes.get("id") for _, attributes in page.tags}
    assert {(a["href"] or "")[1:] for a in page.of("a")} <= places


def test_a_posterior_that_takes_formulas_as_exact_says_so(full: Path) -> None:
    assert "taken as exact" not in read(full).text
    runs.changed(full, "posterior", exact=["limp_home_spring"])
    assert "formulas of effects taken as exact (intervals of the fit allow for inexact ones)" in read(full).text


@pytest.mark.parametrize(("chance", "sentences"), [(0.9, 1), (0.4, 0), (None, 0)])
def test_what_no_known_effect_explains_stands_in_the_verdict_with_its_probability(
    full: Path, chance: float | None, sentences: int
) -> None:
    runs.changed(full, "diagnosis", probabilities={"limp_home_spring": 0.991, "backlash": 0.01, "unexplained": chance})
    page = write_page(full).path.read_text(encoding="utf-8")
    verdict = page.partition('aria-label="Verdict"')[2].partition("</section>")[0]
    said = "<strong>Something is left that no known effect explains</strong>, with probability 0.90."
    assert verdict.count(said) == verdict.count("Something is left") == sentences


def test_a_mistake_of_the_rig_stands_in_the_verdict_with_what_mends_it(full: Path) -> None:
    told = {"kind": "channel_gain", "test": "response", "channel": "current", "mend": '[model] effects = ["<b>"]'}
    runs.changed(full, "diagnosis", rig=[told])
    page = write_page(full).path.read_text(encoding="utf-8")
    assert "A mistake of the rig: channel gain</strong> (current, response). Mend: <code>[model] effects" in page
    assert "<b>" not in page  # what a file says is text
    runs.changed(full, "diagnosis", rig=[told | {"effect": "channel_gain[response.current]"}])
    assert "[model] effects" not in write_page(full).path.read_text(encoding="utf-8")  # its statement says it
    runs.changed(full, "diagnosis", rig=[told | {"kind": "synchronous_edges"}])
    assert "A mistake of the rig" not in write_page(full).path.read_text(encoding="utf-8")  # a habit is none


def test_what_is_stated_of_an_effect_stands_in_the_verdict_and_every_question_with_its_answers(full: Path) -> None:
    said = "The model may lack <it> (0.55). A measurement that would decide: a probe."
    asked = {"asks": "Round 1: what explains it?", "answers": {"limp_home_spring": 0.55, "nothing": 0.45}}
    runs.changed(full, "diagnosis", statements=[{"effect": "limp_home_spring", "sentence": said}], questions=[asked])
    page = write_page(full).path.read_text(encoding="utf-8")
    assert said.replace("<it>", "&lt;it&gt;") in page
    assert "Round 1: what explains it? limp_home_spring 0.55, nothing 0.45." in page


@pytest.mark.parametrize("left", ["more", "far"])
def test_a_single_residual_is_not_counted(left: str) -> None:
    said = residuals({"fit": [{"left": left}], "chi2_per_dof": 0.5})
    assert said == "a residual that is larger than its noise or not independent (χ²/dof 0.500)"


@pytest.mark.parametrize(
    ("left", "said"),
    [
        (("fits",) * 4, "leave nothing but noise (χ²/dof"),
        (("fits", "fits", "strays", "strays"), "leave nothing but noise from sample to sample (χ²/dof"),
        (("fits", "fits", "fits", "strays"), "run free, 1 of 4 strays by more than 3 σ"),
        (("fits", "more", "far", "fits"), "leave noise in 2 of 4 residuals (χ²/dof"),
        (("fits", "more", "fits", "fits"), "1 is larger than their noise or not independent."),
        ((None, "fits"), "leave residuals (χ²/dof"),
    ],
)
def test_the_verdict_counts_the_residuals_by_the_one_rule(full: Path, left: tuple, said: str) -> None:
    score = json.loads((full / "diagnosis.json").read_text(encoding="utf-8"))["after"]
    row = {key: value for key, value in score["fit"][0].items() if key != "left"}
    rows = [row | ({} if each is None else {"left": each}) for each in left]
    runs.changed(full, "diagnosis", after=score | {"fit": rows})
    assert said in " ".join(read(full).text.split())


def test_a_command_in_a_warning_is_code(full: Path) -> None:
    runs.changed(full, "diagnosis", warnings=["run `etcfit <diagnose>` again"])
    page = write_page(full).path.read_text(encoding="utf-8")
    assert "<li>run <code>etcfit &lt;diagnose&gt;</code> again</li>" in page


def test_a_caption_names_the_trace_and_its_model() -> None:
    assert caption("traces", "response__drive_1").startswith("Response/drive 1: measured and simulated by the final")
    assert "first fit" in caption("before/traces", "response__drive_1")


def test_the_page_has_a_dark_dress_for_the_screen_and_none_for_paper() -> None:
    css = (Path(render.__code__.co_filename).parents[1] / "assets" / "printed.css").read_text(encoding="utf-8")
    assert "@media screen and (prefers-color-scheme: dark)" in css
    assert not re.search(r"background: #fff;(?! border-radius)", css)  # but for the card below a picture


def test_a_fit_alone_is_enough(tmp_path: Path) -> None:
    page = read(runs.run_folder(tmp_path, synthetic=False))
    assert "SYNTHETIC" not in page.text
    assert "has not been looked for" in page.text
    assert {"plant", "gains", "diagnosis"} & {attributes.get("id") for _, attributes in page.tags} == set()


def test_extra_keys_and_other_layouts_are_borne(full: Path) -> None:
    met = {"linear": {"settling_s": True}, "nonlinear": {"settling_s": False}, "reason": "supply voltage binds"}
    runs.changed(full, "pid", met=met, newcomer=[1])
    runs.changed(full, "transfer_function", operating_point=None, stderr={"num": None, "den": [1.0, 2.0, 3.0]})
    runs.changed(full, "posterior", parameters=None, draws=3)
    assert "MISS on the nominal model: settling time" in read(full).text


SUPPLY_TABLE = {"ecu_has": None, "supply_V": [9.0, 12.0, 15.0], "unit": "%/%", "form": "seconds",
                "gains": {"P": [22.31, 16.73, 13.38], "I": [346.0, 259.5, 207.6], "D": [0.1522, 0.1142, 0.0913]},
                "says": ["at 9 V: it <helps> tracking there"]}  # fmt: skip


@pytest.mark.parametrize("has", ["none", "unknown"])
def test_an_ecu_with_nowhere_to_type_it_has_no_such_table_but_is_told_why(full: Path, has: str) -> None:
    runs.changed(full, "pid", supply_table=SUPPLY_TABLE | {"ecu_has": has})
    page = read(full)
    assert "that keep the loop what it is" not in page.text
    assert "at 9 V: it <helps> tracking there" in page.text


def on_parts(share: float) -> dict[str, Any]:
    """How the gains of one rule fare on the parts."""
    worst = {"unit": "u<7>", "requirement": "settling_s", "figure": None, "limit": 0.2, "meets": False}
    of = {"share_met": share, "share_ci95": [0.1, 1.0]}
    return {"measured": {**of, "of": 12, "worst_rmse_pct": 1.25}, "worst": worst, "fails": {"settling_s": ["u<7>"]},
            "drawn": {**of, "share_met": share / 2.0, "of": 199, "worst_rmse_pct": None}}  # fmt: skip


def test_a_page_of_everything_is_as_it_was(full: Path) -> None:
    """Gains of a make of ECU, over the supply, away from the bench and on the parts of a fleet among it."""
    text = read(full).text
    assert not any(
        each in text for each in ("For Link", "keep the loop what it is", "Away from the bench", "On the parts")
    )
    profile = {"name": "link", "title": "Link <G4X>", "source": "its help", "assumed": ["its unit"],
               "gains": {"P gain": {"value": 7.25, "unit": "%/%"}, "I gain": {"value": 110.0, "unit": "%/%, per s"},
                         "D gain": {"value": 0.0825, "unit": "%/%, times s"}},
               "limits": {"DC clamp": {"value": 87.5, "unit": "%"}}, "bias": None}  # fmt: skip
    conditions = {
        "supply_V": [9.0, 15.0],
        "winding_degC": [-20.0, 130.0],
        "friction_over_bench": [0.5, 1.5],
        "worst": {"overshoot_pct": 7.5, "settling_s": None, "gain_margin_db": 4.25, "tracking": 1.0},
        "hardest": {"supply_V": 9.0, "winding_degC": 130.0, "friction_over_bench": 0.5},
        "met": {"overshoot_pct": True, "settling_s": False},
        "stable": False,
        "probability_met": 0.125,
    }
    hardest = {"unit": "u3 at 9 V", "requirement": "stable", "figure": -1.5, "limit": 0.0, "meets": False}
    parts = {
        "fleet": "runs/line",
        "name": "line <4>",
        "units": [f"u{k}" for k in range(12)],
        "of_run": [],
        "left_out": {"u12": "odd: <far> off"},
        "rules": {"simc": on_parts(0.5), "ziegler_nichols": on_parts(0.75)},
        "conditions": {"corners": {"share_met": 0.25, "of": 12}, "drawn": {"share_met": 0.125}, "hardest": hardest},
    }
    runs.changed(full, "pid", profile=profile, supply_table=SUPPLY_TABLE, conditions=conditions, parts=parts)
    page = read(full)
    assert page.open == []
    assert not {"<G4X>", "<far>", "u<7>"} & set(re.findall(r"\w?<\w+>", page.source))  # what a file says is text
    shown, _, sources = page.lines.rpartition("\nSources\n")
    check_view("pages/report.txt", shown, json.loads((full / "fit.json").read_text("utf-8"))["folder"])
    hashes = re.findall(r"\b[0-9a-f]{64}\b", sources)
    assert len(hashes) == 6 + 1 + len(runs.LATER)  # rig.toml, five traces; fit.json and what came after


def test_results_of_other_data_are_called_so(full: Path) -> None:
    runs.changed(full, "diagnosis", files={"rig.toml": "0" * 64})
    assert "diagnosis.json was made of other data than fit.json" in read(full).text


def test_pictures_for_which_there_is_no_room_are_named(full: Path) -> None:
    page = Reader(render(read_run(full), budget=3000))
    assert 0 < len(page.of("img")) < 5
    assert "Left out to keep this page small" in page.text


def test_a_picture_keeps_its_size_and_loses_its_weight(tmp_path: Path) -> None:
    runs.picture(tmp_path / "a__b_c.png", (1200, 800), 200)
    picture = carried(tmp_path / "a__b_c.png")
    assert (picture.name, picture.width, picture.height) == ("a · b c", 1200, 800)


@pytest.mark.parametrize(
    ("content", "said"), [("{", "is no JSON"), ('{"schema": "etcfit.pid/9"}', "etcfit.pid/9"), ("[]", "None")]
)
def test_a_spoilt_file_is_said_to_be(full: Path, content: str, said: str) -> None:
    runs.written(full, "design", content)
    with pytest.raises(UsageError, match=said):
        write_page(full)


def test_a_folder_without_a_fit_is_no_run(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="etcfit fit FOLDER"):
        write_page(tmp_path)
