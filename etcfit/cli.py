"""The command line: arguments -> one library call -> a report. stdout is for results, stderr for everything else.

Exit status: 0 done, 1 the data are wrong, 2 usage, 3 the fit did not converge, 130 interrupted.
Everything heavy is imported inside the commands, so that `etcfit --help` answers at once.
"""

from __future__ import annotations

import ctypes
import functools
import gc
import inspect
import os
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import Field, dataclass, field, fields
from enum import IntEnum
from math import inf, pi
from pathlib import Path
from typing import Annotated, Any, cast, get_args, get_origin, get_type_hints

import typer
from typer.core import TyperArgument, TyperCommand, TyperOption

from . import __version__, stages
from .api.progress import Expected
from .control.request import DesignRequest
from .errors import MeasurementError, UsageError, visible
from .experiment.settings import CampaignSettings
from .posterior.settings import SamplingSettings

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


def _stderr() -> Any:
    from .reporting.blocks import console

    return console(stderr=True, soft_wrap=True, highlight=False)


def _say(text: object, err: bool = False, nl: bool = True) -> None:
    """Print a plain line. Control characters in a name or a label are made visible, not executed by the terminal."""
    typer.echo(visible(str(text)), err=err, nl=nl)


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
        except KeyboardInterrupt as stopped:  # one that comes from a stage says what is kept
            raise _stop(Status.INTERRUPTED, str(stopped) or "interrupted") from None

    return guarded


def _progress(quiet: bool, expected: Expected | None = None) -> AbstractContextManager[Callable[[str, float], None]]:
    """A bar on stderr: report(what is being done, fraction of it done). Where stderr is no terminal, lines.

    `expected` is how long the work will take; None if that is not known.
    """
    from .api.progress import progress

    return progress(quiet, expected, lambda line: _stderr().print(line, markup=False))


# duration on measurements/bench_twin of the commands that report few steps, s
_ON_THE_TWIN = {"check": 15.0, "advise": 25.0, "plan": 40.0}


def _usual(what: str, quiet: bool) -> AbstractContextManager[Callable[[str, float], None]]:
    """Progress of a command whose steps are few and long."""
    return _progress(quiet, Expected(_ON_THE_TWIN[what], "as for a folder like measurements/bench_twin"))


def _make(
    stage: str, work: Callable[..., stages.Done], run: Path, quiet: bool, *asked: Any, opened: Mapping[str, Any] = {}
) -> None:
    """Do the work of a stage in a run folder, and print what it leaves.

    Args:
        stage: its name on the manifest, which has how long it took last time; "" for work that is no stage.
        asked: what the work takes besides the run folder and the progress.
        opened: further arguments of `stages.opened`.
    """
    _finish(work, stages.opened(run, **opened), quiet, *asked, expected=stages.expected(run, stage) if stage else None)


def _finish(
    work: Callable[..., stages.Done], run: Any, quiet: bool, *asked: Any, expected: Expected | None = None
) -> None:
    """Do work in a run folder, show its progress, and print what it leaves."""
    with _progress(quiet, expected) as progress:
        done = work(run, progress, *asked)
    _show_outcome(done)


def _option(
    default: Any, help: str, metavar: str | None = None, shown: str | None = None, *names: str, **more: Any
) -> Any:
    """An option of a command: the default of a parameter, or a field of its options.

    Args:
        default: Ellipsis for an option that is required.
        metavar: a key of `_READERS` where the option takes a text and the parameter what that means.
        shown: the default in words, for `--help`.
        names: names of the option, if they differ from the parameter's; more: further arguments of `typer.Option`.
    """
    more |= {"help": help, "metavar": metavar, "show_default": shown or True}
    return field(default=default, metadata={"names": names, "more": more})


def _with_options(command: Callable[..., None]) -> Callable[..., None]:
    """Give typer a parameter for each option: of the command itself, and for each field of its argument `options`."""
    hints, taken, readers = get_type_hints(command, include_extras=True), list[inspect.Parameter](), {}
    kind = hints.get("options")

    def take(name: str, hint: Any, option: Any) -> None:
        if isinstance(option, Field):
            names, more = option.metadata["names"] or (f"--{name.replace('_', '-')}",), option.metadata["more"]
            if read := _READERS.get(more["metavar"]):
                readers[name] = functools.partial(read, names[0])
                hint = list[str] | None if list in [get_origin(each) for each in get_args(hint)] else str | None
            hint, option = Annotated[hint, typer.Option(*names, **more)], option.default
        taken.append(inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=option, annotation=hint))

    for each in inspect.signature(command).parameters.values():
        if each.name == "options":
            theirs = get_type_hints(kind)
            for own in fields(hints["options"]):
                take(own.name, theirs[own.name], own)
        else:
            take(each.name, hints[each.name], each.default)

    @functools.wraps(command)
    def spread(**given: Any) -> None:
        for name, read in readers.items():
            if (text := given[name]) is not None:
                given[name] = list(map(read, text)) if isinstance(text, list) else read(text)
        if kind is not None:
            given["options"] = kind(**{each.name: given.pop(each.name) for each in fields(kind)})
        command(**given)

    spread.__signature__ = inspect.Signature(taken)  # type: ignore[attr-defined]
    spread.__annotations__ = {each.name: each.annotation for each in taken}
    return spread


