"""Good folders, spoilt at random: never an exception but MeasurementError, never a silent wrong number."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from decimal import Decimal
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, note, settings
from hypothesis import strategies as st

from etcfit.errors import MeasurementError
from etcfit.rig.base import Channel, Rig
from etcfit.rig.reader import read_folder
from etcfit.rig.table import Table, decode, parse_plain, parse_with_care
from folders import TOML, Sheet, back_emf, good, response, write

SHEETS = {"response/1.csv": response(30), "back_emf/1.csv": back_emf(30)}
FILES = {"rig.toml": TOML, **{name: sheet.text() for name, sheet in SHEETS.items()}}
# headers that mean the same, and by how many powers of ten their numbers differ
SAME = {
    "time [ms]": (("time [s]", -3), ("Time [us]", 3), ("time [milliseconds]", 0)),
    "time [s]": (("time [ms]", 3), ("TIME [sec]", 0)),
    "voltage [V]": (("voltage [mV]", 3), ("Voltage [volts]", 0), ("voltage [kV]", -3)),
    "emf [V]": (("emf [mV]", 3), ("EMF [V]", 0)),
    "current [mA]": (("current [A]", -3), ("current [uA]", 3), ("current [µA]", 3)),
    "tps [V]": (("tps [mV]", 3), ("TPS [ V ]", 0)),
    "position [deg]": (("position [degrees]", 0), ("position [°]", 0), ("position [mdeg]", 3)),
}
BARE = settings(
    max_examples=120,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow],
    phases=[Phase.explicit, Phase.generate],
)
# other examples at each run: what one in two hundred shows is found by nineteen runs in twenty
THOROUGH = settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.too_slow])


def reading(files: dict[str, str | bytes]) -> Rig:
    with tempfile.TemporaryDirectory() as folder:
        return read_folder(write(Path(folder), {**FILES, **files}))


GOOD = reading({})


def outcome(files: dict[str, str | bytes]) -> Rig | MeasurementError:
    try:
        return reading(files)
    except MeasurementError as error:
        found = error
    assert all((found.where, found.found, found.required, found.mend))
    return found


def assert_same(rig: Rig, other: Rig) -> None:
    assert [m.file for m in rig.measurements] == [m.file for m in other.measurements]
    for m, n in zip(rig.measurements, other.measurements, strict=True):
        np.testing.assert_allclose(m.time, n.time, rtol=1e-12, atol=1e-15)
        assert set(m.channels) == set(n.channels)
        for name, channel in m.channels.items():
            assert_same_channel(channel, n.channels[name])


def assert_same_channel(channel: Channel, other: Channel) -> None:
    np.testing.assert_allclose(channel.time, other.time, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(channel.value, other.value, rtol=1e-11, atol=1e-12)
    assert channel.sigma == pytest.approx(other.sigma, rel=1e-3)


def assert_sound(rig: Rig) -> None:
    """What no reading may violate, whatever stood in the files."""
    for m in rig.measurements:
        assert (np.diff(m.time) > 0).all()
        assert len(m.time) > 1
        for channel in m.channels.values():
            assert channel.time.shape == channel.value.shape
            assert np.isfinite(channel.value).all()
            assert np.isfinite([channel.sigma, channel.quantum, channel.scale]).all()
            assert channel.sigma > 0


@dataclass(frozen=True)
class Style:
    """How a sheet is written."""

    separator: str
    decimal: str
    newline: str
    encoding: str
    comments: tuple[tuple[int, str], ...]

    def raw(self, sheet: Sheet) -> bytes:
        lines = sheet.text(self.separator, self.decimal).split("\n")
        for place, comment in self.comments:
            lines.insert(place, comment)
        return self.newline.join(lines).encode(self.encoding)


def styles() -> st.SearchStrategy[Style]:
    marks = st.sampled_from([(",", "."), (";", "."), ("\t", "."), (";", ","), ("\t", ",")])
    encodings = st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32", "cp1252"])
    text = st.text("abc,;.\t 0123456789[]#\"'", max_size=12)
    comments = st.lists(st.tuples(st.integers(0, 30), st.one_of(st.just(""), text.map("#{}".format))), max_size=4)
    newline = st.sampled_from(["\n", "\r\n", "\r"])
    return st.builds(lambda m, n, e, c: Style(m[0], m[1], n, e, tuple(c)), marks, newline, encodings, comments)


def shifted(cell: str, power: int) -> str:
    return f"{Decimal(cell).scaleb(power):f}"


def respelt(sheet: Sheet, k: int, choice: int) -> Sheet:
    """The same column under another header, its numbers scaled to match."""
    options = SAME[sheet.header[k]]
    header, power = options[choice % len(options)]
    rows = tuple((*row[:k], shifted(row[k], power), *row[k + 1 :]) for row in sheet.rows)
    return Sheet(sheet.with_header(k, header).header, rows)


@st.composite
def rewritten(draw: st.DrawFn) -> dict[str, str | bytes]:
    """The folder in other words: units, order of columns, separators, decimal marks, encodings, comments."""
    files: dict[str, str | bytes] = {}
    for name, sheet in SHEETS.items():
        for k in draw(st.sets(st.integers(0, len(sheet.header) - 1))):
            sheet = respelt(sheet, k, draw(st.integers(0, 2)))
        style = draw(styles())
        encoding = "utf-8" if style.encoding == "cp1252" and draw(st.booleans()) else style.encoding
        sheet = sheet.in_order(draw(st.permutations(range(len(sheet.header)))))
        files[name] = replace(style, encoding=encoding).raw(sheet)
    return files


Damage = Callable[[Sheet, int, int, str], Sheet]
SAID = ("NaN", "nan", "inf", "-inf", "x", "--", "1e999", "1_0", "0x1F", "1.2.3", "12:30", "#N/A", "٣", "1 2", "−1")
WORDS = st.sampled_from(SAID)


DAMAGES: dict[str, Damage] = {
    "swap": lambda sheet, row, k, word: swap(sheet, row, (row + 1 + k) % len(sheet.rows)),
    "repeat": lambda sheet, row, k, word: replace(sheet, rows=(*sheet.rows[: row + 1], *sheet.rows[row:])),
    "say": lambda sheet, row, k, word: sheet.with_cell(row, k, word),
    "cut cell": lambda sheet, row, k, word: sheet.with_row(row, (*sheet.rows[row][:k], *sheet.rows[row][k + 1 :])),
    "add cell": lambda sheet, row, k, word: sheet.with_row(row, (*sheet.rows[row][:k], "1", *sheet.rows[row][k:])),
    "lose time": lambda sheet, row, k, word: sheet.with_cell(row, 0, ""),
    "double column": lambda sheet, row, k, word: sheet.in_order([*range(len(sheet.header)), k]),
    "lose unit": lambda sheet, row, k, word: sheet.with_header(k, sheet.header[k].split(" [")[0]),
    "wrong unit": lambda sheet, row, k, word: sheet.with_header(k, f"{sheet.header[k].split(' [')[0]} [kg]"),
    "misspell": lambda sheet, row, k, word: sheet.with_header(k, sheet.header[k][1:]),
    "lose header": lambda sheet, row, k, word: replace(sheet, header=sheet.rows[0], rows=sheet.rows[1:]),
    "one row": lambda sheet, row, k, word: replace(sheet, rows=sheet.rows[row : row + 1]),
}


def swap(sheet: Sheet, row: int, other: int) -> Sheet:
    return sheet.with_row(row, sheet.rows[other]).with_row(other, sheet.rows[row])


def neutral(files: dict[str, str | bytes]) -> None:
    note(repr(files))
    assert_same(reading(files), GOOD)


def harmful(damage: str, name: str, style: Style, row: int, k: int, word: str) -> None:
    sheet = SHEETS[name]
    spoilt = DAMAGES[damage](sheet, row, k % len(sheet.header), word)
    raw = replace(style, encoding="utf-8").raw(spoilt)
    found = outcome({name: raw})
    assert isinstance(found, MeasurementError), f"{damage} went unseen in\n{raw.decode()}"
    assert name in found.where


def lossy(name: str, style: Style, dropped: set[int], gaps: set[tuple[int, int]]) -> None:
    """Rows and cells that are missing leave all others as they were."""
    sheet = SHEETS[name]
    cells = {(row, 1 + k % (len(sheet.header) - 1)) for row, k in gaps}
    for row, k in cells:
        sheet = sheet.with_cell(row, k, "")
    kept = [row for row in range(len(sheet.rows)) if row not in dropped]
    rig = reading({name: style.raw(replace(sheet, rows=tuple(sheet.rows[row] for row in kept)))})
    before, after = (next(m for m in r.measurements if m.file == name) for r in (GOOD, rig))
    np.testing.assert_allclose(after.time, before.time[kept], rtol=1e-14)
    for k, channel in enumerate(before.channels, 1):
        there = [row for row in kept if (row, k) not in cells]
        np.testing.assert_allclose(after.channels[channel].value, before.channels[channel].value[there], rtol=1e-14)


def garbled(name: str, edits: list[tuple[str, float, bytes]]) -> None:
    """Any bytes anywhere: an error that explains itself, or a sound rig."""
    content = good()[name]
    raw = bytearray(content if isinstance(content, bytes) else content.encode())
    for kind, where, new in edits:
        k = int(where * len(raw))
        raw[k : k + (0 if kind == "insert" else len(new) or 1)] = b"" if kind == "delete" else new
    note(repr(bytes(raw)))
    found = outcome({name: bytes(raw)})
    if isinstance(found, Rig):
        assert_sound(found)


def careful(text: str) -> Table | None:
    """None where the careful reader refuses the text."""
    try:
        return parse_with_care(text, "a.csv")
    except MeasurementError:
        return None


def assert_both_read_the_same(text: str) -> Table | None:
    """What the fast reader made of it, if anything."""
    note(text)
    try:
        fast = parse_plain(text, "a.csv")
    except MeasurementError:
        assert careful(text) is None
        return None
    if fast is not None:
        slow = careful(text)
        assert slow is not None, "the fast reader took what the careful one refuses"
        assert (fast.header, fast.header_line) == (slow.header, slow.header_line)
        np.testing.assert_array_equal(fast.lines, slow.lines)
        np.testing.assert_array_equal(fast.cells.view(np.int64), slow.cells.view(np.int64))
    return fast


def fast_or_careful(
    name: str, style: Style, gaps: set[tuple[int, int]], edits: list[tuple[float, str]], word: str
) -> None:
    """One text in any style, with gaps, is read alike; and so it is when some of its letters are spoilt."""
    sheet = SHEETS[name]
    for row, k in gaps:
        sheet = sheet.with_cell(row, k % len(sheet.header), "")
    text = decode(style.raw(sheet), "a.csv")
    fast = assert_both_read_the_same(text)
    assert fast is not None or style.comments, "plain text was not read fast"
    for where, new in edits:
        k = int(where * len(text))
        text = text[:k] + new + text[k + 1 :]
    assert_both_read_the_same(text)
    spoilt = replace(style, encoding="utf-8").raw(SHEETS[name].with_cell(5, 1, word))
    assert_both_read_the_same(decode(spoilt, "a.csv"))


NAMES = st.sampled_from(sorted(SHEETS))
ROWS = st.integers(1, 28)
CELLS = st.sets(st.tuples(ROWS, st.integers(0, 3)), max_size=6)
LETTERS = st.text(',;.\t\n "#+-eE0123456789', max_size=3)
SIGNS = [bytes([sign]) for sign in b",;\t\n\r\"#.-[]e='\x00{ %"]
LONGER = [b"nan", b"inf", b"1e308", b"[tps]", b"0x", b"\xef\xbb\xbf", b"\xff\xfe", b"rad"]
PIECES = st.one_of(st.binary(min_size=1, max_size=4), st.sampled_from([*SIGNS, *LONGER]))
EDITS = st.lists(
    st.tuples(st.sampled_from(["insert", "delete", "replace"]), st.floats(0, 1), PIECES), min_size=1, max_size=5
)
SPELT = st.lists(st.tuples(st.floats(0, 1), LETTERS), max_size=5)
QUICK: dict[str, tuple[Callable, Callable]] = {
    "any bytes end in an error or a sound rig": (given(st.sampled_from(sorted(FILES)), EDITS), garbled),
    "the fast reader reads what the careful one reads": (given(NAMES, styles(), CELLS, SPELT, WORDS), fast_or_careful),
}
EVERY = QUICK | {
    "damage is seen": (
        given(st.sampled_from(sorted(DAMAGES)), NAMES, styles(), ROWS, st.integers(0, 3), WORDS),
        harmful,
    ),
    "other words, same rig": (given(rewritten()), neutral),
    "gaps move nothing else": (given(NAMES, styles(), st.sets(ROWS, max_size=6), CELLS), lossy),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_every_damage_is_seen_in_every_column(damage: str) -> None:
    """And every word in every column, one of seven hundred and twenty draws of `harmful`."""
    for name, sheet in SHEETS.items():
        for k, word in product(range(len(sheet.header)), SAID if damage == "say" else SAID[:1]):
            harmful(damage, name, Style(",", ".", "\n", "utf-8", ()), 7, k, word)


@pytest.mark.parametrize(("strategy", "check"), QUICK.values(), ids=QUICK)
def test_in_some_examples(strategy: Callable, check: Callable) -> None:
    BARE(strategy(check))()


@pytest.mark.slow
@pytest.mark.parametrize(("strategy", "check"), EVERY.values(), ids=EVERY)
def test_thoroughly(strategy: Callable, check: Callable) -> None:
    THOROUGH(strategy(check))()
