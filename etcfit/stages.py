"""What leads from a measurement folder to a report, in order: the one list of stages, and who has to run again.

A stage is done when its outputs are those that it wrote and were made from what lies there now, by RUN/run.json. What
one stage leaves is handed to the next in memory, or loaded where another process made it. Nothing heavy is imported
before a stage needs it.
"""

from __future__ import annotations

import functools
import inspect
import json
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, fields, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from .api.arguments import fits, in_words, verb
from .api.progress import Expected, Report, keep_compiled, part_of
from .control.request import DesignRequest
from .errors import UsageError, command, visible
from .posterior.settings import SamplingSettings

if TYPE_CHECKING:
    from .api.explanation import Diagnosed
    from .api.fit import Fit
    from .api.tuned import TuneRequest
    from .estimation.result import FitResult
    from .reporting.closing import Closing
    from .run_folder.folder import RunFolder


@dataclass(frozen=True)
class Done:
    """What a stage leaves for the terminal."""

    shown: Any  # what goes to stdout, a rich renderable; None where the closing says it all
    failure: str = ""  # why the model that is shown did not converge, or ""
    # with what `etcfit run` made it anew, where it had been made before; what an export leaves out; why pictures are
    # missing from a page; or ""
    remark: str = ""
    closing: Closing | None = None  # how the command ends; None of a stage made by hand, as in tests
    stopped: str = ""  # why the data are not sufficient; "" if they are


def _alone(stage: str = "") -> Callable[[Callable[..., Done]], Callable[..., Done]]:
    """Work during which no other process writes into its run folder; the manifest keeps how long a stage took."""

    def held_while(work: Callable[..., Done]) -> Callable[..., Done]:
        @functools.wraps(work)
        def alone(*args: Any, **kwargs: Any) -> Done:
            from .files import held
            from .run_folder.folder import RunFolder
            from .run_folder.manifest import note_seconds

            run = next(each.path for each in args if isinstance(each, RunFolder))
            with held(run):
                began = time.monotonic()
                done = work(*args, **kwargs)
                if stage:
                    note_seconds(run, stage, time.monotonic() - began)
                return done

        return alone

    return held_while


_OF_A_FIT = {"diagnose": 2.5, "design": 2.5, "sample": 2.5}  # so many times as long as the fit, on the bench twin


def expected(run: Path, stage: str) -> Expected | None:
    """How long a stage will take: as last time, or so many times as long as the fit; None where neither is known."""
    from .run_folder.manifest import read_records

    took = {name: record.seconds for name, record in read_records(run).items() if record.seconds is not None}
    if stage in took:
        return Expected(took[stage], "as last time")
    if stage in _OF_A_FIT and "fit" in took:
        return Expected(_OF_A_FIT[stage] * took["fit"], f"{_OF_A_FIT[stage]:g} times as long as the fit, as a rule")
    return None


def opened(run: Path, out: Path | None = None, folder: Path | None = None) -> RunFolder:
    """The run folder, for the stages below.

    Args:
        out: where files will be written; RUN itself where None.
        folder: the measurements, where they will be fitted.
    Raises:
        UsageError: another version wrote it, or it (or `out`) lies among measurements.
        OSError: no file can be written there.
    """
    from .files import require_writable
    from .run_folder.folder import RunFolder
    from .run_folder.manifest import read_records

    if folder is not None:
        from .run_folder.state import refuse_among_measurements  # it needs the rig tests, which nobody else here does

        refuse_among_measurements(folder, run)
    if out is not None:
        from .run_folder.state import refuse_measurement_folder

        refuse_measurement_folder(out)
    read_records(run)
    require_writable(out or run)
    return RunFolder(run)


@_alone("fit")
def fit_folder(folder: Path, run: RunFolder, report: Report) -> Done:
    """The joint fit of all traces: RUN/fit.json, the state of the fit, a picture of its parameters."""
    from .api.verbs import fit

    found = fit(folder, quiet=part_of(report, 0.0, 0.98))
    from .api.work import keep_fit
    from .reporting.closing.model import of_run

    keep_fit(run, found.result, part_of(report, 0.98, 1.0))
    return Done(found.printed(), _failure(found.result), closing=of_run(run.path))


@_alone("diagnose")
def diagnose_run(run: RunFolder, report: Report) -> Done:
    """What the model fitted in RUN lacks: RUN/diagnosis.json, the state of the final model, a picture of its errors.

    Every round is kept, so that one that was interrupted goes on from there.

    Raises:
        KeyboardInterrupt: as it came, with what was found so far as its message.
    """
    report("taking up the fit", 0.0)
    keep_compiled()
    result = run.fit()
    from .api.work import keep_diagnosis
    from .diagnosis import diagnose
    from .reporting.closing.model import of_run
    from .reporting.diagnosis import diagnosis_table
    from .run_folder.diagnosis import KeptRounds

    rounds = KeptRounds(run.path, result)
    try:
        found = diagnose(result, part_of(report, 0.0, 0.98), begun=rounds.read(), keep=rounds.keep)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(rounds.when_interrupted()) from None
    keep_diagnosis(run, found, part_of(report, 0.98, 1.0))
    return Done(diagnosis_table(found), _failure(found.after), rounds.remark, of_run(run.path))


