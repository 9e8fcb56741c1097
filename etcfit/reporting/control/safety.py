"""One picture of what the proposed gains do where something fails; `failures.py` has the tables."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...control.design import Design
from .. import style
from ..numbers import short
from .failures import pct


def draw(design: Design) -> Figure:
    """Jam check, sensor faults, spring return and holding current; below each title what would be good."""
    fig = style.figure(13.0, 10.2, design.fitted.config.synthetic)
    grid = fig.add_gridspec(2, 2, left=0.065, right=0.985, top=0.85, bottom=0.065, hspace=0.46, wspace=0.34)
    for k, draw_panel in enumerate((_jam, _faults, _back, _held)):
        draw_panel(fig.add_subplot(grid[divmod(k, 2)]), design)
    title = f"where something fails: gains of {design.chosen.rule.replace('_', ' ')}"
    style.title(fig, f"{design.fitted.config.name}  ·  {title}", 0.065)
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
        title = f"Jam check: an error above {pct(check.error)} % of travel for {check.timeout:g} s"
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
