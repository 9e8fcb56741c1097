"""What leads from a measurement folder to a report, in order: the one list of stages, and who has to run again.

A stage is done when it was not interrupted, all that it makes is there, and none of what it needs is newer. Nothing
heavy is imported before a stage needs it.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .errors import UsageError

Report = Callable[[str, float], None]

MOST_STEPS = 20_000  # of each ensemble, after which sampling ends all the same


@dataclass(frozen=True)
class Done:
    """What a stage leaves for the terminal.

    Args:
        shown: what goes to stdout, a rich renderable.
        failure: why the fit in it did not converge, or "".
    """

    shown: Any
    failure: str = ""


def fit_folder(folder: Path, run: Path, report: Report) -> Done:
    """The joint fit of all traces: RUN/fit.json, the state of the fit, pictures."""
    report("reading the folder", 0.0)
    from .rig.reader import read_folder

    rig = read_folder(folder)
    report("loading the model", 0.0)
    keep_compiled()
    from .estimation.joint_fit import fit
    from .reporting import write_run
    from .reporting.tables import fit_table

    result = fit(rig, report)
    write_run(run, result, report)
    return Done(fit_table(result), "" if result.converged else f"the fit did not converge: {result.reason}")


def diagnose_run(run: Path, report: Report) -> Done:
    """What the model fitted in RUN lacks: RUN/diagnosis.json, the state of the final model, pictures."""
    report("taking up the fit", 0.0)
    keep_compiled()
    from .run_folder import read_state, rig_of

    state = read_state(run)
    rig = rig_of(state)
    from .diagnosis import diagnose
    from .estimation.joint_fit import resume
    from .reporting import write_diagnosis
    from .reporting.diagnosis.table import diagnosis_table

    diagnosis = diagnose(resume(rig, state.x, state.far, report), report)
    write_diagnosis(run, diagnosis, report)
    after = diagnosis.after
    failure = "" if after.converged else f"the fit of the final model did not converge: {after.reason}"
    return Done(diagnosis_table(diagnosis), failure)


def sample_run(run: Path, report: Report, steps: int = MOST_STEPS) -> Done:
    """How sure: RUN/posterior.nc and RUN/posterior.json of the final model, pictures; goes on with a chain begun."""
    report("taking up the model", 0.0)
    keep_compiled()
    from .run_folder import final_rig, final_state

    state = final_state(run)
    rig, x = final_rig(state)
    from .estimation.joint_fit import resume
    from .posterior import sample
    from .posterior.profile import profiles
    from .reporting import write_posterior
    from .reporting.posterior.table import posterior_table

    posterior = sample(resume(rig, x, state.far, report), run, steps, report, state.formulas)
    profiled = profiles(posterior, report)
    write_posterior(run, posterior, profiled, report)
    here = posterior.convergence
    failure = "" if here.converged else f"this is no posterior yet: {here.reason} `etcfit sample` goes on from here."
    return Done(posterior_table(posterior, profiled), failure)


def reduce_run(
    run: Path, report: Report, unit_in: str = "V", unit_out: str = "rad", at: float = 0.25, pade: int = 0
) -> Done:
    """The linear plant about a plate held at a share of its travel: RUN/transfer_function.json, a Bode plot.

    Where the rig has sine traces, also what they say: RUN/frequency_response.json, a Bode plot of its own.
    """
    report("taking up the fit", 0.0)
    keep_compiled()
    from .control.linearise import reduce
    from .run_folder import read_fitted, read_sines

    fitted, sines = read_fitted(run), read_sines(run)
    report("linearising", 0.3)
    reduction = reduce(fitted, unit_in, unit_out, at)
    from rich.console import Group

    from .reporting import write_reduction
    from .reporting.control.tables import reduction_table

    write_reduction(run, fitted, reduction, pade, report)
    table = reduction_table(fitted, reduction, pade)
    return Done(table if not sines else Group(table, _sines(run, fitted, sines, report)))


def _sines(run: Path, fitted: Any, traces: Any, report: Report) -> Any:
    """What the sine traces say, written and as a table."""
    report("fitting sines", 0.6)
    from .control.frequency import frequency_response
    from .reporting import write_frequency_response
    from .reporting.control.tables import sine_table

    response = frequency_response(fitted, traces)
    write_frequency_response(run, fitted, response, report)
    return sine_table(response)


def design_run(
    run: Path,
    report: Report,
    rule: str = "optimal",
    adc_bits: int = 12,
    feed_forward: bool = False,
    limits: tuple[float, float, float] = (20.0, 0.2, 0.5),
    **ecu: float,
) -> Done:
    """Gains by every rule, one of them proposed: RUN/pid.json, the responses.

    Args:
        run, report: as everywhere.
        rule: whose gains are proposed.
        adc_bits: of the position sensor, over its travel.
        feed_forward: the ECU has a bias curve.
        limits: overshoot (%), settling time (s) and steady-state error (%) at most.
        ecu: what is given of the ECU, by field; see `design.ecu_of` for the rest.
    """
    report("taking up the fit", 0.0)
    keep_compiled()
    from .control.design import DRAWS, SEED, design, ecu_of
    from .control.linearise import stops
    from .control.pid import Requirements
    from .run_folder import read_draws, read_fitted

    fitted = read_fitted(run)
    lower, upper = stops(fitted)
    computer = ecu_of(fitted, resolution=(upper - lower) / 2**adc_bits, **ecu)
    drawn = read_draws(run, fitted, DRAWS - 1, SEED)
    found = design(fitted, computer, Requirements(*limits), rule, drawn, feed_forward, report)
    from .reporting import write_design
    from .reporting.control.tables import design_table

    write_design(run, found, report)
    return Done(design_table(found))


def write_report(run: Path, report: Report) -> Done:
    """One page of everything that RUN holds: RUN/report.html."""
    report("writing the page", 0.0)
    from .reporting.page import write_page

    return Done(str(write_page(run)))


@dataclass(frozen=True)
class Stage:
    """A step from the measurements to the report.

    Args:
        name: of its command.
        makes: files below RUN, all of which are there once it is done.
        needs: files below RUN that it is made from; those that are not there do not count.
        work: what it does, from the measurement folder, the run folder and a progress report.
    """

    name: str
    makes: tuple[str, ...]
    needs: tuple[str, ...]
    work: Callable[[Path, Path, Report], Done]


def _of_run(work: Callable[[Path, Report], Done]) -> Callable[[Path, Path, Report], Done]:
    """Work that needs no more of the measurements than what the run says of them."""
    return lambda folder, run, report: work(run, report)


_MODEL = ("fit_state.npz", "diagnosis_state.npz")
_RESULTS = ("fit.json", "diagnosis.json", "posterior.json", "transfer_function.json", "frequency_response.json",
            "pid.json")  # fmt: skip

# the one list of stages: a new command joins `etcfit run` by a line here, in the place where its results are needed
STAGES: tuple[Stage, ...] = (
    Stage("fit", ("fit.json", "fit_state.npz"), (), fit_folder),
    Stage("diagnose", ("diagnosis.json", "diagnosis_state.npz"), ("fit.json", "fit_state.npz"), _of_run(diagnose_run)),
    Stage("sample", ("posterior.json",), ("diagnosis.json", "diagnosis_state.npz"), _of_run(sample_run)),
    Stage("reduce", ("transfer_function.json",), _MODEL, _of_run(reduce_run)),
    Stage("design", ("pid.json",), (*_MODEL, "posterior.json"), _of_run(design_run)),
    Stage("report", ("report.html",), _RESULTS, _of_run(write_report)),
)


def run_all(
    folder: Path,
    run: Path,
    progress: Callable[[], AbstractContextManager[Report]],
    show: Callable[[str, Done | None], None],
    stages: tuple[Stage, ...] = STAGES,
) -> str:
    """Run every stage that is not done yet, in order.

    Args:
        folder: the measurements.
        run: the run folder; made if absent.
        progress: opened for each stage in turn.
        show: called after each stage with its name and what came of it, None where it was done before.
        stages: in order.
    Returns:
        Why the fit of the last model did not converge, or "".
    Raises:
        UsageError: RUN was made from other measurements.
    """
    _must_belong(run, folder)
    again = False
    for stage in stages:
        again = again or not is_done(stage, folder, run)
        if not again:
            show(stage.name, None)
            continue
        with _begun(run, stage), progress() as report:
            done = stage.work(folder, run, report)
        show(stage.name, done)
    return _failure(run)


def is_done(stage: Stage, folder: Path, run: Path) -> bool:
    """Whether all that a stage makes is there, whole, and at least as new as what it is made from."""
    made = [run / name for name in stage.makes]
    if _mark(run, stage).exists() or not all(path.is_file() for path in made):
        return False
    sources = [run / name for name in stage.needs] or list(_measurements(folder))
    newest = max((path.stat().st_mtime_ns for path in sources if path.exists()), default=0)
    return min(path.stat().st_mtime_ns for path in made) >= newest


def _measurements(folder: Path) -> Iterator[Path]:
    """rig.toml, every CSV and the folders that hold one: a file that is taken away changes its folder."""
    yield folder / "rig.toml"
    for path in folder.glob("*/*.csv"):
        yield path
        yield path.parent


def _mark(run: Path, stage: Stage) -> Path:
    """Lies there while a stage is under way, so that one that was interrupted, or killed, is begun again."""
    return run / f".{stage.name}.unfinished"


@contextmanager
def _begun(run: Path, stage: Stage) -> Iterator[None]:
    run.mkdir(parents=True, exist_ok=True)
    _mark(run, stage).touch()
    yield
    _mark(run, stage).unlink()


def _must_belong(run: Path, folder: Path) -> None:
    if not (run / "fit_state.npz").is_file():
        return
    from .run_folder import read_state

    fitted = read_state(run).folder
    if fitted.resolve() != folder.resolve():
        raise UsageError(f"{run} was made from {fitted}, not from {folder}. Name another run folder with --out, "
                         "or delete this one.")  # fmt: skip


def _failure(run: Path) -> str:
    """Of the last model in RUN that says whether it converged."""
    for name in ("diagnosis.json", "fit.json"):
        if (run / name).is_file():
            content = json.loads((run / name).read_text(encoding="utf-8"))
            return "" if content["converged"] else f"the fit of the final model did not converge: {content['reason']}"
    return ""


def keep_compiled() -> None:
    """The second run of a command finds its model compiled."""
    from .backend import use_compilation_cache

    use_compilation_cache()
