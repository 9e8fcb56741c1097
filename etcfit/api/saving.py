"""What a command leaves in a run folder: files and pictures together; ONE place for the commands and for `save`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import UsageError, command
from ..files import held
from ..run_folder import FLEET, NOT_CONVERGED, RunFolder
from .progress import Report, silent

if TYPE_CHECKING:
    from ..control.design import Design
    from ..control.frequency import FrequencyResponse
    from ..control.linearise import Reduction
    from ..diagnosis.findings import Diagnosis
    from ..estimation.result import FitResult
    from ..posterior.profile import Profile
    from ..posterior.sampling import Posterior
    from ..reporting.page import Page


def keep_fit(run: RunFolder, result: FitResult, report: Report = silent) -> None:
    """fit.json, the fit whole, and the picture that sums it up."""
    from ..reporting import clear_for_fit, draw_fit

    with held(run.path):
        run.keep_fit(result, lambda _: clear_for_fit(run.path))
        with _all_is_saved(run):
            draw_fit(run.path, result, report)


def keep_diagnosis(run: RunFolder, found: Diagnosis, report: Report = silent) -> None:
    """diagnosis.json, the diagnosis whole with the fit it began from, and the pictures that sum it up."""
    from ..reporting import clear_for_diagnosis, draw_diagnosis

    with held(run.path):
        run.keep_diagnosis(found, lambda _: clear_for_diagnosis(run.path, found))
        with _all_is_saved(run):
            draw_diagnosis(run.path, found, report)


@contextmanager
def _all_is_saved(run: RunFolder) -> Iterator[None]:
    """Ctrl-C says what is kept.

    Raises:
        KeyboardInterrupt: as it came, with a message.
    """
    try:
        yield
    except KeyboardInterrupt:
        raise KeyboardInterrupt(
            f"interrupted while pictures were drawn. All results are in {run.path}; "
            f"`{command('report', run.path)}` draws the pictures that are missing."
        ) from None


def keep_page(run: RunFolder, report: Report = silent) -> Page:
    """RUN/report.html, and the pictures that it shows.

    Where the models cannot be loaded any more, as when the measurements have changed since, the page shows the pictures
    that are there, and `missing` says why.
    """
    from ..reporting import draw_others
    from ..reporting.page import write_page
    from ..reporting.page.contents import read_run

    read_run(run.path)  # says what is wrong with RUN before anything is drawn
    missing = ""
    with held(run.path):
        try:
            with _all_is_saved(run):
                draw_others(run, report)
        except UsageError as error:
            missing = f"Some pictures cannot be drawn any more: {error}"
        return replace(write_page(run.path), missing=missing)


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
    from ..run_folder import exit_of, save_posterior

    predicted = bands(posterior, report)
    status = exit_of(posterior.fit) if posterior.convergence.converged else NOT_CONVERGED
    save_posterior(run.path, posterior, profiles, predicted, status, {**asdict(posterior.settings), **settings},
                   lambda draft: draw_posterior(draft, posterior, profiles, predicted, report))  # fmt: skip


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
    from ..run_folder import exit_of, save_reduction

    fitted = result.fitted()

    def beside(draft: Path) -> None:
        draw_reduction(draft, fitted, reduction, report)
        if response is not None:
            draw_frequency_response(draft, fitted, response, report)

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
    from ..run_folder import exit_of, save_design

    settings = {**asdict(design.settings), **settings}
    save_design(
        run.path, design, exit_of(result), settings, lambda draft: draw_design(draft, design, report),
        _read_for(settings),
    )  # fmt: skip


def _read_for(settings: Mapping[str, Any]) -> list[Path]:
    """Files outside of the run folder that gains asked for so were made from."""
    log, parts = settings.get("log"), settings.get("parts")
    return [*([Path(log)] if log else []), *([Path(parts) / FLEET] if parts else [])]
