"""Instruments that lie, and logs that are too slow: done to the traces of a folder that `make_folder` wrote.

The current of the bench supply in place of the motor's, a current without its sign, one through a low-pass, a voltage
channel that samples the PWM itself, a log slower than what it logs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from .mistakes import Sheet, edited

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


def slow_current(folder: Path, seconds: float, tests: Iterable[str] = WITH_CURRENT) -> None:
    """The current behind an RC of so many seconds, at rest as the log begins: y' = (i - y) / RC, i straight between
    two samples."""

    def behind(i: np.ndarray, v: np.ndarray, t: np.ndarray) -> np.ndarray:
        y = i.copy()
        for k in range(1, i.size):
            h = (t[k] - t[k - 1]) / seconds
            slope = (i[k] - i[k - 1]) / h  # per RC
            y[k] = i[k] - slope + (y[k - 1] - i[k - 1] + slope) * np.exp(-h)
        return y

    for test in tests:
        edited(folder, test, _changed("current", behind))


def switched_voltage(folder: Path, rng: np.random.Generator, supply: float = 12.0, tests: Iterable[str] = ("response",)) -> None:
    """The terminal voltage as one sample of a PWM far faster than the log finds it: 0 or the supply's, with chance
    |v| / V_s of the latter."""

    def found(v: np.ndarray, _: np.ndarray, t: np.ndarray) -> np.ndarray:
        on = rng.uniform(size=v.size) < np.abs(v) / supply
        return np.sign(v) * supply * on + 0.01 * rng.standard_normal(v.size)

    for test in tests:
        edited(folder, test, _changed("voltage", found))


def every_nth(folder: Path, n: int, test: str) -> None:
    """A log n times slower than it was."""
    edited(folder, test, lambda sheet: replace(sheet, rows=sheet.rows[::n]))
