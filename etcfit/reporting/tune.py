"""Output of `etcfit tune`: sentences and tables, the same on terminal, page and in tune.json; and one picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import RenderableType
from rich.text import Text

from ..car_log.log import Series
from ..estimation.identifiability import listed
from ..model.ecus import named
from ..run_folder.pid import PID
from .blocks import spaced, stacked
from .control.sentence import missed_in_corner, missed_on_nominal, place_of_corner
from .numbers import between, short
from .table import Notes, Table, of_texts

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ..control.proposal import GainStep

_SECONDS = 8.0  # s of the held-out part in the picture


def tune_table(content: Mapping[str, Any]) -> RenderableType:
    """Contents of the logs, errors of the model on them, and the steps from the present to the proposed gains.

    Args:
        content: the object of tune.json, which the page of the run shows too.
    """
    says, withheld = content["says"], content["why_not"]
    doubts = [] if withheld else content["doubts"]
    rows = [(c["name"], "ok" if c["passed"] else "STOPS" if c["stops"] else "doubtful",
             c["says"] if c["passed"] else f"{c['says']}. {c['cure']}") for c in content["checks"]]  # fmt: skip
    checks = of_texts("The logs", ("check", "", "found"), rows, 2, {"found": "prose"})
    lacks = [f"{each['name']} ({each['found']:.3g} of {each['needed']:g} {each['unit']}): {each['record']}"
             for each in content["record_next"]]  # fmt: skip
    return stacked(
        Text(f"{named(content['ecu']).title}: gains from logs of the car", style="bold"),
        *([spaced(Text(f"NOT FROM THIS LOG. {withheld}", style="bold red"))] if withheld else []),
        *([spaced(Text(" ".join(doubts), style="bold red"))] if doubts else []),
        checks,
        Notes("Model", says["model"]),
        *tables_of_steps(content),
        Notes("Requirements", [says["requirements"]] if says["requirements"] else []),
        Notes("Next", says["next"]),
        Notes("To record next, for surer gains", lacks),
    )


def tables_of_steps(content: Mapping[str, Any]) -> tuple[Table, ...]:
    """The gains of each step in the ECU's own numbers, and their simulated results; none if withheld."""
    if content["why_not"] or not content["steps"]:
        return ()
    return _gains(content), _figures(content)


def _gains(content: Mapping[str, Any]) -> Table:
    rows = []
    for step in content["steps"]:
        factors = (step["factors"] or {}) if step is not content["steps"][0] else {}
        cells = [short(gain, 4) + (f"  x {factors[key]:.2f}" if factors.get(key) else "")
                 for key, gain in step["gains"].items()]  # fmt: skip
        rows.append((_spoken(step["name"]), *cells))
    head = (f"{name}\n{content['unit'][key]}" for name, key in zip(named(content["ecu"]).gains, "PID", strict=True))
    title = "Gains, as this ECU writes them; x: over the present gain; half way: about the root of that factor"
    return of_texts(title, ("step", *head), rows)


def _figures(content: Mapping[str, Any]) -> Table:
    rows, steps = [], content["steps"]
    for step in steps:
        chances = (None if value is None else f"{value:.2f}"
                   for value in (step["probability_met"], step["probability_better"]))  # fmt: skip
        rows.append((_spoken(step["name"]), range_of(step["overshoot_pct"]), range_of(step["settling_s"]),
                     short(step["rmse_pct"]), short(step["gain_margin_db"]), short(step["phase_margin_deg"]),
                     *(chance or "-" for chance in chances)))  # fmt: skip
    never = "; never: not before the next step" if any(None in step["settling_s"] for step in steps) else ""
    return of_texts(f"What the model says they do: steps of 10 to 70 % of the travel and back{never}",
                 ("step", "overshoot\n% of step", "settling\ns", "RMSE %,\ntrapezoid", "gain\nmargin dB",
                  "phase\nmargin deg", "P(meets all\nrequirements)", "P(tracks\nbetter)"), rows)  # fmt: skip


