"""The rules: published figures, and that every rule's file is registered."""

from __future__ import annotations

import ast
import math
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

import control
import etcfit.control.pid
from etcfit.control.loop_figures import judge
from etcfit.control.pid import RULES, Gains, Refusal, Requirements, Task, formulas
from etcfit.control.pid.formulas import (
    Ultimate,
    amigo,
    damping_optimum,
    first_order,
    simc,
    tyreus_luyben,
    ultimate,
    ziegler_nichols,
)
from etcfit.control.pid.linear_loop import margins, respond
from etcfit.control.setpoint import Setpoint, step, trapezoid
from etcfit.model.ecu import Ecu
from etcfit.model.linear import PAPER_EQ_8, TransferFunction

CONTINUOUS = Ecu(period=2e-5, filter=0.0)
AT_ONCE = Ecu(period=1e-12, filter=0.0)


def task(plant: TransferFunction, ecu: Ecu = CONTINUOUS) -> Task:
    """What the rules on a transfer function alone need."""
    return Task(plant, ecu, Requirements(), cast(Any, None))


def gains(found: Gains | Refusal) -> Gains:
    assert isinstance(found, Gains)
    return found


def test_ultimate_gain_and_period_of_eq_8_are_the_papers() -> None:
    u = ultimate(PAPER_EQ_8)
    assert isinstance(u, Ultimate)
    assert u.gain == pytest.approx(10.029, abs=5e-4)
    assert u.period == pytest.approx(0.1159, abs=5e-5)
    a2, a1, a0 = PAPER_EQ_8.den[1:]
    assert u.gain == pytest.approx((a2 * a1 - a0) / PAPER_EQ_8.b0, rel=1e-9)
    assert u.period == pytest.approx(2.0 * math.pi / math.sqrt(a1), rel=1e-9)


def test_ziegler_nichols_gains_of_eq_8_are_the_papers() -> None:
    assert gains(ziegler_nichols(task(PAPER_EQ_8, AT_ONCE))) == pytest.approx((6.017, 103.87, 0.0871), rel=5e-4)


def test_their_overshoot_is_the_papers_on_its_trapezoid_and_48_percent_on_a_step() -> None:
    found = gains(ziegler_nichols(task(PAPER_EQ_8, AT_ONCE)))
    ramps, jump = trapezoid(lead=0.0), step(0.0, 1.0, 0.4, lead=0.0)

    def overshoot(setpoint: Setpoint) -> float:
        time = setpoint.instants(CONTINUOUS.period)
        return float(judge(setpoint, time, respond(PAPER_EQ_8, found, CONTINUOUS, setpoint)).overshoot_pct)

    first = Setpoint(ramps.times[:4], ramps.shares[:4], ramps.levels[:1])
    assert 17.7 < overshoot(first) < 19.9
    assert overshoot(jump) == pytest.approx(48.0, abs=1.0)


def test_tyreus_luyben() -> None:
    u = ultimate(PAPER_EQ_8)
    assert isinstance(u, Ultimate)
    kp, ki, kd = gains(tyreus_luyben(task(PAPER_EQ_8, AT_ONCE)))
    assert (kp, kp / ki, kd / kp) == pytest.approx((u.gain / 2.2, 2.2 * u.period, u.period / 6.3))


def lags(gain: float, *times: float, delay: float = 0.0) -> TransferFunction:
    """gain / ((T1 s + 1) (T2 s + 1) (T3 s + 1))."""
    den = np.real(np.poly([-1.0 / t for t in times]))
    return TransferFunction(gain * den[3], *den[1:].tolist(), delay=delay)


def test_simc_halves_the_smallest_lag() -> None:
    # k = 2, T = 1, 0.2 and 0.05: L = 0.025, T2 = 0.225, Kc = 1/(2 * 0.05) = 10, Ti = 8 * 0.025 = 0.2, by hand
    found = gains(simc(task(lags(2.0, 1.0, 0.2, 0.05), AT_ONCE)))
    assert found == pytest.approx(Gains.series(10.0, 0.2, 0.225), rel=1e-6)


def test_simc_counts_all_that_the_ecu_delays() -> None:
    # a period of 4 ms and a filter of 6 ms: 2 ms of hold, 2 ms of difference, 6 ms of filter; L = 0.035 by hand
    found = gains(simc(task(lags(2.0, 1.0, 0.2, 0.05), Ecu(period=4e-3, filter=6e-3))))
    assert found == pytest.approx(Gains.series(1.0 / (2.0 * 0.07), 8.0 * 0.035, 0.225), rel=1e-6)


