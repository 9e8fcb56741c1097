"""What a fit leaves behind, and its pictures of all parameters: Table 2 beside them, each way of asking how sure."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

import results
from etcfit.api.work import keep_fit
from etcfit.estimation.intervals import Interval
from etcfit.model.paper import TABLE_2
from etcfit.reporting import clear_for_fit, draw_others, has_undrawn, pictures, style
from etcfit.reporting.pictures import beside, briefly, jobs
from etcfit.reporting.posterior.pictures import Spread, draw_spreads
from etcfit.rig.config import parse_config
from etcfit.run_folder.folder import RunFolder


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    said: list[tuple[str, float]] = []
    result = results.result(results.rig(tmp_path_factory.mktemp("rig")))
    run = tmp_path_factory.mktemp("run") / "new"
    keep_fit(RunFolder(run), result)
    assert [p.name for p in run.rglob("*.png")] == ["parameters.png"]
    draw_others(RunFolder(run), lambda text, share: said.append((text, share)))
    assert 1 + len(said) == len(list((run / "pictures").rglob("*.png")))
    assert [share for _, share in said] == sorted(share for _, share in said)
    return run


def test_every_file_is_there(run: Path) -> None:
    pictures = {p.relative_to(run / "pictures").as_posix() for p in (run / "pictures").rglob("*")}
    tests = ("back_emf", "inductance", "resistance", "response")
    assert {"parameters.png", *(f"tests/{t}.png" for t in tests)} <= pictures
    assert {*(f"traces/{t}__1.png" for t in tests), "traces/response__2.png"} <= pictures
    assert not [p for p in run.rglob(".*")], "scratch files are left behind"
    assert min(min(imread(path).shape[:2]) for path in run.rglob("*.png")) > 150


def test_another_process_can_be_handed_them(tmp_path: Path) -> None:
    handed = pickle.loads(pickle.dumps(jobs(results.result(results.rig(tmp_path)))))
    for path, draw in handed[:3]:
        assert draw().axes, path


def test_a_title_has_room_for_the_model(tmp_path: Path) -> None:
    rig = results.rig(tmp_path)  # an inductance test with a resistance of its own
    assert briefly(results.result(rig)) == "Eqs. 1-2"
    assert briefly(results.result(rig, added=("limp_home_spring",))) == "Eqs. 1-2 + limp_home_spring"
    many = results.result(rig, added=("limp_home_spring", "stribeck_friction", "gravity_load"))
    assert briefly(many) == "Eqs. 1-2 + 4 effects"


@pytest.mark.slow
def test_pictures_of_another_fit_are_not_left_behind(run: Path, tmp_path: Path) -> None:
    stale = run / "pictures" / "traces" / "response__99.png"
    stale.write_bytes(b"a trace that is no longer there")
    (run / "pictures" / "notes.txt").write_text("somebody's own", "utf-8")
    clear_for_fit(run)
    assert not stale.exists()
    assert (run / "pictures" / "notes.txt").exists()


def test_a_fit_that_is_stopped_before_its_picture_leaves_none_of_another_model(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped(*_: object) -> None:
        raise KeyboardInterrupt

    run, first = tmp_path / "run", results.result(results.rig(tmp_path / "rig"))
    for place in (run / "pictures" / "parameters.png", run / "pictures" / "traces" / "response__1.png"):
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(b"of another model")
    monkeypatch.setattr("etcfit.reporting.draw_fit", stopped)
    with pytest.raises(KeyboardInterrupt, match="All results are in"):
        keep_fit(RunFolder(run), first)
    assert not list(run.rglob("*.png"))
    assert has_undrawn(run)


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


PLATE = "[rig]\ngear_ratio = 15.0\n"


def table_2(toml: str) -> dict[str, float]:
    return beside(parse_config(toml, "rig.toml"))


def test_it_holds_what_is_printed_and_the_combinations_that_follow() -> None:
    found = table_2(PLATE)
    same = ("R_a", "L_a", "K_b", "K_m", "B_m", "B_L", "K_s", "T_PL", "T_f", "J_eq", "B_eq")
    assert {symbol: found[symbol] for symbol in same} == {symbol: TABLE_2[symbol] for symbol in same}
    assert found["V_PL"] == pytest.approx(0.362 * 1.513 / (20.68 * 0.0189))  # by its own gear ratio
    assert set(found) - set(same) == {"V_PL", "V_f", "V_s", "V_w"}


def test_what_contradicts_its_own_j_eq_is_left_out() -> None:
    n = TABLE_2["N"]
    assert n**2 * TABLE_2["J_m"] + TABLE_2["J_L"] > 30 * TABLE_2["J_eq"]
    assert n**2 * TABLE_2["B_m"] + TABLE_2["B_L"] == pytest.approx(TABLE_2["B_eq"], rel=0.01)
    assert {"J_m", "J_L"} & set(table_2(PLATE)) == set()


def test_without_a_gear_ratio_motors_are_compared_at_the_plate() -> None:
    found, known = table_2("[rig]\n"), table_2(PLATE)
    assert found["K_b"] == found["K_m"] == pytest.approx(0.391, rel=1e-3)  # the paper's 5.12 V at 13.10 rad/s
    assert found["B_m"] == pytest.approx(TABLE_2["B_eq"], rel=0.01)
    assert all(found[symbol] == known[symbol] for symbol in set(known) - {"K_b", "K_m", "B_m"})


def test_nothing_is_compared_with_what_is_no_plate_between_stops() -> None:
    assert table_2("[rig]\ntravel_deg = [-inf, inf]\n") == {}


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
