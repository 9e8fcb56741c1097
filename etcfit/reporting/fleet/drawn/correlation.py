"""Which parameters go together: the correlation between units as a matrix."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ..words import Content
from .frame import frame

_WRITTEN = 16  # symbols up to which the numbers stand in the cells


def draw(content: Content) -> Figure:
    """Blue together, red against each other; a cell whose correlation is not known is empty."""
    names = content["correlation"]["symbols"]
    rows = content["correlation"]["matrix"]
    matrix = np.array([[np.nan if r is None else r for r in row] for row in rows], dtype=float)
    side = max(4.2, 1.6 + 0.62 * len(names))
    fig, (panel,) = frame(content, "correlation between units", (max(6.5, side + 1.2), side + 0.4), (1, 1))
    image = panel.imshow(matrix, vmin=-1.0, vmax=1.0, cmap="RdBu")
    panel.set_xticks(range(len(names)), names, rotation=45 if len(names) > 10 else 0)
    panel.set_yticks(range(len(names)), names)
    panel.grid(visible=False)
    for spine in panel.spines.values():
        spine.set_visible(False)
    if len(names) <= _WRITTEN:
        for (row, column), r in np.ndenumerate(matrix):
            if np.isfinite(r):
                panel.text(column, row, f"{r:.2f}".replace("-0.00", "0.00"), ha="center", va="center", fontsize=10,
                           color="white" if abs(r) > 0.65 else "black")  # fmt: skip
    fig.colorbar(image, ax=panel, label="correlation", shrink=0.8)
    return fig
