"""The command line: arguments -> one library call -> a report. stdout is for results, stderr for everything else.

Exit status: 0 done, 1 the data are wrong, 2 usage, 3 the fit did not converge, 130 interrupted.
Everything heavy is imported inside the commands, so that `etcfit --help` answers at once.
"""

from __future__ import annotations

import functools
import gc
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import IntEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from . import __version__
from .errors import MeasurementError, UsageError

app = typer.Typer(
    help="Parameters of an electronic throttle body, from a folder of rig measurements.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_show_locals=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


class Status(IntEnum):
    """The exit statuses that scripts may rely on."""

    DONE = 0
    DATA = 1
    USAGE = 2
    NOT_CONVERGED = 3
    INTERRUPTED = 130


Folder = Annotated[Path, typer.Argument(help="A measurement folder.", exists=True, file_okay=False, metavar="FOLDER")]
Out = Annotated[Path, typer.Option("--out", help="The run folder to write.", file_okay=False, metavar="RUN")]
Run = Annotated[Path, typer.Argument(help="A run folder.", exists=True, file_okay=False, metavar="RUN")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress on stderr.")]

_PIPE_WIDTH = 140  # columns; a pipe has no width, and a table cut to 80 loses figures


def _stdout() -> Any:
    from rich.console import Console

    return Console(width=None if sys.stdout.isatty() else _PIPE_WIDTH)


def _stderr() -> Any:
    from rich.console import Console

    return Console(stderr=True, soft_wrap=True, highlight=False)


def _stop(status: Status, message: str) -> typer.Exit:
    from rich.markup import escape

    _stderr().print(f"[bold red]etcfit:[/] {escape(message)}")
    return typer.Exit(status)


def _contract(command: Callable[..., None]) -> Callable[..., None]:
    """Errors that a user can mend become a message and an exit status; no traceback."""

    @functools.wraps(command)
    def guarded(*args: Any, **kwargs: Any) -> None:
        try:
            command(*args, **kwargs)
        except MeasurementError as error:
            raise _stop(Status.DATA, str(error)) from None
        except UsageError as error:
            raise _stop(Status.USAGE, str(error)) from None
        except OSError as error:  # a folder that cannot be written, a full disk
            raise _stop(Status.USAGE, f"{error.filename or 'output'}: {error.strerror or error}") from None
        except KeyboardInterrupt:
            raise _stop(Status.INTERRUPTED, "interrupted") from None

    return guarded


@contextmanager
def _progress(quiet: bool) -> Iterator[Callable[[str, float], None]]:
    """A bar on stderr: report(what is being done, fraction of it done). Where stderr is no terminal, a line a stage."""
    if quiet:
        yield lambda stage, done: None
        return
    console = _stderr()
    if console.is_terminal:
        with _bar(console) as report:
            yield report
    else:
        yield _lines(console)


@contextmanager
def _bar(console: Any) -> Iterator[Callable[[str, float], None]]:
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn()
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("starting", total=1.0)
        yield lambda stage, done: bar.update(task, description=stage, completed=done)


def _lines(console: Any) -> Callable[[str, float], None]:
    said: list[str] = []

    def report(stage: str, done: float) -> None:
        if stage not in said[-1:]:
            said.append(stage)
            console.print(stage, markup=False)

    return report


def _keep_compiled() -> None:
    """The second run of a command finds its model compiled."""
    from .backend import use_compilation_cache

    use_compilation_cache()


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"etcfit {__version__}")
        raise typer.Exit


@app.callback()
def _global(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version and stop.", callback=_show_version, is_eager=True)
    ] = False,
) -> None:
    pass


@app.command()
@_contract
def check(folder: Folder, quiet: Quiet = False) -> None:
    """What is in FOLDER, what it can identify, and what is wrong with it; fits nothing."""
    with _progress(quiet) as report:
        report("reading the folder", 0.0)
        from .rig.reader import read_folder

        rig = read_folder(folder)
        report("working out what these data can identify", 0.3)
        _keep_compiled()
        from .check import check as check_rig
        from .report.tables import check_table

        result = check_rig(rig)
    _stdout().print(check_table(result))


