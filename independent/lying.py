"""Instruments that lie, and logs that are too slow: done to the traces of a folder that `make_folder` wrote.

The current of the bench supply in place of the motor's, a current without its sign, one through a low-pass, a voltage
channel that samples the PWM itself, a log slower than what it logs.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from .control import Computer, follow
from .drives import steps
from .effects import NONE
from .folder import rig_toml, write_trace
from .instruments import CLOSED_V, OPEN_V, Bench
from .mistakes import Sheet, edited
from .protocols import Series, Session, Trace
from .simulate import throttle
from .truth import OPEN, Truth
from .under_ecu import setpoint

WITH_CURRENT = ("resistance", "inductance", "static_load", "viscous", "response")


def _changed(quantity: str, change: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]):
    """A sheet's column (SI) as a function of itself, the voltage (V) and the time (s)."""

    def on(sheet: Sheet) -> Sheet:
        k, rows = sheet.at(quantity), sheet.rows.copy()
        milli = 1e-3 if "[m" in sheet.header[k] else 1.0
        clock = 1e-3 if sheet.header[0].endswith("[ms]") else 1.0
        rows[:, k] = change(milli * rows[:, k], rows[:, sheet.at("voltage")], clock * rows[:, 0]) / milli
        return replace(sheet, rows=rows)

    return on


def supply_current(folder: Path, supply: float = 12.0, tests: Iterable[str] = WITH_CURRENT) -> None:
    """The bench supply's current, i_s = (v / V_s) i."""
    for test in tests:
        edited(folder, test, _changed("current", lambda i, v, t: i * v / supply))


def unsigned_current(folder: Path, tests: Iterable[str] = WITH_CURRENT) -> None:
    """|i|, as a rectifier or a multimeter of the cheap kind shows it."""
    for test in tests:
        edited(folder, test, _changed("current", lambda i, v, t: np.abs(i)))


def slow_current(
    folder: Path, seconds: float, rng: np.random.Generator, noise: float = 0.008, tests: Iterable[str] = WITH_CURRENT
) -> None:
    """The current behind an RC of so many seconds, settled as the log begins, and the converter's noise (A) after it:
    y' = (i - y) / RC, i straight between two samples."""

    def behind(i: np.ndarray, v: np.ndarray, t: np.ndarray) -> np.ndarray:
        y = i.copy()
        for k in range(1, i.size):
            h = (t[k] - t[k - 1]) / seconds
            slope = (i[k] - i[k - 1]) / h  # per RC
            y[k] = i[k] - slope + (y[k - 1] - i[k - 1] + slope) * np.exp(-h)
        return y + noise * rng.standard_normal(y.size)

    for test in tests:
        edited(folder, test, _changed("current", behind))


def switched_voltage(
    folder: Path, rng: np.random.Generator, supply: float = 12.0, tests: Iterable[str] = ("response",)
) -> None:
    """The terminal voltage as one sample of a PWM far faster than the log finds it: 0 or the supply's, with chance
    |v| / V_s of the latter."""

    def found(v: np.ndarray, _: np.ndarray, t: np.ndarray) -> np.ndarray:
        on = rng.uniform(size=v.size) < np.abs(v) / supply
        return np.sign(v) * supply * on + 0.01 * rng.standard_normal(v.size)

    for test in tests:
        edited(folder, test, _changed("voltage", found))


def binary_drive(
    folder: Path, truth: Truth, seed: int, hold: int, levels: tuple[float, float], rate: float, duration: float = 1.5
) -> None:
    """No lie: a response to a random binary voltage (V) that changes at every so-many-th sample, or stays."""
    rng = np.random.default_rng(seed)
    session = Session(rng, truth, NONE, Bench(edge_phase=0.0 if hold == 1 else None))
    count = math.ceil(duration * rate / hold) + 2
    drive = steps(np.full(count, hold / rate), rng.choice(levels, count))
    headers = ("time [s]", "voltage [V]", "current [mA]", "tps [V]")
    plant = throttle(truth, NONE)
    columns = session.record(plant, drive.after(0.05, duration + 0.02), Series(1, duration, rate), headers)
    _one_response(folder, truth, columns, seed)


def duty_log(folder: Path, truth: Truth, seed: int, rate: float, every: int, duration: float = 6.0) -> None:
    """Duty and position of a plate that follows steps under a computer of `rate` Hz, of which every so-many-th tick is
    logged."""
    rng, computer = np.random.default_rng(seed), Computer(20.0, 300.0, 0.4, period=1.0 / rate)
    ticks = np.arange(round(duration * rate)) / rate
    wanted = setpoint(rng, "steps", ticks, 0.19, 1.33)
    angle, volts = follow(throttle(truth, NONE), computer, wanted)
    tps = CLOSED_V + (OPEN_V - CLOSED_V) * angle / OPEN
    rows = slice(None, None, every)
    columns = {
        "time [s]": ticks[rows],
        "duty [%]": 100.0 * volts[rows] / computer.supply,
        "tps [V]": Bench().sensors["tps"].read(rng, tps[rows]),
    }
    _one_response(folder, truth, columns, seed)


def _one_response(folder: Path, truth: Truth, columns: dict[str, np.ndarray], seed: int) -> None:
    (folder / "response").mkdir(parents=True, exist_ok=True)
    text = rig_toml("one response", truth.N, Bench(), [], noise=True)
    (folder / "rig.toml").write_text(text, encoding="utf-8", newline="\n")
    write_trace(folder, Trace("response/log.csv", columns), seed)


def coasting_log(folder: Path, truth: Truth, seed: int, period: float = 5e-4, rate: float = 200.0) -> None:
    """Duty and speed of a motor alone whose bridge opens in the off time; each level until the speed has settled.

    The current rises with (V - e)/L for D periods and falls with (V + e)/L, through the diodes back into the supply,
    until it stops: i = (V - e) D (D + D_2) T / 2L with D_2 = D (V - e)/(V + e); the speed follows K i = B w, of a
    motor that runs on light bearings, as one whose current stops within a period must.
    """
    rng, supply = np.random.default_rng(seed), 12.0
    duties = np.linspace(0.35, 0.6, 6)
    speeds = np.array([_coasting_speed(truth, duty, supply, period) for duty in duties])
    time = np.arange(0.0, duties.size, 1.0 / rate)
    level = np.minimum(time.astype(int), duties.size - 1)
    before = np.concatenate(([0.0], speeds[:-1]))
    speed = speeds[level] + (before - speeds)[level] * np.exp(-(time - level) / 0.08)
    rpm = 60.0 / (2.0 * math.pi) * speed
    columns = {
        "time [s]": time,
        "duty [%]": 100.0 * duties[level],
        "motor_speed [rpm]": np.round(rpm + 10.0 * rng.standard_normal(time.size)),
    }
    _one_response(folder, truth, columns, seed)


def _coasting_speed(truth: Truth, duty: float, supply: float, period: float) -> float:
    """At which the mean current's torque is that of a twentieth of the viscous friction, rad/s, by bisection."""
    low, high = 0.0, supply / truth.K_b
    for _ in range(60):
        speed = 0.5 * (low + high)
        e = truth.K_b * speed
        falls = min(duty * (supply - e) / (supply + e), 1.0 - duty)
        current = (supply - e) * duty * (duty + falls) * period / (2.0 * truth.L_a)
        low, high = (speed, high) if truth.K_m * current > 0.05 * truth.B_m * speed else (low, speed)
    return low
