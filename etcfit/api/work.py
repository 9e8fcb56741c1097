"""Work shared by verbs and stages: from a fit to its linear plant, to gains, to the files of another program; and the
files and pictures that each step writes into a run folder.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ..errors import UsageError, command
from ..files import held, write_json
from ..run_folder.folder import RunFolder
from ..run_folder.manifest import FLEET, NOT_CONVERGED, POSTERIOR, replacing
from .progress import Report, silent

if TYPE_CHECKING:
    import numpy as np

    from ..car_log.log import Series
    from ..control.design import Design
    from ..control.frequency import FrequencyResponse
    from ..control.linearise import Reduction
    from ..control.request import DesignRequest
    from ..control.settings import DesignSettings
    from ..diagnosis.findings import Diagnosis
    from ..estimation.fitted_model import Fitted, FleetModel
    from ..estimation.result import FitResult
    from ..model.ecu import Ecu
    from ..model.ecus import EcuProfile
    from ..posterior.profile import Profile
    from ..posterior.sampling import Posterior
    from ..reporting.page import Page
    from ..rig.base import RigConfig


def design_of(
    model: Fitted | FleetModel,
    request: DesignRequest,
    drawn: np.ndarray | None,
    report: Report,
    settings: DesignSettings | None = None,
) -> Design:
    """Gains by every rule for an ECU that reads the position by an ADC over its travel; for a fleet, gains with which
    nearly all of its units meet the requirements.

    Args:
        request: the request; for a fleet without `parts`.
        drawn: coordinates of further models, shape (D, P), or None; None for a fleet, whose units are drawn.
        settings: draws, and the budgets of simulation and rules; the defaults if None.
    Raises:
        MeasurementError: the log cannot be read, or has no setpoint.
        UsageError: no such make, a given field that its source fixes at another value, or parts of another design.
    """
    from ..control.design import design, design_for_fleet
    from ..control.fleet import future_units
    from ..control.pid import Requirements
    from ..control.settings import DesignSettings
    from ..estimation.fitted_model import FleetModel

    computer, make = _computer(model.nominal if isinstance(model, FleetModel) else model, request)
    log = None if request.log is None else setpoint_of(Path(request.log), model.config)
    limits, mine = Requirements(**request.limits), settings or DesignSettings()
    if isinstance(model, FleetModel):
        return design_for_fleet(model, computer, limits, request.rule, future_units(model), request.feed_forward,
                                report, mine, profile=make, log=log, present=request.present)  # fmt: skip
    parts = None
    if request.parts is not None:
        from ..run_folder.fleet import parts_of

        parts = parts_of(Path(request.parts))
    found = design(model, computer, limits, request.rule, drawn, request.feed_forward, report, mine, make, log,
                   request.present, parts=parts)  # fmt: skip
    return replace(found, anyway=True) if request.anyway else found


def _computer(fitted: Fitted, request: DesignRequest) -> tuple[Ecu, EcuProfile | None]:
    """The ECU from its given properties and those that its make fixes."""
    from ..control.design import ecu_of
    from ..model.ecus import named

    make, ecu = None if request.profile is None else named(request.profile), request.ecu
    if make is not None:
        ecu = make.completed(ecu)
    lower, upper = fitted.config.stops
    return ecu_of(fitted, **({"resolution": (upper - lower) / 2**request.adc_bits} | dict(ecu))), make


def setpoint_of(path: Path, config: RigConfig) -> Series:
    """The setpoint of the plate in a log from the car, per cent of the travel."""
    from ..car_log.read import read_log
    from ..errors import MeasurementError

    log = read_log(path, config, "rig.toml")
    if log.setpoint is None:
        raise MeasurementError(str(path), "no setpoint among its columns.", "Gains are tried on the log's setpoint.",
                               log.hint)  # fmt: skip
    return log.setpoint


class Exported(NamedTuple):
    """An export on the disk.

    Args:
        cannot_hold: what the format leaves out, one sentence each; the files say so too.
    """

    files: tuple[Path, ...]
    cannot_hold: tuple[str, ...]


def keep_fit(run: RunFolder, result: FitResult, report: Report = silent) -> None:
    """Write fit.json, the whole fit, and its summary picture."""
    from ..reporting import clear_for_fit, draw_fit

    with held(run.path):
        run.keep_fit(result, lambda _: clear_for_fit(run.path))
        with _all_is_saved(run):
            draw_fit(run.path, result, report)


def keep_diagnosis(run: RunFolder, found: Diagnosis, report: Report = silent) -> None:
    """Write diagnosis.json, the whole diagnosis with the fit that it began from, and its summary pictures."""
    from ..reporting import clear_for_diagnosis, draw_diagnosis

    with held(run.path):
        run.keep_diagnosis(found, lambda _: clear_for_diagnosis(run.path, found))
        with _all_is_saved(run):
            draw_diagnosis(run.path, found, report)


@contextmanager
def _all_is_saved(run: RunFolder) -> Iterator[None]:
    """Give Ctrl-C a message that says which results are saved."""
    try:
        yield
    except KeyboardInterrupt:
        raise KeyboardInterrupt(
            f"interrupted while pictures were drawn. All results are in {run.path}; "
            f"`{command('report', run.path)}` draws the pictures that are missing."
        ) from None


def keep_page(run: RunFolder, report: Report = silent) -> Page:
    """Write RUN/report.html and the pictures that it shows.

    If the models cannot be loaded any more, for example because the measurements have changed, the page shows the
    existing pictures, and `missing` says why.
    """
    from ..reporting import draw_others
    from ..reporting.page import read_run, write_page

    read_run(run.path)  # reports errors of RUN before anything is drawn
    missing = ""
    with held(run.path):
        try:
            with _all_is_saved(run):
                draw_others(run, report)
        except UsageError as error:
            missing = f"Some pictures cannot be drawn any more: {error}"
        return replace(write_page(run.path), missing=missing)


def keep_posterior(
    run: RunFolder, posterior: Posterior, profiles: Mapping[str, Profile], report: Report = silent
) -> None:
    """Write posterior.json, posterior.nc and pictures."""
    from ..posterior.sampling import bands
    from ..reporting.drawing import draw_shared
    from ..reporting.posterior.pictures import jobs
    from ..run_folder.posterior import posterior_json, write_netcdf
    from ..run_folder.state import exit_of

    predicted = bands(posterior, report)
    status = exit_of(posterior.fit) if posterior.convergence.converged else NOT_CONVERGED
    settings = asdict(posterior.settings) | {"steps": posterior.settings.most_steps}
    with replacing(run.path, "sample", status, settings) as draft:
        write_netcdf(draft / POSTERIOR, posterior)
        write_json(draft / "posterior.json", "posterior", posterior_json(posterior, profiles, predicted))
        draw_shared(draft / "pictures" / "posterior", jobs(posterior, profiles, predicted), report)


def keep_reduction(
    run: RunFolder,
    result: FitResult,
    reduction: Reduction,
    response: FrequencyResponse | None,
    pade_order: int,
    report: Report = silent,
) -> None:
    """Write transfer_function.json, frequency_response.json if the rig has sine traces, and their Bode plots."""
    from ..reporting.control import bode
    from ..reporting.drawing import Job, draw_here
    from ..run_folder.plant import frequency_json, reduction_json
    from ..run_folder.state import exit_of

    fitted = result.fitted()
    settings = {
        "input": reduction.input_unit,
        "output": reduction.output_unit,
        "at": reduction.share,
        "pade_order": pade_order,
        "frequency": None if response is None else asdict(response.settings),
    }
    with replacing(run.path, "reduce", exit_of(result), settings) as draft:
        plant = reduction_json(fitted, reduction, pade_order)
        write_json(draft / "transfer_function.json", "transfer_function", plant)
        jobs: list[Job] = [(Path("bode.png"), partial(bode.draw, fitted, reduction))]
        if response is not None:
            write_json(draft / "frequency_response.json", "frequency_response", frequency_json(fitted, response))
            if response.points:
                jobs.append((Path("sines.png"), partial(bode.draw_sines, fitted.config, response)))
        draw_here(draft / "pictures" / "control", jobs, report)


def keep_design(
    run: RunFolder, result: FitResult, design: Design, settings: Mapping[str, Any], report: Report = silent
) -> None:
    """Write pid.json and the responses of every rule; the manifest names the log and the fleet behind the gains."""
    from ..reporting import draw_design
    from ..run_folder.pid import PID
    from ..run_folder.state import exit_of

    log, parts = settings.get("log"), settings.get("parts")
    outside = [*([Path(log)] if log else []), *([Path(parts) / FLEET] if parts else [])]
    with replacing(
        run.path, "design", exit_of(result), {**asdict(design.settings), **settings}, outside=outside
    ) as draft:
        write_json(draft / "pid.json", "pid", PID.json(design))
        draw_design(draft, design, report)
