"""What the proposed gains do where something fails: for stdout, and one picture."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rich.console import RenderableType

from ...control.design import Design
from .. import style
from ..blocks import sentences, stacked, table
from ..numbers import short


def safety_table(design: Design) -> RenderableType:
    """Sentences on jam check and heat, then a row a failure."""
    return stacked(
        sentences("Jam check", jam_words(design)),
        _sensors(design),
        _sags(design),
        table(
            "The springs bring it back",
            ("no current, from %", "open terminals s", "shorted s", "rests at %"),
            [(_pct(each.opening), _seconds(each.cut_s), _seconds(each.shorted_s), " to ".join(map(_pct, each.rests)))
             for each in design.safety.returns],
        ),
        sentences("Holding", holding_words(design)),
    )  # fmt: skip


def jam_words(design: Design) -> list[str]:
    """The pair proposed, why, and its margins."""
    found, settings = design.safety, design.settings.safety
    seen = found.envelope
    tried = (
        f"{seen.models} models, each under conditions of a car, in every scenario: error up to {_pct(seen.largest)} %"
    )
    check = found.jam
    if check is None:
        return [tried, f"none proposed: no threshold up to {_pct(settings.most)} % is undercut within "
                f"{settings.within:g} s with {settings.reserve:g} times in hand"]  # fmt: skip
    kept = "no error tried is kept up so long" if check.sustained == 0.0 else (
        f"the largest error kept up so long is {_pct(check.sustained)} %")  # fmt: skip
    told = ", ".join(f"{name} {short(after)} s" for name, after in check.tells.items() if after is not None)
    return [
        tried,
        f"proposed: an error above {_pct(check.error)} % for more than {check.timeout:g} s; the least threshold that "
        f"gets along with {settings.within:g} s at {settings.reserve:g} times in hand",
        f"no false trip: a sound throttle is further off for {short(check.longest)} s at most, {kept}",
        f"a plate held since the first change of a scenario is told after: {told or 'none'}; while no more is asked "
        "of it than the threshold, never",
    ]


def _pct(share: float) -> str:
    return short(100.0 * share)


def _seconds(value: float | None) -> str:
    return "never" if value is None else short(value)


def _sensors(design: Design) -> RenderableType | None:
    settings = design.settings.safety
    rows = [(each.fault, _pct(each.opens), _seconds(each.jam_after), _pct(each.jam_opens), _seconds(each.apart_after),
             _pct(each.apart_opens)) for each in design.safety.sensors]  # fmt: skip
    head = ("sensor at 25 %", "unchecked\nopens to %", "jam check\nafter s", "\nopens to %", "two sensors\nafter s",
            "\nopens to %")  # fmt: skip
    said = (f"The position sensor fails (at {settings.supply:g} V; two sensors: {_pct(settings.apart)} % apart for "
            f"{settings.apart_for:g} s; worst of hot and cold, little and much friction)")  # fmt: skip
    return table(said, head, rows)


def _sags(design: Design) -> RenderableType | None:
    settings, trips = design.settings.safety, {None: "-", True: "YES", False: "no"}
    rows = [(each.name, _pct(each.opening), _pct(each.closes), _pct(each.opens), _seconds(each.back_after),
             _pct(each.wound), trips[each.false_trip]) for each in design.safety.sags]  # fmt: skip
    crank = " then ".join(
        f"{v:g} V for {1e3 * t:g} ms" for v, t in zip(settings.crank, settings.crank_for, strict=True)
    )
    said = f"The supply sags (dip: {settings.dip:g} V for {1e3 * settings.dip_for:g} ms; crank: {crank})"
    return table(said, ("supply", "held %", "falls %", "overshoots %", "back s", "integral %", "seen as jam"), rows)


def holding_words(design: Design) -> list[str]:
    """Current, heat, and how long the full duty may last."""
    held, settings = design.safety.holding, design.settings
    k = int(np.argmax(np.abs(held.current)))
    said = [f"{short(abs(held.current[k]))} A and {short(held.watts[k])} W in the winding at most, at "
            f"{_pct(held.shares[k])} % of the travel; full duty against a stop: {short(held.stall_A)} A, "
            f"{short(held.stall_W)} W"]  # fmt: skip
    if held.rise is None or held.longest is None:
        said.append(
            "how warm the winding becomes is not known: the model has no winding heating; power is all there is"
        )
        return said
    limit = f"{settings.safety.insulation:g} degrees Celsius"
    lasts = f"{short(held.longest)} s to {limit}" if math.isfinite(held.longest) else f"never up to {limit}"
    said.append(f"in the long run {short(float(np.max(held.rise)))} K warmer; full duty from "
                f"{settings.conditions.bench:g}: {lasts}")  # fmt: skip
    return said


def draw(design: Design) -> Figure:
    """Jam check, sensor faults, spring return and holding current; below each title what would be good."""
    fig = style.figure(13.0, 10.2, design.fitted.config.synthetic)
    grid = fig.add_gridspec(2, 2, left=0.065, right=0.985, top=0.85, bottom=0.065, hspace=0.46, wspace=0.34)
    for k, draw_panel in enumerate((_jam, _faults, _back, _held)):
        draw_panel(fig.add_subplot(grid[divmod(k, 2)]), design)
    title = f"where something fails: gains of {design.chosen.rule.replace('_', ' ')}"
    fig.suptitle(f"{design.fitted.config.name}  ·  {title}", x=0.065, y=0.985, ha="left", va="top", fontsize=13)
    style.caution(fig, design.fitted.state.cautions, 0.955)
    return fig


def _title(panel: Axes, what: str, good: str) -> None:
    """What a panel shows, and in grey what would be good."""
    panel.text(0.0, 1.115, what, transform=panel.transAxes, fontsize=12, fontweight="bold")
    panel.text(0.0, 1.035, f"good: {good}", transform=panel.transAxes, fontsize=10, color=style.MEASURED)


def _jam(panel: Axes, design: Design) -> None:
    seen, check, settings = design.safety.envelope, design.safety.jam, design.settings.safety
    panel.plot(
        100.0 * seen.errors, seen.longest, color=style.SIMULATED, label="a sound throttle, longest of all models"
    )
    panel.axhline(
        settings.within, color=style.MEASURED, lw=1.2, ls=":", label=f"slowest allowed: {settings.within:g} s"
    )
    title = "Jam check: none proposed"
    if check is not None:
        panel.plot([100.0 * check.error], [check.timeout], "*", ms=17, color=style.READING, zorder=3, ls="none",
                   label="proposed")  # fmt: skip
        title = f"Jam check: an error above {_pct(check.error)} % of travel for {check.timeout:g} s"
    panel.set(
        xlabel="error of the position [% of travel]",
        ylabel="longest time above that error [s]",
        xscale="log",
        ylim=(0.0, 3.0 * settings.within),
    )
    style.log_ticks(panel.xaxis, panel.get_xlim())
    _title(panel, title, "the star above the line (no false alarm) and below the dots")
    panel.legend(loc="upper right")


def _faults(panel: Axes, design: Design) -> None:
    """A cell a fault and a check: how far the plate opens, and after which time the check has told it."""
    every = design.safety.sensors
    cells = [
        [(each.opens, None), (each.jam_opens, each.jam_after), (each.apart_opens, each.apart_after)] for each in every
    ]
    beyond = np.array([[opens - each.asked for opens, _ in row] for each, row in zip(every, cells, strict=True)])
    panel.imshow(np.clip(beyond, 0.0, None), cmap="Reds", vmin=0.0, vmax=1.1, aspect="auto")
    for k, row in enumerate(cells):
        for column, (opens, after) in enumerate(row):
            told = "" if column == 0 else ("\nnot detected" if after is None else f"\nafter {short(after, 2)} s")
            panel.text(column, k, f"opens to {100.0 * opens:.0f} %{told}", ha="center", va="center", fontsize=10)
    panel.set_xticks(range(3), ["no check", "jam check", "jam check and\ntwo sensors"], fontsize=10)
    panel.set_yticks(range(len(every)), [f"{style.wrapped(each.fault, 3.2, 9)}\n(asked: {100.0 * each.asked:.0f} %)"
                                         for each in every], fontsize=9)  # fmt: skip
    panel.tick_params(length=0)
    panel.grid(visible=False)
    panel.set_xticks(np.arange(2) + 0.5, minor=True)
    panel.set_yticks(np.arange(len(every) - 1) + 0.5, minor=True)
    panel.grid(visible=True, which="minor", color="white", lw=2.5)
    panel.tick_params(which="minor", length=0)
    _title(panel, "The position sensor fails", "pale, for the plate stays near what is asked for [% of travel]")


def _back(panel: Axes, design: Design) -> None:
    every, settings = design.safety.returns, design.settings.safety
    opening = [100.0 * each.opening for each in every]
    for name, colour, label in (("cut_s", style.READING, "terminals open"),
                                ("shorted_s", style.SIMULATED, "terminals shorted (they brake)")):  # fmt: skip
        times = [math.nan if getattr(each, name) is None else getattr(each, name) for each in every]
        panel.plot(opening, times, "o-", color=colour, label=label)
    panel.set(xlabel="opening at which the current fails [% of travel]", ylabel="time to the rest position [s]")
    panel.set_ylim(bottom=0.0)
    back = [each.back_after for each in design.safety.sags if each.name == "dip"]
    longest = max((math.inf if after is None else after for after in back), default=0.0)
    said = f"back within {short(longest, 2)} s" if math.isfinite(longest) else "not back"
    dip = f"after a dip of the supply ({settings.dip:g} V, {1e3 * settings.dip_for:g} ms) {said}"
    _title(panel, "No current: the springs bring the plate back", f"short; {dip}")
    panel.legend(loc="upper left")


def _held(panel: Axes, design: Design) -> None:
    held = design.safety.holding
    share = 100.0 * held.shares
    panel.fill_between(share, held.closing, held.opening, color=style.BAND, lw=0, label="dry friction holds the plate")
    panel.plot(share, held.current, color=style.READING, label="in the middle of the dry friction")
    panel.axhline(0.0, color=style.MEASURED, lw=0.8)
    panel.set(xlabel="position [% of travel]", ylabel="current that holds the plate [A]")
    heat = (f"small: here {short(float(np.max(held.watts)), 2)} W at most; at full duty against a stop "
            f"{short(held.stall_W, 2)} W ({short(held.stall_A, 2)} A)")  # fmt: skip
    _title(panel, "Holding: current, and heat in the winding", heat)
    panel.legend(loc="upper left")