@_alone("sample")
def sample_run(run: RunFolder, report: Report, steps: int = SamplingSettings.most_steps) -> Done:
    """How sure: RUN/posterior.nc and RUN/posterior.json of the final model, pictures; goes on with a chain begun."""
    from .api.verbs import sample
    from .reporting.closing.control import of_posterior
    from .reporting.drawing import begin_helper

    begin_helper()
    found = sample(run, steps=steps, quiet=part_of(report, 0.0, 0.8)).profiled(part_of(report, 0.8, 0.9))
    found.save(run, part_of(report, 0.9, 1.0))
    why = "" if found.converged else f"this is no posterior yet: {found.reason} `etcfit sample` goes on from here."
    closing = of_posterior(found.posterior, run.path)
    return Done(found.printed(), why or _failure(found.posterior.fit), found.remark, closing)


def _can_sample() -> None:
    """See `run_folder.posterior.require_netcdf`."""
    from .run_folder.posterior import require_netcdf

    require_netcdf()


@_alone("reduce")
def reduce_run(
    run: RunFolder, report: Report, input: str = "V", output: str = "rad", at: float = 0.25, pade_order: int = 0
) -> Done:
    """The linear plant about a plate held at a share of its travel: RUN/transfer_function.json, a Bode plot.

    Where the rig has sine traces, also what they say: RUN/frequency_response.json, a Bode plot of its own.
    """
    from .api.verbs import reduce
    from .reporting.closing.control import of_plant

    found = reduce(run, input, output, at, quiet=report)
    found.save(run, pade_order, report)
    result = found.fit.result
    return Done(found.printed(pade_order), _failure(result), closing=of_plant(found.reduction, result.state, run.path))


@_alone("design")
def design_run(run: RunFolder, report: Report, request: DesignRequest) -> Done:
    """Gains by every rule, one of them proposed: RUN/pid.json, the responses."""
    keep_compiled()
    from .api.verbs import designed
    from .reporting.closing.control import of_design

    found = designed(run, request, part_of(report, 0.0, 0.95))
    found.save(run, part_of(report, 0.95, 1.0))
    result = run.final()
    return Done(found.printed(), _failure(result), closing=of_design(found.design, result.state, run.path))


def tune_logs(files: Sequence[Path], run: RunFolder, report: Report, request: TuneRequest) -> Done:
    """From logs of a car to gains: RUN/tune.json with its picture, and what fit, diagnosis and design leave."""
    keep_compiled()
    from .api.tuned import tune_logs as tune
    from .reporting.closing.control import of_tune

    found = tune(files, run, request, report)
    unfinished = "" if found.result is None else _failure(found.result)
    return Done(found.printed(), unfinished, closing=of_tune(found, run.path, files), stopped=found.why_not)


def design_fleet(run: Path, report: Report, request: DesignRequest) -> Done:
    """Gains that nearly all units of a fleet meet the requirements with, from its run folder: RUN/pid.json, the
    responses."""
    report("taking up the fleet", 0.0)
    keep_compiled()
    from .api.fleet import Fleet
    from .api.verbs import designed
    from .files import held
    from .reporting.closing.control import of_fleet_design

    with held(run):
        found = designed(Fleet.in_run(run), request, report)
        found.save(run, report)
    return Done(found.printed(), closing=of_fleet_design(found.design, run))


def fleet(run: Path, report: Report, location: str, workers: int | None, scheduler: str | None, watch: Report) -> Done:
    """Every unit of a fleet fitted, and what they tell together: RUN/fleet.json, units.parquet, pictures, page.

    Arguments as of `etcfit.fleet`; `watch` is told where the workers can be watched.
    """
    keep_compiled()
    from .api.fleet_work import work_through
    from .api.fleet_work import workers as place_of
    from .reporting.closing.control import of_fleet
    from .reporting.fleet import fleet_table

    files, remark = work_through(location, run, place_of(workers, scheduler), report, watch)
    return Done(fleet_table(files.content), remark=remark, closing=of_fleet(files.content, run))


