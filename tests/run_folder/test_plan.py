"""What is planned: the files, what plays a test as a C compiler reads it, and what the folder waits for."""

from __future__ import annotations

import csv
import json
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import campaigns
import folders
import results
from etcfit.api.measurements import Planned
from etcfit.errors import UsageError
from etcfit.experiment.campaign import Campaign
from etcfit.rig.config import parse_config
from etcfit.rig.reader import read_folder
from etcfit.run_folder.plan import PLAN, play_files, rig_toml, waiting_folder


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    return campaigns.campaign(results.rig(tmp_path_factory.mktemp("rig")))


def test_the_folder_is_readable_once_the_records_are_there(plan: Campaign, tmp_path: Path) -> None:
    folders.write(tmp_path, waiting_folder(plan))
    for test, record in zip(plan.tests, PLAN.json(plan)["tests"], strict=True):
        head = [column["header"] for column in record["logger"]]
        rng = np.random.default_rng(1)
        time = test.candidate.plan.time
        columns = [time, *(rng.uniform(c["low"], c["high"], time.size) for c in record["logger"][1:])]
        body = "\n".join(",".join(f"{v:.6f}" for v in row) for row in zip(*columns, strict=True))
        (tmp_path / "measurements" / test.file).write_text(",".join(head) + "\n" + body + "\n", encoding="utf-8")
        assert ",".join(head) in (tmp_path / "measurements" / test.file).with_name("README.txt").read_text("utf-8")
    rig = read_folder(tmp_path / "measurements")
    assert {m.file for m in rig.measurements} == {test.file for test in plan.tests}
    assert rig.config == replace(plan.rig.config, holdout=())
    assert rig.config.synthetic


def test_a_rig_without_a_rig_toml_gets_its_nameplate(plan: Campaign) -> None:
    config = replace(plan.rig.config, name='a "rig"')
    bare = replace(plan, rig=replace(plan.rig, toml="", config=config))
    found = parse_config(rig_toml(bare), "rig.toml")
    assert (found.name, found.synthetic, found.gear_ratio) == ('a "rig"', True, plan.rig.config.gear_ratio)
    assert found.travel == pytest.approx(plan.rig.config.travel)
    assert found.tps == plan.rig.config.tps


def test_a_plan_is_written_whole_and_nothing_is_replaced(plan: Campaign, tmp_path: Path) -> None:
    out = Planned(plan).save(tmp_path / "plan")
    written = json.loads((out / "plan.json").read_text(encoding="utf-8"))
    for test in written["tests"]:
        assert (out / "measurements" / test["test"] / "README.txt").is_file()
        for file in (test["play"] or {}).values():
            assert not isinstance(file, str) or (out / file).is_file()
        curve = test["expected"]
        assert all(
            len(part) == len(curve["time"]) for name, c in curve.items() if name != "time" for part in c.values()
        )
    assert written["limits"]["position_rad"] == pytest.approx([0.04 * np.pi / 2, 0.96 * np.pi / 2])
    assert sorted(path.name for path in tmp_path.iterdir()) == ["plan"]  # no draft is left
    with pytest.raises(UsageError, match="already there and not an empty folder"):
        Planned(plan).save(out)


def test_a_notebook_shows_the_tests(plan: Campaign) -> None:
    planned = Planned(plan)
    assert list(planned.tests.index) == [test.file for test in plan.tests]
    assert planned.tests["current"].iloc[0] == pytest.approx(2.02, rel=1e-3)
    assert planned.tests["current"].iloc[1] == 0.0  # open terminals
    assert planned.stderr.loc["T_f", "expected"] == pytest.approx(0.04 * 0.7**3)
    for text in (repr(planned), planned._repr_html_(), planned.summary()):
        assert "back_emf/plan_2.csv" in text
    assert "SYNTHETIC" in planned.summary()


CC, CXX = (next(filter(None, map(shutil.which, names)), None) for names in (("cc", "gcc"), ("c++", "g++")))
READ_BACK = """#include <stdio.h>
#include "plan_1.h"
int main(void) {
  printf("%lu %lu %d %g\\n", PLAN_1_COUNT, PLAN_1_PERIOD_US, PLAN_1_FULL, (double)PLAN_1_SUPPLY_V);
  for (unsigned long k = 0; k < PLAN_1_COUNT; k++) printf("%d\\n", PLAN_1_AT(k));
  return 0;
}
"""
# a clock that each look moves on by 50 us, one `g` on the line, then silence or, in time, another character
ARDUINO = """#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
enum { LOW, HIGH, OUTPUT };
static uint32_t now = 4294000000UL;  /* it wraps while the test plays */
static uint32_t began = 0;
static int sign = 1, sync = 0, waiting = 1;
static uint32_t micros() { return now += 50; }
static void pinMode(int, int) {}
static void digitalWrite(int pin, int level) {
  if (pin == 8) sign = level == HIGH ? -1 : 1;
  if (pin == 7) { sync = level; if (level) began = now; }
}
static void analogWrite(int, int value) { printf("%u %d %d\\n", (unsigned)(now - began), sync, sign * value); }
struct {
  void begin(long) {}
  void println(const char *text) { fprintf(stderr, "%s\\n", text); }
  int available() { return waiting || (sync && STOP_US && now - began > STOP_US); }
  int read() { if (waiting) { waiting = 0; return 'g'; } sync = 0; return 'x'; }
} Serial;
#include "plan_1.ino"
int main() { setup(); loop(); return 0; }
"""


