"""The command line keeps its contract: exit statuses, and results alone on stdout."""

from __future__ import annotations

import inspect
import json
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast, get_args, get_type_hints

import numpy as np
import pytest
from typer.main import get_command
from typer.testing import CliRunner, Result

import campaigns
import diagnoses
import etcfit
import results
import runs
from equality import equal
from etcfit.cli import app
from etcfit.control.request import DesignRequest
from etcfit.errors import MeasurementError, UsageError
from etcfit.experiment.advice import Advice, Option
from etcfit.experiment.campaign import Campaign
from etcfit.experiment.settings import AdviceSettings
from etcfit.files import plain
from etcfit.reporting.closing import Closing
from etcfit.rig.base import Rig
from etcfit.run_folder.folder import RunFolder
from etcfit.run_folder.state import save_diagnosis, save_fit
from etcfit.stages import Done, stages_until

CLOSING = "Answer: It is known.\nNext:   etcfit report bench\n"
ASKED = {
    "overshoot_pct": 20.0,
    "settling_s": 0.2,
    "steady_state_error_pct": 0.5,
    "duty_activity_pct": 5.0,
}  # of gains, where nothing else is


@pytest.fixture
def invoke(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Result]:
    """Run the command line inside tmp_path, in which a folder `bench` lies."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TERM", "dumb")
    (tmp_path / "bench").mkdir()
    return lambda *words: CliRunner().invoke(app, [str(word) for word in words])


class Stages:
    """Stands in for the stages behind the commands and notes what they are asked; `done` is what they leave."""

    def __init__(self) -> None:
        self.asked: list[tuple[Any, ...]] = []
        self.done = Done("a table", closing=Closing("It is known.", "etcfit report bench"))
        self.raises: BaseException | None = None

    def work(self, *asked: Any, **more: Any) -> Done:
        paths = tuple(each.path if isinstance(each, RunFolder) else each for each in asked)
        report = next(each for each in paths if callable(each))
        report("working", 0.5)
        if self.raises:
            raise self.raises
        self.asked.append((*(each for each in paths if each is not report), *([more] if more else [])))
        return self.done


@pytest.fixture
def stages(monkeypatch: pytest.MonkeyPatch) -> Stages:
    fake = Stages()
    works = ("fit_folder", "diagnose_run", "sample_run", "reduce_run", "design_run", "export_run", "write_report")
    for name in (*works, "write_interactive"):
        monkeypatch.setattr(f"etcfit.stages.{name}", fake.work)
    return fake


COMMANDS = {
    "fit": (("fit", "bench", "--out", "runs/a"), (Path("bench"), Path("runs/a"))),
    "diagnose": (("diagnose", "bench"), (Path("bench"),)),
    "sample": (("sample", "bench", "--steps", "700"), (Path("bench"), 700)),
    "reduce": (("reduce", "bench", "--output", "deg", "--at", "30", "--pade", "2"),
               (Path("bench"), "V", "deg", 0.3, 2)),
    "design": (("design", "bench", "--rule", "simc"), (Path("bench"), DesignRequest("simc", limits=ASKED))),
    "export": (("export", "bench", "--to", "c", "--step", "1ms", "--at", "30"),
               (Path("bench"), "c", None, 1e-3, 0.3, None, False)),
    "report": (("report", "bench"), (Path("bench"),)),
    "report --interactive": (("report", "bench", "--interactive"), (Path("bench"),)),
}  # fmt: skip


@pytest.mark.parametrize(("words", "asked"), COMMANDS.values(), ids=COMMANDS)
def test_a_command_is_one_call_and_its_table(
    invoke, stages: Stages, words: tuple[str, ...], asked: tuple[Any, ...]
) -> None:
    done = invoke(*words)
    assert (done.exit_code, done.stdout) == (0, f"a table\n{CLOSING}")
    assert "working" in done.stderr
    assert stages.asked == [asked]
    assert invoke(*words, "--quiet").stderr == ""


def test_what_an_export_cannot_hold_is_told_even_to_the_quiet(invoke, stages: Stages) -> None:
    stages.done = Done("out/plant.c", "", "No noise.\nNo [wind].")
    done = invoke("export", "bench", "--to", "c", "--out", "out", "--quiet")
    assert (done.exit_code, done.stdout, done.stderr) == (0, "out/plant.c\n", "No noise.\nNo [wind].\n")
    assert stages.asked == [(Path("bench"), "c", Path("out"), None, 0.25, None, False)]


@pytest.mark.parametrize("words", [words for words, _ in COMMANDS.values()], ids=COMMANDS)
def test_a_model_that_did_not_converge_is_shown_and_exits_3(invoke, stages: Stages, words: tuple[str, ...]) -> None:
    stages.done = Done("a table", "gradient still 12 [of tolerance]")
    done = invoke(*words, "--quiet")
    assert (done.exit_code, done.stdout) == (3, "a table\n")
    assert "gradient still 12 [of tolerance]" in done.stderr


@pytest.mark.parametrize(
    ("error", "status"),
    [
        (MeasurementError("a.csv:3", "found", "required", "mend"), 1),
        (UsageError("other"), 2),
        (OSError(28, "No space left on device", "runs"), 2),
        (KeyboardInterrupt(), 130),
    ],
)
@pytest.mark.parametrize("words", [words for words, _ in COMMANDS.values()], ids=COMMANDS)
def test_an_error_is_a_message_and_a_status(
    invoke, stages: Stages, words: tuple[str, ...], error: BaseException, status: int
) -> None:
    stages.raises = error
    done = invoke(*words, "--quiet")
    assert (done.exit_code, done.stdout) == (status, "")
    assert done.stderr.startswith("etcfit:")
    assert "Traceback" not in done.output


@pytest.fixture
def advised(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Advice without working it out; notes at which model it is asked for."""
    asked: list[Any] = []

    def advise(rig: Rig, at: Any = None) -> Advice:
        asked.append(at)
        options = (Option("viscous", "a step", "", np.array([0.5]), None, None),)
        return Advice(rig, ("R_a",), np.array([0.01]), options, ())

    monkeypatch.setattr("etcfit.experiment.advice.advise", advise)
    return asked


