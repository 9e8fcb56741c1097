"""The procedure sheet: self-contained, without scripts, with all that a person at the bench must know."""

from __future__ import annotations

import base64
import io
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest
from PIL import Image

import campaigns
import results
from etcfit.experiment.campaign import Campaign
from etcfit.reporting.blocks import render
from etcfit.reporting.plan_sheet import plan_table, write_sheet


class Page(HTMLParser):
    """Tags, pictures and text."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.links: list[str] = []
        self.said: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.links += [value or "" for name, value in attrs if name in ("src", "href")]

    def handle_data(self, data: str) -> None:
        self.said.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.said).split())


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    return campaigns.campaign(results.rig(tmp_path_factory.mktemp("rig")))


@pytest.fixture(scope="module")
def page(plan: Campaign, tmp_path_factory: pytest.TempPathFactory) -> Page:
    return Page(write_sheet(tmp_path_factory.mktemp("plan"), plan).read_text(encoding="utf-8"))


def test_it_needs_nothing_from_elsewhere_and_runs_nothing(page: Page) -> None:
    assert "script" not in page.tags
    assert all(link.startswith(("data:", "#")) for link in page.links)
    pictures = [link for link in page.links if link.startswith("data:image/png")]
    assert len(pictures) == 3
    for picture in pictures:
        with Image.open(io.BytesIO(base64.b64decode(picture.partition(",")[2]))) as image:
            assert image.width > 800


@pytest.mark.parametrize(
    "said",
    [
        "SYNTHETIC DATA",
        "Fingers.",
        "Fuse. 5.0 A",
        "Heat. The winding is expected to reach 45 °C (heat capacity assumed: 6 J/K)",
        "The fit did not converge.",
        "Test 1: Driven response",
        "Bridge disconnected",
        "it slams shut",
        "Gear apart: the motor runs alone",
        "must touch no stop",
        "measurements/back_emf/plan_2.csv",
        "play/plan_1/plan_1.ino",
        "then wait 12 s",
        "Motor speed not logged so far: noise assumed.",
        "resolution or finer",
        "current [mA]",
    ],
)
def test_it_says_what_a_person_at_the_bench_must_know(page: Page, said: str) -> None:
    assert said in page.text


def test_what_is_measured_is_not_called_synthetic(plan: Campaign, tmp_path: Path) -> None:
    measured = replace(plan, rig=replace(plan.rig, config=replace(plan.rig.config, synthetic=False, name="<b>x</b>")))
    page = Page(write_sheet(tmp_path, replace(measured, tests=plan.tests[1:2])).read_text(encoding="utf-8"))
    assert "SYNTHETIC" not in page.text
    assert "<b>x</b>: test procedure" in page.text
    assert "b" not in page.tags


def test_the_table_names_tests_and_what_they_tell(plan: Campaign) -> None:
    text = render(plan_table(plan))
    for said in ("SYNTHETIC DATA", "response/plan_1.csv", "series_ohm.inductance", "0.34", "6.0 A, limit 5 A", "45"):
        assert said in text
