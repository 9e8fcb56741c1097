"""The bank of folders: what is judged right, what a run that was broken off does again, what its table says first."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dying
from benchmarks.bank import __main__ as command
from benchmarks.bank.ablation import ablation
from benchmarks.bank.cases import Case, at, case, chosen, interleaved, known, made
from benchmarks.bank.judging import grade, is_right, is_true
from benchmarks.bank.mechanisms import MECHANISMS, itself
from benchmarks.bank.picture import picture
from benchmarks.bank.rates import RATES, Rate
from benchmarks.bank.records import blank
from benchmarks.bank.table import parameters, probabilities, rates, table, worsened
from benchmarks.bank.work import append, in_processes, key, latest, run, saved
from etcfit.rig.reader import read_folder
from independent.mistakes import Sheet

ROOT = Path(__file__).resolve().parents[1]
RATE = {rate.words: rate for rate in RATES}
MADE = {"kind": "channel_gain", "test": "viscous", "channel": "current", "size": 1.05, "file": ""}


def named(name: str, probability: float = 0.9, right: bool = True, **more: Any) -> dict[str, Any]:
    return {
        "name": name,
        "kind": name.partition("[")[0],
        "probability": probability,
        "ties": [],
        "right": right,
        **more,
    }


def interval(z: float | None) -> dict[str, Any]:
    return {"z": z, "holds": None if z is None else abs(z) < 1.96, "status": "estimated"}


def record(kind: str, names: Sequence[str] = (), *found: dict[str, Any], strength: str = "high", **more: Any) -> Any:
    """One folder with these names in it and those found."""
    truth = {"names": list(names), "strength": [strength] * len(names), "edges": "", "mistake": {}}
    whole = {"class": kind, "seed": 1, "commit": "a", "truth": truth, "named": list(found), "unexplained": 0.1,
             "check": {"refused": None, "found": []}, "curve": None, "converged": [True, True], "compromise": False,
             "scale_told": [], "statements": [], "seconds": 10.0, "intervals": {
                 "before": {"R_a": interval(3.0)}, "after": {"R_a": interval(1.0), "L_a": interval(None)}}}  # fmt: skip
    return whole | more


def mistaken(*found: dict[str, Any], **more: Any) -> dict[str, Any]:
    truth = {"names": ["channel_gain"], "strength": [], "edges": "", "mistake": MADE}
    return record("mistake", (), *found) | {"truth": truth} | more


# ---- seeds


def test_a_seed_is_the_folder_that_it_always_was() -> None:
    """As the records of earlier test sets had them."""
    drawn = {seed: (case(seed).kind, case(seed).names, case(seed).strength) for seed in (6500, 6504, 6514, 9000, 20084)}
    assert drawn == {
        6500: ("single", ("asymmetric_friction",), ("high",)),
        6504: ("pair", ("actuation_delay", "backlash"), ("high", "medium")),
        6514: ("clean", (), ()),
        9000: ("single", ("limp_home_spring",), ("medium",)),
        20084: ("single", ("load_dependent_friction",), ("high",)),
    }
    assert [each.names for each in at("mistake", "", 20191)] == [("gear_ratio",)]
    assert [each.names for each in at("mistake", "other_rig", 22200)] == [("other_rig",)]


def test_a_stiffening_spring_is_an_effect_of_the_catalogue_wherever_it_was_drawn() -> None:
    kinds = {case(seed).kind for seed in range(6500, 6700) if case(seed).names == ("stiffening_spring",)}
    assert kinds == {"single"}


def test_folders_of_a_class_are_the_next_seeds_that_have_it() -> None:
    assert [each.seed for each in chosen("clean", 6500, 3)] == [6514, 6522, 6525]
    backlash = chosen("single:backlash", 6500, 2)
    assert {each.names for each in backlash} == {("backlash",)}
    assert backlash[0].seed < backlash[1].seed
    assert [each.names for each in chosen("ecu", 17_500, 4)] == [("known",), ("scaled",), ("free",), ("known",)]
    assert {each.strength for each in chosen("outside:friction_tide", 8000, 3)} == {("low",), ("medium",), ("high",)}
    assert {each.edges for each in chosen("edges", 8300, 3)} == {"on", "just before", "just after"}
    assert [len(each.names) for each in chosen("edges", 8300, 5)] == [0, 1, 0, 1, 2]


@pytest.mark.parametrize("token", ["clear", "single:friction", "slow:backlash", "mistake:typo"])
def test_what_is_no_class_is_named(token: str) -> None:
    with pytest.raises(ValueError, match=r"no class .* Classes: clean, single"):
        chosen(token, 6500, 1)


def test_a_run_that_is_broken_off_has_some_of_every_class() -> None:
    some = {token: chosen(token, 8000, n) for token, n in (("slow", 2), ("edges", 6))}
    order = ["edges", "slow", "edges", "edges", "edges", "slow", "edges", "edges"]
    assert [each.kind for each in interleaved(some)] == order


def test_a_log_is_too_slow_for_its_computer(tmp_path: Path) -> None:
    (slow,) = at("slow", "", 8200)
    assert made(slow, tmp_path) == {}
    rig = read_folder(tmp_path)
    assert len(rig.measurements) == 4
    sheet = Sheet.read(tmp_path / "response" / "steps_1.csv")
    assert sheet.header == ("time [s]", "duty [%]", "tps [V]")
    np.testing.assert_allclose(np.diff(sheet.rows[:, 0]), 0.01, atol=1e-6)
    assert np.ptp(sheet.rows[:, 1]) > 50.0
    assert {"V_f", "V_w", "T_f"} <= set(known(slow))


# ---- judging


@pytest.mark.parametrize(
    ("name", "right"),
    [
        (named("channel_gain[viscous.current]", test="viscous", channel="current"), True),
        (named("channel_gain[viscous.voltage]", test="viscous", channel="voltage"), True),  # one reads too much ...
        (named("channel_gain[viscous.motor_speed]", test="viscous", channel="motor_speed"), False),
        (named("channel_gain[response.current]", test="response", channel="current"), False),
        (named("channel_offset[viscous.current]", test="viscous", channel="current"), False),
        (named("channel_gain[viscous.current]", test="viscous", channel="current", file="viscous/1.csv"), False),
        (named("channel_gain", before_any_fit=True), True),
        (named("unit_scale", before_any_fit=True), False),
    ],
)
def test_a_mistake_is_named_by_kind_and_place(name: dict[str, Any], right: bool) -> None:
    assert is_right(mistaken()["truth"], name) is right
    other = named("backlash") | {"ties": [name]}
    assert is_right(mistaken()["truth"], other) is right


def test_an_effect_is_named_by_its_name_or_in_a_tie() -> None:
    truth = record("single", ["gravity_load"])["truth"]
    assert is_right(truth, named("gravity_load"))
    assert not is_right(truth, named("airflow_torque"))
    assert is_right(truth, named("airflow_torque") | {"ties": [named("gravity_load")]})
    edges = truth | {"edges": "on"}
    assert is_right(edges, named("edge_phase[response]"))
    assert not is_right(truth, named("edge_phase[response]"))


WRONG = named("backlash", 0.6, right=False)
GRADED = [
    (record("clean"), "right"),
    (record("clean", unexplained=0.9), "called unexplained"),
    (record("clean", (), WRONG), "wrong name"),
    (record("clean", (), WRONG | {"probability": 0.8}), "wrong name, sure"),
    (record("single", ["gravity_load"], named("gravity_load")), "right"),
    (record("single", ["gravity_load"], named("gravity_load"), WRONG), "wrong name"),
    (record("single", ["gravity_load"], unexplained=0.9), "missed"),
    (record("single", ["gravity_load"], strength="low"), "right"),
    (record("pair", ["gravity_load", "stop_bounce"], named("stop_bounce")), "partly"),
    (record("outside", ["friction_tide"], unexplained=0.9), "right"),
    (record("outside", ["friction_tide"], WRONG), "wrong name"),
    (record("slow", unexplained=0.9), "right"),
    (mistaken(), "missed"),
    (record("ecu", ["free"], scale_told=["V_f"]), "partly"),
    (record("clean", error="ValueError: x"), "failed"),
]


@pytest.mark.parametrize(("of", "expected"), GRADED, ids=[f"{r['class']}-{g}" for r, g in GRADED])
def test_what_became_of_a_folder(of: dict[str, Any], expected: str) -> None:
    assert grade(of) == expected


def test_nothing_and_unexplained_are_statements_too() -> None:
    said = [(r, is_true(r, "nothing"), is_true(r, "unexplained")) for r in (
        record("clean"), record("single", ["backlash"], strength="low"), record("single", ["backlash"]),
        record("outside", ["friction_tide"]), mistaken(), record("slow"))]  # fmt: skip
    assert [flags for _, *flags in said] == [[True, False], [True, False], [False, False], [False, True],
                                             [False, False], [None, None]]  # fmt: skip


# ---- rates


def test_each_rate_is_of_the_folders_that_it_is_asked_of() -> None:
    every = [
        record("clean"),
        record("clean", (), WRONG),
        record("single", ["gravity_load"], WRONG, named("gravity_load")),
        record("single", ["gravity_load"], strength="low"),
        record("pair", ["gravity_load", "stop_bounce"], named("stop_bounce"), named("gravity_load")),
        record("pair", ["gravity_load", "stop_bounce"], named("stop_bounce")),
        record("outside", ["friction_tide"], WRONG | {"probability": 0.85}),
        mistaken(named("channel_gain[viscous.current]")),
        record("ecu", ["known"]),
    ]
    flags = {rate.words: rate.of(every) for rate in RATES}
    assert flags["clean: left alone"] == [True, False]
    assert flags["one clear effect: named first"] == [False]
    assert flags["one faint effect: no wrong name"] == [True]
    assert flags["pairs: both named"] == [True, False]
    assert flags["outside: no wrong name"] == [False]
    assert flags["mistakes of the rig: named"] == [True]
    assert flags["all folders: a wrong name at 0.8 or more"] == [False] * 6 + [True, False]  # [ecu] is not diagnosed
    assert flags["95 % intervals hold: `[ecu]`, gains known"] == [True]
    assert flags["95 % intervals hold: slow logs"] == []


@pytest.mark.parametrize(
    ("missed", "flags"),
    [({}, [False]), ({"chi2": 1.0, "backlash": {"tell": True}}, [False]), ({"chi2": None}, []),
     ({"chi2": 1.0, "backlash": {"tell": False}}, [])],
)  # fmt: skip
def test_what_the_data_do_not_tell_is_not_missed(missed: dict[str, Any], flags: list[bool]) -> None:
    rate = RATE["pairs: both named, where the data tell both"]
    both = ["backlash", "gravity_load"]
    assert rate.of([record("pair", both, named("gravity_load"), missed=missed)]) == flags
    assert rate.of([record("pair", both, *map(named, both))]) == [True]


def test_what_the_checks_find_is_right_at_its_place_and_an_alarm_elsewhere() -> None:
    gain = {"kind": "channel_gain", "test": "viscous", "file": None, "channel": "current", "size": 1.05, "chance": 1e-9}
    found, missed = RATE["mistakes of the rig: found by its checks"], mistaken()
    elsewhere = mistaken(check={"refused": None, "found": [gain | {"test": "response"}]})
    assert found.of([mistaken(check={"refused": None, "found": [gain]}), elsewhere, missed]) == [True, False, False]
    quiet = RATE["no mistake: none found by the rig's checks"]
    edges = {"refused": None, "found": [gain | {"kind": "synchronous_edges"}]}
    some = [record("clean", check=edges), record("single", ["actuation_delay"], check=edges), record("clean"), missed]
    assert quiet.of(some) == [False, True, True]


def test_a_folder_that_broke_is_not_right() -> None:
    broken = [record("clean", error="x", intervals={}), record("single", ["backlash"], error="x", intervals={})]
    assert RATE["clean: left alone"].of(broken) == [False]
    assert RATE["one clear effect: named first"].of(broken) == [False]


def test_statements_are_sorted_by_what_they_state() -> None:
    said = [record("clean", statements=[["backlash", 0.9, True], ["nothing", 0.7, False], ["unexplained", 0.9, None]])]
    assert RATE["stated at 0.9 (0.85 to 0.95): right"].of(said) == [True]
    assert RATE["stated at 0.7 (0.6 to 0.8): right"].of(said) == [False]
    assert "| 0.8 to 0.95 | 1 | 90 % | 100 % |" in probabilities(said)


@pytest.mark.parametrize(
    ("right", "of", "verdict"),
    [(200, 200, "met"), (40, 40, "met, few"), (38, 40, "**missed**, few"), (80, 100, "**missed**")],
)
def test_a_verdict_says_whether_so_few_folders_can_tell(right: int, of: int, verdict: str) -> None:
    rate = Rate("x", 0.97, 1.0, lambda _: [])
    assert rate.verdict([True] * right + [False] * (of - right)) == verdict


def test_targets_in_words() -> None:
    asked = {(0.97, 1.0): "at least 97 %", (0.0, 0.02): "at most 2 %", (0.93, 0.97): "93 to 97 %", (1.0, 1.0): "all"}
    assert [Rate("x", *ends, lambda _: []).target for ends in asked] == [*asked.values()]


# ---- the table


def test_what_got_worse_stands_before_what_got_better_and_before_the_rates() -> None:
    old = [record("clean", seed=1), record("pair", ["gravity_load"], seed=2, commit="a")]
    new = [record("clean", (), WRONG, seed=1, commit="b"),
           record("pair", ["gravity_load"], named("gravity_load"), seed=2, commit="b"),
           record("slow", seed=3, commit="b")]  # fmt: skip
    text = table(latest(new), latest(old))
    places = [text.index(words) for words in (
        "2 folders are in both files, by a before", "**Worse: 1**", "- clean 1: nothing: wrong name (was right)",
        "**Better: 1**", "- pair 2: gravity_load (high): right (was missed)",
        "| clean: left alone | 0 of 1 (0 %) |")]  # fmt: skip
    assert places == sorted(places)
    assert "| 1 of 1 (100 %) | **missed**, few |" in text  # as it was before


def test_an_interval_that_misses_far_makes_a_folder_worse() -> None:
    near, far = record("clean"), record("clean", intervals={"after": {"R_a": interval(7.0)}})
    assert worsened(near, far) == [("worst |z|", "1.0", "7.0 (R_a)")]
    assert worsened(far, near) == []
    several = {"after": {s: interval(2.5) for s in ("R_a", "L_a", "K_b")}}
    assert ("intervals that miss", "0", "3") in worsened(near, record("clean", intervals=several))
    lost = record("clean", converged=[True, False])
    assert worsened(near, lost) == [("", "converged", "not converged")]


def test_intervals_by_parameter() -> None:
    some = [record("clean", intervals={"after": {"R_a": interval(z)}}) for z in (1.0, -3.0)]
    assert "| `R_a` | 1 of 2 (50 %) | -1.00 | 2.24 | 3.0 |" in parameters(some)


def test_the_picture_is_drawn(tmp_path: Path) -> None:
    picture([r for r, _ in GRADED], tmp_path / "bank.png")
    assert (tmp_path / "bank.png").stat().st_size > 20_000


def test_the_page_has_the_table_of_the_records_kept() -> None:
    records = saved(ROOT / "benchmarks" / "bank" / "records.jsonl")
    assert records
    assert not any(tempfile.gettempdir() in str(each) for each in records)  # messages name files of the folder alone
    pages = ROOT / "docs" / "validation"
    assert table(latest(records)) in (pages / "bank_training.md").read_text(encoding="utf-8")
    test = [*latest(saved(ROOT / "benchmarks" / "bank" / "test_records.jsonl")).values()]
    assert rates(test) in (pages / "bank.md").read_text(encoding="utf-8")


def test_the_records_kept_are_of_the_folders_that_their_seeds_draw() -> None:
    for each in saved(ROOT / "benchmarks" / "bank" / "records.jsonl"):
        kinds = {c.key for c in (*at(each["class"], "", each["seed"]), *_by_name(each))}
        assert key(each) in kinds


def _by_name(of: dict[str, Any]) -> tuple[Case, ...]:
    return at(of["class"], of["truth"]["names"][0], of["seed"]) if of["class"] in ("outside", "mistake") else ()


# ---- a run that was broken off


def blanks(cases: Sequence[Case], jobs: int) -> Iterator[dict[str, Any]]:
    yield from (blank(each, {}) for each in cases)


def test_what_is_there_by_this_commit_is_not_run_again(tmp_path: Path) -> None:
    file, cases, said = tmp_path / "bank.jsonl", chosen("clean", 6500, 3), []
    run(cases[:2], 1, file, said.append, blanks, "a")
    assert len(said) == 2
    run(cases, 1, file, said.append, blanks, "a")
    assert len(said) == 3
    assert said[-1].startswith("1 of 1, 0 s left; clean 6525: nothing: right; no name")
    assert [each["seed"] for each in saved(file)] == [6514, 6522, 6525]
    every = run(cases, 1, file, said.append, blanks, "b")  # another commit runs all of them
    assert len(said) == 6
    assert {each["commit"] for each in every} == {"b"}


def test_each_record_is_kept_before_the_next_is_made(tmp_path: Path) -> None:
    file, cases = tmp_path / "bank.jsonl", chosen("slow", 8200, 2)

    def broken_off(some: Sequence[Case], jobs: int) -> Iterator[dict[str, Any]]:
        yield blank(some[0], {})
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(cases, 1, file, lambda _: None, broken_off, "a")
    assert [each["seed"] for each in saved(file)] == [8200]


def test_a_line_that_was_cut_off_is_none_and_gives_way_to_the_next(tmp_path: Path) -> None:
    file = tmp_path / "bank.jsonl"
    append(file, {"n": 1})
    append(file, {"n": 2})
    file.write_bytes(file.read_bytes()[:-4])
    assert saved(file) == [{"n": 1}]
    append(file, {"n": 3})
    assert saved(file) == [{"n": 1}, {"n": 3}]
    with file.open("a") as out:
        out.write("{}}\n")
    with pytest.raises(json.JSONDecodeError):  # whole, and no record: not passed over
        saved(file)


@pytest.mark.slow
def test_a_process_that_dies_costs_its_own_folder_alone() -> None:
    cases = chosen("clean", 6500, 3)
    assert cases[0].seed == dying.FATAL
    records = {r["seed"]: r.get("error") for r in in_processes(cases, 1, dying.work)}
    assert records == {6514: "its process died", 6522: None, 6525: None}


# ---- the command line


@pytest.mark.parametrize(
    "words",
    [
        "--classes clean --first-seed 20000 --save f",
        "--mix training --first-seed 30000 --save f",
        "--mix test",
        "--save f",
    ],
)
def test_the_test_is_not_run_by_accident(words: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["bank", *words.split()])
    with pytest.raises(SystemExit):
        command.arguments()


def test_every_mix_is_of_classes_that_there_are_and_training_is_below_the_test() -> None:
    for name, mix in command.MIXES.items():
        for token in mix:
            first = command.FROZEN.get(name) or command.begins(token)
            (one,) = chosen(token, first, 1)
            assert (one.seed >= command.TEST) is (name in command.FROZEN)
    assert sum(command.MIXES["test"].values()) == 400


@pytest.mark.parametrize("name", MECHANISMS)
def test_a_mechanism_is_a_function_of_the_diagnosis(name: str) -> None:
    assert callable(itself(MECHANISMS[name].where)[1])


def test_a_mechanism_that_is_switched_off_takes_what_it_does_away() -> None:
    made_without = (
        "from benchmarks.bank.mechanisms import watched\n"
        "acted = watched('free sets')\n"
        "from etcfit.diagnosis import course\n"
        "print(course.searched_free('result', 'first', 'progress', print), *acted)"
    )
    out = subprocess.run([sys.executable, "-c", made_without], capture_output=True, text=True, check=True)
    assert out.stdout.split("\n")[0] == "('progress', ()) free sets"


def test_an_ablation_compares_the_folders_in_which_a_mechanism_acted(tmp_path: Path) -> None:
    both = ["backlash", "gravity_load"]
    with_it = record("pair", both, *map(named, both), seed=6, commit="abc", acted=["free sets"], seconds=9.0)
    append(tmp_path / "without", with_it | {"named": [], "commit": "abc without free sets", "seconds": 4.0})
    (row,) = [line for line in ablation(tmp_path / "without", latest([with_it])).split("\n") if "| free sets |" in line]
    assert "| 1 of 1 | 1: pair 6 | 0 |" in row
    assert "9 → 4" in row


def test_rates_have_words_of_their_own() -> None:
    assert len(RATE) == len(RATES)
    assert not [rate.words for rate in RATES if "|" in rate.words]  # it would end a cell
    assert rates([]).count("\n") == 1  # the head alone: no row without a folder