_TAG = re.compile(r"(\\*)(\[[a-z#/@][^\[]*?\])")  # text that rich would read as markup


def literally(text: str | None) -> str | None:
    """A help text, escaped so that rich prints it unchanged: `[ecu]` is a table of rig.toml, not markup."""
    return text and _TAG.sub(r"\1\1\\\2", text)


def _literal_command(*args: Any, **given: Any) -> TyperCommand:
    """A command whose help texts are printed as they are written."""
    command = TyperCommand(*args, **given)
    command.help, command.epilog = literally(command.help), literally(command.epilog)
    for parameter in command.params:
        if isinstance(parameter, TyperArgument | TyperOption):
            parameter.help = literally(parameter.help)
    return command


def _verb(panel: str, example: str, name: str | None = None) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Register a function as a command.

    Args:
        panel: panel of `etcfit --help` that lists the command.
        example: example at the end of the command's own help.
        name: name of the command, if it differs from the function's.
    """

    def registered(command: Callable[..., None]) -> Callable[..., None]:
        cls = cast("type[TyperCommand]", _literal_command)
        register = app.command(name, cls=cls, rich_help_panel=panel, epilog=f"Example: {example}")
        return register(_contract(_with_options(command)))

    return registered


def _small(name: str | None) -> str | None:
    """The name of a make in lower case, as `etcfit.ECUS` has it."""
    return None if name is None else name.casefold()


def _seconds(option: str, text: str) -> float:
    """A time with its unit, s."""
    return _with_unit(option, text, {"us": 1e-6, "ms": 1e-3, "s": 1.0}, "a time", "1ms")


def _radians(option: str, text: str) -> float:
    """An angle with its unit, rad."""
    return _with_unit(option, text, {"deg": pi / 180.0, "rad": 1.0}, "an angle", "0.1deg")


def _bytes(option: str, text: str) -> int:
    """A size with its unit, bytes."""
    return int(_with_unit(option, text, {"kB": 1e3, "MB": 1e6, "GB": 1e9}, "a size", "2GB"))


def _with_unit(option: str, text: str, units: Mapping[str, float], what: str, example: str) -> float:
    """A number with its unit, in SI."""
    number, unit = next(((text.removesuffix(u), u) for u in units if text.endswith(u)), (text, ""))
    try:
        value = float(number) * units[unit]
    except (KeyError, ValueError):
        *others, last = units
        known = f"{', '.join(others)} or {last}"
        raise UsageError(
            f"{option} {text}: {what} needs a number and a unit, {known}. Write, say, {example}."
        ) from None
    if not 0.0 <= value < inf:
        raise UsageError(f"{option} {text}: {what} cannot be negative or infinite. Write, say, {example}.")
    return value


def _three_gains(option: str, present: str) -> tuple[float, float, float]:
    """The gains P, I and D that the ECU has now."""
    try:
        p, i, d = map(float, present.split(","))
    except ValueError:
        raise UsageError(
            f"{option} {present}: three numbers between commas are required. Write, say, 6.2,40,0.05."
        ) from None
    if not all(0.0 <= gain < inf for gain in (p, i, d)):
        raise UsageError(f"{option} {present}: a gain cannot be negative or infinite.")
    return p, i, d


_READERS = {"TIME": _seconds, "ANGLE": _radians, "SIZE": _bytes, "P,I,D": _three_gains}
_ECU = _option(None, "Make of the ECU that gains are for, as rusefi; a wrong name lists all.", "NAME",
               "no particular make", callback=_small)  # fmt: skip
_ANYWAY = _option(False, "Give gains for an ECU even where the fit did not converge or is a compromise.")


def _must_be_writable(out: Path | None) -> None:
    """Refuse a path that cannot be written or is a measurement folder. None: nothing is written."""
    if out is not None:
        from .files import require_writable
        from .run_folder.state import refuse_measurement_folder

        refuse_measurement_folder(out)
        require_writable(out)


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


@_verb("Look", "etcfit check measurements/bench_twin --advise --at runs/bench_twin")
def check(
    folder: Folder,
    advise: bool = _option(False, "Instead of the checks, show what one more trace of each test would add."),
    at: Path | None = _option(None, "Use the final model of this run for the advice, not the graph readings.", "RUN",
                              exists=True, file_okay=False),
    out: Path | None = _option(None, "Also write the advice to RUN/advice.json.", "RUN", file_okay=False),
    quiet: Quiet = False,
) -> None:  # fmt: skip
    """Show what FOLDER contains, which parameters it identifies, and what is wrong with it; no fit."""
    if advise:
        return _advise(folder, at, out, quiet)
    for option, given in (("--at", at), ("--out", out)):
        if given is not None:
            raise UsageError(f"{option} goes with --advise.")
    with _usual("check", quiet) as report:
        from .api.verbs import check as check_rig
        from .reporting.closing import of_check

        found = check_rig(folder, quiet=report)
    # what cannot be fitted has no next step
    closing = None if found.why_not else of_check(found.result, folder)
    _show_outcome(stages.Done(found.printed(), closing=closing, stopped=found.why_not))


def _advise(folder: Path, at: Path | None, out: Path | None, quiet: bool) -> None:
    _must_be_writable(out)
    with _usual("advise", quiet) as report:
        from .api.verbs import advise
        from .reporting.closing import of_advice

        found = advise(folder, at, quiet=report)
        written = None if out is None else found.save(out) / "advice.json"
    _show_outcome(stages.Done(found.printed(), closing=of_advice(found.advice, folder, at, written)))


@_verb("Fit", "etcfit fit measurements/bench_twin --out runs/bench_twin")
def fit(folder: Folder, out: Out, quiet: Quiet = False) -> None:
    """Fit all traces in FOLDER jointly: RUN/fit.json, a table and a picture of the parameters."""
    _make("fit", lambda run, report: stages.fit_folder(folder, run, report), out, quiet, opened={"folder": folder})


@_verb("Explain", "etcfit diagnose runs/bench_twin")
def diagnose(run: Run, quiet: Quiet = False) -> None:
    """Find the effects that the model fitted in RUN lacks, add them and refit, until the residual shows no more."""
    _make("diagnose", stages.diagnose_run, run, quiet)


@_verb("Look", "etcfit report runs/bench_twin --interactive")
def report(
    run: Run,
    interactive: bool = _option(False, "Write the interactive page RUN/report_interactive.html instead: zoom, sliders "
                                "for parameters and gains, every trace with its verdict."),
    quiet: Quiet = False,
) -> None:  # fmt: skip
    """Write RUN/report.html, one self-contained page of everything in RUN, with pictures; or an interactive page."""
    _make("", stages.write_interactive if interactive else stages.write_report, run, quiet)


@_verb("Fit", "etcfit run measurements/bench_twin --out runs/bench_twin --until diagnose", name="run")
def run_(
    folder: Folder,
    out: Out,
    ecu: str | None = _ECU,
    until: str | None = _option(
        None, f"The last stage that runs: {', '.join(stages.LAST)}. The page is written in every case.", "STAGE",
        stages.LAST[-1],
    ),
    no_sample: bool = _option(False, "Skip the posterior, which takes longest."),
    quiet: Quiet = False,
) -> None:  # fmt: skip
    """Run all stages from FOLDER to RUN/report.html, in order; a stage whose results are up to date is skipped.

    The order is: fit, diagnosis, page; transfer function, gains, page; posterior, page.
    """
    if no_sample and until == "sample":
        raise UsageError("--no-sample and --until sample exclude each other.")
    last = until or ("design" if no_sample else stages.LAST[-1])
    with _naming_option("--ecu"):  # a wrong name is refused before an hour's work
        request = stages.designed_for(ecu)
    with _naming_option("--until"):
        wanted = stages.stages_until(last)

    def show(name: str, done: stages.Done | None) -> None:
        if done is not None:
            _show(done.shown)
        remark = "up to date, skipped" if done is None else done.remark
        if remark and not quiet:
            _stderr().print(f"{name}: {remark}", markup=False)

    failure = stages.run_all(folder, out, lambda expected: _progress(quiet, expected), show, wanted, request)
    _show_outcome(stages.Done(None, failure, closing=stages.closing_of(out)))


def _show(result: Any) -> None:
    """Print a table at the width of the terminal, and text, such as a path, unchanged; None prints nothing."""
    if isinstance(result, str):
        _say(result)
    elif result is not None:
        from .reporting.blocks import console

        console(width=None if sys.stdout.isatty() else _PIPE_WIDTH).print(result)


def _show_outcome(done: stages.Done) -> None:
    """Print the result of a command on stdout, its closing lines last; a fit that did not converge is an error."""
    if done.remark:
        _stderr().print(done.remark, markup=False)
    _show(done.shown)
    if done.closing is not None:
        _say(done.closing)
    if done.stopped:
        raise _stop(Status.DATA, done.stopped)
    if done.failure:
        raise _stop(Status.NOT_CONVERGED, done.failure)


@_verb("Look", "etcfit drive logs --compare before.csv after.csv --out runs/car")
def drive(
    logs: Annotated[Path, typer.Argument(help="A log, a folder of logs, or FOLDER/drive.", exists=True)],
    between: tuple[float, float] = _option((5.0, 45.0), "Report the share of the time between these positions, %."),
    compare: tuple[str, str] | None = _option(None, "Compare these two logs, before and after.", "LOG LOG"),
    foretold: Path | None = _option(None, "Compare the log with what this run of `etcfit tune` predicted.", "RUN",
                                    exists=True, file_okay=False),
    made_with: str | None = _option(None, "Gains of the log: present, half-way or proposed; with --foretold.", "NAME",
                                    "half-way"),
    out: Path | None = _option(None, "Folder for drive.html, drive.json, pictures.", "RUN", file_okay=False),
    quiet: Quiet = False,
) -> None:  # fmt: skip
    """Judge logs from the car: how well the plate follows; steps, oscillation, duty, both sensors; compare two logs.

    After new gains: whether the log is as `etcfit tune` predicted.
    """
    if foretold is not None and compare is not None:
        raise UsageError("--foretold and --compare exclude each other: --foretold takes one log, --compare takes two.")
    if made_with is not None and foretold is None:
        raise UsageError("--made-with goes with --foretold.")
    _must_be_writable(out)
    if out is not None and logs.is_dir():  # in a folder of logs without rig.toml, drive.json would pass for a log
        from .run_folder.state import refuse_among_measurements

        refuse_among_measurements(logs, out)
    with _progress(quiet) as progress:
        from .api.verbs import drive
        from .reporting.closing import of_drive
        from .reporting.closing.control import of_foretold

        found = drive(logs, between=between, compare=compare, foretold=foretold, made_with=made_with, quiet=progress)
        if out is not None:
            found.save(out, progress)
    if found.foretold is not None:
        closing = of_foretold(found.foretold, logs if logs.is_file() else logs / found.foretold.log)
    else:
        closing = of_drive(found.studies, logs if logs.is_dir() else logs.parent, out)
    _show_outcome(stages.Done(found.printed(), closing=closing))


@dataclass(frozen=True)
class TuneOptions:
    """Options of `etcfit tune`."""

    ecu: str = _option("generic", "Make of the ECU that made the logs and gets the gains.", "NAME", callback=_small)
    present: list[tuple[float, float, float]] | None = _option(
        None, "Gains P,I,D that the ECU has now, in its own numbers; if the logs have different gains, once for each "
        "log, the present gains last.", "P,I,D"
    )  # fmt: skip
    msq: Path | None = _option(
        None, "Tune of the ECU: gains (unless --present gives them), bias table and limit of the integral.", "FILE",
        exists=True, dir_okay=False,
    )  # fmt: skip
    hold_out: float = _option(40.0, "Share of the longest log that is predicted, not fitted, %.", min=0.0, max=80.0)
    supply: float | None = _option(None, "Supply voltage, V.", None, "as logged, else 13.5", min=1.0, max=100.0)
    ecu_period: float | None = _option(None, "Period of the ECU's clock.", "TIME", "as its maker publishes")
    ecu_delay: float | None = _option(None, "Delay from the ECU's reading to its output.", "TIME", "one period")
    column: list[str] | None = _option(
        None, "Meaning of a column: HEADER=QUANTITY [UNIT] or HEADER=ignore; may be repeated.", "TEXT"
    )
    anyway: bool = _ANYWAY


@_verb("Control", "etcfit tune lap.csv --ecu rusefi --present 6.2,40,0.05 --out runs/car")
def tune(
    logs: Annotated[list[Path], typer.Argument(help="Logs of one car, of any known format.", metavar="LOG...")],
    out: Out,
    options: TuneOptions,
    quiet: Quiet = False,
) -> None:
    """Tune an ECU from logs of a car: checks, model, diagnosis, and gains compared with the present ones.

    It proposes a half-way step first, with what the next log should show.
    """
    from .api.tuned import TuneRequest
    from .importing.answers import parsed
    from .importing.tuning import TuneSettings

    o, given = options, _given_of_ecu(options)
    answers = parsed(o.column or (), (), [str(file) for file in logs])
    request = TuneRequest(o.ecu, tuple(o.present or ()), tuple(given.items()), o.supply, answers, o.anyway,
                          TuneSettings(hold_out=0.01 * o.hold_out)).for_logs(logs, o.msq)  # fmt: skip
    _make("", lambda run, report: stages.tune_logs(logs, run, report, request), out, quiet)


@_verb("Explain", "etcfit sample runs/bench_twin")
def sample(
    run: Run,
    steps: int = _option(SamplingSettings.most_steps, "Largest number of steps of each ensemble.", min=1),
    quiet: Quiet = False,
) -> None:
    """Sample the posterior of the model in RUN (the diagnosis' model, else the fit's); stops by itself, resumes."""
    _make("sample", stages.sample_run, run, quiet, steps)


@_verb("Control", "etcfit reduce runs/bench_twin --output deg --pade 2")
def reduce(
    run: Run,
    unit_in: str = _option("V", "Unit of the input: V or % (of duty).", "UNIT", None, "--input"),
    unit_out: str = _option("rad", "Unit of the output: rad, deg or % (of travel).", "UNIT", None, "--output"),
    at: float = _option(25.0, "Operating point, % of the travel.", min=0.0, max=100.0),
    pade: int = _option(0, "Pade order of delay and sensor lag; 0: without them.", min=0, max=10),
    quiet: Quiet = False,
) -> None:
    """The third-order transfer function of the model in RUN (after a diagnosis, the final one).

    Eqs. 1-2 without dry friction and preload, about a plate held at the operating point. With the paper's Table 2 this
    is 2.208e5 / (s^3 + 1033 s^2 + 9.370e4 s + 1.282e5), poles near -1.4, -99 and -932 1/s. The paper prints another
    one, Eq. 8, 3.10e4 / (s^3 + 113.8 s^2 + 2941 s + 2.38e4), poles -81 and -16.3 +- 5.2j, which does not follow from
    its own table: its static gain is 1.303 instead of 1.722 rad/V. Where the rig has sine traces, their frequency
    response is measured and compared with it.
    """
    _make("reduce", stages.reduce_run, run, quiet, unit_in, unit_out, at / 100.0, pade)


@dataclass(frozen=True)
class DesignOptions:
    """Options of `etcfit design`."""

    rule: str = _option("optimal", "The tuning rule whose gains are proposed.", "NAME")
    ecu: str | None = _ECU
    ecu_period: float | None = _option(
        None, "Period of the ECU's clock.", "TIME", "that of [ecu] in rig.toml, else 1ms"
    )
    ecu_delay: float | None = _option(
        None, "Delay from reading to acting.", "TIME", "that of [ecu] in rig.toml, else 0ms"
    )
    ecu_filter: float | None = _option(None, "Time constant of the filter ahead of the ECU's converter.", "TIME", "0ms")
    divides_by_battery: bool | None = _option(
        None,
        "Whether the ECU divides its duty by the battery voltage, so that its output means volts.",
        None,
        "as the make is known, else not",
        "--divides-by-battery/--no-divides-by-battery",
    )
    present: tuple[float, float, float] | None = _option(
        None, "Gains that the ECU has now, in its own numbers, as 60,80,120.", "P,I,D"
    )
    swings_at: float | None = _option(
        None, "The P, in the ECU's own number, at which P alone makes the plate oscillate.", min=0.0
    )
    sensor_noise: float | None = _option(
        None,
        "Noise of one position reading, 1 sd, as 0.1deg.",
        "ANGLE",
        "that of the rig's logs, as fit.json has it; 0deg where none logs a position",
    )
    adc_bits: int = _option(12, "Bits of the position sensor's converter, over the travel.", min=6, max=24)
    feed_forward: bool = _option(False, "The ECU has a bias curve.")
    feed_forward_terms: str | None = _option(
        None, "Feed-forward that code of yours adds: friction, rate or both, as friction,rate.", "TERMS"
    )
    overshoot: float = _option(20.0, "Largest overshoot, %.", min=0.0)
    settling: float = _option("0.2s", "Longest settling time, as 0.2s.", "TIME")
    error: float = _option(0.5, "Largest steady-state error, %.", min=0.0)
    duty_activity: float = _option(5.0, "Largest standard deviation of the duty at rest, %.", min=0.0)
    rms_current: float = _option(inf, "Largest rms current, A.", None, "no limit", min=0.0)
    winding_heat: float = _option(inf, "Most heat in the winding, W.", None, "no limit", min=0.0)
    bridge_heat: float = _option(inf, "Most heat in the bridge, W.", None, "no limit", min=0.0)
    log: Path | None = _option(
        None, "A log from the car: its setpoint is a further scenario.", exists=True, dir_okay=False
    )
    parts: Path | None = _option(
        None, "Run folder of `etcfit fleet`: gains for parts like its units.", "RUN", exists=True, file_okay=False
    )
    anyway: bool = _ANYWAY
    fleet: bool = _option(False, "RUN is a run folder of `etcfit fleet`: gains for 99 % of its units.")


@_verb("Control", "etcfit design runs/bench_twin --ecu rusefi --ecu-period 1ms")
def design(run: Run, options: DesignOptions, quiet: Quiet = False) -> None:
    """PID gains for the model in RUN (after a diagnosis, the final one): every rule compared, one proposed."""
    request = _design_request(options)
    if not options.fleet:
        return _make("design", stages.design_run, run, quiet, request)
    _finish(stages.design_fleet, run, quiet, request)


def _design_request(o: DesignOptions) -> DesignRequest:
    """The request of `etcfit design`, in SI."""
    given = _given_of_ecu(o)
    limits = {
        "overshoot_pct": o.overshoot,
        "settling_s": o.settling,
        "steady_state_error_pct": o.error,
        "duty_activity_pct": o.duty_activity,
        "current_rms_A": o.rms_current,
        "winding_W": o.winding_heat,
        "bridge_W": o.bridge_heat,
    }
    if zero := [symbol for symbol, limit in limits.items() if limit == 0.0]:
        raise UsageError(f"{zero[0]}: no loop stays below 0. Give a larger limit.")
    terms = _terms(o.feed_forward, o.feed_forward_terms)
    if o.fleet and o.parts is not None:
        raise UsageError("--parts and --fleet exclude each other: with --fleet RUN itself is the fleet.")
    required = {symbol: limit for symbol, limit in limits.items() if limit != inf}
    known = {} if o.present is None else dict(zip("PID", o.present, strict=True))
    known |= {} if o.swings_at is None else {"swings_at": o.swings_at}
    return DesignRequest(o.rule, o.adc_bits, terms, required, given, o.ecu, o.log, o.parts, o.anyway, known)


# field of `Ecu` -> option that gives it
_OF_ECU = {"period": "ecu_period", "delay": "ecu_delay", "lag": "ecu_filter", "noise": "sensor_noise",
           "compensated": "divides_by_battery"}  # fmt: skip


def _given_of_ecu(options: TuneOptions | DesignOptions) -> dict[str, float]:
    """The given properties of the ECU, by field of `Ecu`; one that its make fixes at another value is refused."""
    every = {field: getattr(options, name, None) for field, name in _OF_ECU.items()}
    given = {field: float(value) for field, value in every.items() if value is not None}
    if given.get("period") == 0.0:
        raise UsageError("--ecu-period: the period must be longer than 0. Write, say, 1ms.")
    if options.ecu is not None:
        from .model.ecus import named

        with _naming_option("--ecu"):
            clash = named(options.ecu).clashes(given)
        if clash:
            option = _OF_ECU[clash[0]].replace("_", "-")
            raise UsageError(f"--{option}: {options.ecu} fixes it. Leave it out.")
    return given


@contextmanager
def _naming_option(option: str) -> Iterator[None]:
    """Put the name of the option in front of a usage error."""
    try:
        yield
    except UsageError as err:
        raise UsageError(f"{option} {err}") from None


def _terms(spring: bool, others: str | None) -> bool | str:
    """The feed-forward: whether the spring's table alone, or names between commas."""
    if others is None:
        return spring
    from .model.feed_forward import terms_of

    with _naming_option("--feed-forward-terms"):
        terms_of(others)
    return f"spring,{others}" if spring else others


