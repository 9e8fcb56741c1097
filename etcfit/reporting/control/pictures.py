"""Pictures of gains: responses to the setpoint, tracking against effort, and failures.

Responses are shown for every rule in its hardest scenario, and for the proposed gains in every scenario.

    not above r + max(c, 1 %) overshoot/100    from the change on
    within max(2 % c, 0.2 %) of r              from the settling time on
    within max(c, 40 %) error/100 of r         in the last quarter

r is the new level and c the change, per cent of the travel; every change of the setpoint is drawn upwards.
Source: `control.response`, which judges by them. Differs from source: no.

Tracking against effort is on the nominal model: a line of the least errors, and every rule. A rule is below the line
only if it misses another requirement, which the picture then names. `gains.py` has the tables on failures.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ...car_log.criteria import LEAST_HELD, LEAST_OVERSHOT, NEGLIGIBLE, SETTLED, TAIL
from ...control.design import BEST, Design
from ...control.judged import Tuned
from ...control.loop_figures import OF_THE_PAPER, LoopFigures, Requirements, judge
from ...control.setpoint import Level, Stretch
from ...model.ecu import Notation
from .. import style
from ..numbers import short
from .gains import pct
from .sentence import UNSTABLE, Place, doubt, hardest, hardest_place, misses

_COLUMNS = 2
_BEFORE = 0.03  # s shown before the change
_LEFT, _RIGHT = 0.09, 0.985


def _models(design: Design) -> str:
    """Name of the models in addition to the nominal one."""
    return "units" if design.origin == "fleet" else "draws"


def draw_responses(design: Design) -> Figure:
    """One panel per rule; the proposed one is marked."""
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
    """Notation of the ECU for the gains; None if neither the command nor rig.toml names one, or no gains are given."""
    make = design.task.profile
    return None if design.withheld else design.fitted.config.notation if make is None else make.notation


def _panel(panel: Axes, design: Design, tuned: Tuned) -> None:
    assert tuned.band is not None, "a rule with gains has been tried"
    required, place = design.task.requirements, hardest_place(tuned, design.task.requirements)
    missed = misses(tuned, required)
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
    _limits(panel, level, required)
    wanted = design.setpoint.at(np.maximum(time[seen], level.begins - 0.5 * _BEFORE)) - level.after
    panel.plot(since, 100.0 * upwards * wanted, color=style.MEASURED, lw=1.2, label="setpoint")
    draw_band(panel, since, upwards * (band if upwards > 0.0 else band[::-1]), _models(design))
    panel.set(xlim=(-_BEFORE, level.ends - level.begins))
    turned = "" if upwards > 0.0 else ", drawn upwards"
    where = f"{place.scenario}, {100.0 * level.before:.3g} → {100.0 * level.after:.3g} % of travel{turned}"
    panel.text(0.985, 0.04, where, transform=panel.transAxes, fontsize=9, ha="right", color=style.MEASURED)
    far = 3.0 * _allowed(level, required)[place.hardest.symbol]  # half of the height, a few times what is allowed
    most = max(far, min(3.0 * far, 1.1 * 100.0 * float(np.max(upwards * band))))
    panel.set_ylim(-far, most)


def _level(design: Design, tuned: Tuned, place: Place) -> Level:
    """The change within a scenario that is hardest for the draws."""
    assert tuned.band is not None, "a rule with gains has been tried"
    time, band = design.setpoint.instants(design.task.ecu.period), tuned.band
    limit = {place.hardest.symbol: place.hardest.limit}

    def strain(level: Level) -> float:
        alone = replace(design.setpoint, levels=(level,), tracked=(Stretch(level.begins, level.ends),))
        worst = hardest(judge(alone, time, band).worst().known(), limit)
        return 0.0 if worst is None else worst.strain

    return max(design.setpoint.only(place.scenario), key=strain)


def _allowed(level: Level, required: Requirements) -> dict[str, float]:
    """Allowed distance from the new level by each requirement, % of the travel."""
    size = abs(level.change)
    return {
        "overshoot_pct": required.overshoot_pct * max(size, LEAST_OVERSHOT),
        "settling_s": 100.0 * max(SETTLED * size, NEGLIGIBLE),
        "steady_state_error_pct": required.steady_state_error_pct * max(size, LEAST_HELD),
    }


def _limits(panel: Axes, level: Level, required: Requirements) -> None:
    """Forbidden regions of a response, shaded."""
    over, near, held = (_allowed(level, required)[symbol] for symbol in OF_THE_PAPER)
    length = level.ends - level.begins
    settled, tail = min(required.settling_s, length), (1.0 - TAIL) * length
    time = np.array([0.0, settled, settled, max(settled, tail), max(settled, tail), length])
    high = np.minimum(over, np.array([over, over, near, near, min(near, held), min(near, held)]))
    sky = np.full(time.size, 1e3)
    shading = {"color": style.FAILED, "alpha": 0.13, "lw": 0.0}
    panel.fill_between(time, high, sky, label="not allowed", **shading)
    panel.fill_between(time[2:], -sky[2:], -high[2:], **shading)


def draw_band(panel: Axes, time: np.ndarray, band: np.ndarray, models: str) -> None:
    """Responses of the draws of the nonlinear model, or of the units of a fleet: quantiles of `Tuned.band`.

    Args:
        time: s, shape (K,).
        band: quantiles at these instants, shape (3, K).
        models: "draws" or "units".
    """
    low, middle, high = 100.0 * band
    panel.fill_between(time, low, high, color=style.SIMULATED, alpha=0.35, lw=0, label=f"95 % of the {models}")
    panel.plot(time, middle, color=style.SIMULATED, label="nonlinear model, median")


def _name(design: Design, tuned: Tuned) -> str:
    """The rule, its gains, and, if the model is an estimate, the number of models that meet everything."""
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
    """The missed requirements, that of the panel first, or how narrowly it meets everything."""
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
_AHEAD = 0.05  # s shown before the first change


def draw_scenarios(design: Design) -> Figure:
    """One panel per scenario."""
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
    seen = (time >= begin) & (time < end - 0.5 * design.task.ecu.period)  # the next scenario begins at `end`
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


_FAR = 2.5  # times the line's largest error: rules beyond are named in a corner, not drawn
_DUTY = ("duty_activity_pct",)  # the axis itself
_WIDER = 1.28  # factor on the axis, with space for names on the right
_BESIDE, _LETTER, _TALL = 11.0, 4.9, 11.0  # label, in points: distance from its mark, width of a letter, height


@dataclass(frozen=True)
class _Point:
    """Gains in the picture."""

    activity: float  # standard deviation of the duty at rest, %
    error: float  # tracking error, % of the travel, root mean square
    name: str = ""  # name of the rule; "" for a point of the front
    missed: tuple[str, ...] = ()  # missed requirements except the duty's activity, the worst first


def draw_front(design: Design) -> Figure:
    """Tracking error over the duty's activity."""
    fig = style.figure(11.0, 6.6, design.fitted.config.synthetic)
    panel = fig.add_axes((0.08, 0.11, 0.89, 0.67))
    # every rule with gains, by its figures on the nominal model
    required = design.task.requirements
    rules = [
        _Point(float(tuned.nonlinear.duty_activity_pct), float(tuned.nonlinear.rmse_pct),
               tuned.rule.replace("_", " "), tuple(misses(tuned, required, _DUTY)))
        for tuned in design.tuned.values() if tuned.nonlinear is not None
    ]  # fmt: skip
    best = _least([_Point(p.activity, p.rmse) for p in design.front if p.meets] + [p for p in rules if not p.missed])
    if best:
        panel.plot([p.activity for p in best], [p.error for p in best], "o-", color=style.SIMULATED, ms=5, lw=1.6,
                   label="least error found that meets everything else")  # fmt: skip
    # rules that are near enough for the scale of the picture
    scale = [*best, *(point for point in rules if point.name == design.chosen.rule.replace("_", " "))]
    activity, error = (_FAR * max(getattr(point, name) for point in scale) for name in ("activity", "error"))
    near = [point for point in rules if point.activity <= activity and point.error <= error]
    _draw_rules(panel, near, design)
    _limit(panel, design)
    panel.set(xlabel="restlessness: standard deviation of the duty while the setpoint rests [% of the supply]",
              ylabel="tracking error, root mean square [% of travel]", xlim=(0.0, _WIDER * panel.get_xlim()[1]),
              ylim=(0.0, 1.08 * panel.get_ylim()[1]))  # fmt: skip
    panel.xaxis.set_major_locator(MaxNLocator(6))
    _name_rules(panel, near)
    style.title(fig, f"{design.fitted.config.name}  ·  tracking against effort, nominal model", 0.08)
    style.legend(fig, [panel], 0.08, 0.885, "upper left", most=2)
    if beyond := [point.name for point in rules if point not in near]:
        panel.text(0.99, 0.98, f"outside the picture: {', '.join(beyond)}", transform=panel.transAxes, fontsize=9,
                   ha="right", va="top", color=style.MEASURED)  # fmt: skip
    if not best:
        panel.text(0.5, 0.5, "no gains were found that meet everything else", transform=panel.transAxes, ha="center")
    style.caution(fig, design.fitted.state.cautions, 0.955)
    return fig


