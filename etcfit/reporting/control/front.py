"""Tracking against effort on the nominal model: the least error that was found, every rule beside it.

A rule may lie below the line: only where it misses something else that is required, and then the picture names it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ...control.design import BEST, Design
from .. import style
from ..numbers import short
from .sentence import misses

_FAR = 2.5  # times the line's worst: rules beyond are named in a corner, not drawn
_DUTY = ("duty_activity_pct",)  # the axis itself
_WIDER = 1.28  # room for names on the right
_BESIDE, _LETTER, _TALL = 11.0, 4.9, 11.0  # of a label, points: from its mark, a letter, its height


@dataclass(frozen=True)
class _Point:
    """Gains in the picture.

    Args:
        activity: standard deviation of the duty at rest, %.
        error: tracking error, % of the travel, root mean square.
        name: of the rule; "" for a point of the front.
        missed: what is missed besides the duty's activity, the worst first.
    """

    activity: float
    error: float
    name: str = ""
    missed: tuple[str, ...] = ()


def draw(design: Design) -> Figure:
    """Tracking error over the duty's activity."""
    fig = style.figure(11.0, 6.6, design.fitted.config.synthetic)
    panel = fig.add_axes((0.08, 0.11, 0.89, 0.67))
    rules = _rules(design)
    best = _least([_Point(p.activity, p.rmse) for p in design.front if p.meets] + [p for p in rules if not p.missed])
    if best:
        panel.plot([p.activity for p in best], [p.error for p in best], "o-", color=style.SIMULATED, ms=5, lw=1.6,
                   label="least error found that meets everything else")  # fmt: skip
    near = _near(best, rules, design.chosen.rule)
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


def _rules(design: Design) -> list[_Point]:
    """Every rule that has gains, as it does on the nominal model."""
    asked = design.task.requirements
    return [
        _Point(float(tuned.nonlinear.duty_activity_pct), float(tuned.nonlinear.rmse_pct),
               tuned.rule.replace("_", " "), tuple(misses(tuned, asked, _DUTY)))
        for tuned in design.tuned.values() if tuned.nonlinear is not None
    ]  # fmt: skip


def _least(points: Sequence[_Point]) -> list[_Point]:
    """Those than which no other is both calmer and closer, the calmest first."""
    least: list[_Point] = []
    for point in sorted(points, key=lambda point: (point.activity, point.error)):
        if not least or point.error < least[-1].error:
            least.append(point)
    return least


def _near(best: Sequence[_Point], rules: Sequence[_Point], proposed: str) -> list[_Point]:
    """Rules that are not so far off that the others would be crowded."""
    shown = [*best, *(point for point in rules if point.name == proposed.replace("_", " "))]
    activity, error = (_FAR * max(getattr(point, name) for point in shown) for name in ("activity", "error"))
    return [point for point in rules if point.activity <= activity and point.error <= error]


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
    """Of the duty's activity, where the picture reaches so far."""
    asked, end = design.task.requirements.duty_activity_pct, panel.get_xlim()[1]
    if asked < _WIDER * end:
        panel.axvspan(
            asked, 10.0 * end, color=style.FAILED, alpha=0.08, lw=0.0, label=f"not allowed: above {asked:g} %"
        )
        panel.set_xlim(right=end)


def _name_rules(panel: Axes, rules: Sequence[_Point]) -> None:
    """A name beside each point, and what the rule misses; none over another or over a point."""
    dots = 72.0 / panel.figure.dpi
    places = {point: dots * panel.transData.transform((point.activity, point.error)) for point in rules}
    taken = [(x - 9.0, x + 9.0, y - 9.0, y + 9.0) for x, y in places.values()]
    for point in sorted(rules, key=lambda point: -point.error):
        x, y = places[point]
        said = f"{point.name}: {point.missed[0]}" if point.missed else point.name
        heights = (y - 4.0 + sign * step for step in range(200) for sign in (1.0, -1.0))  # the nearest first
        low = next(low for low in heights if not any(_overlap(_box(x, low, said), other) for other in taken))
        taken.append(_box(x, low, said))
        panel.annotate(said, (point.activity, point.error), textcoords="offset points", xytext=(_BESIDE, low - y),
                       fontsize=9, color=style.FAILED if point.missed else "black")  # fmt: skip


def _overlap(one: tuple[float, float, float, float], other: tuple[float, float, float, float]) -> bool:
    return one[0] < other[1] and other[0] < one[1] and one[2] < other[3] and other[2] < one[3]


def _box(x: float, low: float, said: str) -> tuple[float, float, float, float]:
    """Left, right, bottom and top of a label, points."""
    return x + _BESIDE, x + _BESIDE + _LETTER * len(said), low, low + _TALL