@_verb("Many units", "etcfit fleet line_4 --out runs/line_4 --workers 4")
def fleet(
    what: Annotated[
        list[str], typer.Argument(help="A folder of units or its address (s3://...); or: report RUN.", metavar="FLEET")
    ],
    out: Path | None = _option(None, "The run folder to write.", "RUN", file_okay=False),
    workers: int | None = _option(None, "Processes on this machine.", None, "one per core", min=1, max=1024),
    scheduler: str | None = _option(None, "Address of a running Dask scheduler, as tcp://host:8786.", "ADDRESS"),
    quiet: Quiet = False,
) -> None:
    """Fit many units of one design (each FLEET/<unit>/ is a measurement folder): how they differ, and which are odd.

    `etcfit fleet report RUN` writes the page again.
    """
    match what, out:
        case ["report", run], None:
            return _finish(stages.fleet_report, Path(run), quiet)
        case [_], None:
            raise UsageError("--out RUN is missing: the run folder to write.")
        case [location], Path():
            if workers is not None and scheduler is not None:
                raise UsageError("--workers and --scheduler exclude each other: the scheduler has its own workers.")
        case _:
            raise UsageError("Write `etcfit fleet FLEET --out RUN`, or `etcfit fleet report RUN`.")
    from .api.progress import silent

    def watched(address: str, share: float) -> None:
        _stderr().print(f"workers: {address}", markup=False)

    _finish(stages.fleet, out, quiet, location, workers, scheduler, silent if quiet else watched)