@app.command()
@_contract
def fit(folder: Folder, out: Out, quiet: Quiet = False) -> None:
    """The joint fit of all traces in FOLDER: RUN/fit.json, a table and pictures."""
    with _progress(quiet) as report:
        report("reading the folder", 0.0)
        from .rig.reader import read_folder

        rig = read_folder(folder)
        report("loading the model", 0.0)
        _keep_compiled()
        from .fit import fit as fit_rig
        from .report import write_run
        from .report.tables import fit_table

        result = fit_rig(rig, report)
        write_run(out, result, report)
    _stdout().print(fit_table(result))
    if not result.converged:
        raise _stop(Status.NOT_CONVERGED, f"the fit did not converge: {result.reason}")


@app.command()
@_contract
def diagnose(run: Run, quiet: Quiet = False) -> None:
    """What the model fitted in RUN lacks: residual, missing effect, refit, until nothing is left; before and after."""
    with _progress(quiet) as report:
        report("taking up the fit", 0.0)
        _keep_compiled()
        from .run_folder import read_state, rig_of

        state = read_state(run)
        rig = rig_of(state)
        from .diagnose import diagnose as diagnose_fit
        from .fit import resume
        from .report import write_diagnosis
        from .report.diagnosis.table import diagnosis_table

        diagnosis = diagnose_fit(resume(rig, state.x, state.far, report), report)
        write_diagnosis(run, diagnosis, report)
    _stdout().print(diagnosis_table(diagnosis))
    if not diagnosis.after.converged:
        raise _stop(Status.NOT_CONVERGED, f"the fit of the final model did not converge: {diagnosis.after.reason}")


@app.command()
@_contract
def reduce(
    run: Run,
    unit_in: Annotated[str, typer.Option("--input", help="V or % (of duty).", metavar="UNIT")] = "V",
    unit_out: Annotated[str, typer.Option("--output", help="rad, deg or % (of travel).", metavar="UNIT")] = "rad",
    at: Annotated[float, typer.Option(help="Operating point, % of the travel.", min=0.0, max=100.0)] = 25.0,
    pade: Annotated[int, typer.Option(help="Append delay and sensor lag, to this Pade order.", min=0, max=10)] = 0,
    quiet: Quiet = False,
) -> None:
    """The third-order transfer function of the model in RUN (after a diagnosis, the final one).

    Eqs. 1-2 without dry friction and preload, about a plate held at the operating point. With the paper's Table 2 this
    is 2.208e5 / (s^3 + 1033 s^2 + 9.370e4 s + 1.282e5), poles near -1.4, -102 and -930 1/s. The paper prints another
    one, Eq. 8, 3.10e4 / (s^3 + 113.8 s^2 + 2941 s + 2.38e4), poles -81 and -16.3 +- 5.2j, which does not follow from
    its own table: its static gain is 1.303 instead of 1.722 rad/V.
    """
    with _progress(quiet) as report:
        report("taking up the fit", 0.0)
        _keep_compiled()
        from .reduce import reduce as reduce_model
        from .run_folder import read_fitted

        fitted = read_fitted(run)
        report("linearising", 0.3)
        reduction = reduce_model(fitted, unit_in, unit_out, at / 100.0)
        from .report import write_reduction
        from .report.control.tables import reduction_table

        write_reduction(run, fitted, reduction, pade, report)
    _stdout().print(reduction_table(fitted, reduction, pade))


