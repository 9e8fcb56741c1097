"""The command line keeps its contract: exit statuses, and results alone on stdout."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
from typer.testing import CliRunner, Result

import etcfit
import runs
from etcfit.cli import app
from etcfit.errors import MeasurementError, UsageError
from etcfit.stages import Done

RIG = SimpleNamespace(folder="bench")


@pytest.fixture
def invoke(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Result]:
    """Run the command line inside tmp_path, in which a folder `bench` lies."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TERM", "dumb")
    (tmp_path / "bench").mkdir()
    return lambda *words: CliRunner().invoke(app, [str(word) for word in words])


class Library:
    """Stands in for the modules behind the commands and notes what they are asked."""

    def __init__(self) -> None:
        self.written: list[tuple[Path, Any]] = []
        self.result = SimpleNamespace(converged=True, reason="gradient below tolerance")
        self.raises: BaseException | None = None

    def read_folder(self, folder: Path) -> SimpleNamespace:
        if self.raises:
            raise self.raises
        assert folder == Path("bench")
        return RIG

    def fit(self, rig: SimpleNamespace, report: Callable[[str, float], None]) -> SimpleNamespace:
        assert rig is RIG
        report("fitting", 0.5)
        return self.result

    def write_run(self, run: Path, result: SimpleNamespace, report: Callable[[str, float], None]) -> None:
        self.written.append((run, result))


def _module(name: str, **names: Any) -> ModuleType:
    module = ModuleType(name)
    vars(module).update(names)
    return module


@pytest.fixture
def library(monkeypatch: pytest.MonkeyPatch) -> Library:
    fake = Library()
    modules = {
        "etcfit.rig.reader": {"read_folder": fake.read_folder},
        "etcfit.experiment.check": {"check": lambda rig: SimpleNamespace(why_not="")},
        "etcfit.estimation.joint_fit": {"fit": fake.fit},
        "etcfit.reporting": {"write_run": fake.write_run},
        "etcfit.reporting.tables": {
            "fit_table": lambda result: "the fit's table",
            "check_table": lambda result: "what it can identify",
        },
    }
    for name, names in modules.items():
        monkeypatch.setitem(sys.modules, name, _module(name, **names))
    return fake


def test_check_prints_its_verdict(invoke, library: Library) -> None:
    done = invoke("check", "bench")
    assert (done.exit_code, done.stdout) == (0, "what it can identify\n")


def test_fit_writes_the_run_and_prints_its_table(invoke, library: Library) -> None:
    done = invoke("fit", "bench", "--out", "runs/a")
    assert (done.exit_code, done.stdout) == (0, "the fit's table\n")
    assert "fitting" in done.stderr
    assert library.written == [(Path("runs/a"), library.result)]


def test_report_prints_where_the_page_is(invoke, tmp_path: Path) -> None:
    run = runs.run_folder(tmp_path)
    done = invoke("report", run)
    assert (done.exit_code, done.stdout) == (0, f"{run / 'report.html'}\n")


def test_run_goes_through_the_stages_and_says_what_was_done_before(invoke, monkeypatch: pytest.MonkeyPatch) -> None:
    def run_all(folder: Path, run: Path, progress: Any, show: Callable[..., None]) -> str:
        assert (folder, run) == (Path("bench"), Path("a"))
        show("fit", None)
        with progress() as report:
            report("finding out", 0.5)
        show("diagnose", Done("the diagnosis"))
        return "it did not converge"

    monkeypatch.setattr("etcfit.stages.run_all", run_all)
    done = invoke("run", "bench", "--out", "a")
    assert (done.exit_code, done.stdout) == (3, "the diagnosis\n")
    assert [line.split(":")[0] for line in done.stderr.splitlines()] == ["fit", "finding out", "etcfit"]


def test_quiet_silences_progress(invoke, library: Library) -> None:
    done = invoke("fit", "bench", "--out", "a", "--quiet")
    assert (done.exit_code, done.stdout, done.stderr) == (0, "the fit's table\n", "")


def test_a_fit_that_did_not_converge_writes_says_why_and_exits_3(invoke, library: Library) -> None:
    library.result = SimpleNamespace(converged=False, reason="gradient still 12 [of tolerance]")
    done = invoke("fit", "bench", "--out", "a")
    assert done.exit_code == 3
    assert done.stdout == "the fit's table\n"
    assert "gradient still 12 [of tolerance]" in done.stderr
    assert library.written