@_verb("Share", "etcfit export runs/bench_twin --to c --out firmware")
def export(
    run: Run,
    to: str = _option(..., "Format: c, fmu, msq, mat, m, python, mujoco, mujoco-position or isaac.", "FORMAT"),
    out: Path | None = _option(None, "The folder to write; RUN/export if not given.", "DIR", file_okay=False),
    step: float | None = _option(None, "Time step of the plant in C and FMU.", "TIME", "0.5ms"),
    at: float = _option(25.0, "Operating point of a transfer function, % of the travel.", min=0.0, max=100.0),
    into: Path | None = _option(None, "Your own tune, for msq: the gains are written into a copy.", "FILE", exists=True,
                                dir_okay=False),
    anyway: bool = _ANYWAY,
    quiet: Quiet = False,
) -> None:  # fmt: skip
    """Write the model in RUN (after a diagnosis, the final one) for another program; say what that format lacks."""
    _make("", stages.export_run, run, quiet, to, out, step, at / 100.0, into, anyway, opened={"out": out})


@_verb("Measure", "etcfit plan runs/bench_twin --out plans/next --current 4")
def plan(
    source: Annotated[
        Path,
        typer.Argument(
            help="A run folder, or a measurement folder.", exists=True, file_okay=False, metavar="RUN|FOLDER"
        ),
    ],
    out: Path = _option(..., "The folder to write.", "PLAN", file_okay=False),
    tests: int = _option(CampaignSettings.tests, "Largest number of tests.", min=1, max=50),
    current: float = _option(CampaignSettings.current, "Limit of the winding's current, A."),
    temperature: float = _option(CampaignSettings.temperature, "Limit of the winding's temperature, degC."),
    supply: float | None = _option(None, "Supply voltage, V.", None, "that of the rig", min=0.1),
    criterion: str = _option("A", "What to minimise: A, the sum of relative variances, or D, their geometric mean."),
    without: list[str] | None = _option(None, "A rig test that you cannot make; may be repeated.", "TEST"),
    quiet: Quiet = False,
) -> None:
    """Choose the most informative next tests within limits: files to play, and a procedure sheet."""
    from .datasets.base import refuse_to_overwrite

    refuse_to_overwrite(out)
    settings = CampaignSettings(tests=tests, current=current, temperature=temperature)
    with _usual("plan", quiet) as report:
        from .api.progress import part_of
        from .api.verbs import plan
        from .reporting.closing import of_plan

        chosen = plan(source, settings, criterion=criterion, without=without or (), supply=supply,
                      quiet=part_of(report, 0.0, 0.8))  # fmt: skip
        report("drawing", 0.8)
        chosen.save(out)
    _show_outcome(stages.Done(chosen.printed(), closing=of_plan(chosen.campaign, out)))


