"""What a person sees of a run: tables for the terminal, pictures and the page for the run folder.

The only matplotlib; lazy.
"""

from __future__ import annotations

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
    for old in (run / "pictures").glob("*.png"):
        old.unlink()
    for folder in ("traces", "tests"):
        for old in (run / "pictures" / folder).glob("*.png"):
            old.unlink()
    from .drawing import draw_shared
    from .pictures import jobs

    draw_shared(run / "pictures", jobs(result), report)


def draw_diagnosis(run: Path, diagnosis: Diagnosis, report: Report = quiet) -> None:
    """Missing torque and voltage, rounds, errors before and after: RUN/pictures/diagnosis."""
    from .diagnosis.pictures import jobs
    from .drawing import draw_shared

    draw_shared(run / "pictures" / "diagnosis", jobs(diagnosis), report)


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