def _least(points: Sequence[_Point]) -> list[_Point]:
    """The Pareto front: gains without others that are both calmer and more accurate, the calmest first."""
    least: list[_Point] = []
    for point in sorted(points, key=lambda point: (point.activity, point.error)):
        if not least or point.error < least[-1].error:
            least.append(point)
    return least


def _draw_rules(panel: Axes, rules: Sequence[_Point], design: Design) -> None:
    proposed, share = design.chosen.rule.replace("_", " "), 100.0 * design.settings.optimum.certain
    for point in rules:
        marker, size, colour, said = "s", 7.0, style.READING, "a rule that meets everything else"
        if point.name == proposed:
            held = f", sought to hold for {share:.0f} % of the models" if proposed == BEST else ""
            marker, size, said = "*", 17.0, f"proposed: {short(point.error)} % at {short(point.activity, 2)} %{held}"
        elif point.missed:
            marker, size, colour, said = (
                "x",
                8.0,
                style.FAILED,
                "a rule that misses what it says: no match for the line",
            )
        panel.plot([point.activity], [point.error], marker, ms=size, mew=2.0, color=colour, zorder=3, ls="none",
                   label=said)  # fmt: skip


def _limit(panel: Axes, design: Design) -> None:
    """The limit of the duty's activity, if the picture includes it."""
    required, end = design.task.requirements.duty_activity_pct, panel.get_xlim()[1]
    if required < _WIDER * end:
        panel.axvspan(
            required, 10.0 * end, color=style.FAILED, alpha=0.08, lw=0.0, label=f"not allowed: above {required:g} %"
        )
        panel.set_xlim(right=end)