@_verb("Measure", "etcfit fetch kassel-throttle")
def fetch(
    name: Annotated[str, typer.Argument(help="kassel-throttle, wintec-throttle, emps or bam-xl330.", metavar="NAME")],
    to: Path | None = _option(None, "The folder to write; measurements/NAME if not given.", "FOLDER"),
    data: Path | None = _option(None, "Folder of local copies.", exists=True, file_okay=False),
    quiet: Quiet = False,
) -> None:
    """Write a public measured data set as a measurement folder, from a local copy (also $ETCFIT_DATA) or a download."""
    with _progress(quiet) as report:
        from .api.verbs import fetch
        from .reporting.closing import of_fetched

        folder = fetch(name, to, data, quiet=report)
    _say(of_fetched(name, folder))


@_verb("Measure", "etcfit new my_rig --like bosch-0280750148")
def new(
    folder: Annotated[Path, typer.Argument(help="The folder to make.", file_okay=False, metavar="FOLDER")],
    like: str | None = _option(None, "A known nameplate: bosch-0280750148 or kassel.", "NAME"),
    quiet: Quiet = False,
) -> None:
    """Write a rig.toml that explains every key, and a folder for each rig test that says what to record."""
    del quiet  # no progress is shown; every command takes the same options
    from .importing.new import new_folder
    from .reporting.closing import of_new

    _say(of_new(new_folder(folder, like)))


