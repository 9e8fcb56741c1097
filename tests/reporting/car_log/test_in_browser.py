"""The page of some logs in a browser, as wide as a desk and as a telephone: verdict at once, nothing cut, nothing asked
of the network."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from etcfit.car_log import DriveLog, Series, study
from etcfit.reporting.car_log.writing import write_drive
from etcfit.rig.base import RigConfig
from independent import hunting

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of a hunting log with duty and both sensors, its name as long as loggers make them."""
    run, rng = tmp_path_factory.mktemp("run"), np.random.default_rng(2)
    plate, pid = hunting.drawn("stick-slip", rng)
    wanted = np.concatenate((hunting.staircase(rng, 16.0, 8.0), hunting.staircase(rng, 20.0, 0.8)))
    log = hunting.logged(rng, wanted, *hunting.run(plate, pid, wanted, 0.02, rng), 200.0, 0.05, 0.1)
    every = {name: Series(log["time"], log[name]) for name in ("position", "setpoint", "duty")}
    volts = {"sensor 1": 0.6 + 0.037 * log["position"], "sensor 2": np.maximum(4.5 - 0.06 * log["position"], 0.5)}
    others = {"duty": every["duty"]} | {name: Series(log["time"], value) for name, value in volts.items()}
    name = "2026-07-14_motorway_and_town_warm_engine_second_driver.csv"
    found = study(DriveLog(name, every["position"], every["setpoint"], {"setpoint": "TPS Target"}, others=others))
    write_drive(run, RigConfig("car"), [found], lambda *_: None)
    return run / "drive.html"


@pytest.mark.parametrize("width", [1280, 380])
def test_the_verdict_is_seen_at_once_and_nothing_is_cut(browser: Browser, page: Path, width: int) -> None:
    context = browser.new_context(viewport={"width": width, "height": 900})
    shown = context.new_page()
    said: list[str] = []
    asked: list[str] = []
    shown.on("console", lambda message: said.append(message.text))
    shown.on("request", lambda request: asked.append(request.url))
    shown.goto(page.as_uri())
    assert shown.evaluate("document.documentElement.scrollWidth") <= width
    verdict = shown.locator(".verdict").first.bounding_box()
    assert verdict is not None
    assert verdict["y"] + verdict["height"] < 900
    assert shown.locator("table").count() == 5  # thresholds, steps, parts of the travel, duty, both sensors
    assert shown.evaluate("[...document.images].every((each) => each.complete && each.naturalWidth > 0)")
    wide = "[...document.querySelectorAll('.scroll')].every((each) => each.getBoundingClientRect().right <= innerWidth)"
    assert shown.evaluate(wide)  # what is wider than the screen is scrolled within it
    letters = "[...document.querySelectorAll('td, p, li')].map((e) => parseFloat(getComputedStyle(e).fontSize))"
    assert min(shown.evaluate(letters)) >= 12.0
    assert said == []
    assert [url for url in asked if not url.startswith(("file:", "data:"))] == []
    context.close()
