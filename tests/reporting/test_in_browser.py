"""Pages that are only read, in a browser as wide as a desk and as a telephone: whole, quiet, nothing cut, nothing asked
of the network."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

import runs
from browsing import Visit
from etcfit.car_log import DriveLog, Series, study
from etcfit.reporting.car_log.writing import write_drive
from etcfit.reporting.page import write_page
from etcfit.rig.base import RigConfig
from independent import hunting

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytestmark = pytest.mark.slow


def report(folder: Path) -> Path:
    return write_page(runs.run_folder(folder, runs.LATER, lost=("B_L",))).path


def drive(folder: Path) -> Path:
    """Of a hunting log with duty and both sensors, its name as long as loggers make them."""
    rng = np.random.default_rng(2)
    plate, pid = hunting.drawn("stick-slip", rng)
    wanted = np.concatenate((hunting.staircase(rng, 16.0, 8.0), hunting.staircase(rng, 20.0, 0.8)))
    log = hunting.logged(rng, wanted, *hunting.run(plate, pid, wanted, 0.02, rng), 200.0, 0.05, 0.1)
    every = {name: Series(log["time"], log[name]) for name in ("position", "setpoint", "duty")}
    volts = {"sensor 1": 0.6 + 0.037 * log["position"], "sensor 2": np.maximum(4.5 - 0.06 * log["position"], 0.5)}
    others = {"duty": every["duty"]} | {name: Series(log["time"], value) for name, value in volts.items()}
    name = "2026-07-14_motorway_and_town_warm_engine_second_driver.csv"
    found = study(DriveLog(name, every["position"], every["setpoint"], {"setpoint": "TPS Target"}, others=others))
    write_drive(folder, RigConfig("car"), [found], lambda *_: None)
    return folder / "drive.html"


@pytest.mark.parametrize("width", [1280, 380])
@pytest.mark.parametrize(("write", "images"), [(report, 5), (drive, None)])
def test_it_is_whole_and_quiet(browser: Browser, tmp_path: Path, write, images: int | None, width: int) -> None:
    visit = Visit(browser, write(tmp_path), width)
    shown = visit.page
    assert shown.evaluate("document.documentElement.scrollWidth") <= width
    assert shown.evaluate("[...document.images].every((each) => each.complete && each.naturalWidth > 0)")
    assert images in (None, shown.locator("img").count())
    assert visit.said == []
    assert [url for url in visit.asked if not url.startswith(("file:", "data:"))] == []
    if write is drive:
        verdict = shown.locator(".verdict").first.bounding_box()
        assert verdict is not None
        assert verdict["y"] + verdict["height"] < 900  # seen at once
        assert shown.locator("table").count() == 5  # thresholds, steps, parts of the travel, duty, both sensors
        wide = "[...document.querySelectorAll('.scroll')].every((e) => e.getBoundingClientRect().right <= innerWidth)"
        assert shown.evaluate(wide)  # what is wider than the screen is scrolled within it
        letters = "[...document.querySelectorAll('td, p, li')].map((e) => parseFloat(getComputedStyle(e).fontSize))"
        assert min(shown.evaluate(letters)) >= 12.0


def test_a_complaint_would_be_heard(browser: Browser, tmp_path: Path) -> None:
    bad = tmp_path / "bad.html"
    bad.write_text("<!doctype html><body><script>console.error('spoilt')</script></body>", encoding="utf-8")
    assert Visit(browser, bad).said == ["spoilt"]