@pytest.fixture
def folder(plan: Campaign, tmp_path: Path) -> Path:
    return folders.write(tmp_path, play_files(plan)) / "play"


def test_what_is_not_driven_has_nothing_to_play(plan: Campaign) -> None:
    names = {path.split("/")[1].removesuffix(".csv") for path in play_files(plan)}
    assert names == {"plan_1", "plan_3"}  # the second is a release


def test_the_csv_is_what_is_played(plan: Campaign, folder: Path) -> None:
    lines = (folder / "plan_1.csv").read_text(encoding="utf-8").splitlines()
    assert any("SYNTHETIC" in line for line in lines if line.startswith("#"))
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    played = plan.tests[0].candidate.played
    assert played is not None
    assert np.allclose([float(row["time [s]"]) for row in rows], played.time)
    assert np.allclose([float(row["voltage [V]"]) for row in rows], played.volts, atol=1e-5)
    assert [round(100.0 * float(row["duty [%]"])) for row in rows] == played.counts.tolist()


@pytest.mark.skipif(CC is None, reason="no C compiler on PATH")
def test_a_compiler_reads_the_table_back_equal(plan: Campaign, folder: Path) -> None:
    assert CC
    here = folder / "plan_1"
    (here / "main.c").write_text(READ_BACK, encoding="utf-8")
    for standard in ("-std=c99", "-std=c11"):
        words = [CC, standard, "-Wall", "-Wextra", "-Werror", "-pedantic", "-o", str(here / "main"),
                 str(here / "main.c")]  # fmt: skip
        subprocess.run(words, check=True, capture_output=True, timeout=60)
    told, *counts = subprocess.run([here / "main"], check=True, capture_output=True, text=True).stdout.splitlines()
    played = plan.tests[0].candidate.played
    assert played is not None
    assert told.split() == [str(played.counts.size), "1000", "10000", f"{played.supply:g}"]
    assert [int(count) for count in counts] == played.counts.tolist()


def run_sketch(here: Path, stop_us: int) -> tuple[list[list[int]], str]:
    """What the sketch put out, as (time since sync in us, sync, signed PWM of 255), and what it said."""
    assert CXX
    main = ARDUINO.replace("STOP_US", f"{stop_us}u")
    (here / "main.cpp").write_text(main, encoding="utf-8")
    words = [CXX, "-Wall", "-Werror", "-I", str(here), "-o", str(here / "sketch"), str(here / "main.cpp")]
    subprocess.run(words, check=True, capture_output=True, timeout=60)
    done = subprocess.run([here / "sketch"], check=True, capture_output=True, text=True, timeout=60)
    return [[int(word) for word in line.split()] for line in done.stdout.splitlines()], done.stderr


@pytest.mark.skipif(CXX is None, reason="no C++ compiler on PATH")
def test_the_sketch_plays_the_table_in_time_and_ends_with_nothing(plan: Campaign, folder: Path) -> None:
    out, said = run_sketch(folder / "plan_1", 0)
    played = plan.tests[0].candidate.played
    assert played is not None
    shown = np.array([row for row in out if row[1] == 1])[: played.counts.size]
    assert np.allclose(shown[:, 2], 255 * played.counts / 10_000, atol=0.51)
    assert np.abs(shown[:, 0] - 1e6 * played.time).max() <= 120  # two looks at the clock
    assert out[-1][2] == 0
    assert said.splitlines()[-1] == "played"


@pytest.mark.skipif(CXX is None, reason="no C++ compiler on PATH")
def test_any_character_stops_the_sketch_at_once(folder: Path) -> None:
    out, said = run_sketch(folder / "plan_1", 1_500_000)
    assert "STOPPED" in said
    assert out[-1][2] == 0
    assert max(row[0] for row in out if row[1]) < 1_502_000


def code(name: str, text: str) -> str:
    """What is no comment, as a compiler or a reader of CSV takes it."""
    if name.endswith(".csv"):
        return "\n".join(line for line in text.split("\n") if not line.startswith("# "))
    how = [CC or "", "-x", "c++" if name.endswith(".ino") else "c", "-Wall", "-Werror", "-trigraphs", "-E", "-P", "-"]
    own = text.replace("#include", "include")
    return subprocess.run(how, input=own, text=True, capture_output=True, check=True).stdout


@pytest.mark.skipif(CC is None, reason="no C compiler on PATH")
@pytest.mark.parametrize("name", ['x */ int main(void) {} /* "\n#error', "*\\\n/ #error", "*??/\n/ #error", "a\r0,1,2",
                                  "@NAME@", f"{'a ' * 40}*\\ / #error"])  # fmt: skip
def test_no_name_of_a_rig_is_code_or_a_row(plan: Campaign, name: str) -> None:
    innocent, found = (
        play_files(replace(plan, rig=replace(plan.rig, config=replace(plan.rig.config, name=each))))
        for each in ("rig", name)
    )
    assert [code(*each) for each in innocent.items()] == [code(*each) for each in found.items()]
