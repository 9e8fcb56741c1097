"""One picture of it all: what was named for what is there, and how much better the model predicts."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from independent import CATALOGUE, OUTSIDE

from .verdicts import NEAR, Record, counted, is_clear, least_left, of_kind

_KINDS = ("clean", "single", "pair", "outside")
_SPREAD = 0.32  # half width of a kind's cloud of points


def picture(records: Sequence[Record], path: Path) -> None:
    """Left the confusion matrix of what is clear to see, right the held-out error of every folder before and after."""
    from etcfit.reporting import style

    with style.drawing():
        fig = style.figure(15.0, 8.6, synthetic=True)
        matrix, errors = fig.subplots(1, 2, width_ratios=[2.1, 1.0])
        _matrix(matrix, records)
        _errors(errors, records)
        title = f"What etcfit diagnose says of {len(records)} folders whose missing physics is known"
        fig.suptitle(title, x=0.015, ha="left", fontsize=13)
        fig.tight_layout(rect=(0.0, 0.0, 1.0, 0.96))
        style.save(fig, path)


def _matrix(panel: Any, records: Sequence[Record]) -> None:
    from etcfit.reporting import style

    rows = ("clean", *CATALOGUE, *OUTSIDE)
    clear = counted([r for r in records if is_clear(r)])
    others = sorted({column for _, column in clear} - {"-", *CATALOGUE})
    columns = ("-", *CATALOGUE, *others)
    for (row, column), count in clear.items():
        right = row == column or (column == "-" and row in ("clean", *OUTSIDE))
        missed = column == "-" and row in CATALOGUE
        colour = style.DRIVE if right else style.BAND if missed else style.SIMULATED
        x, y = columns.index(column), rows.index(row)
        panel.add_patch(_square(x, y, colour))
        panel.text(x, y, str(count), ha="center", va="center", fontsize=10, color="black" if missed else "white")
    panel.set_xlim(-0.5, len(columns) - 0.5)
    panel.set_ylim(len(rows) - 0.5, -0.5)
    panel.set_xticks(range(len(columns)), ["nothing", *(c.replace("_", " ") for c in columns[1:])], rotation=90)
    panel.set_yticks(range(len(rows)), [r.replace("_", " ") for r in rows])
    panel.axhline(0.5, color=style.MEASURED, lw=0.8)
    panel.axhline(len(CATALOGUE) + 0.5, color=style.MEASURED, lw=0.8)
    panel.set_ylabel("in the folder (medium or high; last five: outside the catalogue)")
    panel.set_xlabel("named first: green right, grey missed, orange wrong")


def _square(x: int, y: int, colour: str) -> Any:
    from matplotlib.patches import Rectangle

    return Rectangle((x - 0.46, y - 0.46), 0.92, 0.92, color=colour, lw=0)


def _errors(panel: Any, records: Sequence[Record]) -> None:
    from etcfit.reporting import style

    for k, kind in enumerate(_KINDS):
        chosen = of_kind(records, kind)
        if not chosen:
            continue
        x = k + np.linspace(-_SPREAD, _SPREAD, len(chosen)) if len(chosen) > 1 else np.array([float(k)])
        least = np.array([least_left(r, ("position",)) for r in chosen])
        before, after = (np.array([r[w]["holdout_position"] for r in chosen]) / least for w in ("before", "after"))
        order = np.argsort(before)
        panel.vlines(x, after[order], before[order], color=style.BAND, lw=1.2, zorder=1)
        for ratio, colour, label in ((before, style.BEFORE, "Eqs. 1-2"), (after, style.AFTER, "after the loop")):
            panel.plot(x, ratio[order], "o", ms=4, color=colour, label=label if k == 0 else None, zorder=2)
    panel.axhline(NEAR, color=style.MEASURED, lw=0.8, ls="--", label=f"{NEAR}")
    panel.set_yscale("log")
    panel.set_xticks(range(len(_KINDS)), ["clean", "one effect", "two effects", "outside"])
    panel.set_ylabel("held-out position error / what the body itself leaves [1]")
    panel.legend(loc="upper left")
