"""What one process compiled the next one loads without tracing; what it cannot load it makes anew."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from etcfit import backend
from etcfit.problem import executables
from etcfit.problem.program import Program

# a program of the package with a Cholesky factor in it, and one of the model's parameters; what each compiled is timed
WORK = """
import jax, numpy as np
from etcfit import backend
from etcfit.estimation.levenberg_marquardt import least_squares
from etcfit.problem.normal_equations import NormalEquations
from etcfit.problem import executables
backend.use_compilation_cache()
lowered = []
lower = executables.compiled
executables.compiled = lambda *args: lowered.append(1) or lower(*args)
A = np.diag([30.0, 20.0])
def equations(y):
    r = A @ y - 1.0
    return NormalEquations(r @ r, A.T @ r, A.T @ A)
y, steps = least_squares(equations, lambda y: equations(y).chi2, np.zeros(2), 1e-9, 20)
print(len(lowered), steps, *(value.hex() for value in y))
"""


def worked(cache: Path, **environment: str) -> tuple[list[str], str]:
    done = subprocess.run([sys.executable, "-c", WORK], capture_output=True, text=True, check=True,
                          env=os.environ | {"ETCFIT_CACHE": str(cache)} | environment)  # fmt: skip
    return done.stdout.split(), done.stderr


@pytest.mark.slow
def test_the_next_process_traces_nothing_and_finds_the_same_digits(tmp_path: Path) -> None:
    (first, *digits), _ = worked(tmp_path)
    assert first == "1"
    again, _ = worked(tmp_path)
    assert again == ["0", *digits]
    other, _ = worked(tmp_path, XLA_FLAGS="--xla_cpu_enable_fast_math=false")
    assert other[0] == "1"  # told otherwise, XLA compiles otherwise


@pytest.mark.slow
def test_two_devices_and_a_read_only_folder_are_no_matter(tmp_path: Path) -> None:
    several = {"XLA_FLAGS": "--xla_force_host_platform_device_count=2"}
    (_, *digits), _ = worked(tmp_path, **several)
    for file in tmp_path.rglob("*"):
        file.chmod(0o555)
    assert worked(tmp_path, **several)[0] == ["0", *digits]


@pytest.mark.slow
def test_what_cannot_be_loaded_is_made_anew_and_said_once(tmp_path: Path) -> None:
    _, *digits = worked(tmp_path)[0]
    for file in (tmp_path / "compiled" / "programs").iterdir():
        file.write_bytes(b"no program")
    again, said = worked(tmp_path)
    assert again == ["1", *digits]
    assert said.count("UserWarning") == 1
    assert worked(tmp_path)[0] == ["0", *digits]
    for torn in (b"\0" * 40, b"\xff" * 40):
        for file in (tmp_path / "compiled" / "asked").iterdir():
            file.write_bytes(torn)
        assert worked(tmp_path)[0] == ["1", *digits]


@pytest.mark.usefixtures("kept")
def test_a_source_that_was_changed_after_it_was_imported_is_not_what_runs() -> None:
    fixed, given = (executables.digest_asked, {}), (np.ones(3),)
    asked = executables.digest_asked(fixed, given)
    assert asked is not None
    assert asked == executables.digest_asked(fixed, (np.zeros(3),)) != executables.digest_asked(fixed, (1.0,))
    touched = Path(executables.__file__).stat().st_mtime
    try:
        os.utime(executables.__file__)
        assert executables.digest_asked(fixed, given) is None
    finally:
        os.utime(executables.__file__, (touched, touched))
    assert executables.digest_asked(fixed, given) == asked


@pytest.fixture
def kept(tmp_path: Path) -> Iterator[Path]:
    """A folder of its own for what is compiled."""
    before = backend.compiled_folder()
    backend.keep_compiled_in(tmp_path)
    yield tmp_path
    backend.keep_compiled_in(before)


def test_a_program_that_a_change_of_the_source_left_alone_is_not_compiled_again(
    kept: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []
    program = Program(lambda x: 2.0 * x, static=0)
    monkeypatch.setattr(executables, "digest_asked", lambda fixed, given: asked[-1])
    for source in ("before", "after"):
        asked.append(source)
        assert np.all(np.asarray(program(np.ones(3))) == 2.0)
        executables.finish_writing()
        program.forget()
    assert sorted(file.name for file in (kept / "asked").iterdir()) == ["after", "before"]
    assert len(list((kept / "programs").iterdir())) == 1


class One(NamedTuple):
    value: Any


class Other(NamedTuple):
    value: Any


def test_programs_that_differ_in_what_they_use_or_return_are_not_taken_for_one_another(
    kept: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []
    monkeypatch.setattr(executables, "digest_asked", lambda fixed, given: asked[-1])
    functions = {
        "first": lambda a, b: One(a + 1.0),
        "second": lambda a, b: One(b + 1.0),
        "renamed": lambda a, b: Other(a + 1.0),
    }
    found = {}
    for _ in range(2):  # made, then loaded
        for name, function in functions.items():
            asked.append(name)
            found[name] = Program(function, static=0)(np.float64(1.0), np.float64(5.0))
            executables.finish_writing()
    assert found == {"first": One(2.0), "second": One(6.0), "renamed": Other(2.0)}
    assert [type(each) for each in found.values()] == [One, One, Other]
    assert len(list((kept / "programs").iterdir())) == 3


def test_programs_beyond_the_room_go_oldest_first(kept: Path) -> None:
    for folder in ("programs", "asked"):
        (kept / folder).mkdir()
    for age, name in enumerate(("new", "old", "oldest")):
        (kept / "programs" / name).write_bytes(b"x" * 100)
        os.utime(kept / "programs" / name, (1e9 - age, 1e9 - age))
        (kept / "asked" / f"for {name}").write_text(name, encoding="ascii")
    executables.tidy(250)
    assert {file.name for file in (kept / "programs").iterdir()} == {"new", "old"}
    assert {file.name for file in (kept / "asked").iterdir()} == {"for new", "for old"}
