"""Tracking against effort: the front of the best gains, every rule beside it, the proposed point marked."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ...control.design import Design
from .. import style
from ..numbers import short

_FAR = 2.5  # times the front's worst: rules beyond are named in a corner, not drawn


def draw(design: Design) -> Figure:
    """Tracking error over the duty's activity."""
    fig = style.figure(9.0, 5.6, design.fitted.config.synthetic)
    panel = fig.add_axes((0.09, 0.12, 0.88, 0.66))
    points = sorted(design.front, key=lambda point: point.activity)
    panel.plot([p.activity for p in points], [p.rmse for p in points], color=style.SIMULATED, lw=1.4)
    for meets, name, face in ((True, "the best within a limit of activity", style.SIMULATED),
                              (False, "the best, misses something else", "white")):  # fmt: skip
        kept = [p for p in points if p.meets is meets]
        if kept:
            panel.plot([p.activity for p in kept], [p.rmse for p in kept], "o", ms=7, mec=style.SIMULATED, mfc=face,
                       label=name)  # fmt: skip
    beyond = _rules(design, panel)
    asked = design.task.requirements.duty_activity_pct
    if asked < 1.1 * panel.get_xlim()[1]:
        panel.axvline(asked, color=style.MEASURED, lw=1.0, ls=":", label=f"asked for: below {asked:g} %")
    panel.set(xlabel="standard deviation of the duty at rest [%]", ylabel="tracking error [% of travel, rms]")
    panel.set_xlim(left=0.0)
    panel.set_ylim(bottom=0.0)
    panel.xaxis.set_major_locator(MaxNLocator(6))
    fig.suptitle(f"{design.fitted.config.name}  ·  tracking against effort", x=0.09, y=0.985, ha="left", va="top",
                 fontsize=13)  # fmt: skip
    style.legend(fig, [panel], 0.09, 0.925, "upper left", most=3)
    if beyond:
        panel.text(0.99, 0.98, f"beyond the picture: {', '.join(beyond)}", transform=panel.transAxes, fontsize=8.5,
                   ha="right", va="top", color=style.MEASURED)  # fmt: skip
    style.caution(fig, design.fitted.state.cautions, 0.94)
    return fig


def _rules(design: Design, panel: Axes) -> list[str]:
    """Every rule as a point with its name; those too far off are given back by name."""
    activity, error = (_FAR * max(getattr(p, name) for p in design.front) for name in ("activity", "rmse"))
    beyond = []
    for tuned in design.tuned.values():
        if tuned.nonlinear is None:
            continue
        x, y = float(tuned.nonlinear.duty_activity_pct), float(tuned.nonlinear.rmse_pct)
        name, proposed = tuned.rule.replace("_", " "), tuned is design.chosen
        if not proposed and not (x <= activity and y <= error):
            beyond.append(name)
            continue
        said = "a rule that meets everything" if tuned.meets_all else "a rule that misses something"
        if proposed:
            said = f"proposed: {short(y)} % at {short(x, 2)} %"
        panel.plot([x], [y], "*" if proposed else "s", ms=16 if proposed else 6, mec=style.READING,
                   mfc=style.READING if tuned.meets_all else "white", zorder=3, ls="none", label=said)  # fmt: skip
        if not proposed:
            panel.annotate(name, (x, y), textcoords="offset points", xytext=(7, 4), fontsize=8.5)
    return beyond