@app.command()
@_contract
def design(
    run: Run,
    rule: Annotated[str, typer.Option(help="Whose gains are proposed.", metavar="NAME")] = "optimal",
    ecu_period: Annotated[str, typer.Option(help="Of the ECU's clock, as 1ms.", metavar="TIME")] = "1ms",
    ecu_delay: Annotated[str, typer.Option(help="From reading to acting, as 0.5ms.", metavar="TIME")] = "0ms",
    adc_bits: Annotated[int, typer.Option(help="Of the position sensor, over its travel.", min=6, max=24)] = 12,
    feed_forward: Annotated[bool, typer.Option("--feed-forward", help="The ECU has a bias curve.")] = False,
    overshoot: Annotated[float, typer.Option(help="At most, %.", min=0.0)] = 20.0,
    settling: Annotated[str, typer.Option(help="At most, as 0.2s.", metavar="TIME")] = "0.2s",
    error: Annotated[float, typer.Option(help="Steady-state error at most, %.", min=0.0)] = 0.5,
    quiet: Quiet = False,
) -> None:
    """PID gains for the model in RUN (after a diagnosis, the final one): every rule compared, one proposed."""
    with _progress(quiet) as report:
        report("taking up the fit", 0.0)
        from .design import DRAWS, SEED, ecu_of
        from .design import design as design_gains
        from .pid import Requirements
        from .reduce import stops
        from .run_folder import read_draws, read_fitted

        _keep_compiled()
        fitted = read_fitted(run)
        lower, upper = stops(fitted)
        period, delay = _seconds("--ecu-period", ecu_period), _seconds("--ecu-delay", ecu_delay)
        if not period > 0.0:
            raise UsageError(f"--ecu-period {ecu_period}: the period must be longer than 0. Write, say, 1ms.")
        ecu = ecu_of(fitted, period=period, delay=delay, filter=2.0 * period, resolution=(upper - lower) / 2**adc_bits)
        asked = Requirements(overshoot, _seconds("--settling", settling), error)
        drawn = read_draws(run, fitted, DRAWS - 1, SEED)
        found = design_gains(fitted, ecu, asked, rule, drawn, feed_forward, report)
        from .report import write_design
        from .report.control.tables import design_table

        write_design(run, found, report)
    _stdout().print(design_table(found))


_SECONDS = {"us": 1e-6, "ms": 1e-3, "s": 1.0}


def _seconds(option: str, text: str) -> float:
    """A time with its unit, s."""
    number, unit = next(((text.removesuffix(u), u) for u in _SECONDS if text.endswith(u)), (text, ""))
    try:
        value = float(number) * _SECONDS[unit]
    except (KeyError, ValueError):
        raise UsageError(f"{option} {text}: a time needs a number and a unit, us, ms or s. Write, say, 1ms.") from None
    if not 0.0 <= value < float("inf"):
        raise UsageError(f"{option} {text}: a time cannot be negative or endless. Write, say, 1ms.")
    return value


@app.command()
@_contract
def fetch(
    name: Annotated[str, typer.Argument(help="kassel-throttle, emps or bam-xl330.", metavar="NAME")],
    to: Annotated[Path | None, typer.Option(help="Where; measurements/NAME if not given.", metavar="FOLDER")] = None,
    data: Annotated[Path | None, typer.Option(help="Folder of local copies.", exists=True, file_okay=False)] = None,
    quiet: Quiet = False,
) -> None:
    """A public measured data set as a measurement folder; local copies (also $ETCFIT_DATA) before a download."""
    with _progress(quiet) as report:
        report(f"fetching {name}", 0.0)
        from .fetch import fetch as fetch_dataset

        folder = fetch_dataset(name, to or Path("measurements") / name, data)
    typer.echo(folder)


def main() -> None:
    """The console script."""
    gc.set_threshold(100_000, 50, 50)  # tracing a model makes many objects and no garbage: 1.5 s of a fit
    try:
        app()
    except KeyboardInterrupt:  # outside any command: while arguments are parsed or typer closes down
        sys.exit(Status.INTERRUPTED)


if __name__ == "__main__":
    main()
