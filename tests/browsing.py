"""A page in a real browser: what it complained of, what it asked the network for, and waiting for what it draws."""

from __future__ import annotations

import shutil
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from playwright.sync_api import Browser

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

    def settle(self) -> None:
        self.page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
