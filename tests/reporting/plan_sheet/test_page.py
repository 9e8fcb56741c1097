"""The procedure sheet: self-contained, without scripts, with all that a person at the bench must know."""

from __future__ import annotations

import base64
import io
from dataclasses import replace
from pathlib import Path

import pytest
from PIL import Image

import campaigns
import results
from etcfit.experiment.campaign import Campaign
from etcfit.reporting.plan_sheet import write_sheet
from golden import check_view
from pages import Reader


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    return campaigns.campaign(results.rig(tmp_path_factory.mktemp("rig")))


@pytest.fixture(scope="module")
def page(plan: Campaign, tmp_path_factory: pytest.TempPathFactory) -> Reader:
    return Reader(write_sheet(tmp_path_factory.mktemp("plan"), plan).read_text(encoding="utf-8"))


def test_it_needs_nothing_from_elsewhere_and_runs_nothing(page: Reader) -> None:
    assert page.of("script") == []
    links = [a[name] or "" for _, a in page.tags for name in ("src", "href") if name in a]
    assert all(link.startswith(("data:", "#")) for link in links)
    pictures = [link for link in links if link.startswith("data:image/png")]
    assert len(pictures) == 3
    for picture in pictures:
        with Image.open(io.BytesIO(base64.b64decode(picture.partition(",")[2]))) as image:
            assert image.width > 800


def test_it_says_what_a_person_at_the_bench_must_know(page: Reader) -> None:
    check_view("pages/plan.txt", page.lines)


def test_what_is_measured_is_not_called_synthetic(plan: Campaign, tmp_path: Path) -> None:
    measured = replace(plan, rig=replace(plan.rig, config=replace(plan.rig.config, synthetic=False, name="<b>x</b>")))
    page = Reader(write_sheet(tmp_path, replace(measured, tests=plan.tests[1:2])).read_text(encoding="utf-8"))
    assert "SYNTHETIC" not in page.text
    assert "<b>x</b>: test procedure" in page.text
    assert page.of("b") == []