@pytest.fixture
def sampler(library: Library, monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """Stands in for what `sample` asks; `asked` holds the fit, the folder, the steps and the inexact formulas."""
    convergence = SimpleNamespace(converged=True, reason="60 tau long")
    fake = SimpleNamespace(convergence=convergence, asked=None)
    state = SimpleNamespace(far=False, formulas=("backlash",))

    def sample(
        fit: Any, run: Path, steps: int, report: Callable[[str, float], None], exact: tuple[str, ...]
    ) -> SimpleNamespace:
        fake.asked = fit, run, steps, exact
        return fake

    modules = {
        "etcfit.run_folder": {"final_state": lambda run: state, "final_rig": lambda state: (RIG, "x")},
        "etcfit.estimation.joint_fit": {"resume": lambda rig, x, far, report: (rig, x, far)},
        "etcfit.posterior": {"sample": sample},
        "etcfit.posterior.profile": {"profiles": lambda posterior, report: {}},
        "etcfit.reporting": {"write_posterior": lambda run, posterior, *_: library.written.append((run, posterior))},
        "etcfit.reporting.posterior.table": {"posterior_table": lambda posterior, profiled: "the posterior's table"},
    }
    for name, names in modules.items():
        monkeypatch.setitem(sys.modules, name, _module(name, **names))
    return fake


def test_sample_writes_the_posterior_and_prints_its_table(invoke, library: Library, sampler: SimpleNamespace) -> None:
    done = invoke("sample", "bench", "--steps", "700")
    assert (done.exit_code, done.stdout) == (0, "the posterior's table\n")
    assert sampler.asked == ((RIG, "x", False), Path("bench"), 700, ("backlash",))
    assert library.written == [(Path("bench"), sampler)]


def test_a_chain_that_is_too_short_is_written_says_so_and_exits_3(
    invoke, library: Library, sampler: SimpleNamespace
) -> None:
    sampler.convergence = SimpleNamespace(converged=False, reason="About 900 more steps are needed.")
    done = invoke("sample", "bench")
    assert (done.exit_code, done.stdout) == (3, "the posterior's table\n")
    assert "no posterior yet: About 900 more steps are needed." in done.stderr
    assert library.written


@pytest.mark.parametrize("command", [("check", "bench"), ("fit", "bench", "--out", "a")])
@pytest.mark.parametrize(
    ("error", "status", "message"),
    [
        (MeasurementError("response/3.csv:118", "time falls.", "It must rise.", "Sort the log."), 1, "3.csv:118: time"),
        (UsageError("no such thing"), 2, "no such thing"),
        (PermissionError(13, "Permission denied", "runs/a"), 2, "runs/a: Permission denied"),
        (KeyboardInterrupt(), 130, "interrupted"),
    ],
    ids=["data", "usage", "disk", "interrupt"],
)
def test_an_error_is_a_message_and_a_status(
    invoke, library: Library, command: tuple[str, ...], error: BaseException, status: int, message: str
) -> None:
    library.raises = error
    done = invoke(*command, "--quiet")
    assert done.exit_code == status
    assert message in done.stderr
    assert "Traceback" not in done.output
    assert done.stdout == ""
    assert library.written == []


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


def test_fetch_refuses_to_overwrite(invoke) -> None:
    Path("bench/mine.txt").write_text("precious")
    done = invoke("fetch", "emps", "--to", "bench")
    assert done.exit_code == 2
    assert "bench is already there" in done.stderr


def test_fetch_writes_below_measurements_and_prints_where(invoke, measured: Path) -> None:
    done = invoke("fetch", "kassel-throttle", "--data", measured, "--quiet")
    assert (done.exit_code, done.stdout, done.stderr) == (0, f"{Path('measurements/kassel-throttle')}\n", "")
    assert Path("measurements/kassel-throttle/rig.toml").is_file()


@pytest.fixture
def diagnosed(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """Stands in for the modules behind `diagnose`: a fit in RUN that is taken up, diagnosed and written."""
    state = SimpleNamespace(x=[1.0], far=True)
    diagnosis = SimpleNamespace(after=SimpleNamespace(converged=True, reason="gradient zero"))
    fake = SimpleNamespace(diagnosis=diagnosis, written=[], raises=None)

    def read_state(run: Path) -> SimpleNamespace:
        if fake.raises:
            raise fake.raises
        return state

    def resume(rig: Any, x: list[float], far: bool, report: Callable[[str, float], None]) -> str:
        assert (rig, x, far) == (RIG, state.x, True)
        return "the fit"

    def diagnose(result: str, report: Callable[[str, float], None]) -> SimpleNamespace:
        assert result == "the fit"
        report("screening", 0.5)
        return diagnosis

    modules = {
        "etcfit.run_folder": {"read_state": read_state, "rig_of": lambda state: RIG},
        "etcfit.estimation.joint_fit": {"resume": resume},
        "etcfit.diagnosis": {"diagnose": diagnose},
        "etcfit.reporting": {"write_diagnosis": lambda run, d, report: fake.written.append((run, d))},
        "etcfit.reporting.diagnosis.table": {"diagnosis_table": lambda d: "the ledger"},
    }
    for name, names in modules.items():
        monkeypatch.setitem(sys.modules, name, _module(name, **names))
    return fake


def test_diagnose_writes_and_prints_the_ledger(invoke, diagnosed: SimpleNamespace) -> None:
    done = invoke("diagnose", "bench")
    assert (done.exit_code, done.stdout) == (0, "the ledger\n")
    assert "screening" in done.stderr
    assert diagnosed.written == [(Path("bench"), diagnosed.diagnosis)]
    assert invoke("diagnose", "bench", "--quiet").stderr == ""


def test_a_diagnosis_whose_final_fit_did_not_converge_exits_3(invoke, diagnosed: SimpleNamespace) -> None:
    diagnosed.diagnosis.after = SimpleNamespace(converged=False, reason="gradient still 12 [of tolerance]")
    done = invoke("diagnose", "bench", "--quiet")
    assert (done.exit_code, done.stdout) == (3, "the ledger\n")
    assert "gradient still 12 [of tolerance]" in done.stderr
    assert diagnosed.written


@pytest.mark.parametrize(
    ("error", "status"),
    [
        (MeasurementError("a.csv:3", "found", "required", "mend"), 1),
        (UsageError("other"), 2),
        (KeyboardInterrupt(), 130),
    ],
)
def test_a_diagnosis_that_fails_writes_nothing(
    invoke, diagnosed: SimpleNamespace, error: BaseException, status: int
) -> None:
    diagnosed.raises = error
    done = invoke("diagnose", "bench", "--quiet")
    assert (done.exit_code, done.stdout, diagnosed.written) == (status, "", [])
    assert "Traceback" not in done.output


def test_diagnose_without_a_fit_is_a_usage_error(invoke) -> None:
    done = invoke("diagnose", "bench", "--quiet")
    assert (done.exit_code, done.stdout) == (2, "")
    assert "holds no fit" in done.stderr
    assert "etcfit fit" in done.stderr


def test_version(invoke) -> None:
    assert invoke("--version").stdout == f"etcfit {etcfit.__version__}\n"


def test_help_needs_nothing_heavy() -> None:
    # what makes it answer at once: none of these is imported
    program = """
import sys
from etcfit.cli import main
sys.argv = ["etcfit", "--help"]
try:
    main()
finally:
    heavy = {"jax", "numpy", "scipy", "pandas", "matplotlib", "pint", "equinox", "pooch"} & set(sys.modules)
    print(heavy, file=sys.stderr)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0
    assert "fetch" in done.stdout
    assert done.stderr.strip() == "set()"


@pytest.mark.parametrize("command", ["reduce", "design"])
def test_reduce_and_design_without_a_fit_are_usage_errors(invoke, command: str) -> None:
    done = invoke(command, "bench", "--quiet")
    assert (done.exit_code, done.stdout) == (2, "")
    assert "holds no fit" in done.stderr


@pytest.mark.parametrize(
    ("words", "given"),
    [((), {}), (("--ecu-period", "2ms"), {"period": 2e-3}),
     (("--ecu-delay", "0ms", "--ecu-period", "5ms"), {"period": 5e-3, "delay": 0.0})],
)  # fmt: skip
def test_design_passes_on_what_is_given_of_the_ecu_and_no_more(
    invoke, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], given: dict[str, float]
) -> None:
    asked: list[dict[str, float]] = []
    monkeypatch.setattr("etcfit.stages.design_run", lambda *_, **ecu: asked.append(ecu) or Done("done"))
    assert invoke("design", "bench", "--quiet", *words).exit_code == 0
    assert asked == [given]


def test_an_ecu_without_a_clock_is_a_usage_error(invoke) -> None:
    done = invoke("design", "bench", "--ecu-period", "0ms", "--quiet")
    assert done.exit_code == 2
    assert "longer than 0" in done.stderr


@pytest.mark.slow
def test_reduce_writes_the_transfer_function_and_prints_it(tmp_path: Path, invoke) -> None:
    run = Path(__file__).parents[1] / "notebooks" / "bench_twin_run" / "fit_state.npz"
    shutil.copytree(run.parents[2] / "measurements" / "bench_twin", "measurements/bench_twin")
    Path("notebooks/run").mkdir(parents=True)
    shutil.copy(run, "notebooks/run")
    done = invoke("reduce", "notebooks/run", "--output", "deg", "--pade", "2", "--quiet")
    assert (done.exit_code, done.stderr) == (0, "")
    assert "SYNTHETIC DATA" in done.stdout
    found = json.loads(Path("notebooks/run/transfer_function.json").read_text())
    assert found["schema"] == "etcfit.transfer_function/1"
    assert found["output"]["unit"] == "deg"
    assert Path("notebooks/run/pictures/control/bode.png").stat().st_size > 10_000
    wrong = invoke("design", "notebooks/run", "--ecu-period", "fast", "--quiet")
    assert (wrong.exit_code, wrong.stdout) == (2, "")
    assert "Write, say, 1ms" in wrong.stderr
