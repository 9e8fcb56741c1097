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
from dataclasses import dataclass, field, fields
from enum import IntEnum
from math import inf, pi
from pathlib import Path
from typing import Annotated, Any, cast, get_type_hints

import typer
from typer.core import TyperArgument, TyperCommand, TyperOption

from . import __version__, stages
from .api.progress import Expected, keep_compiled
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
Interactive = Annotated[
    bool,
    typer.Option("--interactive", help="The page to work with instead, RUN/report_interactive.html: zoom, sliders for "
                 "parameters and gains, every trace with its verdict."),
]  # fmt: skip
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress on stderr.")]
Advise = Annotated[bool, typer.Option("--advise", help="What one more trace of each test would tell instead.")]
At = Annotated[
    Path | None,
    typer.Option("--at", help="Advise at the final model of this run, not at the graph readings.", metavar="RUN",
                 exists=True, file_okay=False),
]  # fmt: skip
AdviceOut = Annotated[Path | None, typer.Option("--out", help="Write the advice there too, advice.json.", metavar="RUN",
                                                file_okay=False)]  # fmt: skip

_PIPE_WIDTH = 140  # columns; a pipe has no width, and a table cut to 80 loses figures


def _stdout() -> Any:
    from .reporting.blocks import console

    return console(width=None if sys.stdout.isatty() else _PIPE_WIDTH)


def _stderr() -> Any:
    from .reporting.blocks import console

    return console(stderr=True, soft_wrap=True, highlight=False)


def _say(text: object, err: bool = False, nl: bool = True) -> None:
    """A plain line, in which a name or a label gives the terminal no orders."""
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

    `expected` is how long it will take; None where nothing is known of that.
    """
    from .api.progress import progress

    return progress(quiet, expected, lambda line: _stderr().print(line, markup=False))


def _stage(run: Path, stage: str, quiet: bool) -> AbstractContextManager[Callable[[str, float], None]]:
    """Progress of a stage, which says at once how long it will take."""
    return _progress(quiet, stages.expected(run, stage))


# of commands that say little of how far they are: what they take on measurements/bench_twin, s
_ON_THE_TWIN = {"check": 15.0, "advise": 25.0, "plan": 40.0}


def _usual(what: str, quiet: bool) -> AbstractContextManager[Callable[[str, float], None]]:
    """Progress of a command whose steps are few and long."""
    return _progress(quiet, Expected(_ON_THE_TWIN[what], "as for a folder like measurements/bench_twin"))


def _option(
    default: Any, help: str, metavar: str | None = None, shown: str | None = None, *names: str, **more: Any
) -> Any:
    """A field that is an option of a command.

    Args:
        default: of the field; Ellipsis for one that must be given.
        help, metavar: of `--help`.
        shown: the default in words, for `--help`.
        names: of the option, where they are not the field's; more: further arguments of `typer.Option`.
    """
    option = typer.Option(*names, help=help, metavar=metavar, show_default=shown or True, **more)
    return field(default=default, metadata={"option": option})


def _with_options(command: Callable[..., None]) -> Callable[..., None]:
    """A command whose argument `options` is an object takes the fields of its class one by one, as typer has them."""
    hints = get_type_hints(command, include_extras=True)
    if "options" not in hints:
        return command
    kind, theirs = hints["options"], get_type_hints(hints["options"])
    taken: list[inspect.Parameter] = []
    for each in inspect.signature(command).parameters.values():
        if each.name != "options":
            taken.append(each.replace(kind=each.KEYWORD_ONLY, annotation=hints[each.name]))
            continue
        for own in fields(kind):
            hint = Annotated[theirs[own.name], own.metadata["option"]]  # pyright: ignore
            taken.append(inspect.Parameter(own.name, each.KEYWORD_ONLY, default=own.default, annotation=hint))

    @functools.wraps(command)
    def spread(**given: Any) -> None:
        options = kind(**{each.name: given.pop(each.name) for each in fields(kind)})
        command(options=options, **given)

    spread.__signature__ = inspect.Signature(taken)  # type: ignore[attr-defined]
    spread.__annotations__ = {each.name: each.annotation for each in taken}
    return spread


_TAG = re.compile(r"(\\*)(\[[a-z#/@][^\[]*?\])")  # what rich takes for markup


def literally(text: str | None) -> str | None:
    """A help text as rich prints it unchanged: `[ecu]` is a table of rig.toml, no markup."""
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
    """A command of the command line.

    Args:
        panel: of `etcfit --help`.
        example: of the command's own help.
        name: where it is not the function's.
    """

    def registered(command: Callable[..., None]) -> Callable[..., None]:
        cls = cast("type[TyperCommand]", _literal_command)
        register = app.command(name, cls=cls, rich_help_panel=panel, epilog=f"Example: {example}")
        return register(_contract(_with_options(command)))

    return registered


def _small(name: str | None) -> str | None:
    """A make's name as `etcfit.ECUS` has it, however it is written."""
    return None if name is None else name.casefold()


