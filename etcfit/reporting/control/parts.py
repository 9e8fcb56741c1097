"""How gains fare on the parts of a design, for stdout."""

from __future__ import annotations

import numpy as np
from rich.console import Group, RenderableType
from rich.text import Text

from ...control.design import Design
from ...control.on_units import OnParts, PartsVerdict, Share
from ..blocks import headed, plain_table
from ..numbers import short
from .fleet import hardest, share_in_words, some_of


def parts_table(design: Design) -> RenderableType | None:
    """Every rule on measured and drawn units, the worst unit by name; None where no fleet tells the parts."""
    found = design.parts
    if found is None:
        return None
    drawn = next(iter(found.rules.values())).drawn.units
    counts = f"met by of\n{len(found.units)} units", f"\n{len(drawn)} drawn"
    share = plain_table("rule", *counts, "largest RMSE %\nunits", "\ndrawn")
    worst = plain_table("rule", "worst unit", "hardest for it", "figure", "limit")
    for name, each in found.rules.items():
        largest = (short(float(np.max(on.figures.rmse_pct))) for on in each)
        share.add_row(name, *(_share(on.share) for on in each), *largest)
        worst.add_row(name, *hardest(each.worst)[:4])
    said = (Text(f"  {line}") for line in _words(design, found))
    return headed(f"On the parts of {found.name}", Group(share, Text(), worst, *said))


def _share(share: Share) -> str:
    return f"{100.0 * share.value:.1f} %"


def _words(design: Design, found: PartsVerdict) -> list[str]:
    """How to read it, and how the proposed gains fare outside the bench."""
    chosen = found.rules[design.chosen.rule]
    said = [
        "share that meets everything by a stable loop: of the measured units by their shrunk values, and of units "
        f"drawn from the population of {found.where}; optimal is sought over the latter",
        f"{design.chosen.rule}: {share_in_words(chosen.drawn.share)} of such parts",
        *_fails(chosen),
        f"outside the bench: {found.share_at_corners.met} of {found.share_at_corners.of} units meet everything at "
        f"every corner of supply, winding and friction; {_share(found.anywhere.share)} of the drawn ones do, each "
        "under conditions of its own",
        _hardest_corner(found),
        f"not told by the fleet, taken from the run: {', '.join(found.of_run) or 'nothing'}",
    ]
    return said + [f"not judged: {unit}, {why}" for unit, why in found.left_out.items()]


def _fails(chosen: OnParts) -> list[str]:
    return [f"{symbol.replace('_', ' ')} missed by {len(units)}: {some_of(units)}"
            for symbol, units in chosen.measured.fails.items()]  # fmt: skip


def _hardest_corner(found: PartsVerdict) -> str:
    place, requirement, figure, limit, meets = hardest(found.corners.named(1)[0])
    verdict = "met all the same" if meets == "yes" else "missed"
    return f"hardest: {place}: {requirement} {figure}, asked {limit}: {verdict}"