@pytest.mark.parametrize("period", [1e-3, 2e-3, 5e-3])
def test_simc_is_stable_with_room_to_spare_under_any_clock(period: float) -> None:
    """The paper's Table 2 in Eqs. 1-2; without the derivative's lag among the delays it is unstable at all three."""
    ecu = Ecu(period=period, filter=2.0 * period)
    plant = TransferFunction(2.208e5, 1033.0, 9.370e4, 1.282e5)
    found = margins(gains(simc(task(plant, ecu))), plant, ecu)
    assert found.gain_db > 6.0
    assert found.phase_deg > 30.0


def test_amigo_reads_the_step_response() -> None:
    T, L = first_order(lags(3.0, 1.0, 0.02, 0.01))
    # the tangent rule on nearly one lag: T close to it, L close to the sum of the small ones
    assert pytest.approx(1.0, rel=0.08) == T
    assert 0.02 < L < 0.03
    kp, ki, kd = gains(amigo(task(lags(3.0, 1.0, 0.02, 0.01), AT_ONCE)))
    assert kp == pytest.approx((0.2 + 0.45 * T / L) / 3.0)
    assert kp / ki == pytest.approx(L * (0.4 * L + 0.8 * T) / (L + 0.1 * T))
    assert kd / kp == pytest.approx(0.5 * L * T / (0.3 * L + T))


@pytest.mark.parametrize("small", [(0.02, 0.01), (1e-3, 4e-4)])
def test_the_steepest_tangent_is_found_however_fast_the_small_lags_are(small: tuple[float, float]) -> None:
    """Step response and slope in closed form: 1 - sum_k w_k exp(-t / tau_k), w_k = tau_k^2 / prod (tau_k - tau_j)."""
    tau = np.array([1.0, *small])
    w = np.array([t**2 / np.prod([t - other for other in tau if other != t]) for t in tau])
    t = np.linspace(0.0, 2.0, 2_000_001)
    y = 1.0 - np.exp(-t[:, None] / tau) @ w
    slope = np.exp(-t[:, None] / tau) @ (w / tau)
    k = int(np.argmax(slope))
    L = t[k] - y[k] / slope[k]
    reached = t[np.argmax(y >= 1.0 - math.exp(-1.0))]
    assert first_order(lags(3.0, *tau)) == (pytest.approx(reached - L, rel=2e-3), pytest.approx(L, rel=2e-3))


def test_amigo_refuses_a_plant_that_runs_away_though_its_gain_is_finite() -> None:
    assert isinstance(amigo(task(TransferFunction(1.0, 10.0, 5.0, -2.0))), Refusal)


def test_damping_optimum_places_the_double_ratios() -> None:
    plant = lags(1.3, 0.5, 0.05, 0.002)
    kp, ki, kd = gains(damping_optimum(task(plant)))
    a = [1.0, plant.a2, plant.a1 + plant.b0 * kd, plant.a0 + plant.b0 * kp, plant.b0 * ki][::-1]
    ratios = [a[k] * a[k - 2] / a[k - 1] ** 2 for k in (2, 3, 4)]
    assert ratios[:2] == pytest.approx([0.5, 0.5])
    assert ratios[2] <= 0.5 + 1e-9
    loop: Any = control.feedback(control.tf([kd, kp, ki], [1.0, 0.0]) * plant.to_control(), 1)
    assert np.all(loop.poles().real < 0.0)


@pytest.mark.parametrize(
    ("name", "value", "te"), [("SETTLES", 6.0, 0.02), ("SETTLES", 3.0, 0.04), ("DAMPED", 0.1, 0.018913)]
)
def test_the_damping_optimum_is_as_quick_as_its_constants_say(
    name: str, value: float, te: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ki = a2 / (D^3 Te^3 b0) with Te = 0.12 s / settles, or damped a2 / (D^2 a1) where that is less."""
    monkeypatch.setattr(formulas, name, value)
    plant = lags(1.3, 0.5, 0.05, 0.002)  # a2 = 522, a1 = 11040
    asked = replace(task(plant), requirements=Requirements(settling_s=0.12))
    _, ki, _ = gains(damping_optimum(asked))
    assert ki == pytest.approx(plant.a2 / (0.125 * te**3 * plant.b0), rel=1e-4)


def test_a_plant_without_ultimate_gain_is_refused_in_words() -> None:
    second = lags(1.0, 1.0, 0.1, 1e-12)
    refused = ziegler_nichols(task(second, AT_ONCE))
    assert isinstance(refused, Refusal)
    assert "ultimate gain" in refused.why


def test_every_rule_is_registered() -> None:
    folder = Path(etcfit.control.pid.__file__).parent
    rules = {
        node.name
        for file in folder.glob("*.py")
        for node in ast.parse(file.read_text(encoding="utf-8")).body
        if isinstance(node, ast.FunctionDef)
        and ast.unparse(node.args) == "task: Task"
        and "Source:" in ast.unparse(node)
    }
    assert len(rules) >= 8
    assert rules == set(RULES)
    assert all(rule.__name__ == name for name, rule in RULES.items())