_ECU = _option(None, "Make of the ECU that gains are for, as rusefi; a wrong name lists all.", "NAME",
               "no particular make",
               callback=_small)  # fmt: skip
_ANYWAY = _option(False, "Give gains for an ECU even where the fit did not converge or is a compromise.", None, None,
                  "--anyway")  # fmt: skip


def _must_be_writable(out: Path | None) -> None:
    """See `files.require_writable`; nor is it a measurement folder. None for nothing to write."""
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
def check(folder: Folder, advise: Advise = False, at: At = None, out: AdviceOut = None, quiet: Quiet = False) -> None:
    """What is in FOLDER, what it can identify, and what is wrong with it; fits nothing."""
    if advise:
        return _advise(folder, at, out, quiet)
    for option, given in (("--at", at), ("--out", out)):
        if given is not None:
            raise UsageError(f"{option} goes with --advise.")
    with _usual("check", quiet) as report:
        report("reading the folder", 0.0)
        from .rig.reader import read_folder

        rig = read_folder(folder)
        report("working out what these data can identify", 0.3)
        keep_compiled()
        from .experiment.check import check as check_rig
        from .reporting.check_table import check_table
        from .reporting.closing import of_check

        result = check_rig(rig)
    _stdout().print(check_table(result))
    if result.why_not:  # `fit` would refuse it
        raise _stop(Status.DATA, result.why_not)
    _say(of_check(result, folder))


def _advise(folder: Path, at: Path | None, out: Path | None, quiet: bool) -> None:
    _must_be_writable(out)
    with _usual("advise", quiet) as report:
        report("reading the folder", 0.0)
        from .rig.reader import read_folder

        rig = read_folder(folder)
        report("working out what one more trace would tell", 0.3)
        keep_compiled()
        from .experiment.advice import advise
        from .reporting.check_table import advice_table
        from .reporting.closing import of_advice
        from .run_folder.plan import save_advice
        from .run_folder.state import fitted_to

        advice = advise(rig, None if at is None else fitted_to(at, rig))
        if out is not None:
            save_advice(out, advice)
    _stdout().print(advice_table(advice))
    _say(of_advice(advice, folder, at, None if out is None else out / "advice.json"))


@_verb("Fit", "etcfit fit measurements/bench_twin --out runs/bench_twin")
def fit(folder: Folder, out: Out, quiet: Quiet = False) -> None:
    """The joint fit of all traces in FOLDER: RUN/fit.json, a table and a picture of the parameters."""
    with _stage(out, "fit", quiet) as progress:
        done = stages.fit_folder(folder, stages.opened(out, folder=folder), progress)
    _tell(done)


@_verb("Explain", "etcfit diagnose runs/bench_twin")
def diagnose(run: Run, quiet: Quiet = False) -> None:
    """What the model fitted in RUN lacks: residual, missing effect, refit, until nothing is left; before and after."""
    with _stage(run, "diagnose", quiet) as progress:
        done = stages.diagnose_run(stages.opened(run), progress)
    _tell(done)


@_verb("Look", "etcfit report runs/bench_twin --interactive")
def report(run: Run, interactive: Interactive = False, quiet: Quiet = False) -> None:
    """One self-contained HTML page of all that RUN holds, RUN/report.html, with its pictures; or one to work with."""
    write = stages.write_interactive if interactive else stages.write_report
    with _progress(quiet) as progress:
        done = write(stages.opened(run), progress)
    _tell(done)


@dataclass(frozen=True)
class RunOptions:
    """Options of `etcfit run`."""

    ecu: str | None = _ECU
    until: str | None = _option(
        None,
        f"The last stage that is done: {', '.join(stages.LAST)}. The page is written all the same.",
        "STAGE",
        stages.LAST[-1],
    )
    no_sample: bool = _option(False, "No posterior, which takes longest.", None, None, "--no-sample")


