"""Responses to the setpoint: of every rule where it is hardest for it, and of the proposed gains in every scenario.

    not above r + max(c, 1 %) overshoot/100    from the change on
    within max(2 % c, 0.2 %) of r              from the settling time on
    within max(c, 40 %) error/100 of r         in the last quarter

r is the new level and c the change, per cent of the travel; the change of the setpoint is drawn as one upwards.
Source: `control.response`, which judges by them. Differs from source: no.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...car_log.criteria import LEAST_HELD, LEAST_OVERSHOT, NEGLIGIBLE, SETTLED, TAIL
from ...control.design import Design
from ...control.judged import Tuned
from ...control.loop_figures import OF_THE_PAPER, LoopFigures, Requirements, judge
from ...control.setpoint import Level, Stretch
from ...model.ecu import Notation
from .. import style
from ..numbers import short
from .sentence import UNSTABLE, Place, doubt, hardest, hardest_place, misses

_COLUMNS = 2
_BEFORE = 0.03  # s shown ahead of the change
_LEFT, _RIGHT = 0.09, 0.985


def _models(design: Design) -> str:
    """What the models are beside the nominal one."""
    return "units" if design.origin == "fleet" else "draws"


def draw(design: Design) -> Figure:
    """A panel a rule; the proposed one says so."""
    shown = [tuned for tuned in design.tuned.values() if tuned.gains is not None]
    rows = -(-len(shown) // _COLUMNS)
    tall = 1.6 + 2.75 * rows
    fig = style.figure(12.0, tall, design.fitted.config.synthetic)
    panels = list(fig.subplots(rows, _COLUMNS, squeeze=False).flat)
    fig.subplots_adjust(left=_LEFT, right=_RIGHT, top=1.0 - 1.5 / tall, bottom=0.55 / tall, hspace=0.62, wspace=0.15)
    for panel, tuned in zip(panels, shown, strict=False):
        _panel(panel, design, tuned)
    for panel in panels[len(shown) :]:
        panel.set_visible(False)
    for panel in panels[: len(shown) : _COLUMNS]:
        panel.set_ylabel("position − new level\n[% of travel]", fontsize=10)
    for panel in panels[max(0, len(shown) - _COLUMNS) : len(shown)]:
        panel.set_xlabel("time since the setpoint changed [s]")
    own = _notation(design)
    unit = "Kp, Ki, Kd in V/rad, V/(rad s), V s/rad" if own is None else f"P, I, D in {own.title}"
    title = f"{design.fitted.config.name}  ·  every rule where it is hardest for it"
    style.title(fig, title, _LEFT)
    style.legend(fig, panels[: len(shown)], _LEFT, 1.0 - 0.42 / tall, "upper left")
    fig.text(_LEFT, 1.0 - 0.72 / tall, f"gains after a rule's name: {unit}", fontsize=9, va="top", color=style.MEASURED)
    style.caution(fig, design.fitted.state.cautions, 1.0 - 0.3 / tall)
    return fig


def _notation(design: Design) -> Notation | None:
    """Of the ECU that the gains are for; None where neither the command nor rig.toml names one, or it may get none."""
    make = design.task.profile
    return None if design.withheld else design.fitted.config.notation if make is None else make.notation


def _panel(panel: Axes, design: Design, tuned: Tuned) -> None:
    assert tuned.band is not None, "a rule with gains has been tried"
    asked, place = design.task.requirements, hardest_place(tuned, design.task.requirements)
    missed = misses(tuned, asked)
    panel.set_title(f"{_name(design, tuned)}\n{_verdict(design, missed, place)}", loc="left", fontsize=10,
                    color=style.FAILED if missed else "black")  # fmt: skip
    if design.parts is not None:
        measured, drawn = (each.share for each in design.parts.rules[tuned.rule])
        words = f"met by {100.0 * drawn.value:.1f} % of drawn parts, {measured.met} of {measured.of} measured"
        panel.text(0.99, 0.95, words, transform=panel.transAxes, ha="right", va="top", fontsize=9)
    if place is None:
        return
    level = _level(design, tuned, place)
    time = design.setpoint.instants(design.task.ecu.period)
    seen = (time >= level.begins - _BEFORE) & (time < level.ends - 0.5 * design.task.ecu.period)
    upwards = np.sign(level.change)
    since, band = time[seen] - level.begins, tuned.band[:, seen] - level.after
    _limits(panel, level, asked)
    wanted = design.setpoint.at(np.maximum(time[seen], level.begins - 0.5 * _BEFORE)) - level.after
    panel.plot(since, 100.0 * upwards * wanted, color=style.MEASURED, lw=1.2, label="setpoint")
    draw_band(panel, since, upwards * (band if upwards > 0.0 else band[::-1]), _models(design))
    panel.set(xlim=(-_BEFORE, level.ends - level.begins))
    turned = "" if upwards > 0.0 else ", drawn upwards"
    where = f"{place.scenario}, {100.0 * level.before:.3g} → {100.0 * level.after:.3g} % of travel{turned}"
    panel.text(0.985, 0.04, where, transform=panel.transAxes, fontsize=9, ha="right", color=style.MEASURED)
    far = 3.0 * _allowed(level, asked)[place.hardest.symbol]  # half of the height, a few times what is allowed
    most = max(far, min(3.0 * far, 1.1 * 100.0 * float(np.max(upwards * band))))
    panel.set_ylim(-far, most)


def _level(design: Design, tuned: Tuned, place: Place) -> Level:
    """The change within a scenario that the draws have the hardest time with."""
    assert tuned.band is not None, "a rule with gains has been tried"
    time, band = design.setpoint.instants(design.task.ecu.period), tuned.band
    limit = {place.hardest.symbol: place.hardest.limit}

    def strain(level: Level) -> float:
        alone = replace(design.setpoint, levels=(level,), tracked=(Stretch(level.begins, level.ends),))
        worst = hardest(judge(alone, time, band).worst().known(), limit)
        return 0.0 if worst is None else worst.strain

    return max(design.setpoint.only(place.scenario), key=strain)


def _allowed(level: Level, asked: Requirements) -> dict[str, float]:
    """Distance from the new level that each requirement allows, % of the travel."""
    size = abs(level.change)
    return {
        "overshoot_pct": asked.overshoot_pct * max(size, LEAST_OVERSHOT),
        "settling_s": 100.0 * max(SETTLED * size, NEGLIGIBLE),
        "steady_state_error_pct": asked.steady_state_error_pct * max(size, LEAST_HELD),
    }


def _limits(panel: Axes, level: Level, asked: Requirements) -> None:
    """What a response may not enter, shaded."""
    over, near, held = (_allowed(level, asked)[symbol] for symbol in OF_THE_PAPER)
    length = level.ends - level.begins
    settled, tail = min(asked.settling_s, length), (1.0 - TAIL) * length
    time = np.array([0.0, settled, settled, max(settled, tail), max(settled, tail), length])
    high = np.minimum(over, np.array([over, over, near, near, min(near, held), min(near, held)]))
    sky = np.full(time.size, 1e3)
    shading = {"color": style.FAILED, "alpha": 0.13, "lw": 0.0}
    panel.fill_between(time, high, sky, label="not allowed", **shading)
    panel.fill_between(time[2:], -sky[2:], -high[2:], **shading)


def draw_band(panel: Axes, time: np.ndarray, band: np.ndarray, models: str) -> None:
    """What the draws of the nonlinear model do, or the units of a fleet: quantiles of `Tuned.band`.

    Args:
        time: s, shape (K,).
        band: at these instants, shape (3, K).
        models: "draws" or "units".
    """
    low, middle, high = 100.0 * band
    panel.fill_between(time, low, high, color=style.SIMULATED, alpha=0.35, lw=0, label=f"95 % of the {models}")
    panel.plot(time, middle, color=style.SIMULATED, label="nonlinear model, median")


def _name(design: Design, tuned: Tuned) -> str:
    """The rule, its gains, and how many models meet everything; the last not of a model that is no estimate."""
    assert tuned.gains is not None, "a rule that refused is not drawn"
    assert tuned.probability_met is not None, "a rule with gains has been tried"
    own = _notation(design)
    gains = " / ".join(short(g) for g in (tuned.gains if own is None else design.written(tuned.gains, own)))
    name = f"{tuned.rule.replace('_', ' ')}{' (proposed)' if tuned is design.chosen else ''}:  {gains}"
    if design.origin == "fleet":
        every = design.fleet if tuned is design.chosen else None  # only the proposed gains are tried on all units
        return f"{name}   met by {100.0 * (tuned.probability_met if every is None else every.share.value):.1f} %"
    return name if design.fitted.state.cautions else f"{name}   P(met) {tuned.probability_met:.2f}"


def _verdict(design: Design, missed: list[str], place: Place | None) -> str:
    """What it misses, that of the panel first, or how narrowly it meets everything."""
    word = doubt(design.fitted.state)
    if missed == [UNSTABLE]:
        return UNSTABLE
    if missed:
        first = place.hardest.says if place is not None and not place.hardest.met else missed[0]
        more = f"; and {len(missed) - 1} more" if len(missed) > 1 else ""
        return f"misses: {first}{more}"
    met = f"nominal model meets all, {word}" if word else "nominal model meets all"
    return met if place is None else f"{met}; hardest: {place.hardest.says}"


_ACROSS = 2
_AHEAD = 0.05  # s shown ahead of the first change


def draw_scenarios(design: Design) -> Figure:
    """A panel a scenario."""
    names = design.setpoint.scenarios
    rows = -(-len(names) // _ACROSS)
    tall = 1.3 + 3.0 * rows
    fig = style.figure(12.0, tall, design.fitted.config.synthetic)
    panels = list(fig.subplots(rows, _ACROSS, squeeze=False).flat)
    fig.subplots_adjust(left=0.07, right=0.985, top=1.0 - 1.2 / tall, bottom=0.6 / tall, hspace=0.55, wspace=0.16)
    for panel, name in zip(panels, names, strict=False):
        _scenario(panel, design, name)
    for panel in panels[len(names) :]:
        panel.set_visible(False)
    title = f"{design.fitted.config.name}  ·  {design.chosen.rule.replace('_', ' ')} in every scenario"
    style.title(fig, title, 0.07)
    style.legend(fig, panels[:1], 0.07, 1.0 - 0.42 / tall, "upper left")
    style.caution(fig, design.fitted.state.cautions, 1.0 - 0.3 / tall)
    return fig


def _scenario(panel: Axes, design: Design, name: str) -> None:
    chosen, setpoint = design.chosen, design.setpoint
    assert chosen.band is not None, "the proposed rule has been tried"
    parts = [part for part in (*setpoint.levels, *setpoint.stretches) if part.scenario == name]
    begin, end = min(part.begins for part in parts) - _AHEAD, max(part.ends for part in parts)
    time = setpoint.instants(design.task.ecu.period)
    seen = (time >= begin) & (time < end - 0.5 * design.task.ecu.period)  # there the next scenario begins
    since = time[seen] - begin
    panel.plot(since, 100.0 * setpoint.at(time[seen]), color=style.MEASURED, lw=1.2, label="setpoint")
    draw_band(panel, since, chosen.band[:, seen], _models(design))
    panel.set_title(f"{name}\n{_says(chosen.scenarios[name])}", loc="left", fontsize=10)
    panel.set(xlabel="time [s]", ylabel="position [% travel]", xlim=(0.0, end - begin))


def _says(figures: LoopFigures) -> str:
    if np.isnan(figures.overshoot_pct):
        return f"RMSE {short(figures.rmse_pct)} %"
    settled = f"settled in {short(figures.settling_s)} s" if np.isfinite(figures.settling_s) else "not settled"
    return (
        f"overshoot {short(figures.overshoot_pct, 2)} %, {settled}, error {short(figures.steady_state_error_pct, 2)} %"
    )
