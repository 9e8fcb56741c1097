"""A bridge that coasts in the off time of its PWM: simulated period by period, found by check and diagnosis."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from etcfit.diagnosis import diagnose
from etcfit.estimation.joint_fit import fit
from etcfit.rig.base import Rig
from etcfit.rig.reader import read_folder

RIG = """
[rig]
name = "a wheel motor"
synthetic = true
gear_ratio = 1.0
supply_V = 12.0
travel_deg = [-inf, inf]

[parameters]
K_s = { fixed = 0.0 }
T_PL = { fixed = 0.0 }
"""
SUPPLY, R, L, K, J, B, FRICTION = 12.0, 2.0, 0.05e-3, 0.19, 1e-3, 5e-4, 0.04  # SI
PERIOD, LOGGED, NOISE = 1e-4, 0.005, 0.15  # s of the PWM, s between rows, rad/s


def mean_current(duty: float, speed: float) -> float:
    """Of one period that begins without a current, A; in the off time it flows back into the supply until it ends."""
    emf, tau = K * speed, L / R
    peak = (SUPPLY - emf) / R * (1.0 - np.exp(-duty * PERIOD / tau))
    dying = min((1.0 - duty) * PERIOD, tau * np.log1p(peak * R / (SUPPLY + emf)))
    return float((duty * (SUPPLY - emf) - dying / PERIOD * (SUPPLY + emf)) / R)


def recording(folder: Path, shorted: bool) -> Rig:
    """Steps of the duty, and the speed; a bridge that shorts the motor drives it by the mean voltage."""
    duties = np.repeat([0.25, 0.1, 0.4, 0.15, 0.6, 0.2, 0.8, 0.3, 0.95, 0.5], round(1.5 / PERIOD))
    speed, rows, every = 0.0, [], round(LOGGED / PERIOD)
    for k, duty in enumerate(duties):
        if k % every == 0:
            rows.append((k * PERIOD, 100.0 * duty, speed))
        current = (duty * SUPPLY - K * speed) / R if shorted else mean_current(duty, speed)
        speed = max(0.0, speed + PERIOD / J * (K * current - B * speed - FRICTION))
    table = np.array(rows)
    table[:, 2] += NOISE * np.random.default_rng(0).standard_normal(len(table))
    (folder / "response").mkdir()
    lines = ["time [s],duty [%],motor_speed [rad/s]", *(",".join(f"{x:.6g}" for x in row) for row in table)]
    (folder / "response" / "steps.csv").write_text("\n".join(lines) + "\n")
    (folder / "rig.toml").write_text(RIG)
    return read_folder(folder)


@pytest.mark.slow
def test_a_bridge_that_coasts_is_found(tmp_path: Path) -> None:
    """A tenth of the error is left: the current does not die in the same time at every speed."""
    rig = recording(tmp_path, shorted=False)
    assert "coasting_bridge" in {finding.kind for finding in rig.findings}
    found = diagnose(fit(rig))
    assert found.added == ("coasting_bridge",)
    assert found.probabilities["coasting_bridge"] > 0.7
    (before,), (after,) = found.before.score_fit, found.after.score_fit
    assert after.rms < 0.1 * before.rms


@pytest.mark.slow
def test_a_bridge_that_shorts_the_motor_is_not_called_so(tmp_path: Path) -> None:
    rig = recording(tmp_path, shorted=True)
    assert "coasting_bridge" not in {finding.kind for finding in rig.findings}
    assert diagnose(fit(rig)).added == ()
