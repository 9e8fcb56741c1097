"""A page in a real browser: what it complained of, what it asked the network for, and waiting for what it draws."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Locator

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


class Visit:
    """A page in a window of some width, in a light or a dark dress."""

    ready = "true"  # JavaScript: whether there is something to look at

    def __init__(self, browser: Browser, path: Path, width: int = 1300, scheme: str = "light") -> None:
        context = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme)  # pyright: ignore[reportArgumentType]
        self.page = context.new_page()
        self.said: list[str] = []
        self.asked: list[str] = []
        self.page.on("console", lambda message: self.said.append(message.text))
        self.page.on("pageerror", lambda error: self.said.append(str(error)))
        self.page.on("request", lambda request: self.asked.append(request.url))
        self.page.goto(path.as_uri())
        self.until(self.ready)
        self.settle()

    def until(self, true: str) -> None:
        """Wait for it; `wait_for_function` asks again by `eval`, which the page's policy forbids."""
        end = monotonic() + 30.0
        while not self.page.evaluate(true):
            assert monotonic() < end, f"never true: {true}"
            self.page.wait_for_timeout(20.0)

    def mark(self, name: str) -> float:
        """When the page came to a mark, ms from its request."""
        self.until(f"performance.getEntriesByName('{name}').length")
        return float(self.page.evaluate(f"performance.getEntriesByName('{name}')[0].startTime"))

    def drag(self, over: Locator) -> None:
        """Over the second quarter of a chart's width."""
        box = over.bounding_box()
        assert box
        self.page.mouse.move(box["x"] + 0.25 * box["width"], box["y"] + 20)
        self.page.mouse.down()
        self.page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 25, steps=5)
        self.page.mouse.up()
        self.settle()

    def check_names(self, *kinds: str) -> int:
        """Every control of these kinds has a name, and every chart words; how many charts there are."""
        for kind in kinds:
            assert self.page.get_by_role(kind).count() > 0  # pyright: ignore[reportArgumentType]
            assert self.page.get_by_role(kind, name="", exact=True).count() == 0  # pyright: ignore[reportArgumentType]
        named = self.page.eval_on_selector_all(".chart", "(all) => all.map((each) => each.getAttribute('aria-label'))")
        assert all(named)
        return len(named)

    def check_contrast(self, names: str, papers: str, least: float) -> None:
        """Of colours by their names on the page; WCAG 2.2."""
        colours = {name: self.page.evaluate(f"etcfit.colour('{name}')") for name in f"{names} {papers}".split()}
        ratios = {(name, paper): contrast(colours[name], colours[paper])
                  for name in names.split() for paper in papers.split()}  # fmt: skip
        assert {pair: ratio for pair, ratio in ratios.items() if ratio < least} == {}

    def settle(self) -> None:
        self.page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")


def contrast(one: str, other: str) -> float:
    """Ratio of relative luminances of two colours, WCAG 2.2."""
    light, dark = sorted(map(_luminance, (one, other)), reverse=True)
    return (light + 0.05) / (dark + 0.05)


def _luminance(colour: str) -> float:
    red, green, blue = (s / 12.92 if s <= 0.04045 else ((s + 0.055) / 1.055) ** 2.4 for s in _shares(colour))
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def _shares(colour: str) -> list[float]:
    """Shares of red, green and blue, from #abc, #aabbcc, rgb(...) or color(srgb ...)."""
    if colour.startswith("#"):
        digits = colour[1:] if len(colour) == 7 else "".join(2 * c for c in colour[1:])
        return [int(digits[k : k + 2], 16) / 255.0 for k in (0, 2, 4)]
    numbers = [float(each) for each in re.findall(r"[\d.]+(?:e-?\d+)?", colour)[:3]]
    return numbers if colour.startswith("color(") else [each / 255.0 for each in numbers]
