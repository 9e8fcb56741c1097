"""RUN/fleet.html: one self-contained page to work with; everything of a fleet, up to ten thousand units."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ...files import whole
from ..html import environment
from ..page import typeset
from ..standalone import LIBRARY, LIBRARY_STYLE, LICENCE, Parts, as_text
from .content import carried
from .words import JUDGEMENT, Content, Judgement, title, verdict

if TYPE_CHECKING:
    import pandas as pd

NAME = "fleet.html"
# in the order in which they run; each is plain JavaScript that puts what others need into `etcfit`
SCRIPTS = ("decode.js", "numbers.js", "theme.js", "store.js", "panel.js", "points.js", "bars.js", "filters.js",
           "card.js", "sections.js", "main.js")  # fmt: skip
_STYLES = (LIBRARY_STYLE, "base.css", "fleet.css")
_ROOM = ("etcfit.reporting.fleet", "template")

part = Parts((_ROOM,))


def write_fleet_page(run: Path, content: Content, units: pd.DataFrame, judgement: Judgement = JUDGEMENT) -> Path:
    """Write RUN/fleet.html, whole or not at all.

    Args:
        run: the run folder.
        content: fleet.json.
        units: units.parquet.
        judgement: when a figure is called bad.
    Returns:
        The page.
    """
    page = render(content, units, judgement)
    path = run / NAME
    with whole(path) as draft:
        draft.write_text(page, encoding="utf-8")
    return path


def render(content: Content, units: pd.DataFrame, judgement: Judgement = JUDGEMENT) -> str:
    """The whole page, HTML: words and tables stand in it, what is drawn is drawn from the data by its scripts."""
    return (
        environment(_ROOM)
        .get_template("fleet.html")
        .render(
            fleet=content,
            title=title(content),
            verdict=verdict(content, judgement),
            judgement=judgement,
            symbol=typeset.symbol,
            unit=typeset.unit,
            number=typeset.number,
            measured=typeset.measured,
            span=typeset.span,
            text=as_text(carried(content, units)),
            styles=part.every(_STYLES),
            scripts=part.every((LIBRARY, *SCRIPTS)),
            licence=part(LICENCE),
        )
    )
