"""A page that carries its data, as a parser reads it: tags, words, scripts, and the numbers that its script unpacks."""

from __future__ import annotations

import base64
import json
from html.parser import HTMLParser
from typing import Any

import numpy as np

VOID = {"meta", "link", "img", "br", "wbr", "hr", "input", "progress"}


class Reader(HTMLParser):
    """Tags with their attributes, the words between them, what stands in scripts and styles; tags close in turn."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.inside: list[tuple[str, dict[str, str | None], str]] = []
        self.words: list[str] = []
        self.within, self.open, self.source = "", list[str](), page
        self.feed(page)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        self.within = tag
        self.open += [] if tag in VOID else [tag]

    def handle_endtag(self, tag: str) -> None:
        assert tag in VOID or self.open.pop() == tag
        self.within = ""

    def handle_data(self, data: str) -> None:
        if self.within in ("script", "style"):
            self.inside.append((*self.tags[-1], data))
        else:
            self.words.append(data)

    @property
    def text(self) -> str:
        """The words, their blanks as one."""
        return " ".join(" ".join(self.words).split())

    @property
    def lines(self) -> str:
        """The words, in the lines of the page's source."""
        return "\n".join(filter(None, (" ".join(line.split()) for line in " ".join(self.words).split("\n"))))

    def of(self, tag: str) -> list[dict[str, str | None]]:
        """Attributes of each such tag."""
        return [attributes for name, attributes in self.tags if name == tag]

    @property
    def data(self) -> dict[str, Any]:
        (text,) = [data for _, attributes, data in self.inside if attributes.get("type") == "application/json"]
        return json.loads(text)


def unpacked(pack: dict[str, Any]) -> np.ndarray:
    """Numbers as the page reads them."""
    if "f32" in pack:
        return pack["from"] + np.frombuffer(base64.b64decode(pack["f32"]), "<f4").astype(float)
    if "i32" in pack:
        return np.frombuffer(base64.b64decode(pack["i32"]), "<i4")
    level = np.frombuffer(base64.b64decode(pack["i16"]), "<i2").astype(float)
    return np.where(level == -32768, np.nan, pack["zero"] + pack["step"] * level)


def assert_asks_for_nothing(page: Reader, code: str, *below: str) -> None:
    """Nothing is loaded but what is in the page or `below` it; no script or style reaches for a network or a store."""
    loads = [a[name] for _, a in page.tags for name in ("src", "href", "srcset", "action", "data") if a.get(name)]
    assert loads
    assert all(each is not None and each.startswith(("#", "data:", *below)) for each in loads)
    styles = "".join(data for tag, _, data in page.inside if tag == "style")
    for word in ("url(", "@import", "fetch(", "XMLHttpRequest", "WebSocket", "sendBeacon", "localStorage", "http:",
                 "https:"):  # fmt: skip
        assert word not in styles + code