def _spoken(name: str) -> str:
    """Name of a step, as "half way"."""
    return name.replace("_", " ")


def range_of(each: Sequence[float | None]) -> str:
    """Range of 95 % of the models that fit; None is infinite."""
    return between(each[0], each[2], 2)


def says_of(found: Any, steps: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The sentences of tune.json, which terminal and page show too.

    Args:
        found: the result, see `api.tuned.Tuned`.
        steps: steps of tune.json.
    """
    shown = () if found.why_not else steps
    return {
        "answer": answer(found),
        "model": _model(found),
        "requirements": of_requirements(PID.json(found.design), shown) if shown else None,
        "next": _next(shown, bool(found.request.own and found.request.own.bias)) if shown else [],
    }


def answer(found: Any) -> str:
    """The half-way gains if the present ones are known, else the proposed ones; or why there are none."""
    if found.why_not:
        return f"Not from this log. {found.why_not}"
    step = found.steps[min(1, len(found.steps) - 1)]
    gains = zip(found.profile.gains, found.written(step.gains), strict=True)
    words = ", ".join(f"{name} {short(gain, 4)}" for name, gain in gains)
    doubt = " In spite of this: " + " ".join(found.doubts) if found.doubts else ""
    return f"{'Proposed gains' if len(found.steps) == 1 else 'Half-way gains to try first'}: {words}.{doubt}"


def of_requirements(pid: Mapping[str, Any], steps: Sequence[Mapping[str, Any]]) -> str:
    """The requirements that the proposed gains miss, and the consequences.

    Args:
        pid: the object of pid.json.
        steps: steps of tune.json, the proposed gains last.
    """
    here, there = missed_on_nominal(pid), missed_in_corner(pid)
    if not here and not there:
        return "The proposed gains meet every requirement, in the worst corner of supply, heat and friction too."
    judged = "Judged on all moves of a design, the smallest steps too (overshoot and error are shares of the step),"
    said = [f"{judged} on the fitted model the proposed gains miss {listed(here)}." if here else
            f"{judged} on the fitted model the proposed gains meet every requirement."]  # fmt: skip
    if there:
        place = place_of_corner(pid["conditions"]).replace("the bench's", "that of the log")
        said.append(f"{'Also' if here else 'But'} in the worst corner outside the log ({place}) they miss "
                    f"{listed(there)}.")  # fmt: skip
    first, last = steps[0]["rmse_pct"], steps[-1]["rmse_pct"]
    if len(steps) > 1 and first is not None and last is not None:
        figures = f"RMSE {short(last)} instead of {short(first)} % of the travel"
        said.append(f"They track better than the present ones all the same ({figures})." if last < first else
                    f"Nor do they track better than the present ones ({figures}).")  # fmt: skip
    if not here:
        said.append("What decides is whether your car meets that corner: log there before you rely on it.")
    elif limits := pid.get("limits"):
        eased = f"Gains could meet everything if this were eased: {'; or '.join(limits)}"
        said.append(f"What decides: {limits[0]}." if limits[0].startswith("no limit") else f"{eased}.")
    return " ".join(said)


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
    said += [f"Stability with the {name} gains: {each.says}" if each.enough else
             f"WARNING: this log does not show that the loop with the {name} gains is stable. {each.says}"
             for name, each in zip(names, found.borne, strict=False)]  # fmt: skip
    if found.result.state.cautions and not found.doubts:
        said.append(
            f"{found.result.state.cautions[-1]} The loops bear what it misses: gains are given, no probability."
        )
    return said


def percent(share: float) -> str:
    """A share in per cent; below 1 never printed as 100.0."""
    return "over 99.9" if 0.999 < share < 1.0 else f"{100.0 * share:.1f}"


def _next(steps: Sequence[Mapping[str, Any]], biased: bool) -> list[str]:
    """What to do, and what the next log should show.

    Args:
        biased: whether the ECU has a bias table now.
    """
    if len(steps) == 1:
        return ["Say which gains are in the ECU now (--present P,I,D or --msq FILE): then a half-way step is given.",
                "Type the proposed gains in with the engine off, and log the same moves again."]  # fmt: skip
    half = steps[1]
    zeros = ("Set every value of the bias table to 0 together with the gains, which were sought without one; an "
             "exported .msq does so.")  # fmt: skip
    return [
        *([zeros] if biased else []),
        "Type in the half-way gains first, engine off, and log the same moves again, with three steps from 10 to 70 % "
        f"of the travel and back, 0.5 s each. These should overshoot by {range_of(half['overshoot_pct'])} % of the "
        f"step and {_settles(half['settling_s'])} (95 % of the models that fit).",
        "etcfit drive NEXT_LOG --foretold, with this run folder, says whether they do: if so, type in the proposed "
        "gains; if not, give the command that it names, which tunes again with that log and the half-way gains.",
    ]  # fmt: skip


def _settles(seconds: Sequence[float | None]) -> str:
    """A range of settling times in words, also if it ends at infinity."""
    low, _, high = seconds
    if high is not None:
        return f"settle in {range_of(seconds)} s"
    return (f"settle in {short(low, 2)} s or later, in some models not before the next step" if low is not None else
            "not settle before the next step")  # fmt: skip


def draw_tune(found: Any) -> Figure:
    """Measured and predicted on the held-out part; below, a large step with each set of gains."""
    from . import style

    fig = style.figure(11.0, 7.2, found.result.rig.config.synthetic)
    grid = fig.add_gridspec(2, 1, left=0.07, right=0.98, top=0.89, bottom=0.08, hspace=0.45)
    _prediction(fig.add_subplot(grid[0, 0]), found)
    _steps(fig.add_subplot(grid[1, 0]), found)
    said = "NOT FROM THIS LOG: the model is no estimate" if found.why_not else "from the log to gains"
    style.title(fig, f"{found.profile.title}  ·  {said}")
    return fig


def _prediction(panel: Axes, found: Any) -> None:
    """The seconds with most motion of the held-out part, or of the fitted one if nothing was held out."""
    from . import style

    result = found.result
    problem = result.holdout or result.problem
    trace = next(each for each in problem.batch.traces if "position" in each.channels)
    k = trace.channels.index("position")
    low, high = result.rig.config.travel
    measured, predicted = (100.0 * (each[:, k] - low) / (high - low)
                           for each in (trace.data, result.predicted[trace.measurement.file]))  # fmt: skip
    time = np.asarray(trace.measurement.time)[: measured.size]
    begin = Series(time, np.nan_to_num(measured)).busiest(_SECONDS)
    seen = (time >= begin) & (time <= begin + _SECONDS)
    panel.plot(time[seen], measured[seen], color=style.MEASURED, lw=4.0, alpha=0.5, label="measured")
    panel.plot(time[seen], predicted[seen], color=style.SIMULATED, lw=1.2, label="predicted from the input alone")
    part = "held-out" if result.holdout is not None else "fitted"
    share = found.explained[0] if result.holdout is not None else found.explained[1]
    panel.set_title(f"{part} part: {percent(share)} % of the motion explained", loc="left", fontsize=10)
    panel.set(xlabel="time [s]", ylabel="throttle [% of travel]")
    panel.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.2)


def _steps(panel: Axes, found: Any) -> None:
    from . import style

    step: GainStep = found.steps[0]
    panel.plot(step.time, 100.0 * step.setpoint, color="black", lw=1.0, ls="--", label="target")
    colours = {"present": style.MEASURED, "half_way": style.CLOSING, "proposed": style.READING}
    for step in found.steps:
        panel.plot(step.time, 100.0 * step.position, color=colours[step.name], lw=1.6, label=_spoken(step.name))
    panel.set_title("large steps, simulated with the fitted model", loc="left", fontsize=10)
    panel.set(xlabel="time [s]", ylabel="throttle [% of travel]", yticks=range(0, 101, 10))
    panel.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, borderaxespad=0.2)
