"""The page in a real browser: nothing on the console, every picture loaded, nothing wider than the screen."""

from __future__ import annotations

import re
import subprocess
from html import escape
from pathlib import Path

import pytest

import runs
from browsing import CHROMIUM
from etcfit.reporting.page import write_page

FLAGS = ("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync",
         "--disable-background-networking", "--disable-component-update", "--hide-scrollbars",
         "--enable-logging=stderr")  # fmt: skip
# the page as it is, in a frame of any width (a window has a least one), beside a script that counts
PROBE = """<!doctype html><title></title><iframe style="border:0;width:{width}px;height:900px" srcdoc="{page}"></iframe>
<script>addEventListener("load", () => {{
  const shown = document.querySelector("iframe").contentDocument, images = [...shown.images];
  const loaded = images.filter(image => image.complete && image.naturalWidth > 0).length;
  document.title = `images ${{loaded}}/${{images.length}} width ${{shown.documentElement.scrollWidth}}`;
}});</script>"""


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on PATH; test_page.py reads the page without one")
@pytest.mark.slow
@pytest.mark.parametrize("width", [1280, 390])
def test_a_browser_shows_it_all_without_complaint(tmp_path: Path, width: int) -> None:
    page = write_page(runs.run_folder(tmp_path, runs.LATER, lost=("B_L",))).path
    assert "CONSOLE" not in _visit(page, tmp_path / "first").stderr
    probe = tmp_path / "probe.html"
    probe.write_text(PROBE.format(width=width, page=escape(page.read_text(encoding="utf-8"))), encoding="utf-8")
    title = re.search(r"<title>(.*?)</title>", _visit(probe, tmp_path / "second").stdout)
    assert title
    assert title[1] == f"images 5/5 width {width}"


@pytest.mark.slow
def test_the_probe_would_see_a_complaint(tmp_path: Path) -> None:
    if CHROMIUM is None:
        pytest.skip("no chromium on PATH")
    bad = tmp_path / "bad.html"
    bad.write_text("<!doctype html><body><script>console.error('spoilt')</script></body>", encoding="utf-8")
    assert "CONSOLE" in _visit(bad, tmp_path / "profile").stderr


def _visit(page: Path, profile: Path) -> subprocess.CompletedProcess[str]:
    assert CHROMIUM
    words = [CHROMIUM, *FLAGS, f"--user-data-dir={profile}", "--window-size=1400,900", "--dump-dom", page.as_uri()]
    return subprocess.run(words, capture_output=True, text=True, check=True, timeout=120)
