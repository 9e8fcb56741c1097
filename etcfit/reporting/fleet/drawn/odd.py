"""Odd units, the oddest first: how far each is from the population, and why."""

from __future__ import annotations

import textwrap

import numpy as np
from matplotlib.figure import Figure

from ..words import Content
from .frame import ODD, frame

_MOST = 20
_WIDE = 68  # letters of a reason in a line


def draw(content: Content) -> Figure:
    """A bar a unit, with its reason beside it."""
    odd = content["odd"][:_MOST]
    count = len(content["odd"])
    words = f"{count:,} odd unit{'' if count == 1 else 's'}" + (f", the {_MOST} oddest" if count > _MOST else "")
    fig, (panel,) = frame(content, words, (12.0, 1.5 + 0.52 * len(odd)), (1, 1))
    distance = np.array([each["distance"] for each in odd], dtype=float)
    most = float(distance.max())
    panel.barh(range(len(odd)), distance, height=0.55, color=ODD)
    for row, each in enumerate(odd):
        why = textwrap.shorten(each["why"], 2 * _WIDE, placeholder=" ...")
        panel.text(distance[row] + 0.02 * most, row, "\n".join(textwrap.wrap(why, _WIDE)), va="center", fontsize=9.5)
    panel.set_yticks(range(len(odd)), [each["unit"] for each in odd])
    panel.set_ylim(len(odd) - 0.4, -0.6)
    panel.set_xlim(0.0, 2.6 * most)
    panel.set_xticks([tick for tick in panel.get_xticks() if tick <= 1.05 * most])
    panel.set_xlabel("Mahalanobis distance from the population", loc="left")
    panel.grid(visible=False, axis="y")
    return fig