@_verb("Fit", "etcfit run measurements/bench_twin --out runs/bench_twin --until diagnose", name="run")
def run_(folder: Folder, out: Out, options: RunOptions, quiet: Quiet = False) -> None:
    """Everything from FOLDER to RUN/report.html, in order; what is done already is not done again.

    Fit, diagnosis, page; transfer function, gains, page; posterior, page.
    """
    until, no_sample = options.until, options.no_sample
    if no_sample and until == "sample":
        raise UsageError("--no-sample and --until sample exclude each other.")
    last = until or ("design" if no_sample else stages.LAST[-1])
    with _of_option("--ecu"):  # a wrong name is refused before an hour's work
        asked = stages.designed_for(options.ecu)
    with _of_option("--until"):
        wanted = stages.stages_until(last)

    def show(name: str, done: stages.Done | None) -> None:
        if done is not None:
            _show(done.shown)
        remark = "done before, from what lies there now" if done is None else done.remark
        if remark and not quiet:
            _stderr().print(f"{name}: {remark}", markup=False)

    failure = stages.run_all(folder, out, lambda expected: _progress(quiet, expected), show, wanted, asked)
    _tell(stages.Done(None, failure, closing=stages.closing_of(out)))


def _show(result: Any) -> None:
    """A table as wide as the terminal; plain words, such as a path, as they are; nothing where there is none."""
    if result is None:
        return
    if isinstance(result, str):
        _say(result)
    else:
        _stdout().print(result)


def _tell(done: stages.Done) -> None:
    """What came of a command, on stdout, its closing last; a fit that did not converge is no success."""
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
    between: Annotated[tuple[float, float], typer.Option(help="Share of the time between these, %.")] = (5.0, 45.0),
    compare: Annotated[
        tuple[str, str] | None, typer.Option(help="These two, before and after.", metavar="LOG LOG")
    ] = None,
    foretold: Annotated[
        Path | None,
        typer.Option(help="Is the log as this run of `etcfit tune` foretold?", metavar="RUN", exists=True,
                     file_okay=False),
    ] = None,
    made_with: Annotated[
        str | None,
        typer.Option(help="Whose gains made it: present, half-way or proposed; with --foretold.", metavar="NAME",
                     show_default="half-way"),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="drive.html, drive.json and pictures.", file_okay=False, metavar="RUN")
    ] = None,
    quiet: Quiet = False,
) -> None:  # fmt: skip
    """Logs from the car: does the plate follow well enough; steps, oscillation, duty, both sensors; two compared.

    After new gains: is the log as `etcfit tune` foretold?
    """
    if foretold is not None and compare is not None:
        raise UsageError("--foretold and --compare exclude each other: the one is about one log, the other about two.")
    if made_with is not None and foretold is None:
        raise UsageError("--made-with goes with --foretold.")
    _must_be_writable(out)
    with _progress(quiet) as progress:
        progress("reading the logs", 0.0)
        if out is not None and logs.is_dir():  # of logs alone, without a rig.toml: drive.json would pass for one there
            from .run_folder.state import refuse_among_measurements

            refuse_among_measurements(logs, out)
        from .api.work import one_held_against
        from .car_log import study
        from .car_log.read import logs_at
        from .car_log.study import chosen
        from .reporting.car_log import compared_table, drive_table
        from .reporting.car_log.writing import write_drive
        from .reporting.closing import of_drive

        config, found = logs_at(logs)
        studies = [study(log, between) for log in (found if compare is None else chosen(found, compare))]
        held = None if foretold is None else one_held_against(studies, foretold, made_with)
        if out is not None:
            write_drive(out, config, studies, progress, held)
    if held is not None:
        from .reporting.car_log import foretold_table
        from .reporting.closing.control import of_foretold

        _stdout().print(foretold_table(held))
        return _say(of_foretold(held, logs if logs.is_file() else logs / held.log))
    _stdout().print(drive_table(config, studies) if compare is None else compared_table(config, *studies))
    _say(of_drive(studies, logs if logs.is_dir() else logs.parent, out))


