"""Ten ways in which the folder of a unit can be broken."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from pathlib import Path

TRACE = Path("response") / "drive_1.csv"


def empty(unit: Path) -> None:
    """Nothing in it."""
    shutil.rmtree(unit)
    unit.mkdir()


def no_data(unit: Path) -> None:
    """A trace without a byte."""
    (unit / TRACE).write_bytes(b"")


def header_only(unit: Path) -> None:
    """A trace without a row."""
    _lines(unit, lambda lines: lines[:2])


def words(unit: Path) -> None:
    """A word where a number must be."""
    _lines(unit, lambda lines: [*lines[:20], "nothing,was,logged,here", *lines[21:]])


def time_falls(unit: Path) -> None:
    """Two halves in the wrong order."""
    _lines(unit, lambda lines: [*lines[:2], *lines[len(lines) // 2 :], *lines[2 : len(lines) // 2]])


def torn(unit: Path) -> None:
    """A row with fewer fields than the header."""
    _lines(unit, lambda lines: [*lines[:50], lines[50].partition(",")[0], *lines[51:]])


def bytes_of_another_file(unit: Path) -> None:
    """A picture under the name of a trace."""
    (unit / TRACE).write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 8)


def unknown_unit(unit: Path) -> None:
    """A header with a unit that nobody knows."""
    _lines(unit, lambda lines: [lines[0], lines[1].replace("[mA]", "[furlong]"), *lines[2:]])


def bad_toml(unit: Path) -> None:
    """A rig.toml that is none."""
    (unit / "rig.toml").write_text("[rig\nname = \n", encoding="utf-8")


def no_voltage(unit: Path) -> None:
    """Driven responses, and nobody logged with what."""
    for file in (unit / "response").glob("*.csv"):
        rows = [line.split(",") for line in file.read_text(encoding="utf-8").splitlines()[1:]]
        file.write_text("\n".join(",".join([row[0], *row[2:]]) for row in rows) + "\n", encoding="utf-8")


def _lines(unit: Path, change: Callable[[list[str]], list[str]]) -> None:
    lines = (unit / TRACE).read_text(encoding="utf-8").splitlines()
    (unit / TRACE).write_text("\n".join(change(lines)) + "\n", encoding="utf-8")


BROKEN: Mapping[str, Callable[[Path], None]] = {
    way.__name__: way
    for way in (empty, no_data, header_only, words, time_falls, torn, bytes_of_another_file, unknown_unit, bad_toml,
                no_voltage)
}  # fmt: skip
