"""What `etcfit tune` shows: a table for the terminal and one picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import RenderableType
from rich.text import Text

from .blocks import sentences, shown, spaced, stacked
from .numbers import short
from .table import Table, of_texts

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..control.proposal import GainStep

NAMES = {"present": "present", "half_way": "half way", "proposed": "proposed"}
_SECONDS = 8.0  # of the held-out part that are drawn


def tune_table(found: Any) -> RenderableType:
    """What the logs hold, how well the model predicts them, and the way from the present gains to the proposed ones."""
    parts: list[RenderableType | None] = [
        Text(f"{found.profile.title}: gains from logs of the car", style="bold"),
        *([spaced(Text(f"NOT FROM THIS LOG. {found.why_not}", style="bold red"))] if found.why_not else []),
        *([spaced(Text(" ".join(found.doubts), style="bold red"))] if found.doubts and not found.why_not else []),
        shown(_checks(found)),
        sentences("Model", list(_model(found))),
    ]
    if found.steps and not found.why_not:
        never = "; never: not before the next step" if _unsettled(found) else ""
        title = f"What the model says they do: steps of 10 to 70 % of the travel and back{never}"
        parts += [shown(_gains(found)), shown(_figures(found, title)),
                  sentences("Next", list(_next(found)))]  # fmt: skip
    lacks = [f"{each.name} ({each.found:.3g} of {each.needed:g} {each.unit}): {each.record}" for each in found.lacks]
    parts.append(sentences("To record next, for surer gains", lacks))
    return stacked(*parts)


def _compromise(found: Any) -> bool:
    """Gains come of a model that is no estimate: no probability is named."""
    return bool(found.doubts or (found.result is not None and found.result.state.cautions))


def _checks(found: Any) -> Table:
    rows = [(c.name, "ok" if c.passed else "STOPS" if c.stops else "doubtful",
             c.says if c.passed else f"{c.says}. {c.cure}") for c in found.input.checks]  # fmt: skip
    return of_texts("The logs", ("check", "", "found"), rows, 2, {"found": "prose"})


def _model(found: Any) -> list[str]:
    if found.result is None:
        return []
    effects = ", ".join(e.name for e in found.result.free_parameters.layout.types[-4:])
    held_out, fitted = found.explained
    words = [f"It explains {percent(fitted)} % of the fitted motion"] if fitted is not None else []
    if held_out is not None:
        words.append(f"{percent(held_out)} % of the part that was held out, where it is off by "
                     f"{short(found.held_out_error)} % of the travel (rms)")  # fmt: skip
    chi2 = found.result.state.chi2_per_dof
    said = [f"{', and '.join(words)}; chi2 per degree of freedom {short(chi2)}; with {effects}."]
    names = [step.name.replace("_", "-") for step in found.steps if step.name != "present"]
    said += [f"Stability with the {name} gains: {each.says}" for name, each in zip(names, found.borne, strict=False)]
    if found.result.state.cautions and not found.doubts:
        said.append(
            f"{found.result.state.cautions[-1]} The loops bear what it misses: gains are given, no probability."
        )
    return said


def percent(share: float) -> str:
    """A share in per cent, one that is not whole never as 100.0."""
    return "over 99.9" if 0.999 < share < 1.0 else f"{100.0 * share:.1f}"


def _gains(found: Any) -> Table:
    units, first, rows = found.profile.notation.of_each, found.written(found.steps[0].gains), []
    for step in found.steps:
        cells = []
        for gain, before in zip(found.written(step.gains), first, strict=True):
            factor = f"  x {gain / before:.2f}" if before and step is not found.steps[0] else ""
            cells.append(f"{short(gain, 4)}{factor}")
        rows.append((NAMES[step.name], *cells))
    head = (f"{name}\n{unit}" for name, unit in zip(found.profile.gains, units, strict=True))
    return of_texts("Gains, as this ECU writes them; the number behind x: over the present gain", ("step", *head), rows)


def _figures(found: Any, title: str) -> Table:
    doubted, rows = _compromise(found), []
    for step in found.steps:
        chance = ("-", "-") if doubted else (
            f"{step.probability_met:.2f}", "-" if step.better is None else f"{step.better:.2f}")  # fmt: skip
        rows.append((NAMES[step.name], _range(step.overshoot), _range(step.settling), short(step.figures.rmse_pct),
                     short(step.figures.gain_margin_db), short(step.figures.phase_margin_deg), *chance))  # fmt: skip
    heads = ("step", "overshoot\n% of step", "settling\ns", "RMSE\n%", "gain\nmargin dB", "phase\nmargin deg",
             "P(meets all)", "P(better)")  # fmt: skip
    return of_texts(title, heads, rows)


def _range(each: tuple[float, float, float]) -> str:
    low, _, high = (short(value, 2) if np.isfinite(value) else "never" for value in each)
    return low if low == high else f"{low}..{high}"


def _next(found: Any) -> list[str]:
    """What to do, and what the next log should show."""
    if len(found.steps) == 1:
        return ["Say which gains are in the ECU now (--present P,I,D or --msq FILE): then a half-way step is given.",
                "Type the proposed gains in with the engine off, and log the same moves again."]  # fmt: skip
    half = found.steps[1]
    return [
        "Type in the half-way gains first, engine off, and log the same moves again, with steps from 10 to 70 % of the "
        f"travel and back, 0.5 s each. These should overshoot by {_range(half.overshoot)} % of the step and "
        f"{_settles(half.settling)} (95 % of the models that fit).",
        "If it does, type in the proposed gains; if it does not, run tune again with that log and the half-way gains.",
    ]  # fmt: skip


def _settles(seconds: tuple[float, float, float]) -> str:
    """What a range of settling times says, one that ends at infinity in words."""
    low, _, high = seconds
    if np.isfinite(high):
        return f"settle in {_range(seconds)} s"
    return (f"settle in {short(low, 2)} s or more, or not before the next step" if np.isfinite(low) else
            "not settle before the next step")  # fmt: skip


def _unsettled(found: Any) -> bool:
    return not all(np.isfinite(step.settling[-1]) for step in found.steps)


def draw_tune(path: Path, found: Any) -> None:
    """Measured and predicted on the held-out part; below, a large step with each set of gains."""
    from . import style

    with style.drawing():
        fig = style.figure(11.0, 7.2, found.result.rig.config.synthetic)
        grid = fig.add_gridspec(2, 1, left=0.07, right=0.98, top=0.89, bottom=0.08, hspace=0.45)
        _prediction(fig.add_subplot(grid[0, 0]), found)
        _steps(fig.add_subplot(grid[1, 0]), found)
        title = f"{found.profile.title}  ·  " + ("NOT FROM THIS LOG: the model is no estimate" if found.why_not else
                                                 "from the log to gains")  # fmt: skip
        fig.suptitle(title, x=0.015, y=0.985, ha="left", va="top", fontsize=13)
        style.save(fig, path)


def _prediction(panel: Axes, found: Any) -> None:
    """The busiest seconds of the held-out part; of the fitted one where nothing was held out."""
    from . import style

    result = found.result
    problem = result.holdout or result.problem
    trace = next(each for each in problem.batch.traces if "position" in each.channels)
    k = trace.channels.index("position")
    low, high = result.rig.config.travel
    measured, predicted = (100.0 * (each[:, k] - low) / (high - low)
                           for each in (trace.data, result.predicted[trace.measurement.file]))  # fmt: skip
    time = np.asarray(trace.measurement.time)[: measured.size]
    way = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(np.nan_to_num(measured))))))
    ends = np.interp(time + _SECONDS, time, way)
    begin = float(time[int(np.argmax(ends - way))])
    seen = (time >= begin) & (time <= begin + _SECONDS)
    panel.plot(time[seen], measured[seen], color=style.MEASURED, lw=1.6, label="measured")
    panel.plot(time[seen], predicted[seen], color=style.SIMULATED, lw=1.2, label="predicted, free running")
    part = "held-out" if result.holdout is not None else "fitted"
    share = found.explained[0] if result.holdout is not None else found.explained[1]
    panel.set_title(f"{part} part: {percent(share)} % of the motion explained", loc="left", fontsize=10)
    panel.set(xlabel="time [s]", ylabel="throttle [% of travel]")
    panel.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.2)


def _steps(panel: Axes, found: Any) -> None:
    from . import style

    step: GainStep = found.steps[0]
    panel.plot(step.time, 100.0 * step.asked, color="black", lw=1.0, ls="--", label="target")
    colours = {"present": style.MEASURED, "half_way": style.CLOSING, "proposed": style.READING}
    for step in found.steps:
        panel.plot(step.time, 100.0 * step.position, color=colours[step.name], lw=1.6, label=NAMES[step.name])
    panel.set_title("large steps, simulated with the fitted model", loc="left", fontsize=10)
    panel.set(xlabel="time [s]", ylabel="throttle [% of travel]")
    panel.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, borderaxespad=0.2)