def test_advice_is_printed_and_written_where_it_is_asked_for(invoke, tmp_path: Path, advised: list[Any]) -> None:
    found = diagnoses.diagnosis(results.rig(tmp_path / "rig"))
    save_fit(tmp_path / "run", found.before)
    done = invoke("check", "rig", "--advise", "--quiet")
    assert (done.exit_code, done.stderr) == (0, "")
    assert "viscous" in done.stdout
    table = done.stdout.partition("Next:")[0]
    written = invoke("check", "rig", "--advise", "--at", "run", "--out", "there", "--quiet").stdout
    assert written == f"{table}Look:   there/advice.json\nNext:   etcfit plan run --out plans/run\n"
    save_diagnosis(tmp_path / "run", found)
    assert invoke("check", "rig", "--advise", "--at", "run", "--quiet").stdout.startswith(table)
    assert advised[0] is None
    assert equal(advised[1:], [found.before, found.after])  # the final model, once there is one
    advice = json.loads((tmp_path / "there" / "advice.json").read_text(encoding="utf-8"))
    assert advice["options"][0]["widths"] == {"R_a": 0.5}
    assert advice["settings"] == plain(AdviceSettings())


def test_report_prints_where_the_page_is(invoke, tmp_path: Path) -> None:
    run = runs.run_folder(tmp_path)
    done = invoke("report", run)
    assert done.exit_code == 0
    answer, look, further = done.stdout.splitlines()
    assert answer.startswith("Answer: ")
    assert look == f"Look:   {run / 'report.html'} and {run / 'pictures' / 'parameters.png'}"
    assert further.startswith("Next:   etcfit ")


