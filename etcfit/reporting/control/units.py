"""How gains fare unit by unit, of pid.json: on a fleet, and on the parts of one design; for every view."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ...control.loop_figures import FIGURES
from ...control.on_units import STABLE
from ...errors import first_names
from ..numbers import or_never, short
from ..table import Column, Part, Table

_NAMED = 12  # units in a line
_OF = FIGURES | {STABLE: FIGURES["gain_margin_db"]}

_WORST = (
    Column("hardest for it", lambda one: _OF[one["requirement"]].name, "word"),
    Column("figure", lambda one: _with_unit(one, "figure")),
    Column("limit", lambda one: _with_unit(one, "limit")),
)


def _with_unit(one: Mapping[str, Any], key: str) -> str:
    return "never" if one[key] is None else f"{short(one[key])} {_OF[one['requirement']].unit}"


def fleet_parts(pid: Mapping[str, Any]) -> list[Part]:
    """Share that meets everything, what the others miss, and the worst units; nothing of a design of one unit."""
    found = pid.get("fleet")
    if not found:
        return []
    said = [found["says"], f"so of {_interval(found)} of such units"]
    if future := found.get("future"):
        met = round(future["share_met"] * future["draws"])
        said.append(f"of {future['draws']} units drawn from the population, which the search did not know, {met} do: "
                    f"{_interval(future)}")  # fmt: skip
    columns = (Column("worst units", "unit", "word"), *_WORST, Column("meets all", "meets", "word"))
    title = f"{pid['rule']} on every unit of the fleet"
    return [Table(title, columns, found["worst"], [*said, *_missed(found["fails"])])]


def _interval(share: Mapping[str, Any]) -> str:
    """With its 95 % interval."""
    low, high = share["share_ci95"]
    return f"{_percent(share)} % (95 %: {100.0 * low:.1f} to {100.0 * high:.1f} %)"


def _percent(share: Mapping[str, Any]) -> str:
    return f"{100.0 * share['share_met']:.1f}"


def _missed(fails: Mapping[str, Any]) -> list[str]:
    return [f"{_OF[symbol].name} missed by {len(units)}: {first_names(units, _NAMED)}"
            for symbol, units in fails.items()]  # fmt: skip


def parts_table(pid: Mapping[str, Any]) -> Table | None:
    """Every rule on measured and drawn units, the worst unit by name; None where no fleet tells the parts."""
    found = pid.get("parts")
    if not found:
        return None
    rows = [{"rule": name, **each["worst"], **each} for name, each in found["rules"].items()]
    drawn = next(iter(found["rules"].values()))["drawn"]["of"]
    columns = (
        Column("rule", "rule", "name"),
        Column(f"met by, % of\n{len(found['units'])} units", lambda row: _percent(row["measured"])),
        Column(f"% of\n{drawn} drawn", lambda row: _percent(row["drawn"])),
        Column("largest RMSE\nof units, %", lambda row: or_never(row["measured"]["worst_rmse_pct"])),
        Column("largest RMSE\nof drawn, %", lambda row: or_never(row["drawn"]["worst_rmse_pct"])),
        Column("worst unit", "unit", "word"),
        *_WORST,
    )
    return Table(f"On the parts of {found['name']}", columns, rows, _words(found, pid["rule"]))


def _words(found: Mapping[str, Any], rule: str) -> list[str]:
    """How to read it, and how the proposed gains fare outside the bench."""
    chosen, there = found["rules"][rule], found["conditions"]
    corners, hardest = there["corners"], there["hardest"]
    verdict = "met all the same" if hardest["meets"] else "missed"
    return [
        "share that meets everything by a stable loop: of the measured units by their shrunk values, and of units "
        f"drawn from the population of {found['fleet']}; optimal is sought over the latter",
        f"{rule}: {_interval(chosen['drawn'])} of such parts",
        *_missed(chosen["fails"]),
        f"outside the bench: {round(corners['share_met'] * corners['of'])} of {corners['of']} units meet everything at "
        f"every corner of supply, winding and friction; {_percent(there['drawn'])} % of the drawn ones do, each under "
        "conditions of its own",
        f"hardest: {hardest['unit']}: {_OF[hardest['requirement']].name} {_with_unit(hardest, 'figure')}, asked "
        f"{_with_unit(hardest, 'limit')}: {verdict}",
        f"not told by the fleet, taken from the run: {', '.join(found['of_run']) or 'nothing'}",
        *(f"not judged: {unit}, {why}" for unit, why in found["left_out"].items()),
    ]