@dataclass(frozen=True)
class TuneOptions:
    """Options of `etcfit tune`."""

    ecu: str = _option("generic", "Make of the ECU that made the logs and gets the gains.", "NAME", callback=_small)
    present: list[str] | None = _option(
        None, "P,I,D that are in it now, as it writes them; once a log where these differ, the last are in it now.",
        "P,I,D",
    )  # fmt: skip
    msq: Path | None = _option(
        None, "Its tune: gains, unless --present gives them, bias table and limit of the integral.", "FILE",
        exists=True, dir_okay=False,
    )  # fmt: skip
    hold_out: float = _option(40.0, "Of the longest log, predicted and not fitted, %.", min=0.0, max=80.0)
    supply: float | None = _option(None, "V.", None, "as logged, else 13.5", min=1.0, max=100.0)
    ecu_period: str | None = _option(None, "Of the ECU's clock.", "TIME", "as its maker publishes")
    ecu_delay: str | None = _option(None, "From its reading to its output.", "TIME", "one period")
    column: list[str] | None = _option(None, "HEADER=QUANTITY [UNIT], or =ignore; may be repeated.", "TEXT")
    anyway: bool = _ANYWAY


@_verb("Control", "etcfit tune lap.csv --ecu rusefi --present 6.2,40,0.05 --out runs/car")
def tune(
    logs: Annotated[list[Path], typer.Argument(help="Logs of one car, of any known format.", metavar="LOG...")],
    out: Out,
    options: TuneOptions,
    quiet: Quiet = False,
) -> None:
    """From logs of a car to gains: checks, model, diagnosis, gains beside those that are in the ECU now.

    A half-way step comes first, with what the next log should show.
    """
    from .api.tuned import TuneRequest
    from .importing.answers import parsed
    from .importing.tuning import TuneSettings

    ecu, present = options.ecu, [_three_gains(each) for each in options.present or ()]
    if len(present) > 1 and len(present) != len(logs):
        raise UsageError(f"--present is there {len(present)} times for {len(logs)} logs. Give it once, or once for "
                         "each log in their order.")  # fmt: skip
    given = _times_of_ecu(options)
    _refuse_what_a_make_fixes(ecu, given)
    answers = parsed(options.column or (), (), [str(file) for file in logs])
    gains = present[-1] if present else None
    request = TuneRequest(ecu, gains, tuple(given.items()), options.supply, answers, options.anyway,
                          TuneSettings(hold_out=0.01 * options.hold_out),
                          tuple(present) if len(present) > 1 else ())  # fmt: skip
    if options.msq is not None:
        request = request.with_tune(options.msq)
    with _progress(quiet) as progress:
        done = stages.tune_logs(logs, stages.opened(out), progress, request)
    _tell(done)


def _three_gains(present: str) -> tuple[float, float, float]:
    """P, I and D that are in the ECU now."""
    try:
        p, i, d = map(float, present.split(","))
    except ValueError:
        raise UsageError(
            f"--present {present}: three numbers between commas are required. Write, say, 6.2,40,0.05."
        ) from None
    if not all(0.0 <= gain < inf for gain in (p, i, d)):
        raise UsageError(f"--present {present}: a gain cannot be negative or endless.")
    return p, i, d


@_verb("Explain", "etcfit sample runs/bench_twin")
def sample(
    run: Run,
    steps: Annotated[
        int, typer.Option(help="Steps of each ensemble after which to stop all the same.", min=1)
    ] = SamplingSettings.most_steps,
    quiet: Quiet = False,
) -> None:
    """The posterior of the model in RUN (that of the diagnosis, else of the fit); stops by itself, can be resumed."""
    with _stage(run, "sample", quiet) as progress:
        done = stages.sample_run(stages.opened(run), progress, steps)
    _tell(done)