def _name_rules(panel: Axes, rules: Sequence[_Point]) -> None:
    """A name beside each point, with the missed requirements; labels do not overlap each other or a point."""
    dots = 72.0 / panel.figure.dpi
    places = {point: dots * panel.transData.transform((point.activity, point.error)) for point in rules}
    # left, right, bottom and top of what is drawn, points
    taken = [(x - 9.0, x + 9.0, y - 9.0, y + 9.0) for x, y in places.values()]
    for point in sorted(rules, key=lambda point: -point.error):
        x, y = places[point]
        said = f"{point.name}: {point.missed[0]}" if point.missed else point.name
        heights = (y - 4.0 + sign * step for step in range(200) for sign in (1.0, -1.0))  # the nearest first
        left, right = x + _BESIDE, x + _BESIDE + _LETTER * len(said)
        beside = [other for other in taken if left < other[1] and other[0] < right]
        low = next(low for low in heights if not any(low < end and start < low + _TALL for *_, start, end in beside))
        taken.append((left, right, low, low + _TALL))
        panel.annotate(said, (point.activity, point.error), textcoords="offset points", xytext=(_BESIDE, low - y),
                       fontsize=9, color=style.FAILED if point.missed else "black")  # fmt: skip


def draw_safety(design: Design) -> Figure:
    """Jam check, sensor faults, spring return and holding current; below each title the good outcome."""
    fig = style.figure(13.0, 10.2, design.fitted.config.synthetic)
    grid = fig.add_gridspec(2, 2, left=0.065, right=0.985, top=0.85, bottom=0.065, hspace=0.46, wspace=0.34)
    for k, draw_panel in enumerate((_jam, _faults, _back, _held)):
        draw_panel(fig.add_subplot(grid[divmod(k, 2)]), design)
    title = f"where something fails: gains of {design.chosen.rule.replace('_', ' ')}"
    style.title(fig, f"{design.fitted.config.name}  ·  {title}", 0.065)
    style.caution(fig, design.fitted.state.cautions, 0.955)
    return fig


def _panel_title(panel: Axes, what: str, good: str) -> None:
    """The title of a panel, and in grey the good outcome."""
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
    _panel_title(panel, title, "the star above the line (no false alarm) and below the dots")
    panel.legend(loc="upper right")


def _faults(panel: Axes, design: Design) -> None:
    """One cell per fault and check: how far the plate opens, and when the check detects the fault."""
    every = design.safety.sensors
    cells = [
        [(each.opens, None), (each.jam_opens, each.jam_after), (each.apart_opens, each.apart_after)] for each in every
    ]
    beyond = np.array([[opens - each.setpoint for opens, _ in row] for each, row in zip(every, cells, strict=True)])
    panel.imshow(np.clip(beyond, 0.0, None), cmap="Reds", vmin=0.0, vmax=1.1, aspect="auto")
    for k, row in enumerate(cells):
        for column, (opens, after) in enumerate(row):
            when = "" if column == 0 else ("\nnot detected" if after is None else f"\nafter {short(after, 2)} s")
            panel.text(column, k, f"opens to {100.0 * opens:.0f} %{when}", ha="center", va="center", fontsize=10)
    panel.set_xticks(range(3), ["no check", "jam check", "jam check and\ntwo sensors"], fontsize=10)
    faults = [f"{style.wrapped(each.fault, 3.2, 9)}\n(setpoint: {100.0 * each.setpoint:.0f} %)" for each in every]
    panel.set_yticks(range(len(every)), faults, fontsize=9)
    panel.tick_params(length=0)
    panel.grid(visible=False)
    panel.set_xticks(np.arange(2) + 0.5, minor=True)
    panel.set_yticks(np.arange(len(every) - 1) + 0.5, minor=True)
    panel.grid(visible=True, which="minor", color="white", lw=2.5)
    panel.tick_params(which="minor", length=0)
    _panel_title(panel, "The position sensor fails", "pale, where the plate stays near the setpoint [% of travel]")


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
    _panel_title(panel, "No current: the springs bring the plate back", f"short; {dip}")
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
    _panel_title(panel, "Holding: current, and heat in the winding", heat)
    panel.legend(loc="upper left")
