"""The page put together: template, style, scripts and data in one file."""

from __future__ import annotations

from importlib.resources import files
from typing import Any

from ..html import environment
from ..page.verdict import NOISE
from .content import as_text
from .lights import FAR

# in the order in which they run; each is plain JavaScript that puts what others need into `etcfit`
SCRIPTS = ("effects.js", "stepper.js", "trace_run.js", "loop_run.js", "decode.js", "numbers.js", "chart.js", "list.js",
           "sliders.js", "trace_view.js", "loop_view.js", "main.js")  # fmt: skip
LIBRARY = "vendor/uPlot.iife.min.js"
_LICENCE = "vendor/uPlot.LICENSE.txt"
_STYLES = ("vendor/uPlot.min.css", "style.css")


def part(name: str) -> str:
    """A file of the page's own folder."""
    return (files("etcfit.reporting.interactive") / "page" / name).read_text(encoding="utf-8")


def render(data: dict[str, Any]) -> str:
    """The whole page, HTML.

    Args:
        data: see `content`.
    """
    return (
        environment(("etcfit.reporting.interactive", "page"))
        .get_template("page.html")
        .render(
            data=data,
            text=as_text(data),
            styles=[part(name) for name in _STYLES],
            scripts=[part(name) for name in (LIBRARY, *SCRIPTS)],
            licence=part(_LICENCE),
            noise=f"{NOISE:g}",
            far=f"{FAR:g}",
        )
    )