@_verb("Control", "etcfit reduce runs/bench_twin --output deg --pade 2")
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
    is 2.208e5 / (s^3 + 1033 s^2 + 9.370e4 s + 1.282e5), poles near -1.4, -99 and -932 1/s. The paper prints another
    one, Eq. 8, 3.10e4 / (s^3 + 113.8 s^2 + 2941 s + 2.38e4), poles -81 and -16.3 +- 5.2j, which does not follow from
    its own table: its static gain is 1.303 instead of 1.722 rad/V. Where the rig has sine traces, their frequency
    response is measured and set beside it.
    """
    with _stage(run, "reduce", quiet) as progress:
        done = stages.reduce_run(stages.opened(run), progress, unit_in, unit_out, at / 100.0, pade)
    _tell(done)


@dataclass(frozen=True)
class DesignOptions:
    """Options of `etcfit design`."""

    rule: str = _option("optimal", "The tuning rule whose gains are proposed.", "NAME")
    ecu: str | None = _ECU
    ecu_period: str | None = _option(None, "Period of the ECU's clock.", "TIME", "that of [ecu] in rig.toml, else 1ms")
    ecu_delay: str | None = _option(
        None, "Delay from reading to acting.", "TIME", "that of [ecu] in rig.toml, else 0ms"
    )
    ecu_filter: str | None = _option(None, "Time constant of the filter ahead of the ECU's converter.", "TIME", "0ms")
    divides_by_battery: bool | None = _option(
        None,
        "Whether the ECU divides its duty by the battery voltage, so that its output means volts.",
        None,
        "as the make is known, else not",
        "--divides-by-battery/--no-divides-by-battery",
    )
    present: str | None = _option(None, "Gains that the ECU has now, in its own numbers, as 60,80,120.", "P,I,D")
    swings_at: float | None = _option(
        None, "The P, in the ECU's own number, at which P alone makes the plate oscillate.", min=0.0
    )
    sensor_noise: str | None = _option(
        None,
        "Noise of one position reading, 1 sd, as 0.1deg.",
        "ANGLE",
        "that of the rig's logs, as fit.json has it; 0deg where none logs a position",
    )
    adc_bits: int = _option(12, "Bits of the position sensor's converter, over the travel.", min=6, max=24)
    feed_forward: bool = _option(False, "The ECU has a bias curve.", None, None, "--feed-forward")
    feed_forward_terms: str | None = _option(
        None, "Feed-forward that code of yours adds: friction, rate or both, as friction,rate.", "TERMS"
    )
    overshoot: float = _option(20.0, "Largest overshoot, %.", min=0.0)
    settling: str = _option("0.2s", "Longest settling time, as 0.2s.", "TIME")
    error: float = _option(0.5, "Largest steady-state error, %.", min=0.0)
    duty_activity: float = _option(5.0, "Largest standard deviation of the duty at rest, %.", min=0.0)
    rms_current: float = _option(inf, "Largest rms current, A.", None, "no limit", min=0.0)
    winding_heat: float = _option(inf, "Most heat in the winding, W.", None, "no limit", min=0.0)
    bridge_heat: float = _option(inf, "Most heat in the bridge, W.", None, "no limit", min=0.0)
    log: Path | None = _option(
        None, "A log from the car: its setpoint is one scenario more.", exists=True, dir_okay=False
    )
    parts: Path | None = _option(
        None, "Run folder of `etcfit fleet`: gains for parts like its units.", "RUN", exists=True, file_okay=False
    )
    anyway: bool = _ANYWAY
    fleet: bool = _option(False, "RUN is of `etcfit fleet`: gains for 99 % of its units.", None, None, "--fleet")


@_verb("Control", "etcfit design runs/bench_twin --ecu rusefi --ecu-period 1ms")
def design(run: Run, options: DesignOptions, quiet: Quiet = False) -> None:
    """PID gains for the model in RUN (after a diagnosis, the final one): every rule compared, one proposed."""
    request = _design_request(options)
    with _progress(quiet) if options.fleet else _stage(run, "design", quiet) as progress:
        if options.fleet:
            done = stages.design_fleet(run, progress, request)
        else:
            done = stages.design_run(stages.opened(run), progress, request)
    _tell(done)


def _design_request(o: DesignOptions) -> DesignRequest:
    """What is asked for, in SI."""
    given = _times_of_ecu(o)
    if o.sensor_noise is not None:
        given["noise"] = _with_unit("--sensor-noise", o.sensor_noise, _RADIANS, "an angle", "0.1deg")
    if o.divides_by_battery is not None:
        given["compensated"] = float(o.divides_by_battery)
    _refuse_what_a_make_fixes(o.ecu, given)
    limits = {
        "overshoot_pct": o.overshoot,
        "settling_s": _seconds("--settling", o.settling),
        "steady_state_error_pct": o.error,
        "duty_activity_pct": o.duty_activity,
        "current_rms_A": o.rms_current,
        "winding_W": o.winding_heat,
        "bridge_W": o.bridge_heat,
    }
    if zero := [symbol for symbol, limit in limits.items() if limit == 0.0]:
        raise UsageError(f"{zero[0]}: nothing stays below 0. Ask for more than that.")
    terms = _terms(o.feed_forward, o.feed_forward_terms)
    if o.fleet and o.parts is not None:
        raise UsageError("--parts and --fleet exclude each other: with --fleet RUN itself is the fleet.")
    asked = {symbol: limit for symbol, limit in limits.items() if limit != inf}
    known = {} if o.present is None else dict(zip("PID", _three_gains(o.present), strict=True))
    known |= {} if o.swings_at is None else {"swings_at": o.swings_at}
    return DesignRequest(o.rule, o.adc_bits, terms, asked, given, o.ecu, o.log, o.parts, o.anyway, known)


_TIMES = {"period": "--ecu-period", "delay": "--ecu-delay", "lag": "--ecu-filter"}  # field of `Ecu` -> option


def _times_of_ecu(options: TuneOptions | DesignOptions) -> dict[str, float]:
    """What is given of the ECU's times, s, by field of `Ecu`."""
    texts = {each: getattr(options, option[2:].replace("-", "_"), None) for each, option in _TIMES.items()}
    given = {each: _seconds(_TIMES[each], text) for each, text in texts.items() if text is not None}
    if given.get("period") == 0.0:
        raise UsageError(f"--ecu-period {texts['period']}: the period must be longer than 0. Write, say, 1ms.")
    return given


