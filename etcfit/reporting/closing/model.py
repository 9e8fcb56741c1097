"""Closing lines of a fit, a diagnosis, a page or a whole run, from the contents of RUN."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ...diagnosis.probabilities import WORTH_NAMING, likely_hypotheses
from ...errors import command
from ...estimation.goodness import Left
from ...run_folder.manifest import read_records
from ...run_folder.state import measurements_of
from ..page import Contents, read_run, tuned_of
from ..page.verdict import left_unexplained, residuals
from . import NEXT_LOG, Closing, first_few, mended

PAGE, INTERACTIVE = "report.html", "report_interactive.html"
_GUESSES = 2  # largest number of unproven names in one line


def of_run(run: Path, *pages: Path) -> Closing:
    """Closing lines for the last model in RUN; pages come before the picture of errors or parameters. If the run is of
    `tune`, the words of `tune` on the gains."""
    contents = read_run(run)
    if (tuned := tuned_of(run)) and tuned["says"]["next"] and len(tuned["steps"]) > 1:
        further = command("drive", NEXT_LOG, "--foretold", run)
        return Closing(tuned["says"]["answer"], further, (*pages, run / "pictures" / "tune.png"))
    picture = "diagnosis/ledger.png" if contents.get("diagnosis") else "parameters.png"
    further = _next(contents)
    if further == command("report", run, "--interactive") and run / INTERACTIVE in pages:
        further = advice_at(run)
    return Closing(" ".join((*_found(contents), _known(contents))), further, (*pages, run / "pictures" / picture))


def _next(contents: Contents) -> str:
    """The next step for the last model: a diagnosis, mending the rig, a look at open questions, then gains."""
    run, lost, found = contents.run, _with_status(contents, "not identifiable"), contents.get("diagnosis")
    if not found:
        # by the rule of `estimation.goodness`: the residuals of the fitted traces are noise
        rows = contents.score["fit"]
        if not _is_sound(contents) or any(row.get("left") not in (Left.FITS, Left.STRAYS) for row in rows):
            return command("diagnose", run)
        return advice_at(run) if lost and not contents.get("pid") else _after_the_model(contents)
    sure = {each["effect"]: each["acted_on"] for each in _stated(contents)}
    if mistake := next((each for each in found.get("rig") or () if each["effect"] and sure.get(each["effect"])), None):
        return mended(mistake["mend"], measured(run), command("fit", measured(run), "--out", run))
    if not all(sure.values()):
        return advice_at(run)
    done = _is_sound(contents) and left_unexplained(contents) is None
    return _after_the_model(contents) if done else command("report", run, "--interactive")


def _after_the_model(contents: Contents) -> str:
    run, pid = contents.run, contents.get("pid")
    return command("export", run, "--to", "c") if pid else command("design", run)


def advice_at(run: Path) -> str:
    """The command that shows which further test would help most, at the model in RUN."""
    return command("check", measured(run), "--advise", "--at", run)


def measured(run: Path) -> str:
    """The measurement folder of a run as seen from here; FOLDER where its traces were data frames."""
    folder = measurements_of(run, read_records(run)["fit"])
    if folder is None:
        return "FOLDER"
    try:
        return str(folder) if run.is_absolute() else os.path.relpath(folder)
    except ValueError:  # another drive
        return str(folder)


def _stated(contents: Contents) -> Sequence[Mapping[str, Any]]:
    """The diagnosis' statements on the effects that it added."""
    return contents.get("diagnosis").get("statements") or ()


def _found(contents: Contents) -> list[str]:
    """The statements of the diagnosis, name by name; or that nothing was added."""
    found = contents.get("diagnosis")
    if not found:
        return []
    stated = [each["sentence"] for each in _stated(contents)]
    if stated:
        return stated
    if _is_sound(contents) and left_unexplained(contents) is None:
        return ["No effect of the catalogue is missing, as far as these data show."]
    names = [f"{name} (P {p:.2f})" for name, p in likely_hypotheses(found.get("probabilities") or {})
             if name not in ("nothing", "unexplained") and p >= WORTH_NAMING][:_GUESSES]  # fmt: skip
    guess = f"; it may be {' or '.join(names)}, not proven" if names else ""
    return [f"Something is missing, and no known effect explains it{guess}."]


def _known(contents: Contents) -> str:
    """Which parameters are known, and the residuals of the model."""
    final = contents.final
    if not final.get("converged", True):
        return f"The fit did not converge: {final['reason']}. Its parameters are no results."
    if why := final.get("compromise"):
        return f"Parameters are ranges, not estimates: {why}. An effect is missing, or the rig has a mistake."
    known, lost = _with_status(contents, "estimated"), _with_status(contents, "not identifiable")
    said = f"{first_few(known)} {'is' if len(known) == 1 else 'are'} known" if known else "No parameter is known"
    said += f"; these data cannot tell {first_few(lost)}" if lost else ""
    if contents.score.get("chi2_per_dof") is None:
        return f"{said}; the model cannot be simulated over all of the data."
    return f"{said}; the model leaves {residuals(contents.score).partition(';')[0]}."  # the page has the rest


def _is_sound(contents: Contents) -> bool:
    """Whether the last model is an estimate: it converged, and is no compromise."""
    return bool(contents.final.get("converged", True) and not contents.final.get("compromise"))


def _with_status(contents: Contents, status: str) -> list[str]:
    return [symbol for symbol, each in contents.final["parameters"].items() if each["status"] == status]
