"""plan.json, and a measurement folder that is readable once the records are in it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import campaigns
import results
from etcfit.api.measurements import Planned
from etcfit.errors import UsageError
from etcfit.experiment.campaign import Campaign
from etcfit.rig.config import parse_config
from etcfit.rig.reader import read_folder
from etcfit.run_folder.plan import plan_json, rig_toml, waiting_folder


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    return campaigns.campaign(results.rig(tmp_path_factory.mktemp("rig")))


def test_the_folder_is_readable_once_the_records_are_there(plan: Campaign, tmp_path: Path) -> None:
    for path, text in waiting_folder(plan).items():
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text(text, encoding="utf-8")
    for test, record in zip(plan.tests, plan_json(plan)["tests"], strict=True):
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