def _refuse_what_a_make_fixes(make: str | None, given: Mapping[str, float]) -> None:
    """Refuse what is given of an ECU where the make that is named fixes it otherwise."""
    if make is None:
        return
    from .model.ecus import named

    with _of_option("--ecu"):
        clash = named(make).clashes(given)
    if clash:
        option = _TIMES | {"compensated": "--divides-by-battery"}
        raise UsageError(f"{option[clash[0]]}: {make} fixes it. Leave it out.")


@contextmanager
def _of_option(option: str) -> Iterator[None]:
    """A usage error is told with the option that it came by."""
    try:
        yield
    except UsageError as err:
        raise UsageError(f"{option} {err}") from None


def _terms(spring: bool, others: str | None) -> bool | str:
    """What is asked for ahead of the PID: the spring's table alone, or names between commas."""
    if others is None:
        return spring
    from .model.feed_forward import terms_of

    with _of_option("--feed-forward-terms"):
        terms_of(others)
    return f"spring,{others}" if spring else others


_SECONDS = {"us": 1e-6, "ms": 1e-3, "s": 1.0}
_BYTES = {"kB": 1e3, "MB": 1e6, "GB": 1e9}
_RADIANS = {"deg": pi / 180.0, "rad": 1.0}


def _seconds(option: str, text: str) -> float:
    """A time with its unit, s."""
    return _with_unit(option, text, _SECONDS, "a time", "1ms")


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
        raise UsageError(f"{option} {text}: {what} cannot be negative or endless. Write, say, {example}.")
    return value