@pytest.mark.slow
def test_the_page_to_work_with_is_written_beside_the_printed_one(invoke, tmp_path: Path) -> None:
    run = runs.run_folder(tmp_path)
    done = invoke("report", run, "--interactive", "--quiet")
    assert done.exit_code == 0
    assert f"Look:   {run / 'report_interactive.html'} and " in done.stdout
    assert not (run / "report.html").exists()


def test_run_goes_through_the_stages_and_says_what_was_done_before(invoke, monkeypatch: pytest.MonkeyPatch) -> None:
    def run_all(folder: Path, run: Path, progress: Any, show: Callable[..., None], stages: Any, asked: Any) -> str:
        assert (folder, run, asked) == (Path("bench"), Path("a"), {"design": {"profile": "link"}})
        ended.append([stage.name for stage in stages])
        show("fit", None)
        with progress(None) as report:
            report("finding out", 0.5)
        show("diagnose", Done("the diagnosis", remark="made anew", closing=Closing("Of one stage.", "none")))
        return "it did not converge"

    ended: list[list[str]] = []
    monkeypatch.setattr("etcfit.stages.run_all", run_all)
    monkeypatch.setattr("etcfit.stages.closing_of", lambda run: Closing("It is known.", "etcfit report bench"))
    done = invoke("run", "bench", "--out", "a", "--ecu", "link")
    assert (done.exit_code, done.stdout) == (3, f"the diagnosis\n{CLOSING}")
    assert [line.split(":")[0] for line in done.stderr.splitlines()] == ["fit", "finding out", "diagnose", "etcfit"]
    assert CLOSING in invoke("run", "bench", "--out", "a", "--ecu", "link", "--no-sample", "--quiet").stdout
    invoke("run", "bench", "--out", "a", "--ecu", "link", "--until", "diagnose")
    assert ended == [names_until("sample"), names_until("design"), ["fit", "diagnose", "report"]]


def names_until(last: str) -> list[str]:
    return [stage.name for stage in stages_until(last)]


def commands() -> dict[str, Any]:
    """Every command as click has it."""
    return cast("Any", get_command(app)).commands


def flat(text: str) -> str:
    """A text without the frames and line breaks of a terminal."""
    return " ".join(re.sub(r"[│╭╮╰╯─]", " ", text).split())


