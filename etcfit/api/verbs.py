"""The commands of etcfit as Python functions, for scripts and notebooks: `etcfit.fit`, `etcfit.diagnose`, ...

    rig = read_folder(FOLDER);  fit(rig) -> diagnose -> sample, reduce, design -> report

Each takes the result of an earlier one, or a run folder, and returns an object of this room. The commands call these
functions. Most only compute and return; `report`, `export`, `fetch`, `tune`, `fleet`, `sample` with a folder, and
`save` of a result write files. `quiet` may be a function instead, which is called with each step and the share that is
done. Heavy modules are imported when a function is called.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Literal

from ..control.request import DesignRequest
from ..errors import UsageError, command, require_extra
from ..posterior.settings import SamplingSettings
from .arguments import verb
from .progress import Report, silent, working

if TYPE_CHECKING:
    import numpy as np

    from ..control.pid import Requirements
    from ..control.settings import DesignSettings, FrequencySettings
    from ..diagnosis.settings import DiagnosisSettings
    from ..estimation.fitted_model import Fitted
    from ..estimation.result import FitResult
    from ..estimation.settings import FitSettings
    from ..experiment.settings import AdviceSettings, CampaignSettings, CheckSettings
    from ..exporting import ExportSettings
    from ..importing.tuning import TuneSettings
    from ..model.feed_forward import TermNames
    from ..rig.base import Rig
    from ..run_folder.folder import RunFolder
    from .controller import Designed, Reduced
    from .explanation import Diagnosed, Sampled
    from .fit import Fit
    from .fleet import Fleet
    from .measurements import Advised, Checked, Driven, Planned
    from .tuned import Tuned
    from .work import Exported

    Folder = str | Path
    Model = Fit | Diagnosed | Sampled | Reduced | RunFolder | Folder


@verb
def check(rig: Rig | Folder, settings: CheckSettings | None = None, *, quiet: bool | Report = False) -> Checked:
    """The contents of a measurement folder, which parameters it identifies, and what is wrong with it; no fit.

    Args:
        rig: a rig, or its folder.
        settings: thresholds for an odd clock or channel; the defaults if None.
    Raises:
        MeasurementError: the folder is wrong.
    """
    with working(quiet) as report:
        rig = _rig_of(rig, report)
        from ..experiment.check import check as check_rig
        from .measurements import Checked

        report("computing which parameters these data identify", 0.3)
        return Checked(check_rig(rig, **_given(settings)))


@verb
def advise(
    rig: Rig | Folder,
    at: Fit | Diagnosed | Folder | None = None,
    settings: AdviceSettings | None = None,
    *,
    quiet: bool | Report = False,
) -> Advised:
    """How one more trace of each rig test would change each interval, before it is measured; no fit.

    Args:
        rig: a rig, or its folder.
        at: the model to use: a fit or a diagnosis of this rig (its final model counts), or its run folder; None for
            the graph readings.
        settings: when two parameters count as separate, and how a trace would be made; the defaults if None.
    Raises:
        MeasurementError: the folder is wrong, or nothing in it can be fitted.
        UsageError: `at` holds no fit, or a fit of other measurements.
    """
    with working(quiet) as report:
        rig = _rig_of(rig, report)
        from ..experiment.advice import advise as advise_rig
        from .measurements import Advised

        model = None if at is None else _fitted_to(at, rig)
        report("computing what one more trace would add", 0.3)
        return Advised(advise_rig(rig, model, **_given(settings)))


@verb
def plan(
    source: Rig | Model,
    settings: CampaignSettings | None = None,
    *,
    criterion: str = "A",
    without: Sequence[str] = (),
    supply: float | None = None,
    quiet: bool | Report = False,
) -> Planned:
    """The next tests as files to play: those that most improve the least known parameters, within the rig's limits.

    Args:
        source: a fit or a diagnosis (its final model counts), a run folder; or a rig, or a measurement folder, whose
            graph readings then replace a fit.
        settings: limits and candidates; the defaults if None.
        criterion: "A" for the sum of the relative variances, "D" for their geometric mean.
        without: rig tests that cannot be made.
        supply: supply voltage, V; that of the rig if None.
    Raises:
        MeasurementError: the folder is wrong, or nothing in it can be fitted.
        UsageError: no such criterion or rig test, no voltage drives the rig, or no candidate is within the limits.
    """
    with working(quiet) as report:
        from ..experiment.campaign import Criterion, plan_campaign
        from ..rig.base import Rig
        from .measurements import Planned

        if criterion not in {each.value for each in Criterion}:
            raise UsageError(f"there is no criterion {criterion}. There are {', '.join(Criterion)}.")
        if isinstance(source, Rig) or (isinstance(source, str | Path) and (Path(source) / "rig.toml").is_file()):
            rig, model = _rig_of(source, report), None
        else:
            model = _fit_of("plan", source).result
            rig = model.rig
        report("computing the information of the next tests", 0.2)
        limits = {"criterion": Criterion(criterion), "without": without, "supply": supply}
        return Planned(plan_campaign(rig, model, **_given(settings), **limits))


@verb
def fit(rig: Rig | Folder, settings: FitSettings | None = None, *, quiet: bool | Report = False) -> Fit:
    """The joint fit of all traces that are not held out.

    Args:
        rig: a rig, or its folder.
        settings: thresholds, budgets and seeds; the defaults if None.
    Raises:
        MeasurementError: the folder is wrong, or nothing in it can be fitted.
    """
    with working(quiet) as report:
        rig = _rig_of(rig, report)
        report("loading the model", 0.0)
        from ..estimation.joint_fit import fit as fit_rig
        from .fit import Fit

        return Fit(fit_rig(rig, report, **_given(settings)))


@verb
def diagnose(
    fit: Fit | Folder, settings: DiagnosisSettings | None = None, *, quiet: bool | Report = False
) -> Diagnosed:
    """Find the effects that the fitted model lacks, add them and refit, until the residual shows no more.

    Args:
        fit: what `fit` returned, or a run folder that holds one.
        settings: thresholds of its decisions; the defaults if None.
    Raises:
        UsageError: the run folder holds no fit.
    """
    with working(quiet) as report:
        from ..diagnosis import diagnose as diagnose_fit
        from ..run_folder.state import load_fit
        from .explanation import Diagnosed
        from .fit import Fit

        if isinstance(fit, str | Path):
            fit = Fit(load_fit(Path(fit)))
        if not isinstance(fit, Fit):
            raise _not_taken("diagnose", fit, "what etcfit.fit returned, or a run folder")
        return Diagnosed(diagnose_fit(fit.result, report, **_given(settings)))


@verb
def sample(
    model: Model, *, steps: int = SamplingSettings.most_steps, keep: Folder | None = None, quiet: bool | Report = False
) -> Sampled:
    """The posterior of a fitted model by emcee; stops by itself when the chain is long enough.

    Args:
        model: a fit, a diagnosis (its final model counts), or a run folder.
        steps: largest number of steps of each ensemble.
        keep: folder in which the chain is saved after each block of steps, so that an interrupted chain can continue;
            None: the run folder if `model` is one, else the chain is not saved.
    Raises:
        UsageError: another process writes into the folder, or `steps` is out of its range.
    """
    from ..run_folder.posterior import require_netcdf

    require_netcdf()
    SamplingSettings(most_steps=steps)  # refuses what is out of its range
    with working(quiet) as report:
        report("taking up the model", 0.0)
        result = _fit_of("sample", model).result
        from ..posterior.sampling import sample as sample_fit
        from .explanation import Sampled

        keep = keep or _path_of(model)
        with TemporaryDirectory() as folder:
            return Sampled(sample_fit(result.taken_as_exact(), keep or folder, steps, report, result.formulas))


@verb
def reduce(
    model: Model,
    input_unit: str = "V",
    output_unit: str = "rad",
    share: float = 0.25,
    settings: FrequencySettings | None = None,
    *,
    quiet: bool | Report = False,
) -> Reduced:
    """The third-order transfer function about a plate held at a share of its travel.

    Args:
        model: a fit, a diagnosis (its final model counts), a posterior (its fit), or a run folder.
        input_unit: "V" or "%" (of duty).
        output_unit: "rad", "deg" or "%" (of travel).
        share: operating point as a share of the travel, 0 to 1.
        settings: which sine traces count, and when they determine an order of lag; the defaults if None.
    """
    with working(quiet) as report:
        report("taking up the fit", 0.0)
        fit = _fit_of("reduce", model)
        from ..control.frequency import frequency_response
        from ..control.linearise import motor_constants
        from ..control.linearise import reduce as linearise
        from ..control.settings import FrequencySettings
        from ..rig.driven import Sine
        from .controller import Reduced

        report("linearising", 0.3)
        fitted, result = fit.result.fitted(), fit.result
        plant = linearise(fitted, input_unit, output_unit, share)
        plant = replace(plant, constants=motor_constants(fitted, *fitted.config.stops, share))
        sines = tuple(trace for trace in result.rig.measurements if trace.test == Sine.name)
        if not sines:
            return Reduced(fit, plant)
        report("fitting sines", 0.6)
        return Reduced(fit, plant, frequency_response(fitted, sines, settings or FrequencySettings()))


@verb
def design(
    model: Model | Fleet,
    *,
    rule: str = "optimal",
    requirements: Requirements | None = None,
    posterior: Sampled | None = None,
    adc_bits: int = 12,
    feed_forward: TermNames = False,
    settings: DesignSettings | None = None,
    profile: str | None = None,
    log: Folder | None = None,
    parts: Fleet | Folder | None = None,
    anyway: bool = False,
    present: Mapping[str, float] | None = None,
    quiet: bool | Report = False,
    **ecu: float,
) -> Designed:
    """PID gains: tries every rule on the linear plant and on the nonlinear one, over many draws, and proposes one.

    Args:
        model: a fit, a diagnosis (its final model counts), a posterior, a transfer function, a run folder; or a fleet,
            for gains that 99 % of its units meet the requirements with.
        rule: the tuning rule whose gains are proposed.
        requirements: limits of the response in every scenario; if None, the paper's and 5 % of duty activity.
        posterior: source of the draws; if None, `model` if it is a posterior, the posterior in the run folder, or the
            fit's own normal approximation.
        adc_bits: bits of the position sensor's converter, over the travel.
        feed_forward: True if the ECU has a bias curve; else names of feed-forward terms, such as
            ("friction", "rate"), with "spring" for that curve.
        settings: draws, and the budgets of simulation and rules; the defaults if None.
        profile: name of the make of ECU, a key of `etcfit.ECUS`; None for none in particular.
        log: file of a log from the car: its most demanding stretch is a further scenario.
        parts: a fleet of the same design, or its run folder: gains for parts like its units, and their results on them.
        anyway: give gains for an ECU even if the fit did not converge or is a compromise.
        present: gains that the ECU has now, in its own numbers: {"P": 60, "I": 80, "D": 120}; with "swings_at" the P at
            which P alone makes the plate oscillate.
        ecu: known properties of the ECU, by field (`period=1e-3`, `delay=0.0`, ...); see `control.design.ecu_of`.
    Raises:
        UsageError: no such rule, or a rule without gains for this plant; no such make of ECU, a given field that its
            source fixes at another value, or feed-forward that it cannot have; parts of another design.
    """
    from ..model.ecu import Ecu
    from .fleet import Fleet

    if unknown := sorted(set(ecu) - set(Ecu._fields)):
        raise TypeError(
            f"etcfit.design knows no {', '.join(unknown)}. Properties of the ECU are {', '.join(Ecu._fields)}."
        )
    limits = {} if requirements is None else asdict(requirements)
    line = parts.run if isinstance(parts, Fleet) else parts
    request = DesignRequest(rule, adc_bits, feed_forward, limits, ecu, profile, log, line, anyway, present or {})
    with working(quiet) as report:
        return designed(model, request, report, settings, posterior)


def designed(
    model: Model | Fleet,
    request: DesignRequest,
    report: Report = silent,
    settings: DesignSettings | None = None,
    posterior: Sampled | None = None,
) -> Designed:
    """The gains of a request; see `design`."""
    from ..control.settings import DesignSettings
    from ..run_folder.manifest import is_fleet
    from .controller import Designed
    from .fleet import Fleet
    from .work import design_of

    if request.parts is not None:
        require_extra("fleet", f"{request.parts}", "pyarrow")
    if isinstance(model, str | Path) and is_fleet(Path(model)):
        model = Fleet.in_run(model)
    if isinstance(model, Fleet):
        if request.parts is not None:
            raise UsageError("parts: the model is a fleet itself. Give one unit's fit, or leave parts out.")
        return Designed(model, design_of(model.model, request, None, report, settings), request)
    report("taking up the fit", 0.0)
    fit = _fit_of("design", model)
    fitted = fit.result.fitted()
    drawn = _draws(model if posterior is None else posterior, fitted, settings or DesignSettings())
    return Designed(fit, design_of(fitted, request, drawn, report, settings), request)


@verb
def export(
    model: Model | Designed,
    to: str,
    out: Folder | None = None,
    settings: ExportSettings | None = None,
    *,
    into: Folder | None = None,
    anyway: bool = False,
    quiet: bool | Report = False,
) -> Exported:
    """The model in a format of another program.

    Args:
        model: a fit, a diagnosis (its final model counts), a posterior, a transfer function, a run folder with the
            gains in it, or gains with their fit.
        to: name of the format: c, fmu, msq, mat, m, python, mujoco, mujoco-position or isaac.
        out: folder for its files; if None, RUN/export of a run folder.
        settings: step and operating point; the defaults if None.
        into: file of your own tune, for msq: the gains are written into a copy.
        anyway: write gains into a tune even if the fit did not converge or is a compromise.
    Raises:
        UsageError: no such format, or the model lacks what the format needs; neither a run folder nor `out` is given.
    """
    from ..exporting import ExportSettings, Source, named, write
    from ..files import require_writable
    from ..run_folder.state import refuse_measurement_folder

    run = _path_of(model)
    if out is None and run is None:
        raise UsageError("an export is written into a folder. Name one: etcfit.export(fit, 'c', 'firmware').")
    format_, folder = named(to), Path(out) if out is not None else Path(run or "") / "export"
    own = None if into is None else Path(into)
    format_.require(own)
    refuse_measurement_folder(folder)
    require_writable(folder)
    with working(quiet) as say:
        from ..run_folder.pid import PID
        from ..run_folder.reading import read_design
        from .controller import Designed
        from .fit import Fit
        from .work import Exported

        say("taking up the model", 0.0)
        fit = model.fit if isinstance(model, Designed) else _fit_of("export", model)
        if not isinstance(fit, Fit):
            raise UsageError("a fleet is not a single model. Export the fit of one unit.")
        say(f"exporting to {to}", 0.5)
        pid = PID.json(model.design) if isinstance(model, Designed) else None if run is None else read_design(run)
        again = command("design", run or "RUN")
        made = format_.export(Source(fit.result.fitted(), settings or ExportSettings(), pid, again, own, anyway))
        return Exported(write(made, folder), made.cannot_hold)


@verb
def report(
    run: Folder | Fit | Diagnosed,
    to: Folder | None = None,
    *,
    page: Literal["printed", "interactive"] = "printed",
    quiet: bool | Report = False,
) -> Path:
    """Write RUN/report.html, one self-contained page of everything in a run folder, and its pictures; or an interactive
    page.

    Args:
        run: the run folder; or a fit or a diagnosis, which is written to `to` first.
        to: the run folder, if `run` is a fit or a diagnosis.
        page: "printed", without scripts, or "interactive", RUN/report_interactive.html.
    Returns:
        Path of the page.
    """
    with working(quiet) as say:
        from ..reporting.interactive import write_interactive
        from ..run_folder.folder import RunFolder
        from .progress import part_of
        from .work import keep_page

        if not isinstance(run, str | Path):
            if to is None:
                raise UsageError("a page is written into a run folder. Name one: etcfit.report(fit, 'runs/x').")
            say("saving", 0.0)
            run = run.save(to)
        say("writing the page", 0.1)
        folder = RunFolder(run)
        made = keep_page(folder, part_of(say, 0.1, 0.95)) if page == "printed" else write_interactive(folder)
    if made.missing:
        warnings.warn(made.missing, stacklevel=3)
    return made.path


@verb
def drive(
    folder: Folder,
    *,
    between: tuple[float, float] = (5.0, 45.0),
    compare: tuple[str, str] | None = None,
    foretold: Folder | None = None,
    made_with: str | None = None,
    quiet: bool | Report = False,
) -> Driven:
    """Logs from the car: operating range, spectrum, how closely the plate follows and whether that is good enough.

    Args:
        folder: a folder of logs, a measurement folder with logs in drive/, or one log.
        between: report the share of the time between these positions, %.
        compare: only these two logs, before and after.
        foretold: run folder of `etcfit.tune`; the log is compared with its prediction, see `Driven.foretold`.
        made_with: gains of that log: "present", "half_way" or "proposed"; half way if None.
    Raises:
        MeasurementError: no log, or a log to compare with a prediction has no such steps.
        UsageError: several logs for `foretold`, or a run folder without a prediction.
    """
    with working(quiet) as report:
        report("reading the logs", 0.0)
        from ..car_log import study
        from ..car_log.read import logs_at
        from ..car_log.study import chosen
        from .measurements import Driven

        config, logs = logs_at(folder)
        every = tuple(study(log, between) for log in (chosen(logs, compare) if compare else logs))
        if foretold is None:
            return Driven(config, every, None, compare is not None)
        if len(every) != 1:
            raise UsageError(f"--foretold takes one log, and there are {', '.join(each.log.name for each in every)}. "
                             "Name the file of the log that was made with the new gains.")  # fmt: skip
        from ..car_log.foretold import held_against
        from ..reporting.car_log import Held
        from ..run_folder.reading import read_foretold

        prediction, name, content = read_foretold(Path(foretold), made_with and made_with.replace("-", "_"))
        return Driven(config, every, Held(every[0].log.name, Path(foretold), name, content,
                                          held_against(every[0], prediction)))  # fmt: skip


@verb
def tune(
    logs: Folder | Sequence[Folder],
    ecu: str,
    out: Folder,
    gains: tuple[float, float, float] | Sequence[tuple[float, float, float]] | None = None,
    *,
    anyway: bool = False,
    supply: float | None = None,
    tune_file: Folder | None = None,
    settings: TuneSettings | None = None,
    quiet: bool | Report = False,
    **controller: float,
) -> Tuned:
    """Gains from logs of a car, compared with the gains that its ECU has now.

    Args:
        logs: files of any known format, all of one car.
        ecu: make of the ECU that made the logs and gets the gains.
        out: the run folder; made if absent.
        gains: P, I and D that the ECU has now, in its own numbers; if the logs were made under different gains, those
            of each log, the present gains last.
        anyway: give gains even if the model is a compromise or did not converge.
        supply: supply voltage, V; if None, as logged, else 13.5.
        tune_file: the ECU's tune (.msq): its gains if none are given, its bias table, the limit of its integral.
        settings: which part of the logs is fitted; the defaults if None.
        controller: fields of `Ecu` that its make leaves open, as period=1e-3.
    Raises:
        MeasurementError: a file cannot be read, or no log has a position with a duty or setpoint beside it.
        UsageError: no such make of ECU, or a field given that its source fixes otherwise.
    """
    with working(quiet) as report:
        from ..importing.tuning import TuneSettings
        from ..run_folder.folder import RunFolder
        from .tuned import TuneRequest, sets_of, tune_logs

        files = [Path(each) for each in ([logs] if isinstance(logs, str | Path) else logs)]
        request = TuneRequest(ecu, sets_of(gains), tuple(controller.items()), supply, anyway=anyway,
                              settings=settings or TuneSettings())  # fmt: skip
        request = request.for_logs(files, None if tune_file is None else Path(tune_file))
        return tune_logs(files, RunFolder(Path(out)), request, report)


@verb
def fetch(name: str, to: Folder | None = None, data: Folder | None = None, *, quiet: bool | Report = False) -> Path:
    """A public measured data set as a measurement folder.

    Args:
        name: one of `etcfit.DATASETS`.
        to: the folder to write; measurements/NAME if None.
        data: folder of local copies; if None, the one that the environment variable ETCFIT_DATA names. A file that
            is not there is downloaded.
    Returns:
        The measurement folder.
    """
    with working(quiet) as report:
        report(f"fetching {name}", 0.0)
        from ..datasets import fetch as fetch_data_set

        return fetch_data_set(name, Path(to or Path("measurements") / name), None if data is None else Path(data))


@verb
def fleet(
    location: Folder,
    out: Folder,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    quiet: bool | Report = False,
) -> Fleet:
    """Fit many units of one design on workers, then estimate the design from all of them.

    A unit with a current result is not fitted again. In a script, call it below `if __name__ == "__main__":`, because
    the worker processes import the script.

    Args:
        location: FLEET, a folder of measurement folders, or an address that fsspec opens (s3://...).
        out: the run folder; made if absent.
        workers: processes on this machine; one per core if None.
        scheduler: address of a running Dask scheduler, such as "tcp://host:8786"; None for this machine.
    Raises:
        MeasurementError: there is no unit, fleet.toml or units.csv is wrong, or no unit could be fitted.
        UsageError: a library of the extra `fleet` is not installed, or no worker answers.
    """
    with working(quiet) as report:
        from .fleet import Fleet
        from .fleet_work import work_through
        from .fleet_work import workers as place_of

        return Fleet(Path(out), *work_through(location, Path(out), place_of(workers, scheduler), report, silent))


@verb
def load(run: Folder) -> Fit | Diagnosed | Fleet:
    """The last model of a run folder, bit for bit as it was saved: the diagnosis if there is one, else the fit; the
    fleet if the run folder is of a fleet.

    Args:
        run: the run folder.
    Raises:
        UsageError: the folder holds no fit, or a fit of another version.
    """
    from ..run_folder.folder import RunFolder
    from ..run_folder.manifest import is_fleet
    from .explanation import Diagnosed
    from .fit import Fit
    from .fleet import Fleet

    if is_fleet(Path(run)):
        return Fleet.in_run(run)
    folder = RunFolder(run)
    found = folder.diagnosis()
    return Fit(folder.fit()) if found is None else Diagnosed(found)


def _rig_of(rig: Rig | Folder, report: Report) -> Rig:
    if not isinstance(rig, str | Path):
        return rig
    from ..rig.reader import read_folder

    report("reading the folder", 0.0)
    return read_folder(rig)


def _fitted_to(at: Fit | Diagnosed | Folder, rig: Rig) -> FitResult:
    """A fit of this rig.

    Raises:
        UsageError: the run folder holds no fit, or the fit is of other measurements.
    """
    from ..run_folder.state import fitted_to
    from .explanation import Diagnosed
    from .fit import Fit

    if isinstance(at, str | Path):
        return fitted_to(Path(at), rig)
    if not isinstance(at, Fit | Diagnosed):
        raise _not_taken("advise", at, "for `at` a fit, a diagnosis or a run folder")
    result = _fit_of("advise", at).result
    if result.rig.digests != rig.digests:
        raise UsageError("this fit is of other measurements. Fit this rig first.")
    return result


def _fit_of(verb: str, model: Model) -> Fit:
    """The fit that belongs to the model given to a verb."""
    from ..run_folder.folder import RunFolder
    from ..run_folder.manifest import is_fleet
    from .fit import Fit

    if isinstance(model, str | Path):
        if is_fleet(Path(model)):
            raise UsageError(
                f"{model} is the run folder of a fleet: etcfit.{verb} takes one unit's run folder, as in {model}/units."
            )
        model = RunFolder(model)
    if isinstance(model, RunFolder):
        return Fit(model.final())
    from .controller import Reduced
    from .explanation import Diagnosed, Sampled

    if isinstance(model, Fit):
        return model
    if isinstance(model, Diagnosed | Sampled | Reduced):
        return model.final if isinstance(model, Diagnosed) else model.fit
    raise _not_taken(verb, model, "a fit, a diagnosis, a posterior, a transfer function or a run folder")


def _path_of(model: object) -> Path | None:
    """The run folder, where a model is given by its run folder."""
    from ..run_folder.folder import RunFolder

    if isinstance(model, RunFolder):
        return model.path
    return Path(model) if isinstance(model, str | Path) else None


def _not_taken(verb: str, given: object, wanted: str) -> TypeError:
    return TypeError(f"etcfit.{verb} takes {wanted}, not {type(given).__name__}.")


def _given(
    settings: AdviceSettings | CampaignSettings | CheckSettings | FitSettings | DiagnosisSettings | None,
) -> dict[str, Any]:
    return {} if settings is None else {"settings": settings}


def _draws(source: Model, fitted: Fitted, settings: DesignSettings) -> np.ndarray | None:
    """Coordinates of draws from a posterior or a run folder that holds one, shape (D, P); None without a posterior."""
    import numpy as np

    from ..run_folder.reading import read_draws
    from .explanation import Sampled

    if (run := _path_of(source)) is not None:
        return read_draws(run, fitted, settings.draws - 1, settings.seed)
    if not isinstance(source, Sampled):
        return None
    points, symbols = source.posterior.points, source.posterior.chain.symbols
    if symbols != fitted.free_parameters.layout.free:
        raise UsageError("this posterior is of another model: other parameters are free in it. Sample the model first.")
    flat = points.reshape(-1, points.shape[-1])
    return flat[np.random.default_rng(settings.seed).integers(len(flat), size=settings.draws - 1)]
