"""A small good measurement folder as text, to be spoilt by the tests of the reader; written without the package."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

TOML = """[rig]
name = "bench"
gear_ratio = 20.68
supply_V = 12.0

[tps]
closed_V = 0.45
open_V = 4.73
travel_deg = 90.0
"""


@dataclass(frozen=True)
class Sheet:
    """A CSV before it is written: header cells and rows of decimal texts."""

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def text(self, separator: str = ",", decimal: str = ".", newline: str = "\n") -> str:
        lines = [separator.join(self.header)]
        lines += [separator.join(cell.replace(".", decimal) for cell in row) for row in self.rows]
        return newline.join([*lines, ""])

    def column(self, k: int) -> np.ndarray:
        return np.array([float(row[k]) for row in self.rows])

    def with_header(self, k: int, name: str) -> Sheet:
        return replace(self, header=(*self.header[:k], name, *self.header[k + 1 :]))

    def with_cell(self, row: int, k: int, text: str) -> Sheet:
        cells = (*self.rows[row][:k], text, *self.rows[row][k + 1 :])
        return self.with_row(row, cells)

    def with_row(self, row: int, cells: tuple[str, ...]) -> Sheet:
        return replace(self, rows=(*self.rows[:row], cells, *self.rows[row + 1 :]))

    def in_order(self, order: list[int]) -> Sheet:
        rows = tuple(tuple(row[k] for k in order) for row in self.rows)
        return Sheet(tuple(self.header[k] for k in order), rows)

    def without(self, k: int) -> Sheet:
        return self.in_order([j for j in range(len(self.header)) if j != k])


def response(n: int = 60, seed: int = 0) -> Sheet:
    """A driven plate: time in ms with jitter, voltage, current in mA, sensor volts."""
    rng = np.random.default_rng(seed)
    time = 5.0 * np.arange(n) + rng.uniform(0, 1, n)
    voltage = 6.0 + 2.0 * np.sin(time / 40) + rng.normal(0, 0.02, n)
    current = 1800.0 + 900.0 * np.sin(time / 40) + rng.normal(0, 8.0, n)
    tps = 2.5 + 1.5 * np.sin(time / 50) + rng.normal(0, 0.004, n)
    return sheet("time [ms]", "voltage [V]", "current [mA]", "tps [V]", columns=(time, voltage, current, tps))


def back_emf(n: int = 60, seed: int = 1) -> Sheet:
    """A plate let go from open: time, EMF, angle in degrees."""
    rng = np.random.default_rng(seed)
    time = 0.004 * np.arange(n)
    angle = np.clip(89.0 - 3000.0 * time**2, 1.0, None) + rng.normal(0, 0.1, n)
    emf = -0.4 * np.gradient(np.radians(angle), time) + rng.normal(0, 0.02, n)
    return sheet("time [s]", "emf [V]", "position [deg]", columns=(time, emf, angle))


def resistance(n: int = 40, seed: int = 2) -> Sheet:
    """A held plate at constant voltage."""
    rng = np.random.default_rng(seed)
    voltage = 2.0 + rng.normal(0, 0.01, n)
    return sheet("time [s]", "voltage [V]", "current [A]", columns=(0.01 * np.arange(n), voltage, voltage / 1.513))


def inductance(n: int = 60, seed: int = 3) -> Sheet:
    """A voltage step on a held plate."""
    rng = np.random.default_rng(seed)
    time = 5e-5 * np.arange(n)
    current = 0.368 * (1 - np.exp(-time / 5.4e-4)) + rng.normal(0, 1e-3, n)
    return sheet("time [s]", "voltage [V]", "current [A]", columns=(time, 1.005 + 0 * time, current))


def sheet(*header: str, columns: tuple[np.ndarray, ...]) -> Sheet:
    return Sheet(header, tuple(tuple(f"{x:.5f}" for x in row) for row in zip(*columns, strict=True)))


def good() -> dict[str, str | bytes]:
    """Every file of the folder by its relative path."""
    return {
        "rig.toml": TOML,
        "response/1.csv": response().text(),
        "back_emf/1.csv": back_emf().text(),
        "resistance/1.csv": resistance().text(),
        "inductance/1.csv": inductance().text(),
    }


def held() -> dict[str, str | bytes]:
    """Only the two tests of a held plate: fitted in seconds, and nothing of the mechanics is identifiable."""
    toml = TOML + '[tests.inductance]\nseries_ohm = "free"\n'
    return {"rig.toml": toml, "resistance/1.csv": resistance().text(), "inductance/1.csv": inductance().text()}


def write(folder: Path, files: Mapping[str, str | bytes]) -> Path:
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return folder


def changed(folder: Path, changes: Mapping[str, str | bytes]) -> Path:
    """The good folder with some files replaced or added."""
    return write(folder, {**good(), **changes})


def only_response(sheet: Sheet) -> dict[str, str]:
    return {"response/1.csv": sheet.text()}


def scaled(sheet: Sheet, k: int, factor: float) -> Sheet:
    rows = tuple((*row[:k], f"{float(row[k]) * factor:.9g}", *row[k + 1 :]) for row in sheet.rows)
    return replace(sheet, rows=rows)


def constant(sheet: Sheet, k: int) -> Sheet:
    return replace(sheet, rows=tuple((*row[:k], sheet.rows[0][k], *row[k + 1 :]) for row in sheet.rows))
