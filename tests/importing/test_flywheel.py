"""A flywheel of a robot: an independent simulation under SysId's four tests; its log is read, fitted, reduced."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import etcfit
import foreign
from etcfit.importing import Answers, import_files
from etcfit.importing.answers import accept_all

K_S, K_V, K_A = 0.25, 0.12, 0.02
R, L, K = 0.3, 2e-4, 0.1  # ohm, H, V s/rad
B, J, T_F = (K_V - K) * K / R, K_A * K / R, K_S * K / R
STEP, EVERY = 1e-4, 50  # s, steps of a sample
RIG = """[rig]
name = "wheel"
gear_ratio = 1.0
supply_V = 12.0
travel_deg = [-inf, inf]

[parameters]
K_s = { fixed = 0.0 }
T_PL = { fixed = 0.0 }
J_L = { fixed = 0.0 }
B_L = { fixed = 0.0 }
"""


def wheel(volts: Callable[[float], float], seconds: float) -> np.ndarray:
    """Rows of t, v, angle, speed, current; explicit steps, a wheel that sticks."""
    i = speed = angle = 0.0
    rows = []
    for k in range(round(seconds / STEP) + 1):
        t = k * STEP
        v = volts(t)
        if k % EVERY == 0:
            rows.append((t, v, angle, speed, i))
        turning = K * i - B * speed
        rate = 0.0
        if speed != 0.0 or abs(turning) > T_F:
            rate = (turning - T_F * np.sign(speed or turning)) / J
        stops = speed * (speed + STEP * rate) < 0.0 and abs(turning) < T_F
        i, angle, speed = (i + STEP * (v - R * i - K * speed) / L, angle + STEP * speed,
                           0.0 if stops else speed + STEP * rate)  # fmt: skip
    return np.array(rows)


def log(path: Path) -> Path:
    tests = {"quasistatic-forward": (lambda t: t, 4.0), "quasistatic-reverse": (lambda t: -t, 4.0),
             "dynamic-forward": (lambda t: 7.0 * (t > 0.0999), 1.1),
             "dynamic-reverse": (lambda t: -7.0 * (t > 0.0999), 1.1)}  # fmt: skip
    rng, state, columns, at = np.random.default_rng(3), [], [[], [], [], []], 1_000_000
    for name, (volts, seconds) in tests.items():
        for row in wheel(volts, seconds):
            time = at + round(1e6 * row[0])
            state.append((time, name))
            noise = (0.0, 1e-3, 0.05, 0.02) * rng.standard_normal(4)
            scale = (1.0, 0.5 / np.pi, 0.5 / np.pi, 1.0)
            for column, value, error, of in zip(columns, row[1:], noise, scale, strict=True):
                column.append((time, of * float(value + error)))
        state.append((state[-1][0] + 20_000, "none"))
        at = state[-1][0] + 500_000
    names = {"voltage": "Volt", "position": "Rotation", "velocity": "Rotation per Second", "current": "Amp"}
    entries = {f"{name}-wheel-shooter": ("double", unit, column)
               for (name, unit), column in zip(names.items(), columns, strict=True)}  # fmt: skip
    return foreign.wpilog(path, {"sysid-test-state-shooter": ("string", "", state), **entries})


@pytest.mark.slow
def test_a_wheels_log_gives_the_constants_that_it_was_made_with(tmp_path: Path) -> None:
    (tmp_path / "rig.toml").write_text(RIG, encoding="utf-8")
    folder = tmp_path / "rig"
    import_files([log(tmp_path / "robot.wpilog")], folder, Answers(), accept_all, rig=tmp_path / "rig.toml")
    reduced = etcfit.reduce(etcfit.fit(folder, quiet=True), quiet=True)
    found = reduced.feedforward
    truth = np.array([K_S, K_V, K_A])
    assert np.all(np.abs(found["value"] - truth) < 3.0 * found["stderr"] + 5e-4 * truth)  # the steps' own error
    assert np.all(found["stderr"] < 0.01 * truth)
    assert reduced.plot.bode() is not None  # of a plant without a spring too
