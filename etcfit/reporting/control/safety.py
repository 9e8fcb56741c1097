"""What the proposed gains do where something fails: for stdout, and one picture."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rich.console import Group, RenderableType

from ...control.design import Design
from .. import style
from ..blocks import headed, plain_table, sentences
from ..numbers import short


def safety_table(design: Design) -> RenderableType:
    """Sentences on jam check and heat, then a row a failure."""
    parts = (sentences("Jam check", jam_words(design)), _sensors(design), _sags(design), _returns(design),
             sentences("Holding", holding_words(design)))  # fmt: skip
    return Group(*(part for part in parts if part is not None))


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


def _sensors(design: Design) -> RenderableType:
    settings = design.settings.safety
    table = plain_table("sensor at 25 %", "unchecked\nopens to %", "jam check\nafter s", "\nopens to %",
                        "two sensors\nafter s", "\nopens to %")  # fmt: skip
    for each in design.safety.sensors:
        table.add_row(each.fault, _pct(each.opens), _seconds(each.jam_after), _pct(each.jam_opens),
                      _seconds(each.apart_after), _pct(each.apart_opens))  # fmt: skip
    said = (f"The position sensor fails (at {settings.supply:g} V; two sensors: {_pct(settings.apart)} % apart for "
            f"{settings.apart_for:g} s; worst of hot and cold, little and much friction)")  # fmt: skip
    return headed(said, table)


def _sags(design: Design) -> RenderableType:
    settings = design.settings.safety
    table = plain_table("supply", "held %", "falls %", "overshoots %", "back s", "integral %", "seen as jam")
    for each in design.safety.sags:
        trip = "-" if each.false_trip is None else "YES" if each.false_trip else "no"
        table.add_row(each.name, _pct(each.opening), _pct(each.closes), _pct(each.opens), _seconds(each.back_after),
                      _pct(each.wound), trip)  # fmt: skip
    crank = " then ".join(
        f"{v:g} V for {1e3 * t:g} ms" for v, t in zip(settings.crank, settings.crank_for, strict=True)
    )
    return headed(f"The supply sags (dip: {settings.dip:g} V for {1e3 * settings.dip_for:g} ms; crank: {crank})", table)


def _returns(design: Design) -> RenderableType:
    table = plain_table("no current, from %", "open terminals s", "shorted s", "rests at %")
    for each in design.safety.returns:
        low, high = (_pct(share) for share in each.rests)
        table.add_row(_pct(each.opening), _seconds(each.cut_s), _seconds(each.shorted_s), f"{low} to {high}")
    return headed("The springs bring it back", table)


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
    """Envelope and jam check, sensor faults, sags of the supply, return and holding current."""
    fig = style.figure(12.0, 8.2, design.fitted.config.synthetic)
    panels = fig.subplots(2, 2)
    fig.subplots_adjust(left=0.07, right=0.985, top=0.86, bottom=0.08, hspace=0.42, wspace=0.36)
    for panel, of in zip(panels.flat, (_jam, _runaways, _back, _held), strict=True):
        of(panel, design)
    fig.suptitle(f"{design.fitted.config.name}  ·  where something fails: {design.chosen.rule.replace('_', ' ')}",
                 x=0.07, y=0.985, ha="left", va="top", fontsize=13)  # fmt: skip
    style.caution(fig, design.fitted.state.cautions, 0.95)
    return fig


def _jam(panel: Axes, design: Design) -> None:
    seen, check, settings = design.safety.envelope, design.safety.jam, design.settings.safety
    panel.plot(100.0 * seen.errors, seen.longest, color=style.SIMULATED, label="a sound throttle, longest of all")
    panel.axhline(settings.within, color=style.MEASURED, lw=1.0, ls=":", label=f"allowed: {settings.within:g} s")
    title = "jam check: none proposed"
    if check is not None:
        panel.plot([100.0 * check.error], [check.timeout], "*", ms=15, color=style.READING, zorder=3, ls="none",
                   label="proposed")  # fmt: skip
        title = f"jam check: more than {_pct(check.error)} % for {check.timeout:g} s"
    panel.set(
        xlabel="error [% of travel]",
        ylabel="longest time above it [s]",
        xscale="log",
        ylim=(0.0, 3.0 * settings.within),
    )
    style.log_ticks(panel.xaxis, panel.get_xlim())
    panel.set_title(title, loc="left", fontsize=10)
    panel.legend(loc="upper right", fontsize=8.5)


def _runaways(panel: Axes, design: Design) -> None:
    every = design.safety.sensors
    place = np.arange(len(every))
    bars = ((-0.27, "opens", style.SIMULATED, "unchecked"), (0.0, "jam_opens", style.CLOSING, "with the jam check"),
            (0.27, "apart_opens", style.READING, "and two sensors"))  # fmt: skip
    for shift, name, colour, label in bars:
        panel.barh(place + shift, [100.0 * getattr(each, name) for each in every], 0.25, color=colour, label=label)
    panel.plot([100.0 * each.asked for each in every], place, "|", ms=26, color="black", label="asked for")
    panel.set_yticks(place, [style.wrapped(each.fault, 3.3, 9) for each in every], fontsize=8.5)
    panel.invert_yaxis()
    panel.grid(visible=False, axis="y")
    panel.set(xlabel="widest opening [% of travel]", xlim=(0.0, 102.0))
    panel.set_title("the position sensor fails", loc="left", fontsize=10, pad=22)
    panel.legend(loc="lower left", bbox_to_anchor=(-0.02, 1.0), ncols=4, fontsize=8, borderaxespad=0.2, markerscale=0.4,
                 handlelength=1.2, columnspacing=1.0)  # fmt: skip


def _back(panel: Axes, design: Design) -> None:
    every = design.safety.returns
    opening = [100.0 * each.opening for each in every]
    for name, colour, label in (("cut_s", style.READING, "open terminals"), ("shorted_s", style.SIMULATED, "shorted")):
        times = [math.nan if getattr(each, name) is None else getattr(each, name) for each in every]
        panel.plot(opening, times, "o-", color=colour, label=f"spring return, {label}")
    dips = [each for each in design.safety.sags if each.name == "dip"]
    panel.plot([100.0 * each.opening for each in dips],
               [math.nan if each.back_after is None else each.back_after for each in dips], "s--", mfc="white",
               color=style.MEASURED, label="back after a dip of the supply")  # fmt: skip
    panel.set(xlabel="from an opening of [% of travel]", ylabel="time until back [s]")
    panel.set_ylim(bottom=0.0)
    panel.set_title("without a current, and after a dip", loc="left", fontsize=10)
    panel.legend(loc="upper left", fontsize=8.5)


def _held(panel: Axes, design: Design) -> None:
    held = design.safety.holding
    share = 100.0 * held.shares
    panel.fill_between(share, held.closing, held.opening, color=style.BAND, lw=0, label="held by dry friction")
    panel.plot(share, held.current, color=style.READING, label="in its middle")
    panel.axhline(0.0, color=style.MEASURED, lw=0.8)
    panel.set(xlabel="position [% of travel]", ylabel="holding current [A]")
    panel.set_title(f"holding: {short(float(np.max(held.watts)))} W at most; full duty {short(held.stall_A)} A, "
                    f"{short(held.stall_W)} W", loc="left", fontsize=10)  # fmt: skip
    panel.legend(loc="lower right", fontsize=8.5)
