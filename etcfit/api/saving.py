"""What a command leaves in a run folder: files and pictures together; ONE place for the commands and for `save`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..run_folder import (
    NOT_CONVERGED,
    RunFolder,
    exit_of,
    save_design,
    save_posterior,
    save_reduction,
)
from .progress import Report, silent

if TYPE_CHECKING:
    from ..control.design import Design
    from ..control.frequency import FrequencyResponse
    from ..control.linearise import Reduction
    from ..diagnosis.findings import Diagnosis
    from ..estimation.result import FitResult
    from ..posterior.profile import Profile
    from ..posterior.sampling import Posterior


def keep_fit(run: RunFolder, result: FitResult, report: Report = silent) -> None:
    """fit.json, the fit whole, and its pictures."""
    from ..reporting import draw_fit

    run.keep_fit(result, lambda: draw_fit(run.path, result, report))


def keep_diagnosis(run: RunFolder, found: Diagnosis, report: Report = silent) -> None:
    """diagnosis.json, the diagnosis whole with the fit it began from, and its pictures."""
    from ..reporting import draw_diagnosis

    run.keep_diagnosis(found, lambda: draw_diagnosis(run.path, found, report))


def keep_posterior(
    run: RunFolder,
    posterior: Posterior,
    profiles: Mapping[str, Profile],
    settings: Mapping[str, Any],
    report: Report = silent,
) -> None:
    """posterior.json, posterior.nc and pictures."""
    from ..posterior.predictive import bands
    from ..reporting import draw_posterior

    predicted = bands(posterior, report)
    status = exit_of(posterior.fit) if posterior.convergence.converged else NOT_CONVERGED
    save_posterior(run.path, posterior, profiles, predicted, status, {**asdict(posterior.settings), **settings},
                   lambda: draw_posterior(run.path, posterior, profiles, predicted, report))  # fmt: skip


def keep_reduction(
    run: RunFolder,
    result: FitResult,
    reduction: Reduction,
    response: FrequencyResponse | None,
    pade_order: int,
    report: Report = silent,
) -> None:
    """transfer_function.json, frequency_response.json where the rig has sine traces, and their Bode plots."""
    from ..reporting import draw_frequency_response, draw_reduction

    fitted = result.fitted()

    def beside() -> None:
        draw_reduction(run.path, fitted, reduction, report)
        if response is not None:
            draw_frequency_response(run.path, fitted, response, report)

    settings = {
        "input": reduction.input_unit,
        "output": reduction.output_unit,
        "at": reduction.share,
        "pade_order": pade_order,
        "frequency": None if response is None else asdict(response.settings),
    }
    save_reduction(run.path, fitted, reduction, response, exit_of(result), settings, beside)


def keep_design(
    run: RunFolder, result: FitResult, design: Design, settings: Mapping[str, Any], report: Report = silent
) -> None:
    """pid.json and the responses of every rule."""
    from ..reporting import draw_design

    settings = {**asdict(design.settings), **settings}
    save_design(
        run.path, design, exit_of(result), settings, lambda: draw_design(run.path, design, report), _read_for(settings)
    )


def _read_for(settings: Mapping[str, Any]) -> list[Path]:
    """Files outside of the run folder that gains asked for so were made from."""
    from ..run_folder.fleet import FLEET

    log, parts = settings.get("log"), settings.get("parts")
    return [*([Path(log)] if log else []), *([Path(parts) / FLEET] if parts else [])]
