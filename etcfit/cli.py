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
def sample(
    run: Run,
    steps: Annotated[
        int, typer.Option(help="Steps of each ensemble after which to stop all the same.", min=1)
    ] = 20_000,
    quiet: Quiet = False,
) -> None:
    """The posterior of the model in RUN (that of the diagnosis, else of the fit); stops by itself, can be resumed."""
    with _progress(quiet) as report:
        report("taking up the model", 0.0)
        _keep_compiled()
        from .run_folder import final_rig, final_state

        state = final_state(run)
        rig, x = final_rig(state)
        from .fit import resume
        from .posterior import sample as sample_fit
        from .posterior.profile import profiles
        from .report import write_posterior
        from .report.posterior.table import posterior_table

        posterior = sample_fit(resume(rig, x, state.far, report), run, steps, report)
        profiled = profiles(posterior, report)
        write_posterior(run, posterior, profiled, report)
    _stdout().print(posterior_table(posterior, profiled))
    if not posterior.convergence.converged:
        raise _stop(Status.NOT_CONVERGED, f"this is no posterior yet: {posterior.convergence.reason} The same command "
                                          "goes on from here.")  # fmt: skip


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
