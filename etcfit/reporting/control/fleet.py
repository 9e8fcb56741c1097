"""How the proposed gains fare on the units of a fleet, for stdout."""

from __future__ import annotations

from rich.console import Group, RenderableType
from rich.text import Text

from ...control.design import Design
from ...control.loop_figures import FIGURES
from ...control.on_units import STABLE, OddOne, Share
from ..blocks import headed, plain_table
from ..numbers import short

_NAMED = 12  # units in a line
_OF = FIGURES | {STABLE: FIGURES["gain_margin_db"]}


def of_models(design: Design) -> str:
    """What the models are that judge gains beside the nominal one."""
    return "units" if design.origin == "fleet" else "draws"


def fleet_table(design: Design) -> RenderableType | None:
    """Share that meets everything, what the others miss, and the worst units; None for a design of one unit."""
    found = design.fleet
    if found is None:
        return None
    lines = [found.says, f"so of {share_in_words(found.share)} of such units"]
    if found.future is not None:
        lines.append(f"of {found.future.of} units drawn from the population, which the search did not know, "
                     f"{found.future.met} do: {share_in_words(found.future)}")  # fmt: skip
    lines += [f"{_OF[symbol].name} missed by {len(units)}: {some_of(units)}" for symbol, units in found.fails.items()]
    table = plain_table("worst units", "hardest for it", "figure", "limit", "meets all")
    for each in found.worst:
        table.add_row(*hardest(each))
    said = (Text(f"  {line}") for line in lines)
    return headed(f"{design.chosen.rule} on every unit of the fleet", Group(*said, table))


def share_in_words(share: Share) -> str:
    """With its 95 % interval."""
    return f"{100.0 * share.value:.1f} % (95 %: {100.0 * share.low:.1f} to {100.0 * share.high:.1f} %)"


def some_of(units: tuple[str, ...]) -> str:
    """Names, no more than a line takes."""
    more = f" and {len(units) - _NAMED} more" if len(units) > _NAMED else ""
    return ", ".join(units[:_NAMED]) + more


def hardest(each: OddOne) -> tuple[str, ...]:
    """Columns of a table: unit, requirement, figure, limit, whether it meets everything."""
    of = _OF[each.requirement]
    figure, limit = (f"{short(value)} {of.unit}" for value in (each.figure, each.limit))
    return (each.unit, of.name, figure, limit, "yes" if each.meets else "no")
