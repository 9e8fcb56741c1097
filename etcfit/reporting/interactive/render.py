"""The page put together: template, style, scripts and data in one file."""

from __future__ import annotations

from typing import Any

from ...estimation.goodness import STRAYS
from ...estimation.settings import ContradictionSettings
from ..html import environment
from ..standalone import LIBRARY, LIBRARY_STYLE, LICENCE, Parts, as_text

# in the order in which they run, after the printed model; each is plain JavaScript that puts what others need into
# `etcfit`
SCRIPTS = ("trace_run.js", "loop_run.js", "decode.js", "numbers.js", "theme.js", "chart.js",
           "list.js", "sliders.js", "trace_view.js", "loop_view.js", "main.js")  # fmt: skip
_STYLES = (LIBRARY_STYLE, "base.css", "style.css")
_ROOM = ("etcfit.reporting.interactive", "page")

_FAR = ContradictionSettings().compromise

part = Parts((_ROOM,))


def render(data: dict[str, Any], model: str) -> str:
    """The whole page, HTML.

    Args:
        data: see `content`.
        model: the script that simulates, see `printed_model`.
    """
    return (
        environment(_ROOM)
        .get_template("page.html")
        .render(
            data=data,
            text=as_text(data),
            styles=part.every(_STYLES),
            scripts=[model, *part.every((LIBRARY, *SCRIPTS))],
            licence=part(LICENCE),
            strays=f"{STRAYS:g}",
            far=f"{_FAR:g}",
        )
    )
