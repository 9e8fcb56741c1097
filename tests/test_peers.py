"""What the table of `benchmarks.peers` works out, by hand; no peer is run."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.peers import __main__ as command
from benchmarks.peers.__main__ import PEERS, column, named
from benchmarks.peers.problem import Problem, chi2
from benchmarks.peers.table import Column, error, number, off, signed, table
from benchmarks.plain import PlainTrace, input_knots
from etcfit.problem.input_signal import InputSignal

TRUTH = {"R_a": 2.0, "T_f": 0.2}
STDERR = {"R_a": 1.0, "T_f": 2.0}  # %


def trace(data: list[list[float]], sigma: list[float]) -> PlainTrace:
    times = np.arange(float(len(data)))
    knots, volts = np.array([0.0, 1.0, 1.0, 3.0]), np.array([0.0, 1.0, 3.0, 3.0])
    return PlainTrace("a/1.csv", "a", False, False, True, times, knots, volts, ("current", "position"),
                      np.array(data), np.array(sigma), (0.0, 0.0, 0.0), 0.5)  # fmt: skip


def problem() -> Problem:
    return Problem((trace([[1.0, 2.0], [math.nan, 4.0]], [0.5, 1.0]),), {"R_a": 1.0}, 20.0, (0.0, 1.5))


def test_an_error_is_relative_to_the_truth_and_none_without_a_value() -> None:
    assert error({"R_a": 2.1}, TRUTH, "R_a") == pytest.approx(5.0)
    assert error({}, TRUTH, "R_a") is None


def test_errors_over_standard_errors() -> None:
    assert off({"R_a": 2.06, "T_f": 0.184}, TRUTH, STDERR) == pytest.approx(math.sqrt((3.0**2 + 4.0**2) / 2.0))
    assert off({"R_a": 2.06}, TRUTH, STDERR) is None
    assert off({"R_a": 2.06, "T_f": 0.184}, TRUTH, {}) is None


def test_chi2_leaves_out_what_was_not_logged() -> None:
    only = problem()
    assert chi2(only.traces, [np.array([[0.0, 0.0], [9.0, 3.0]])]) == pytest.approx(4.0 + 4.0 + 1.0)
    assert (only.samples, only.freedom) == (3, 2)


def test_each_tool_has_a_column_and_each_parameter_a_row() -> None:
    found = Column("a", {"R_a": 2.02, "T_f": 0.19}, 12.34, 60.0, 500.0, 1.5, 1.25)
    tools = [Column("truth", {}, accurate=1.0), found, Column("b", {}, words="not measured: b not installed")]
    lines = table(tools, TRUTH, STDERR).splitlines()
    assert lines[0] == "|  | truth | a | b | one standard error |"
    assert lines[2] == "| processor time, s |  | 12.3 |  |  |"
    assert lines[6] == "| chi2/dof, exact simulation | 1 | 1.25 |  |  |"
    assert lines[7] == "| error of `R_a`, % |  | +1.000 |  | 1 |"
    assert lines[8] == "| error of `T_f`, % |  | -5.000 |  | 2 |"
    assert lines[9] == f"| errors over standard errors, rms |  | {math.sqrt((1.0 + 6.25) / 2.0):.1f} |  |  |"
    assert lines[-1] == "- b: not measured: b not installed"


def test_figures_have_no_exponent() -> None:
    assert [number(v) for v in (None, 0.0123, 1234.5, 99.96)] == ["", "0.0123", "1234", "100"]
    assert [signed(v) for v in (None, -0.004, 12.3)] == ["", "-0.004", "+12.300"]


def test_the_input_jumps_at_a_knot() -> None:
    found = trace([[0.0, 0.0]], [1.0, 1.0]).volts_at
    assert found(np.array([0.5, 1.0, 2.0])).tolist() == [0.5, 3.0, 3.0]
    assert found(np.array([0.5, 1.0, 2.0]), before=True).tolist() == [0.5, 1.0, 3.0]


@pytest.mark.parametrize(
    ("held", "jump_at", "seen"),
    [(False, None, [0.5, 1.0, 3.0]), (False, 0.25, [0.5, 1.0, 5.0]), (True, None, [0.0, 1.0, 1.0])],
)
def test_an_input_becomes_knots(held: bool, jump_at: float | None, seen: list[float]) -> None:
    found = denoised(held)
    knots, volts = input_knots(np.arange(4.0), found, jump_at)
    assert replace(trace([[0.0, 0.0]], [1.0, 1.0]), knots=knots, volts=volts).volts_at(
        np.array([0.5, 1.0, 1.5])
    ).tolist() == pytest.approx(seen)


@pytest.mark.parametrize(("turn", "at"), [(0.0, 1.3), (1.0, 2.0)])
def test_a_jump_in_step_with_the_samples_is_a_knot_where_its_phase_puts_it(turn: float, at: float) -> None:
    found = replace(denoised(held=False), turn=np.array([np.nan, turn, np.nan]))
    knots, volts = input_knots(np.arange(4.0), found, None, 0.3)
    seen = replace(trace([[0.0, 0.0]], [1.0, 1.0]), knots=knots, volts=volts)
    assert seen.volts_at(np.array([at - 1e-9, at])).tolist() == pytest.approx([1.0, 5.0], abs=1e-6)


def denoised(held: bool) -> InputSignal:
    level = np.array([0.0, 1.0, 5.0, 5.0])
    return InputSignal(level, np.zeros(4), np.zeros(4), np.array([False, True, False]), held)


def test_a_fitted_release_comes_before_the_one_that_was_read() -> None:
    one = trace([[0.0, 0.0]], [1.0, 1.0])
    assert (one.release_at({}), one.release_at({"release.a/1.csv": 0.7})) == (0.5, 0.7)


def test_a_peer_without_its_package_is_named_and_not_run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(PEERS, "scipy", ("SciPy", ("scipy", "no-such-package")))
    monkeypatch.setattr(command, "run", None)
    found = column("scipy", tmp_path, problem(), tmp_path, 1.0)
    assert found.words == "not measured: no-such-package not installed (the extra `benchmark`)"
    assert found.values == {}


def test_peers_are_chosen_by_name() -> None:
    assert named("") == list(PEERS)
    assert named("casadi,scipy") == ["casadi", "scipy"]
    with pytest.raises(Exception, match="no peer nobody"):
        named("nobody")