@dataclass(frozen=True)
class ImportOptions:
    """Options of `etcfit import`."""

    to: Path = _option(..., "The measurement folder to write.", "FOLDER", file_okay=False)
    yes: bool = _option(False, "Accept every guess.", None, None, "--yes", "-y")
    column: list[str] | None = _option(
        None, "Meaning of a column: [FILE:]HEADER=QUANTITY [UNIT] or =ignore; may be repeated.", "TEXT"
    )
    test: list[str] | None = _option(None, "Rig test of a file: FILE=TEST; may be repeated.", "TEXT")
    period: float | None = _option(None, "Sampling period, for files without a time column, as 1ms.", "TIME")
    rig: Path | None = _option(None, "A rig.toml to copy, as `etcfit new` writes one.", "RIG.TOML", dir_okay=False)
    motor: str | None = _option(None, "The motor to read from files that have several.", "NAME")
    servo: str | None = _option(
        None,
        "The servo whose registers the columns hold: feetech-sts, feetech-scs, dynamixel-xm, dynamixel-xl330 or "
        "dynamixel-ax.",
        "NAME",
    )
    limit: int = _option("256MB", "Largest size of one recording's numbers in memory.", "SIZE")


@_verb("Measure", "etcfit import recordings/* --to measurements/mine --rig my_rig/rig.toml", name="import")
def import_(
    files: Annotated[
        list[Path], typer.Argument(help="Recordings of any format; a DBC for bus logs.", metavar="FILE...")
    ],
    options: ImportOptions,
    quiet: Quiet = False,
) -> None:
    """Convert foreign recordings to a measurement folder; guess columns, units, signs and rig tests, with reasons."""
    from .importing import import_files
    from .importing.answers import accept_all, parsed, refuse
    from .reporting.closing import of_imported

    o = options
    answers = parsed(o.column or (), o.test or (), [str(file) for file in files], o.period)
    resolve = accept_all if o.yes else _ask_user if sys.stdin.isatty() and sys.stderr.isatty() else refuse
    with _progress(quiet or resolve is _ask_user) as report:
        done = import_files(files, o.to, answers, resolve, rig=o.rig, most=o.limit, motor=o.motor, servo=o.servo,
                            report=report)  # fmt: skip
    for file, source, reason in done.traces:
        _say(f"{done.folder}/{file}  from {source}: {reason}")
    for warning in done.warnings:
        _stderr().print(warning, markup=False)
    _say(of_imported(done))


