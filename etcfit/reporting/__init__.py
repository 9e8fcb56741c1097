"""What a person sees of a fit or a diagnosis: tables for the terminal, pictures for the run folder.

The only matplotlib; lazy.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from ..control.design import Design
from ..control.frequency import FrequencyResponse
from ..control.linearise import Reduction
from ..diagnosis.findings import Diagnosis
from ..estimation.fitted_model import Fitted
from ..estimation.joint_fit import FitResult, Report, quiet
from ..files import write_json
from ..posterior import Posterior
from ..posterior.predictive import bands
from ..posterior.profile import Profile
from ..run_folder import (
    design_json,
    diagnosis_json,
    fit_json,
    frequency_json,
    reduction_json,
    write_diagnosis_state,
    write_state,
)
from ..run_folder.posterior import posterior_json, write_netcdf

_FREQUENCY_RESPONSE, _FREQUENCY_PICTURE = "frequency_response.json", "sines.png"


def write_run(run_dir: Path | str, result: FitResult, report: Report | None = None) -> None:
    """Write a fit to its run folder: fit.json, the state that later commands start from, and the pictures.

    Args:
        run_dir: RUN; made if absent. A file of the same name is replaced, whole or not at all.
        result: a fit, converged or not.
        report: called with what is being written and the share done.
    """
    run = Path(run_dir)
    write_json(run / "fit.json", "fit", fit_json(result))
    write_state(run, result)
    from .pictures import jobs

    _draw(run / "pictures", jobs(result), report)


def write_diagnosis(run_dir: Path | str, diagnosis: Diagnosis, report: Report | None = None) -> None:
    """Write a diagnosis to its run folder: diagnosis.json, the state of the final model, and the pictures.

    Args:
        run_dir: RUN; made if absent. A file of the same name is replaced, whole or not at all.
        diagnosis: what was found.
        report: called with what is being written and the share done.
    """
    run = Path(run_dir)
    write_json(run / "diagnosis.json", "diagnosis", diagnosis_json(diagnosis))
    write_diagnosis_state(run, diagnosis)
    from .diagnosis.pictures import jobs

    _draw(run / "pictures" / "diagnosis", jobs(diagnosis), report)


def write_posterior(
    run_dir: Path | str, posterior: Posterior, profiles: Mapping[str, Profile], report: Report | None = None
) -> None:
    """Write a posterior to its run folder: posterior.json, posterior.nc and the pictures.

    Args:
        run_dir: RUN; made if absent. A file of the same name is replaced, whole or not at all.
        posterior: converged or not.
        profiles: of its weak parameters.
        report: called with what is being written and the share done.
    """
    run = Path(run_dir)
    predicted = bands(posterior, report or quiet)
    write_json(run / "posterior.json", "posterior", posterior_json(posterior, profiles, predicted))
    write_netcdf(run / "posterior.nc", posterior)
    from .posterior.pictures import jobs

    _draw(run / "pictures" / "posterior", jobs(posterior, profiles, predicted), report)


def write_reduction(
    run_dir: Path | str, fitted: Fitted, reduction: Reduction, pade_order: int, report: Report | None = None
) -> None:
    """Write a transfer function to its run folder: transfer_function.json and its Bode plot.

    A frequency response that lies there goes: it was compared with another one.

    Args:
        run_dir: RUN; made if absent. A file of the same name is replaced, whole or not at all.
        fitted, reduction: the model and its linear plant.
        pade_order: see `run_folder.reduction_json`.
        report: called with what is being written and the share done.
    """
    run = Path(run_dir)
    (run / _FREQUENCY_RESPONSE).unlink(missing_ok=True)
    (run / "pictures" / "control" / _FREQUENCY_PICTURE).unlink(missing_ok=True)
    write_json(run / "transfer_function.json", "transfer_function", reduction_json(fitted, reduction, pade_order))
    from .control.bode import BodePicture, draw

    picture = BodePicture.of(fitted, reduction)
    _draw(run / "pictures" / "control", [(Path("bode.png"), lambda: draw(picture))], report)


def write_frequency_response(
    run_dir: Path | str, fitted: Fitted, response: FrequencyResponse, report: Report | None = None
) -> None:
    """Write what sine traces say to the run folder: frequency_response.json and, where any says something, a Bode plot.

    Args:
        run_dir: RUN; made if absent. A file of the same name is replaced, whole or not at all.
        fitted, response: the model, and the response measured and modelled.
        report: called with what is being written and the share done.
    """
    run = Path(run_dir)
    write_json(run / _FREQUENCY_RESPONSE, "frequency_response", frequency_json(fitted, response))
    from .control.sines import draw

    jobs = [(Path(_FREQUENCY_PICTURE), lambda: draw(fitted.config, response))] if response.points else []
    _draw(run / "pictures" / "control", jobs, report)


def write_design(run_dir: Path | str, design: Design, report: Report | None = None) -> None:
    """Write gains to their run folder: pid.json and the responses of every rule.

    Args:
        run_dir: RUN; made if absent. A file of the same name is replaced, whole or not at all.
        design: the gains.
        report: called with what is being written and the share done.
    """
    run = Path(run_dir)
    write_json(run / "pid.json", "pid", design_json(design))
    from .control.responses import draw

    _draw(run / "pictures" / "control", [(Path("responses.png"), lambda: draw(design))], report)


def _draw(folder: Path, jobs: Sequence[tuple[Path, Callable[[], Any]]], report: Report | None) -> None:
    from . import style

    for k, (path, draw) in enumerate(jobs):
        if report is not None:
            report(f"drawing {path}", k / len(jobs))
        with style.drawing():
            style.save(draw(), folder / path)
