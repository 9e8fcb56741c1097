"""Output for people: tables for the terminal, pictures and the page for the run folder.

A fit and a diagnosis draw one summary picture. The others, of every test and trace, take longer than many a fit:
`draw_others` draws them for the page.

Only this room imports matplotlib, and only when it draws.
"""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import command

if TYPE_CHECKING:  # a table of `check` does not need these modules
    from ..control.design import Design
    from ..diagnosis.findings import Diagnosis
    from ..estimation.joint_fit import Report
    from ..estimation.result import FitResult
    from ..run_folder.folder import RunFolder
    from .drawing import Job

_UNDRAWN = "undrawn.txt"  # in RUN/pictures, as long as pictures of the models in RUN are missing

# every function below draws into RUN/pictures; a file of the same name is replaced, completely or not at all


# `clear_...` runs before a model is saved, so that after an interruption no picture shows another model


def clear_for_fit(run: Path) -> None:
    """Delete the pictures of another fit; see `draw_others`."""
    _leave_others(run)
    _clear(run / "pictures")


def draw_fit(run: Path, result: FitResult, report: Report) -> None:
    """The parameters of a fit, converged or not; see `draw_others`."""
    from .drawing import draw_here
    from .pictures import summary

    draw_here(run / "pictures", summary(result), report)


def _leave_others(run: Path) -> None:
    """Note in a file that pictures are missing, for `draw_others` and for the user."""
    (run / "pictures").mkdir(parents=True, exist_ok=True)
    note = f"The other pictures, of every test and trace, are drawn by\n\n    {command('report', run)}\n"
    (run / "pictures" / _UNDRAWN).write_text(note, encoding="utf-8")


def has_undrawn(run: Path) -> bool:
    """Whether `draw_others` has something to draw."""
    return (run / "pictures" / _UNDRAWN).exists()


def draw_others(run: RunFolder, report: Report) -> None:
    """Draw the pictures of the fit and of the diagnosis in RUN that `draw_fit` and `draw_diagnosis` left out.

    An existing picture is not drawn again, so that drawing continues after an interruption.

    Raises:
        UsageError: the models in RUN cannot be loaded; see `RunFolder.diagnosis`.
    """
    from .drawing import draw_shared

    if not has_undrawn(run.path):
        return
    pictures = run.path / "pictures"
    draw_shared(pictures, [job for job in _every(run) if not (pictures / job[0]).exists()], report)
    (pictures / _UNDRAWN).unlink()


def _every(run: RunFolder) -> list[Job]:
    """Every picture of the models in RUN, in the order of interest."""
    from .diagnosis.pictures import jobs
    from .pictures import jobs as jobs_of_model

    found = run.diagnosis()
    if found is None:
        return jobs_of_model(run.fit())
    first = jobs_of_model(found.before) if _is_another(found) else []
    return [*_below("diagnosis", jobs(found)), *jobs_of_model(found.after), *_below("before", first)]


def _below(folder: str, jobs: Sequence[Job]) -> list[Job]:
    return [(Path(folder) / path, draw_sines) for path, draw_sines in jobs]


_OF_A_MODEL = ("", "tests", "traces")  # folders of its pictures, below RUN/pictures


def _clear(pictures: Path) -> None:
    for folder in _OF_A_MODEL:
        _delete(pictures / folder)


def _delete(folder: Path) -> None:
    for old in folder.glob("*.png"):
        old.unlink()


def _move(pictures: Path, to: Path) -> None:
    """All pictures of a model."""
    for folder in _OF_A_MODEL:
        for each in (pictures / folder).glob("*.png"):
            (to / folder).mkdir(parents=True, exist_ok=True)
            each.replace(to / folder / each.name)


def clear_for_diagnosis(run: Path, diagnosis: Diagnosis) -> None:
    """Move the pictures of the first fit to RUN/pictures/before if the final model is another, and back if none is. See
    `draw_others`."""
    pictures, before, another = run / "pictures", run / "pictures" / "before", _is_another(diagnosis)
    _leave_others(run)
    if before.is_dir():
        _clear(pictures)
        if not another:
            _move(before, pictures)
            shutil.rmtree(before)
    elif another:
        _move(pictures, before)
    for folder in ("", "traces"):
        _delete(pictures / "diagnosis" / folder)


def draw_diagnosis(run: Path, diagnosis: Diagnosis, report: Report) -> None:
    """Errors before and after, and the parameters of the final model; see `draw_others`."""
    from .diagnosis.pictures import summary
    from .drawing import draw_here
    from .pictures import summary as summary_of_model

    # the diagnosis may have widened the intervals of the same model
    jobs = [*_below("diagnosis", summary(diagnosis)), *summary_of_model(diagnosis.after)]
    draw_here(run / "pictures", jobs, report)


def _is_another(diagnosis: Diagnosis) -> bool:
    """Whether the final model is another than the first fit's, or was fitted to fewer traces."""
    return diagnosis.final != diagnosis.start or bool(diagnosis.aside)


def draw_design(run: Path, design: Design, report: Report) -> None:
    """Responses of every rule, the proposed gains in every scenario, tracking against effort, failures."""
    from .control import pictures as of_control
    from .drawing import draw_here

    pictures = {"responses": of_control.draw_responses, "scenarios": of_control.draw_scenarios,
                "front": of_control.draw_front, "safety": of_control.draw_safety}  # fmt: skip
    jobs = [(Path(f"{name}.png"), partial(draw, design)) for name, draw in pictures.items()]
    draw_here(run / "pictures" / "control", jobs, report)
