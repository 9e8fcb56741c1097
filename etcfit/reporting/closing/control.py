"""Closing lines of commands that use a model: posterior, transfer function, gains, exports, tune, fleet."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import command
from ...model.ecus import ECUS, Pasting
from ...run_folder.pid import PID
from ..control.sentence import sentence
from ..numbers import counted, short
from ..page import tuned_of
from ..tune import answer as tune_answer
from . import NEXT_LOG, Closing

if TYPE_CHECKING:
    from ...control.design import Design
    from ...control.linearise import Reduction
    from ...estimation.fitted_model import FitState
    from ...posterior.sampling import Posterior
    from ..car_log import Held
    from ..fleet import Content

_TUNE = "msq"  # a format of `etcfit export`


def of_posterior(posterior: Posterior, run: Path) -> Closing:
    """Whether the chain is a posterior, and whether its spread is that of the fit."""
    look = (run / "pictures" / "posterior" / "intervals.png",)
    if not posterior.convergence.converged:
        return Closing(f"No posterior yet: {posterior.convergence.reason}", command("sample", run), look)
    sampled = f"{counted(len(posterior.marginals), 'parameter')} have a posterior: {posterior.convergence.reason}."
    return Closing(f"{sampled}{_caution(posterior.fit.state)}", command("report", run), look)


def of_plant(reduction: Reduction, state: FitState, run: Path) -> Closing:
    """Gain and slowest pole of the linear plant."""
    slowest = max(reduction.plant.poles, key=lambda pole: pole.real)
    units = f"{reduction.output_unit}/{reduction.input_unit}"
    gain = f"The plant has a static gain of {short(float(reduction.plant.dc_gain), 4)} {units}"
    if not np.isfinite(reduction.plant.dc_gain):
        gain = "The plant has no spring, so that a constant voltage turns it on and on"
    pole = f"its slowest pole at {short(float(np.real(slowest)), 4)} 1/s"
    look = (run / "pictures" / "control" / "bode.png",)
    return Closing(f"{gain} and {pole}.{_caution(state)}", _with(state, run, command("design", run)), look)


def said_of(design: Design) -> str:
    """The verdict on the proposed gains in one sentence."""
    return sentence(PID.json(design))


def of_design(design: Design, state: FitState, run: Path) -> Closing:
    """The proposed gains; then how to enter them into an ECU if they meet the requirements, else the page."""
    profile = design.task.profile
    if profile is None:
        named = command("design", run, "--ecu", "NAME")
        further = f"{named}, for gains as your ECU writes them; NAME: {', '.join(ECUS)}"
    elif profile.pasting is Pasting.TUNE_FILE and design.chosen.meets_all and design.robust.meets_all:
        further = command("export", run, "--to", _TUNE)
    else:
        further = command("report", run)
    return Closing(said_of(design), _with(state, run, further),
                   (run / "pictures" / "control" / "responses.png",))  # fmt: skip


def of_fleet_design(design: Design, run: Path) -> Closing:
    """Gains for the units of a fleet; the nominal unit is not exported."""
    return Closing(said_of(design), "try the gains on one unit on the bench, its plate free of an engine",
                   (run / "pictures" / "control" / "responses.png",))  # fmt: skip


def of_export(files: Sequence[Path], cannot_hold: Sequence[str], title: str, state: FitState, run: Path) -> Closing:
    """Written files, and what they leave out."""
    lacks = f"; {counted(len(cannot_hold), 'thing')} of the model left out, as listed" if cannot_hold else ""
    written = f"{counted(len(files), 'file')} written, {title}{lacks}.{_caution(state)}"
    first = "try gains on the bench first"
    if files[0].suffix == f".{_TUNE}" and tuned_of(run):
        first = f"its gains are the proposed ones: type in the half-way gains of {command('tune')} before them"
    further = f"open {files[0].name} in the program that it is for; {first}"
    return Closing(written, _with(state, run, further), (files[0],))


def _caution(state: FitState) -> str:
    """A caution not to use results of a fit that is no estimate."""
    return f" Do not use it yet: {state.cautions[-1]}" if state.cautions else ""


def _with(state: FitState, run: Path, further: str) -> str:
    """The next command for a model that is an estimate; for any other, what it lacks."""
    if not state.cautions:
        return further
    diagnosed = (run / "diagnosis.json").is_file()
    return command("report", run, "--interactive") if diagnosed else command("diagnose", run)


def of_tune(found: Any, run: Path, files: Sequence[Path]) -> Closing:
    """The half-way gains if the present ones are known, else the proposed ones; or why there are none."""
    look, said = (run / "pictures" / "tune.png",), tune_answer(found)
    if found.why_not and found.input.stopped_by:
        return Closing(said, found.input.stopped_by[0].cure, look)
    if found.why_not:
        present = (",".join(f"{gain:.10g}" for gain in gains) for gains in found.request.sets)
        again = _tune(map(str, files), replace(found.request, anyway=True).options(of_files=True), present, run)
        return Closing(said, f"look at {command('report', run)}; the gains all the same: {again}", look)
    if len(found.steps) == 1:
        again = _tune(map(str, files), found.request.options(of_files=True), ["P,I,D"], run)
        return Closing(said, f"say which gains are in the ECU now, for a half-way step: {again}", look)
    return Closing(said, f"type them in, engine off, and log the same moves again; then: "
                   f"{command('drive', NEXT_LOG, '--foretold', run)}", look)  # fmt: skip


def _tune(logs: Iterable[str], options: Iterable[str], present: Iterable[str], run: Path) -> str:
    """The command that tunes again."""
    sets = (word for gains in present for word in ("--present", gains))
    return command("tune", *logs, *options, *sets, "--out", run)


def of_foretold(held: Held, log: Path) -> Closing:
    """A log compared with the prediction: go on to the next gains, or tune again with it."""
    steps = {step["name"]: step["gains"] for step in held.tuned["steps"]}
    names, gains = ECUS[held.tuned["ecu"]].gains, steps[held.made_with]
    present = ",".join(short(gain, 4) for gain in gains.values())
    again = f"tune again with this log: {_tune([str(log)], held.tuned['options'], [present], next_run(held.run))}"
    if not held.found.as_foretold:
        if held.found.unchanged:
            seen = "see whether these gains are in the ECU at all, and log once more; if they are,"
            return Closing(held.says, f"{seen} {again}")
        return Closing(held.says, f"do not go on to other gains; {again}")
    order = list(steps)
    if held.made_with == order[-1]:
        return Closing(held.says, f"keep these gains; good enough by itself? {command('drive', log)}")
    further = order[order.index(held.made_with) + 1]
    from ...control.borne import is_borne  # no other closing needs its imports

    judged = dict(zip(order[1:], held.tuned["borne"], strict=False))
    if further in judged and not is_borne(judged[further]["worst"]):
        return Closing(held.says, f"keep these gains: the run's logs do not tell whether the loop holds with the "
                       f"{further.replace('_', '-')} ones; {again}")  # fmt: skip
    words = ", ".join(f"{name} {short(gain, 4)}" for name, gain in zip(names, steps[further].values(), strict=True))
    then = command("drive", NEXT_LOG, "--foretold", held.run, *(["--made-with", "proposed"] * (further == "proposed")))
    return Closing(held.says, f"type in the {further.replace('_', '-')} gains, engine off: {words}; log the same moves "
                   f"again, then: {then}")  # fmt: skip


def next_run(run: Path) -> Path:
    """A new run folder beside this one: runs/car_2 after runs/car."""
    base = re.sub(r"_\d+$", "", run.name)
    every = (run.with_name(f"{base}_{k}") for k in itertools.count(2))
    return next(each for each in every if not each.exists() and each != run)


def of_fleet(content: Content, run: Path) -> Closing:
    """Findings that need action, or that there are none; gains for all units come next."""
    from ..fleet import verdict
    from ..fleet.page import NAME

    said = verdict(content)
    bad = [sentence.text for sentence in said if sentence.bad]
    answer = " ".join(bad) if bad else " ".join(sentence.text for sentence in said)
    odd = content.get("odd") or ()
    page = content["members"][odd[0]["unit"]].get("page") if odd else None  # page of the oddest unit
    return Closing(answer, command("design", run, "--fleet"), (run / NAME, *([run / page] if page else [])))
