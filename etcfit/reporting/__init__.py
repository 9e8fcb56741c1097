"""What a person sees of a run: tables for the terminal, pictures and the page for the run folder.

The only matplotlib; lazy.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from ..estimation.joint_fit import Report, quiet

if TYPE_CHECKING:  # a table of `check` needs none of what these load
    from ..control.design import Design
    from ..control.frequency import FrequencyResponse
    from ..control.linearise import Reduction
    from ..diagnosis.findings import Diagnosis
    from ..estimation.fitted_model import Fitted
    from ..estimation.result import FitResult
    from ..posterior.predictive import Band
    from ..posterior.profile import Profile
    from ..posterior.sampling import Posterior

# every function below draws into RUN/pictures; one file of the same name is replaced, whole or not at all


def draw_fit(run: Path, result: FitResult, report: Report = quiet) -> None:
    """Traces, tests, parameters and overview of a fit, converged or not; those of another fit go."""
    from .drawing import draw_shared
    from .pictures import jobs

    _clear(run / "pictures")
    draw_shared(run / "pictures", jobs(result), report)


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


def draw_diagnosis(run: Path, diagnosis: Diagnosis, report: Report = quiet) -> None:
    """Missing torque and voltage, rounds, errors before and after: RUN/pictures/diagnosis.

    RUN/pictures become those of the final model, where that is another than the first fit's; those of the first fit
    are moved to RUN/pictures/before.
    """
    from .diagnosis.pictures import jobs
    from .drawing import draw_shared
    from .pictures import jobs as jobs_of_model

    pictures, another = run / "pictures", diagnosis.final != diagnosis.start or bool(diagnosis.aside)
    _set_aside(pictures, pictures / "before", another)
    of_model = jobs_of_model(diagnosis.after)
    # of the same model the diagnosis may have widened the intervals
    of_model = of_model if another else [job for job in of_model if job[0] == Path("parameters.png")]
    for folder in ("", "traces"):
        _delete(pictures / "diagnosis" / folder)
    draw_shared(pictures, [*of_model, *((Path("diagnosis") / path, draw) for path, draw in jobs(diagnosis))], report)


def _set_aside(pictures: Path, before: Path, another: bool) -> None:
    """Pictures of the first fit go to `before` where another model takes their place, and back where none does."""
    if before.is_dir():
        _clear(pictures)
        if not another:
            _move(before, pictures)
            shutil.rmtree(before)
    elif another:
        _move(pictures, before)


def draw_posterior(
    run: Path, posterior: Posterior, profiles: Mapping[str, Profile], bands: Sequence[Band], report: Report = quiet
) -> None:
    """Corner plot, intervals, predictive bands: RUN/pictures/posterior."""
    from .drawing import draw_shared
    from .posterior.pictures import jobs

    draw_shared(run / "pictures" / "posterior", jobs(posterior, profiles, bands), report)


def draw_reduction(run: Path, fitted: Fitted, reduction: Reduction, report: Report = quiet) -> None:
    """The Bode plot of the linear plant: RUN/pictures/control/bode.png."""
    from .control.bode import BodePicture, draw
    from .drawing import draw_here

    picture = BodePicture.of(fitted, reduction)
    draw_here(run / "pictures" / "control", [(Path("bode.png"), partial(draw, picture))], report)


def draw_frequency_response(run: Path, fitted: Fitted, response: FrequencyResponse, report: Report = quiet) -> None:
    """The Bode plot of the sine traces, where any says something: RUN/pictures/control/sines.png."""
    from .control.sines import draw
    from .drawing import draw_here

    jobs = [(Path("sines.png"), partial(draw, fitted.config, response))] if response.points else []
    draw_here(run / "pictures" / "control", jobs, report)


def draw_design(run: Path, design: Design, report: Report = quiet) -> None:
    """Responses of every rule, the proposed gains in every scenario, tracking against effort, failures."""
    from .control import front, responses, safety, scenarios
    from .drawing import draw_here

    pictures = {"responses": responses.draw, "scenarios": scenarios.draw, "front": front.draw,
                "safety": safety.draw}  # fmt: skip
    jobs = [(Path(f"{name}.png"), partial(draw, design)) for name, draw in pictures.items()]
    draw_here(run / "pictures" / "control", jobs, report)