@_verb("Many units", "etcfit fleet line_4 --out runs/line_4 --workers 4")
def fleet(
    what: Annotated[
        list[str], typer.Argument(help="A folder of units, or an address (s3://...); or: report RUN.", metavar="FLEET")
    ],
    out: Annotated[Path | None, typer.Option("--out", help="The run folder.", file_okay=False, metavar="RUN")] = None,
    workers: Annotated[
        int | None, typer.Option(help="Processes on this machine.", min=1, max=1024, show_default="one a core")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(help="Of Dask, that is there already, as tcp://host:8786.", metavar="ADDRESS")
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Many units of one design, FLEET/<unit>/ each a measurement folder: what they are, how they differ, which is odd.

    `etcfit fleet report RUN` makes the page once more.
    """
    match what, out:
        case ["report", run], None:
            with _progress(quiet) as progress:
                done = stages.fleet_report(Path(run), progress)
            return _tell(done)
        case [_], None:
            raise UsageError("--out RUN is missing: the run folder to write.")
        case [location], Path():
            if workers is not None and scheduler is not None:
                raise UsageError("--workers and --scheduler exclude each other: the scheduler has its own workers.")
        case _:
            raise UsageError("Write `etcfit fleet FLEET --out RUN`, or `etcfit fleet report RUN`.")
    from .api.progress import silent

    with _progress(quiet) as progress:
        done = stages.fleet(location, out, workers, scheduler, progress, silent if quiet else _watched)
    _tell(done)


def _watched(address: str, share: float) -> None:
    _stderr().print(f"workers: {address}", markup=False)


@dataclass(frozen=True)
class ExportOptions:
    """Options of `etcfit export`."""

    to: str = _option(..., "c, fmu, msq, mat, m, python, mujoco, mujoco-position or isaac.", "FORMAT")
    out: Path | None = _option(None, "Where; RUN/export if not given.", "DIR", file_okay=False)
    step: str | None = _option(None, "Of the plant in C and FMU.", "TIME", "0.5ms")
    at: float = _option(25.0, "Of a transfer function, % of the travel.", min=0.0, max=100.0)
    into: Path | None = _option(
        None, "Your own tune, for msq: a copy of it is changed.", "FILE", exists=True, dir_okay=False
    )
    anyway: bool = _ANYWAY


@_verb("Share", "etcfit export runs/bench_twin --to c --out firmware")
def export(run: Run, options: ExportOptions, quiet: Quiet = False) -> None:
    """The model in RUN (after a diagnosis, the final one) for another program; says what that format cannot hold."""
    o, seconds = options, None if options.step is None else _seconds("--step", options.step)
    with _progress(quiet) as progress:
        done = stages.export_run(stages.opened(run, o.out), progress, o.to, o.out, seconds, o.at / 100.0, o.into,
                                 o.anyway)  # fmt: skip
    _tell(done)


@dataclass(frozen=True)
class PlanOptions:
    """Options of `etcfit plan`."""

    out: Path = _option(..., "The folder to write.", "PLAN", None, "--out", file_okay=False)
    tests: int = _option(CampaignSettings.tests, "How many, at most.", min=1, max=50)
    current: float = _option(CampaignSettings.current, "Limit of the winding's current, A.")
    temperature: float = _option(CampaignSettings.temperature, "Limit of the winding's temperature, degC.")
    supply: float | None = _option(None, "V.", None, "that of the rig", min=0.1)
    criterion: str = _option("A", "To become small: A, the sum of relative variances, or D, their geometric mean.")
    without: list[str] | None = _option(None, "A rig test that you cannot make; may be repeated.", "TEST")


@_verb("Measure", "etcfit plan runs/bench_twin --out plans/next --current 4")
def plan(
    source: Annotated[
        Path,
        typer.Argument(
            help="A run folder, or a measurement folder.", exists=True, file_okay=False, metavar="RUN|FOLDER"
        ),
    ],
    options: PlanOptions,
    quiet: Quiet = False,
) -> None:
    """The next tests as files to play within limits, chosen for what they tell, with a procedure sheet."""
    from .datasets.base import refuse_to_overwrite

    o = options
    refuse_to_overwrite(o.out)
    try:
        settings = CampaignSettings(tests=o.tests, current=o.current, temperature=o.temperature)
    except ValueError as error:
        raise UsageError(str(error)) from None
    with _usual("plan", quiet) as report:
        report("loading the model", 0.0)
        keep_compiled()
        from .api.verbs import plan as plan_tests

        chosen = plan_tests(source, settings, criterion=o.criterion, without=o.without or (), supply=o.supply,
                            quiet=True)  # fmt: skip
        report("drawing", 0.8)
        chosen.save(o.out)
        from .reporting.closing import of_plan
        from .reporting.plan_sheet import plan_table
    _stdout().print(plan_table(chosen.campaign))
    _say(of_plan(chosen.campaign, o.out))


@_verb("Measure", "etcfit fetch kassel-throttle")
def fetch(
    name: Annotated[str, typer.Argument(help="kassel-throttle, wintec-throttle, emps or bam-xl330.", metavar="NAME")],
    to: Annotated[Path | None, typer.Option(help="Where; measurements/NAME if not given.", metavar="FOLDER")] = None,
    data: Annotated[Path | None, typer.Option(help="Folder of local copies.", exists=True, file_okay=False)] = None,
    quiet: Quiet = False,
) -> None:
    """A public measured data set as a measurement folder; local copies (also $ETCFIT_DATA) before a download."""
    with _progress(quiet) as report:
        report(f"fetching {name}", 0.0)
        from .datasets import fetch as fetch_dataset
        from .reporting.closing import of_fetched

        folder = fetch_dataset(name, to or Path("measurements") / name, data)
    _say(of_fetched(name, folder))


@_verb("Measure", "etcfit new my_rig --like bosch-0280750148")
def new(
    folder: Annotated[Path, typer.Argument(help="The folder to make.", file_okay=False, metavar="FOLDER")],
    like: Annotated[
        str | None, typer.Option(help="A known nameplate: bosch-0280750148 or kassel.", metavar="NAME")
    ] = None,
    quiet: Quiet = False,
) -> None:
    """A rig.toml with every key explained, and a folder for each rig test that says what to record."""
    del quiet  # it shows no progress; scripts give every command the same options
    from .importing.new import new_folder
    from .reporting.closing import of_new

    _say(of_new(new_folder(folder, like)))


@dataclass(frozen=True)
class ImportOptions:
    """Options of `etcfit import`."""

    to: Path = _option(..., "The measurement folder to write.", "FOLDER", file_okay=False)
    yes: bool = _option(False, "Take every guess.", None, None, "--yes", "-y")
    column: list[str] | None = _option(None, "[FILE:]HEADER=QUANTITY [UNIT], or =ignore; may be repeated.", "TEXT")
    test: list[str] | None = _option(None, "FILE=TEST, its rig test; may be repeated.", "TEXT")
    period: str | None = _option(None, "Between samples, for files without a time, as 1ms.", "TIME")
    rig: Path | None = _option(None, "A rig.toml to take over, as `etcfit new` makes one.", "RIG.TOML", dir_okay=False)
    motor: str | None = _option(None, "The motor to take, of files that have several.", "NAME")
    servo: str | None = _option(
        None,
        "The columns are registers of: feetech-sts, feetech-scs, dynamixel-xm, dynamixel-xl330, dynamixel-ax.",
        "NAME",
    )
    limit: str = _option("256MB", "Of one recording's numbers in memory; larger ones are refused.", "SIZE")


@_verb("Measure", "etcfit import recordings/* --to measurements/mine --rig my_rig/rig.toml", name="import")
def import_(
    files: Annotated[
        list[Path], typer.Argument(help="Recordings of any format; a DBC for bus logs.", metavar="FILE...")
    ],
    options: ImportOptions,
    quiet: Quiet = False,
) -> None:
    """Foreign recordings as a measurement folder: columns, units, signs and rig tests guessed, with reasons."""
    from .importing import import_files
    from .importing.answers import accept_all, parsed, refuse
    from .reporting.closing import of_imported

    o = options
    seconds = None if o.period is None else _seconds("--period", o.period)
    answers = parsed(o.column or (), o.test or (), [str(file) for file in files], seconds)
    most = int(_with_unit("--limit", o.limit, _BYTES, "a size", "2GB"))
    resolve = accept_all if o.yes else _asked if sys.stdin.isatty() and sys.stderr.isatty() else refuse
    with _progress(quiet or resolve is _asked) as report:
        done = import_files(files, o.to, answers, resolve, rig=o.rig, most=most, motor=o.motor, servo=o.servo,
                            report=report)  # fmt: skip
    for file, source, reason in done.traces:
        _say(f"{done.folder}/{file}  from {source}: {reason}")
    for warning in done.warnings:
        _stderr().print(warning, markup=False)
    _say(of_imported(done))


def _asked(doubts: Sequence[Any], answers: Any) -> Any:
    """The guesses in doubt, one by one: Enter takes the guess, anything else is the answer."""
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


# glibc by itself: a heap for each thread, and freed arrays of up to 32 MB kept in the holes that they leave
_HEAPS = {-8: ("MALLOC_ARENA_MAX", 2), -3: ("MALLOC_MMAP_THRESHOLD_", 1 << 20), -1: ("MALLOC_TRIM_THRESHOLD_", 1 << 25)}


def _give_memory_back() -> None:
    """Have the C library give freed arrays back: 1.2 GB of a diagnosis' 2.8 were free. What the user has set stands."""
    if sys.platform == "linux":
        with suppress(AttributeError):  # another library than glibc
            tell = ctypes.CDLL(None).mallopt
            for number, (name, value) in _HEAPS.items():
                if name not in os.environ:
                    tell(number, value)


def main() -> None:
    """The console script."""
    _give_memory_back()
    gc.set_threshold(100_000, 50, 50)  # tracing a model makes many objects and no garbage: 1.5 s of a fit
    try:
        app()
    except KeyboardInterrupt:  # outside any command: while arguments are parsed or typer closes down
        sys.exit(Status.INTERRUPTED)


if __name__ == "__main__":
    main()