def _ask_user(doubts: Sequence[Any], answers: Any) -> Any:
    """Ask the user about each doubtful guess: Enter accepts the guess, any other text is the answer."""
    for doubt in doubts:
        _say(f"{doubt.where}\n  {doubt.reason}", err=True)
        while True:
            _say(f"  {doubt.choices} [{doubt.taken}]: ", err=True, nl=False)
            text = sys.stdin.readline().strip() or doubt.taken
            try:
                answers = doubt.accepted(answers) if text == doubt.taken else doubt.answered(text, answers)
                break
            except UsageError as error:
                _say(f"  {error}", err=True)
    return answers


# by default glibc has one heap per thread and keeps freed arrays of up to 32 MB in the heap
_HEAPS = {-8: ("MALLOC_ARENA_MAX", 2), -3: ("MALLOC_MMAP_THRESHOLD_", 1 << 20), -1: ("MALLOC_TRIM_THRESHOLD_", 1 << 25)}


def _give_memory_back() -> None:
    """Let the C library return freed arrays to the system: 1.2 of the 2.8 GB of a diagnosis were free memory.

    Environment variables that the user has set take precedence.
    """
    if sys.platform == "linux":
        with suppress(AttributeError):  # another library than glibc
            set_option = ctypes.CDLL(None).mallopt
            for number, (name, value) in _HEAPS.items():
                if name not in os.environ:
                    set_option(number, value)


def _one_thread_a_product() -> None:
    """Have NumPy, which is not loaded yet, compute products in the thread that asks for them: the cores are busy with
    our own threads, and those of OpenBLAS wait for each other, spinning. What the user has set stands."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def main() -> None:
    """The console script."""
    _give_memory_back()
    _one_thread_a_product()
    gc.set_threshold(100_000, 50, 50)  # tracing a model makes many objects and no garbage: 1.5 s of a fit
    try:
        app()
    except KeyboardInterrupt:  # outside any command: while arguments are parsed or typer closes down
        sys.exit(Status.INTERRUPTED)


if __name__ == "__main__":
    main()