@pytest.mark.parametrize("name", list(commands()))
def test_help_is_printed_as_it_is_written(invoke, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("typer.rich_utils.MAX_WIDTH", 1000)
    source = inspect.unwrap(commands()[name].callback, stop=lambda each: hasattr(each, "__signature__"))
    written = [
        get_args(hint)[1].help for hint in get_type_hints(source, include_extras=True).values() if get_args(hint)
    ]
    shown = flat(invoke(name, "--help").stdout)
    assert written
    for text in (*written, (inspect.getdoc(source) or "").partition("\n\n")[0]):
        assert flat(text) in shown
    assert re.search(rf"Example: etcfit {name} \S", shown)


def test_markup_in_a_help_text_is_text() -> None:
    from rich.text import Text

    from etcfit.cli import literally

    for text in ("else [ecu]'s in rig.toml", "[FILE:]HEADER=QUANTITY [UNIT]", r"a \[b] c", "no brackets"):
        assert Text.from_markup(literally(text) or "").plain == text


def test_commands_stand_in_groups(invoke) -> None:
    panels = {command.rich_help_panel for command in commands().values()}
    assert panels == {"Look", "Fit", "Explain", "Control", "Share", "Many units", "Measure"}
    shown = invoke("--help").stdout
    assert all(panel in shown for panel in panels)


def test_a_limit_that_is_off_says_so_and_a_number_that_is_taken_too(invoke, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("typer.rich_utils.MAX_WIDTH", 1000)
    shown = flat(invoke("design", "--help").stdout)
    assert "inf" not in shown.split()
    assert shown.count("(no limit)") == 3
    assert "that of [ecu] in rig.toml, else 1ms" in shown


@pytest.mark.parametrize("command", list(commands()))
def test_every_example_names_options_that_there_are(command: str) -> None:
    words = shlex.split(commands()[command].epilog.replace("\\", ""))[1:]
    assert words[:2] == ["etcfit", command]
    known = {name for parameter in commands()[command].params for name in parameter.opts}
    assert {word for word in words if word.startswith("--")} <= known


@pytest.mark.parametrize(
    "words",
    [
        ("fit", "bench"),
        ("fit", "no/such/folder", "--out", "a"),
        ("check",),
        ("check", "bench", "--loud"),
        ("ponder", "bench"),
        ("diagnose",),
        ("diagnose", "no/such/run"),
        ("report", "no/such/run"),
        ("report", "bench"),
        ("run", "bench"),
        ("export", "bench"),
        ("export", "bench", "--to", "simulink"),
        ("fetch", "no-such-set"),
        ("fetch", "emps", "--data", "no/such/folder"),
    ],
)
def test_usage_errors_exit_2(invoke, words: tuple[str, ...]) -> None:
    done = invoke(*words)
    assert done.exit_code == 2
    assert "Traceback" not in done.output
    assert done.stdout == ""
    assert done.stderr


REFUSED = {
    **{f"{name} bench": "holds no finished `etcfit fit`" for name in ("diagnose", "sample", "reduce", "design")},
    "check bench --at bench": "--at goes with --advise",
    "check bench --out bench": "--out goes with --advise",
    "run bench --out a --until report": "--until there is no stage report to end with. There are fit, diagnose,",
    "run bench --out a --no-sample --until sample": "--no-sample and --until sample exclude each other",
    "run bench --out a --ecu TeslaLike": "--ecu teslalike: no such engine computer. Known: ",
    "export bench --to c --step 1s": "step = 1.0: it must be",
    "design bench --parts bench --fleet": "--parts and --fleet exclude each other",
    "design bench --parts nowhere": "nowhere",
    "design bench --present 60,80": "--present 60,80: three numbers between commas are required",
    "design bench --ecu rusefi --divides-by-battery": "--divides-by-battery: rusefi fixes it",
    "design bench --ecu rusefi --ecu-period 1ms": "--ecu-period: rusefi",
    "tune bench/lap.csv --ecu Motronic --out a": "--ecu motronic: no such engine computer. Known: ",
    "design bench --ecu motronic": "--ecu motronic: no such engine computer. Known: rusefi, fome,",
    "design bench --feed-forward-terms friction,speed":
        "--feed-forward-terms speed: no such term of feed-forward. Known: spring, friction, rate.",
    "design bench --sensor-noise 0.1": "an angle needs a number and a unit, deg or rad",
    "design bench --ecu-period 0ms": "longer than 0",
    "design bench --winding-heat 0": "winding_W: no loop stays below 0",
}  # fmt: skip


@pytest.mark.parametrize(("words", "said"), REFUSED.items(), ids=REFUSED)
def test_what_cannot_be_is_a_usage_error_in_words_before_any_work(
    invoke, tmp_path: Path, words: str, said: str
) -> None:
    done = invoke(*words.split(), "--quiet")
    assert (done.exit_code, done.stdout) == (2, "")
    assert said in flat(done.stderr)
    assert [path.name for path in tmp_path.iterdir()] == ["bench"]


def test_fetch_writes_below_measurements_and_prints_where(invoke, measured: Path) -> None:
    done = invoke("fetch", "kassel-throttle", "--data", measured, "--quiet")
    assert (done.exit_code, done.stderr) == (0, "")
    assert done.stdout.splitlines()[1:] == [
        "Look:   measurements/kassel-throttle/README.md",
        "Next:   etcfit check measurements/kassel-throttle",
    ]
    assert Path("measurements/kassel-throttle/rig.toml").is_file()


@pytest.mark.parametrize(
    "words",
    [
        "fit bench --out file/x",
        "run bench --out file/x",
        "export bench --to c --out file/x",
        "check bench --advise --out file/x",
        "drive bench --out file/x",
        "plan bench --out file/x",
        "import no.csv --to file/x",
        "fetch emps --to file/x",
    ],
)
def test_a_folder_that_cannot_be_written_is_refused_before_any_work(invoke, tmp_path: Path, words: str) -> None:
    (tmp_path / "file").touch()
    done = invoke(*words.split(), "--quiet")  # there is nothing in bench: whatever looks into it says so
    assert (done.exit_code, done.stdout) == (2, "")
    assert done.stderr.strip() == "etcfit: file/x: Not a directory"


def test_an_fmu_without_a_compiler_is_refused_before_the_model_is_loaded(invoke, monkeypatch) -> None:
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CC", raising=False)
    done = invoke("export", "bench", "--to", "fmu", "--quiet")  # in which there is no model
    assert done.exit_code == 2
    assert "no C compiler is found" in done.stderr
    assert "--to c" in done.stderr


def test_version(invoke) -> None:
    assert invoke("--version").stdout == f"etcfit {etcfit.__version__}\n"


def test_python_runs_the_package_as_a_program() -> None:
    done = subprocess.run([sys.executable, "-m", "etcfit", "--version"], capture_output=True, text=True, check=True)
    assert done.stdout == f"etcfit {etcfit.__version__}\n"


@pytest.mark.parametrize(
    ("option", "shown", "needed"), [("--help", "fetch", {"rich"}), ("--version", etcfit.__version__, set())]
)
def test_help_and_version_need_nothing_heavy(option: str, shown: str, needed: set[str]) -> None:
    # what makes them answer at once: none of these is imported
    heavy = {"jax", "numpy", "scipy", "pandas", "matplotlib", "pint", "equinox", "pooch", "rich"} - needed
    program = f"""
import sys
from etcfit.cli import main
sys.argv = ["etcfit", "{option}"]
try:
    main()
finally:
    print({heavy} & set(sys.modules), file=sys.stderr)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0
    assert shown in done.stdout
    assert done.stderr.strip() == "set()"


PASSED_ON = {
    "--parts bench": {"parts": Path("bench")},
    "": {"ecu": {}, "profile": None, "feed_forward": False, "limits": ASKED},
    "--ecu-period 2ms": {"ecu": {"period": 2e-3}, "profile": None},
    "--ecu-delay 0ms --ecu-period 5ms": {"ecu": {"period": 5e-3, "delay": 0.0}},
    "--ecu rusefi --ecu-delay 1ms": {"ecu": {"delay": 1e-3}, "profile": "rusefi"},
    "--ecu-filter 1ms --sensor-noise 0.1deg": {"ecu": {"lag": 1e-3, "noise": np.radians(0.1)}},
    "--ecu link --ecu-period 1ms": {"ecu": {"period": 1e-3}, "profile": "link"},
    "--feed-forward": {"feed_forward": True},
    "--feed-forward-terms friction": {"feed_forward": "friction"},
    "--feed-forward --feed-forward-terms friction,rate": {"feed_forward": "spring,friction,rate"},
    "--ecu maxxecu --present '60, 80,120' --swings-at 120":
        {"present": {"P": 60.0, "I": 80.0, "D": 120.0, "swings_at": 120.0}, "ecu": {}},
    "--ecu motec --divides-by-battery": {"present": {}, "ecu": {"compensated": 1.0}},
    "--no-divides-by-battery": {"present": {}, "ecu": {"compensated": 0.0}},
    "--duty-activity 3 --rms-current 2.5": {"limits": ASKED | {"duty_activity_pct": 3.0, "current_rms_A": 2.5}},
}  # fmt: skip


@pytest.mark.parametrize(("words", "given"), PASSED_ON.items(), ids=[words or "nothing" for words in PASSED_ON])
def test_design_passes_on_what_is_given_and_no_more(
    invoke, monkeypatch: pytest.MonkeyPatch, words: str, given: dict[str, Any]
) -> None:
    asked: list[DesignRequest] = []
    monkeypatch.setattr("etcfit.stages.design_run", lambda *all_: asked.append(all_[2]) or Done("done"))
    assert invoke("design", "bench", "--quiet", *shlex.split(words)).exit_code == 0
    (request,) = asked
    assert {name: getattr(request, name) for name in given} == given


@pytest.mark.slow
def test_plan_writes_the_files_and_prints_where_the_sheet_is(
    invoke, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Any] = []

    def plan_campaign(rig: Rig, at: Any = None, settings: Any = None, **given: Any) -> Campaign:
        asked.append((at, settings, given))
        return campaigns.campaign(rig, settings)

    monkeypatch.setattr("etcfit.experiment.campaign.plan_campaign", plan_campaign)
    results.rig(tmp_path / "rig")
    words = ("--tests", "3", "--current", "4.5", "--without", "viscous", "--criterion", "D", "--quiet")
    done = invoke("plan", "rig", "--out", "next", *words)
    assert (done.exit_code, done.stderr) == (0, "")
    assert "response/plan_1.csv" in done.stdout
    assert done.stdout.splitlines()[-2] == f"Look:   {Path('next') / 'procedure.html'}"
    assert (tmp_path / "next" / "procedure.html").is_file()
    ((at, settings, given),) = asked
    assert at is None
    assert (settings.tests, settings.current) == (3, 4.5)
    assert given == {"criterion": "D", "without": ["viscous"], "supply": None}
    assert json.loads((tmp_path / "next" / "plan.json").read_text(encoding="utf-8"))["synthetic"]

    found = diagnoses.diagnosis(results.rig(tmp_path / "fitted"))
    save_fit(tmp_path / "run", found.before)
    assert invoke("plan", "run", "--out", "after", "--quiet").exit_code == 0
    assert equal(asked[1][0], found.before)


def test_plan_refuses_before_it_works_anything_out(invoke, tmp_path: Path) -> None:
    results.rig(tmp_path / "rig")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "record.csv").touch()
    for words, said in (
        (("--out", "full"), "already there and not an empty folder"),
        (("--out", "next", "--criterion", "E"), "there is no criterion E. There are A, D."),
        (("--out", "next", "--current", "-1"), "CampaignSettings.current = -1.0"),
        (("--out", "next", "--without", "windmill"), "there is no rig test windmill."),
    ):
        done = invoke("plan", "rig", *words, "--quiet")
        assert done.exit_code == 2
        assert said in " ".join(done.stderr.split())
    assert not (tmp_path / "next").exists()


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux's C library is told so")
def test_freed_arrays_are_given_back() -> None:
    """A worker's thread frees most of what it made; what it still has lies between."""
    program = """
import threading
from etcfit.cli import _give_memory_back
_give_memory_back()
import numpy as np

def resident():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * 4096 / 2**20

def work():
    for k in range(1, 5):
        np.ones(k << 18)
    arrays = [np.ones(1 << 18) for _ in range(128)]
    most.append(resident())
    held.extend(arrays[::16])

most, held = [resident()], []
thread = threading.Thread(target=work)
thread.start()
thread.join()
print(*most, resident())
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    before, most, after = map(float, done.stdout.split())
    assert after - before < 0.2 * (most - before)


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux lists the threads of a process so")
@pytest.mark.parametrize(("given", "threads"), [({}, "1"), ({"OPENBLAS_NUM_THREADS": "2"}, "2")])
def test_a_product_has_one_thread_unless_the_user_wants_more(given: dict[str, str], threads: str) -> None:
    program = """
import os
from etcfit.cli import _one_thread_a_product
_one_thread_a_product()
import numpy as np
x = np.ones((2000, 500))
x.T @ x
print(os.environ["OPENBLAS_NUM_THREADS"], len(os.listdir("/proc/self/task")))
"""
    bare = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, env=bare | given)
    told, running = done.stdout.split()
    assert told == threads
    assert int(running) <= int(threads)