def fleet_report(run: Path, report: Report) -> Done:
    """RUN/fleet.html and its pictures once more, of what lies in RUN."""
    from .api.fleet_work import show
    from .reporting.closing.control import of_fleet
    from .run_folder.fleet import read_fleet_files

    files = read_fleet_files(run)
    show(run, files, report)
    return Done(None, closing=of_fleet(files.content, run))


def export_run(
    run: RunFolder,
    report: Report,
    to: str,
    out: Path | None = None,
    step: float | None = None,
    at: float = 0.25,
    into: Path | None = None,
    anyway: bool = False,
) -> Done:
    """The model in a format of another program, see `etcfit.export`; what that format cannot hold is the remark.

    Args:
        step: of a plant in C, s; the default where None.
        at: share of the travel about which a transfer function is taken.
    Raises:
        UsageError: no such format, a step outside its range, or a model without what the format needs.
    """
    from .api.verbs import export
    from .exporting import ExportSettings, named
    from .reporting.closing.control import of_export

    settings = ExportSettings(share=at) if step is None else ExportSettings(step, at)
    done = export(run, to, out, settings, into=into, anyway=anyway, quiet=report)
    lost, result = done.cannot_hold, run.final()
    closing = of_export(done.files, lost, named(to).title, result.state, run.path)
    return Done("\n".join(map(str, done.files)), _failure(result), "\n".join(lost), closing)


@_alone()
def write_report(run: RunFolder, report: Report) -> Done:
    """One page of everything that RUN holds, RUN/report.html, and the pictures that it shows."""
    report("writing the page", 0.0)
    keep_compiled()
    from .api.work import keep_page
    from .reporting import has_undrawn
    from .reporting.closing.model import of_run

    if has_undrawn(run.path):
        from .reporting.drawing import begin_helper

        begin_helper()
    page = keep_page(run, part_of(report, 0.0, 0.8))
    return Done(None, page.failure, page.missing, of_run(run.path, page.path))


@_alone()
def write_interactive(run: RunFolder, report: Report) -> Done:
    """One page to work with: RUN/report_interactive.html. No stage of `etcfit run`, which leaves the one to print."""
    report("taking up the model", 0.0)
    keep_compiled()
    from .reporting.closing.model import of_run
    from .reporting.interactive import write_interactive

    report("writing the page", 0.5)
    page = write_interactive(run)
    return Done(None, page.failure, closing=of_run(run.path, page.path))


def _failure(result: FitResult) -> str:
    from .run_folder.manifest import failure_of

    return failure_of(result.converged, result.reason)


@dataclass(frozen=True)
class Stage:
    """A step from the measurements to the report."""

    name: str  # of its command, and on the manifest
    work: Callable[..., Done]  # what it does, from the measurement folder, the run folder and a progress report
    # arguments of the work besides, with their annotations: under these names the manifest keeps what the stage last
    # ran with
    options: Mapping[str, str] = field(default_factory=dict)
    require: Callable[[], None] = lambda: None  # raises what would stop its work at the end, before any work


def _of_run(work: Callable[..., Done]) -> Callable[..., Done]:
    """Work that needs no more of the measurements than what the run says of them."""
    return lambda folder, run, report, **options: work(run, report, **options)


def _options(work: Callable[..., Done]) -> dict[str, str]:
    """Arguments of work besides the run and the report, with their annotations."""
    parameters = inspect.signature(work).parameters.items()
    return {name: each.annotation for name, each in parameters if name not in ("run", "report")}


REPORT = Stage("report", _of_run(write_report))
# the one list of stages, in order: a new command joins `etcfit run` by a line here and one in run_folder.STAGE_FILES.
# The page comes as soon as there is something to show, and again where a later stage has changed it
STAGES: tuple[Stage, ...] = (
    Stage("fit", fit_folder),
    Stage("diagnose", _of_run(diagnose_run)),
    REPORT,
    Stage("reduce", _of_run(reduce_run), _options(reduce_run)),
    Stage(
        "design",
        lambda folder, run, report, **options: design_run(run, report, DesignRequest(**options)),
        {each.name: str(each.type) for each in fields(DesignRequest)},
    ),
    REPORT,
    Stage("sample", _of_run(sample_run), _options(sample_run), _can_sample),
    REPORT,
)
LAST = tuple(stage.name for stage in STAGES if stage is not REPORT)  # names of the stages that a run may end with


def stages_until(last: str, stages: tuple[Stage, ...] = STAGES) -> tuple[Stage, ...]:
    """The stages up to one of them, and the page of what they made."""
    if last not in LAST:
        raise UsageError(f"there is no stage {last} to end with. There are {', '.join(LAST)}.")
    end = next(k for k, stage in enumerate(stages) if stage.name == last)
    return (*stages[: end + 1], REPORT)


