"""What is required of gains, and how they fare in scenarios, outside the bench, on a fleet, on parts; for stdout."""

from __future__ import annotations

import numpy as np
from rich.console import Group, RenderableType
from rich.text import Text

from ...control.design import Design
from ...control.loop_figures import FIGURES, MARGINS, OF_THE_PAPER, REQUIRED, TRACKING, Requirements
from ...control.on_units import STABLE, OddOne, PartsVerdict, Share
from ...errors import first_names
from ...run_folder.pid import design_json
from ..blocks import filled, headed, plain_table
from ..numbers import short
from .sentence import sentence

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
    lines += [
        f"{_OF[symbol].name} missed by {len(units)}: {first_names(units, _NAMED)}"
        for symbol, units in found.fails.items()
    ]
    worst = filled(("worst units", "hardest for it", "figure", "limit", "meets all"), map(hardest_cells, found.worst))
    said = (Text(f"  {line}") for line in lines)
    return headed(f"{design.chosen.rule} on every unit of the fleet", Group(*said, worst))


def share_in_words(share: Share) -> str:
    """With its 95 % interval."""
    return f"{100.0 * share.value:.1f} % (95 %: {100.0 * share.low:.1f} to {100.0 * share.high:.1f} %)"


def hardest_cells(each: OddOne) -> tuple[str, ...]:
    """Columns of a table: unit, requirement, figure, limit, whether it meets everything."""
    of = _OF[each.requirement]
    figure, limit = (f"{short(value)} {of.unit}" for value in (each.figure, each.limit))
    return (each.unit, of.name, figure, limit, "yes" if each.meets else "no")


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
        worst.add_row(name, *hardest_cells(each.worst)[:4])
    said = (Text(f"  {line}") for line in _words(design, found))
    return headed(f"On the parts of {found.name}", Group(share, Text(), worst, *said))


def _share(share: Share) -> str:
    return f"{100.0 * share.value:.1f} %"


def _words(design: Design, found: PartsVerdict) -> list[str]:
    """How to read it, and how the proposed gains fare outside the bench."""
    chosen = found.rules[design.chosen.rule]
    place, requirement, figure, limit, meets = hardest_cells(found.corners.named(1)[0])
    verdict = "met all the same" if meets == "yes" else "missed"
    said = [
        "share that meets everything by a stable loop: of the measured units by their shrunk values, and of units "
        f"drawn from the population of {found.where}; optimal is sought over the latter",
        f"{design.chosen.rule}: {share_in_words(chosen.drawn.share)} of such parts",
        *(
            f"{symbol.replace('_', ' ')} missed by {len(units)}: {first_names(units, _NAMED)}"
            for symbol, units in chosen.measured.fails.items()
        ),
        f"outside the bench: {found.share_at_corners.met} of {found.share_at_corners.of} units meet everything at "
        f"every corner of supply, winding and friction; {_share(found.anywhere.share)} of the drawn ones do, each "
        "under conditions of its own",
        f"hardest: {place}: {requirement} {figure}, asked {limit}: {verdict}",
        f"not told by the fleet, taken from the run: {', '.join(found.of_run) or 'nothing'}",
    ]
    return said + [f"not judged: {unit}, {why}" for unit, why in found.left_out.items()]


def what_is_asked(asked: Requirements) -> str:
    """Every limit that there is."""
    limits = ((FIGURES[symbol], limit) for symbol, limit in asked.finite().items() if symbol in REQUIRED)
    return ", ".join(f"{of.name} < {limit:g} {of.unit}" for of, limit in limits)


def scenario_table(design: Design) -> RenderableType:
    """The proposed gains, scenario by scenario; below, the figures that have no column of their own."""
    rows = [(name, *(short(getattr(figures, symbol)) for symbol in TRACKING))
            for name, figures in design.chosen.scenarios.items()]  # fmt: skip
    metrics = design.chosen.nonlinear
    assert metrics is not None, "the proposed rule has gains"
    rest = {symbol: of for symbol, of in FIGURES.items() if not of.heading}
    said = ", ".join(f"{of.name} {short(getattr(metrics, symbol))} {of.unit}" for symbol, of in rest.items())
    made = filled(("scenario", *(f"{FIGURES[symbol].heading} {FIGURES[symbol].unit}" for symbol in TRACKING)), rows)
    cost = Text(f"{said}; the bridge has {design.settings.loop.bridge_ohm:g} ohm")
    return headed(f"{design.chosen.rule} in every scenario (nonlinear model)", Group(made, cost))


def outside_the_bench(design: Design) -> list[str]:
    """How the proposed gains fare where the car is not the bench."""
    robust, asked = design.robust, design.settings.conditions
    figures = [(FIGURES[symbol], float(getattr(robust.worst, symbol))) for symbol in (*OF_THE_PAPER, *MARGINS)]
    worst = ", ".join(f"{of.name} {short(value)} {of.unit}" if np.isfinite(value) else f"{of.name} never"
                      for of, value in figures)  # fmt: skip
    reckons = ("the ECU divides by the battery voltage" if design.task.ecu.compensated else
               "a duty is a share of the supply that there is")  # fmt: skip
    ranges = (f"supply {_range(asked.supply)} V, winding {_range(asked.winding)} degrees Celsius, dry friction "
              f"{_range(asked.friction)} times the bench's; {reckons}")  # fmt: skip
    met = "met at every corner" if robust.meets_all else "not met at every corner"
    share = f"{robust.probability_met:.2f} of the {of_models(design)}, each under conditions of its own, meet them"
    supply, winding, friction = robust.corner
    return [
        f"{ranges}: requirements {met}; {share}",
        f"worst of the corners: {worst}; hardest at {supply:g} V, {winding:g} degrees Celsius, friction {friction:g}",
    ]


def _range(ends: tuple[float, ...]) -> str:
    return f"{ends[0]:g} to {ends[1]:g}"


def against_effort(design: Design) -> list[str]:
    """What a calmer duty would cost, and what gains without any reserve would win."""
    figures, points = design.chosen.nonlinear, design.front
    assert figures is not None, "the proposed rule has gains"
    calm = dict.fromkeys((short(point.rmse), short(point.activity, 2)) for point in points if point.meets)
    said = [f"proposed: RMSE {short(figures.rmse_pct)} % at a duty that moves {short(figures.duty_activity_pct, 2)} %"]
    if calm:
        said.append("within everything else that is required, on the nominal model: " + "; ".join(
            f"{rmse} % at {activity} %" for rmse, activity in calm))  # fmt: skip
    return said


def answer(design: Design) -> str:
    """The verdict on the proposed gains in one sentence, see `sentence`."""
    return sentence(design_json(design))
