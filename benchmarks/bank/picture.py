"""One picture: every rate with its interval beside its target."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from .judging import Record
from .rates import RATES, interval


def picture(records: Sequence[Record], path: Path) -> None:
    """A row a rate: the point is the share, the line its 95 % interval, the bar what is asked."""
    from etcfit.reporting import style

    asked = [(rate, flags) for rate in RATES if (flags := rate.of(records))]
    with style.drawing():
        fig = style.figure(10.5, 1.3 + 0.32 * len(asked), synthetic=True)
        panel = fig.subplots()
        for y, (rate, flags) in enumerate(asked):
            share, (low, high) = 100.0 * sum(flags) / len(flags), interval(flags)
            if rate.low is not None and rate.high is not None:
                panel.barh(
                    y, 100.0 * (rate.high - rate.low), 0.7, 100.0 * rate.low, color=style.BEFORE, alpha=0.45, lw=0
                )
            missed, few = "missed" in rate.verdict(flags), "few" in rate.verdict(flags)
            colour = style.FAILED if missed else style.MEASURED
            panel.plot([100.0 * low, 100.0 * high], [y, y], color=colour, lw=1.6)
            panel.plot(share, y, "s" if missed else "o", color=colour, mfc="white" if few else colour, ms=6)
            panel.text(103.0, y, f"{sum(flags)}/{len(flags)}", va="center", fontsize=9, color=colour)
        panel.set_yticks(range(len(asked)), [rate.words.replace("`", "") for rate, _ in asked], fontsize=9)
        panel.set_ylim(len(asked) - 0.4, -0.6)
        panel.set_xlim(-1.0, 102.0)
        panel.set_xlabel(
            "share [%]; bar: asked; line: 95 % interval; red square: missed; hollow: too few folders to tell"
        )
        fig.suptitle(f"The bank: {len(records)} folders whose truth is known", x=0.015, ha="left", fontsize=13)
        fig.tight_layout(rect=(0.0, 0.0, 0.97, 0.97))
        style.save(fig, path)