def run_all(
    folder: Path,
    path: Path,
    progress: Callable[[Expected | None], AbstractContextManager[Report]],
    show: Callable[[str, Done | None], None],
    stages: tuple[Stage, ...] = STAGES,
    stage_options: Mapping[str, Mapping[str, Any]] = MappingProxyType({}),
) -> str:
    """Run every stage that is not up to date, in order; a stage that was made with options keeps them.

    Args:
        progress: opened for each stage with its expected duration; None if that is not known.
        show: called after each stage with its name and its outcome, None if it was up to date before this run.
        stages: stages in order; a stage may occur twice, and runs again if its inputs have changed.
        stage_options: options by name of stage, in place of the earlier ones; a stage made with others runs again.
    Returns:
        Why the model that is shown did not converge, or "".
    Raises:
        UsageError: RUN was made from other measurements or by another version, or a stage misses what it needs.
    """
    from .files import held
    from .run_folder.manifest import set_aside_stale, settings_before
    from .run_folder.state import is_done, last_failure, must_belong

    must_belong(path, folder)
    run = opened(path, folder=folder)
    with held(path):
        before_all, shown = {stage.name: expected(path, stage.name) for stage in stages}, set[str]()
        for stage in stages:
            stage.require()
        for stage in stages:
            before, wanted = settings_before(path).get(stage.name, {}), stage_options.get(stage.name, {})
            if is_done(path, stage.name, folder) and all(before.get(name) == value for name, value in wanted.items()):
                if stage.name not in shown:
                    show(stage.name, None)
                shown.add(stage.name)
                continue
            if stage.name == REPORT.name:  # it shows what is finished, and comes before what is not
                set_aside_stale(path)
            options = _as_before(path, stage, before) | dict(wanted)
            with progress(before_all[stage.name] or expected(path, stage.name)) as report:
                done = stage.work(folder, run, report, **options)
            taken = {name: value for name, value in options.items() if name not in wanted}
            remark = "" if stage.name in shown else _made_anew(taken, before, settings_before(path)[stage.name])
            show(stage.name, replace(done, remark=remark or done.remark))
            shown.add(stage.name)
        return last_failure(path)


def _as_before(run: Path, stage: Stage, before: Mapping[str, Any]) -> dict[str, Any]:
    """Options that a stage last ran with."""
    for name, annotation in stage.options.items():
        if name in before and not fits(before[name], annotation):
            raise UsageError(f"{run / 'run.json'} says that `etcfit {stage.name}` last ran with {name} "
                             f"{json.dumps(before[name])[:60]}, which is not {in_words(annotation)}. Run "
                             f"`{command(stage.name, run)}` by itself, with the options that you want.")  # fmt: skip
    return {name: before[name] for name in stage.options if name in before}


def closing_of(run: Path) -> Closing:
    """How `etcfit run` ends: by the last model in RUN, its page and its picture."""
    from .reporting.closing.model import PAGE, of_run

    return of_run(run, run / PAGE)


def designed_for(profile: str | None) -> Mapping[str, Mapping[str, Any]]:
    """What `run_all` is asked for where gains are for a make of ECU, found out before the first stage runs."""
    if profile is None:
        return {}
    from .model.ecus import named

    return {"design": {"profile": named(profile).name}}


def _made_anew(options: Mapping[str, Any], before: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    """With what a stage was made that had been made before: no option of it is replaced without a word."""
    if not before:
        return ""
    others = {name: value for name, value in now.items() if before.get(name, value) != value}
    taken = f", with {_listed(options)} as before" if options else ""
    return f"made anew{taken}" + (f"; other than before: {_listed(others)}" if others else "")


def _listed(options: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} {json.dumps(value)}" for name, value in options.items())


@verb
def run(
    folder: Path | str, out: Path | str, *, profile: str | None = None, until: str = LAST[-1], quiet: bool = False
) -> Fit | Diagnosed:
    """Everything from a measurement folder to RUN/report.html, in order; what is done already is not done again.

    Args:
        out: the run folder; made if absent.
        profile: name of the make of ECU that gains are designed for; None for what they were before, else for none.
        until: the last stage: fit, diagnose, reduce, design or sample; the page is written all the same.
    Returns:
        The last model in it, as `etcfit.load` gives it.
    Raises:
        UsageError: no make of ECU or no stage has that name, or RUN was made from other measurements or by another
            version.
    """
    from .api.fleet import Fleet
    from .api.progress import working
    from .api.verbs import load

    def show(name: str, done: Done | None) -> None:
        if done is not None and done.remark and not quiet:
            print(visible(f"{name}: {done.remark}"), file=sys.stderr)

    run_all(Path(folder), Path(out), partial(working, quiet), show, stages_until(until), designed_for(profile))
    found = load(out)
    assert not isinstance(found, Fleet), "the run folder of a fleet has no fit"
    return found
