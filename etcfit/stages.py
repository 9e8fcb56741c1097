"""What leads from a measurement folder to a report, in order: the one list of stages, and who has to run again.

A stage is done when its outputs are those that it wrote and were made from what lies there now, by RUN/run.json. What
one stage leaves is handed to the next in memory, or loaded where another process made it. Nothing heavy is imported
before a stage needs it.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, fields, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from .control.request import DesignRequest
from .errors import UsageError, require_extra
from .posterior.settings import SamplingSettings

if TYPE_CHECKING:
    from .api.diagnosed import Diagnosed
    from .api.fit import Fit
    from .estimation.result import FitResult
    from .run_folder import RunFolder

Report = Callable[[str, float], None]


@dataclass(frozen=True)
class Done:
    """What a stage leaves for the terminal.

    Args:
        shown: what goes to stdout, a rich renderable.
        failure: why the model that is shown did not converge, or "".
        remark: with what `etcfit run` made it anew, where it had been made before; what an export leaves out; or "".
    """

    shown: Any
    failure: str = ""
    remark: str = ""


def opened(run: Path, out: Path | None = None) -> RunFolder:
    """The run folder, for the stages below.

    Args:
        run: the folder.
        out: where files will be written; RUN itself where None.
    Raises:
        UsageError: another version wrote it.
        OSError: no file can be written there.
    """
    from .files import require_writable
    from .run_folder import RunFolder, read_records

    read_records(run)
    require_writable(out or run)
    return RunFolder(run)


def fit_folder(folder: Path, run: RunFolder, report: Report) -> Done:
    """The joint fit of all traces: RUN/fit.json, the state of the fit, pictures."""
    report("reading the folder", 0.0)
    from .rig.reader import read_folder

    rig = read_folder(folder)
    report("loading the model", 0.0)
    keep_compiled()
    from .api.saving import keep_fit
    from .estimation.joint_fit import fit
    from .reporting.drawing import begin_helper
    from .reporting.tables import fit_table

    begin_helper()

    result = fit(rig, report)
    keep_fit(run, result, report)
    return Done(fit_table(result), failure(result))


def diagnose_run(run: RunFolder, report: Report) -> Done:
    """What the model fitted in RUN lacks: RUN/diagnosis.json, the state of the final model, pictures."""
    report("taking up the fit", 0.0)
    keep_compiled()
    result = run.fit()
    from .api.saving import keep_diagnosis
    from .diagnosis import diagnose
    from .reporting.diagnosis.table import diagnosis_table
    from .reporting.drawing import begin_helper

    begin_helper()
    found = diagnose(result, report)
    keep_diagnosis(run, found, report)
    return Done(diagnosis_table(found), failure(found.after))


def sample_run(run: RunFolder, report: Report, steps: int = SamplingSettings.most_steps) -> Done:
    """How sure: RUN/posterior.nc and RUN/posterior.json of the final model, pictures; goes on with a chain begun."""
    _can_sample()
    report("taking up the model", 0.0)
    keep_compiled()
    result = run.final()
    from .api.saving import keep_posterior
    from .posterior.profile import profiles
    from .posterior.sampling import sample
    from .reporting.compromise import cautioned
    from .reporting.drawing import begin_helper
    from .reporting.posterior.table import posterior_table

    begin_helper()
    posterior = sample(result.taken_as_exact(), run.path, steps, report, result.formulas)
    profiled = profiles(posterior, report)
    keep_posterior(run, posterior, profiled, {"steps": steps}, report)
    here = posterior.convergence
    why = "" if here.converged else f"this is no posterior yet: {here.reason} `etcfit sample` goes on from here."
    return Done(cautioned(posterior_table(posterior, profiled), result.state), why or failure(result))


def _can_sample() -> None:
    """See `run_folder.posterior.require_netcdf`."""
    from .run_folder.posterior import require_netcdf

    require_netcdf()


def reduce_run(
    run: RunFolder, report: Report, input: str = "V", output: str = "rad", at: float = 0.25, pade_order: int = 0
) -> Done:
    """The linear plant about a plate held at a share of its travel: RUN/transfer_function.json, a Bode plot.

    Where the rig has sine traces, also what they say: RUN/frequency_response.json, a Bode plot of its own.
    """
    report("taking up the fit", 0.0)
    keep_compiled()
    result = run.final()
    from rich.console import Group

    from .api.control import plant_of
    from .api.saving import keep_reduction
    from .reporting.control.tables import reduction_table, sine_table

    reduction, response = plant_of(result, input, output, at, report)
    keep_reduction(run, result, reduction, response, pade_order, report)
    table = reduction_table(result.fitted(), reduction, pade_order)
    return Done(table if response is None else Group(table, sine_table(response)), failure(result))


def design_run(run: RunFolder, report: Report, asked: DesignRequest) -> Done:
    """Gains by every rule, one of them proposed: RUN/pid.json, the responses."""
    if asked.parts is not None:
        require_extra("fleet", f"{asked.parts}", "pyarrow")
    report("taking up the fit", 0.0)
    keep_compiled()
    result = run.final()
    from .api.control import design_of
    from .api.saving import keep_design
    from .control.design import DRAWS, SEED
    from .reporting.control.tables import design_table
    from .run_folder import read_draws

    fitted = result.fitted()
    drawn = read_draws(run.path, fitted, DRAWS - 1, SEED)
    found = design_of(fitted, asked, drawn, report)
    keep_design(run, result, found, asked.recorded(), report)
    return Done(design_table(found), failure(result))


def design_fleet(run: Path, report: Report, asked: DesignRequest) -> Done:
    """Gains that nearly all units of a fleet meet the requirements with, from its run folder: RUN/pid.json, the
    responses."""
    report("taking up the fleet", 0.0)
    keep_compiled()
    from .api.control import fleet_design_of
    from .api.fleet import Fleet
    from .reporting.control.tables import design_table

    units = Fleet.of(run)
    found = fleet_design_of(units.model, asked, report)
    units.keep_design(run, found, {}, report)
    return Done(design_table(found))


def fleet(location: str, run: Path, workers: int | None, scheduler: str | None, report: Report, watch: Report) -> Done:
    """Every unit of a fleet fitted, and what they tell together: RUN/fleet.json, units.parquet, pictures, page.

    Args:
        location: of the fleet, a folder or an address that fsspec opens.
        run: the run folder.
        workers: processes of this machine; None for one a core.
        scheduler: address of one that is there already; None for processes of this machine.
        report: progress.
        watch: told where the workers can be watched.
    """
    keep_compiled()
    from .api.fleet_work import work_through
    from .api.fleet_work import workers as place_of
    from .reporting.fleet import fleet_table

    files = work_through(location, run, place_of(workers, scheduler), report, watch)
    return Done(fleet_table(files.content))


def fleet_report(run: Path, report: Report) -> Done:
    """RUN/fleet.html and its pictures once more, of what lies in RUN."""
    from .api.fleet_work import show
    from .run_folder.fleet import read_fleet_files

    return Done(str(show(run, read_fleet_files(run), report)))


def export_run(
    run: RunFolder,
    report: Report,
    to: str,
    out: Path | None = None,
    step: float | None = None,
    at: float = 0.25,
    into: Path | None = None,
) -> Done:
    """The model in a format of another program, with what that format cannot hold as the remark.

    Args:
        run, report: as everywhere.
        to: name of the format.
        out: folder; RUN/export where None.
        step: of a plant in C, s; the default where None.
        at: share of the travel about which a transfer function is taken.
        into: the user's own file of that format, of which a copy is changed; None for a new file.
    Raises:
        UsageError: no such format, a step outside its range, or a model without what the format needs.
    """
    from .exporting import ExportSettings, named

    format_ = named(to)
    format_.require(into)
    try:
        settings = ExportSettings(share=at) if step is None else ExportSettings(step, at)
    except ValueError as error:  # the range is the settings' own
        raise UsageError(str(error)) from None
    report("taking up the model", 0.0)
    keep_compiled()
    result = run.final()
    from .api.exported import exported
    from .run_folder import read_design

    report(f"exporting to {to}", 0.5)
    done = exported(result, format_, out or run.path / "export", settings, read_design(run.path), run.path, into)
    return Done("\n".join(map(str, done.files)), failure(result), "\n".join(done.cannot_hold))


def write_report(run: RunFolder, report: Report) -> Done:
    """One page of everything that RUN holds: RUN/report.html."""
    report("writing the page", 0.0)
    from .reporting.page import write_page

    page = write_page(run.path)
    return Done(str(page.path), page.failure)


def write_interactive(run: RunFolder, report: Report) -> Done:
    """One page to work with: RUN/report_interactive.html. No stage of `etcfit run`, which leaves the one to print."""
    report("taking up the model", 0.0)
    keep_compiled()
    from .reporting.interactive import write_interactive

    report("writing the page", 0.5)
    page = write_interactive(run)
    return Done(str(page.path), page.failure)


def failure(result: FitResult) -> str:
    """Why a model that is shown did not converge, or ""."""
    return "" if result.converged else f"the fit of the model that is shown did not converge: {result.reason}"


@dataclass(frozen=True)
class Stage:
    """A step from the measurements to the report.

    Args:
        name: of its command, and on the manifest.
        work: what it does, from the measurement folder, the run folder and a progress report.
        options: arguments of the work besides, under which the manifest keeps what the stage last ran with.
        require: raises what would stop its work at the end, before any work.
    """

    name: str
    work: Callable[..., Done]
    options: tuple[str, ...] = ()
    require: Callable[[], None] = lambda: None


def _of_run(work: Callable[..., Done]) -> Callable[..., Done]:
    """Work that needs no more of the measurements than what the run says of them."""
    return lambda folder, run, report, **options: work(run, report, **options)


# the one list of stages: a new command joins `etcfit run` by a line here and one in run_folder.STAGE_FILES
STAGES: tuple[Stage, ...] = (
    Stage("fit", fit_folder),
    Stage("diagnose", _of_run(diagnose_run)),
    Stage("sample", _of_run(sample_run), ("steps",), _can_sample),
    Stage("reduce", _of_run(reduce_run), ("input", "output", "at", "pade_order")),
    Stage(
        "design",
        lambda folder, run, report, **options: design_run(run, report, DesignRequest(**options)),
        tuple(each.name for each in fields(DesignRequest)),
    ),
    Stage("report", _of_run(write_report)),
)


def run_all(
    folder: Path,
    path: Path,
    progress: Callable[[], AbstractContextManager[Report]],
    show: Callable[[str, Done | None], None],
    stages: tuple[Stage, ...] = STAGES,
    asked: Mapping[str, Mapping[str, Any]] = MappingProxyType({}),
) -> str:
    """Run every stage that is not done yet, in order; one that was made with options before, with the same ones.

    Args:
        folder: the measurements.
        path: the run folder; made if absent.
        progress: opened for each stage in turn.
        show: called after each stage with its name and what came of it, None where it was done before.
        stages: in order.
        asked: options of stages, by the stage's name, in place of those of before; one made with others is not done.
    Returns:
        Why the model that is shown did not converge, or "".
    Raises:
        UsageError: RUN was made from other measurements or by another version, or a stage misses what it needs.
    """
    from .run_folder import is_done, last_failure, must_belong, settings_before

    must_belong(path, folder)
    run = opened(path)
    for stage in stages:
        stage.require()
    for stage in stages:
        before, wanted = settings_before(path).get(stage.name, {}), asked.get(stage.name, {})
        if is_done(path, stage.name, folder) and all(before.get(name) == value for name, value in wanted.items()):
            show(stage.name, None)
            continue
        options = {name: before[name] for name in stage.options if name in before} | dict(wanted)
        with progress() as report:
            done = stage.work(folder, run, report, **options)
        taken = {name: value for name, value in options.items() if name not in wanted}
        show(stage.name, replace(done, remark=_made_anew(taken, before, settings_before(path)[stage.name])))
    return last_failure(path)


def designed_for(profile: str | None) -> Mapping[str, Mapping[str, Any]]:
    """What `run_all` is asked for where gains are for a make of ECU, found out before the first stage runs.

    Raises:
        UsageError: none has that name.
    """
    if profile is None:
        return {}
    from .model.ecus import named

    return {"design": {"profile": named(profile).name}}


def _made_anew(options: Mapping[str, Any], before: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    """With what a stage was made that had been made before: no option of it is replaced without a word.

    Args:
        options: taken over.
        before, now: what it ran with, as the manifest has it.
    """
    if not before:
        return ""
    others = {name: value for name, value in now.items() if before.get(name, value) != value}
    taken = f", with {_listed(options)} as before" if options else ""
    return f"made anew{taken}" + (f"; other than before: {_listed(others)}" if others else "")


def _listed(options: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} {json.dumps(value)}" for name, value in options.items())


def run(folder: Path | str, out: Path | str, *, profile: str | None = None, quiet: bool = False) -> Fit | Diagnosed:
    """Everything from a measurement folder to RUN/report.html, in order; what is done already is not done again.

    Args:
        folder: the measurements.
        out: the run folder; made if absent.
        profile: name of the make of ECU that gains are designed for; None for what they were before, else for none.
        quiet: show no progress.
    Returns:
        The last model in it, as `etcfit.load` gives it.
    Raises:
        UsageError: no make of ECU has that name, or RUN was made from other measurements or by another version.
    """
    from .api.fleet import Fleet
    from .api.progress import working
    from .api.verbs import load

    def show(name: str, done: Done | None) -> None:
        if done is not None and done.remark and not quiet:
            print(f"{name}: {done.remark}", file=sys.stderr)

    run_all(Path(folder), Path(out), lambda: working(quiet), show, asked=designed_for(profile))
    found = load(out)
    assert not isinstance(found, Fleet), "the run folder of a fleet has no fit"
    return found


def keep_compiled() -> None:
    """The second run of a command finds its model compiled."""
    from .backend import use_compilation_cache

    use_compilation_cache()
