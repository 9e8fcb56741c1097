"""Mistakes of the rig in `etcfit check`, its API and a fit: shown with their mends, or refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import etcfit
from etcfit.cli import app
from etcfit.errors import MeasurementError
from etcfit.estimation.ready import ready
from etcfit.rig.reader import read_folder
from independent import CONSISTENT, draw_truth
from independent.mistakes import make_mistaken


def folder_of(path: Path, mistake: str) -> Path:
    make_mistaken(path, draw_truth(np.random.default_rng(7100), CONSISTENT), 7100, mistake, "small")
    return path


@pytest.fixture(scope="module")
def resistor(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return folder_of(tmp_path_factory.mktemp("rig"), "series_resistance")


@pytest.fixture(scope="module")
def turned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return folder_of(tmp_path_factory.mktemp("rig"), "channel_sign")


@pytest.mark.slow
def test_check_shows_the_find_and_its_mend_once(resistor: Path) -> None:
    done = CliRunner().invoke(app, ["check", str(resistor), "--quiet"])
    assert (done.exit_code, done.stderr) == (0, "")
    assert "inductance/" in done.stdout
    assert "What these traces can identify" in done.stdout
    assert "Mistakes and habits of the rig, and what mends them" in done.stdout
    tables, _, closing = done.stdout.partition("Answer: ")
    assert tables.count('[tests.inductance] series_ohm = "free"') == 1
    assert closing.count('[tests.inductance] series_ohm = "free"') == 1  # what to do next


def test_what_physics_rules_out_ends_check_with_1_but_shows_the_folder(turned: Path) -> None:
    done = CliRunner().invoke(app, ["check", str(turned), "--quiet"])
    assert done.exit_code == 1
    assert "Traces" in done.stdout
    assert "no fit takes it" in done.stdout
    assert "channel_sign" in done.stderr


def test_a_fit_refuses_it_and_warns_of_the_others(turned: Path, resistor: Path) -> None:
    with pytest.raises(MeasurementError, match="channel_sign"):
        ready(read_folder(turned))
    rig = read_folder(resistor)
    ready(rig)
    assert any("series_resistance" in warning for warning in rig.warnings)


@pytest.mark.slow
def test_the_api_has_them_as_a_frame(resistor: Path) -> None:
    found = etcfit.check(resistor, quiet=True).findings
    assert list(found.index) == ["series_resistance"]
    assert found.loc["series_resistance", "test"] == "inductance"
    assert found["size"].dtype == np.float64
    assert found["sure"].tolist() == [False]
