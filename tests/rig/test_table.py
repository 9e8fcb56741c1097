"""One table, however it is written; and what is no table, by line.

The fast reader of plain tables and the careful one read the same numbers, bit for bit, or the fast one declines.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from etcfit.errors import MeasurementError
from etcfit.rig.reader import read_folder
from etcfit.rig.rows import fast_cells
from etcfit.rig.table import Table, parse, parse_plain, parse_with_care
from folders import Sheet, changed, only_response, response
from mistakes import assert_refused

R = response()

ENCODED = {
    "German Excel": R.text(";", ",", "\r\n").encode("cp1252"),
    "Excel says sep": ("sep=;\r\n" + R.text(";", ",", "\r\n")).encode("utf-8-sig"),
    "tabs, UTF-16": R.text("\t", ".", "\r\n").encode("utf-16"),
    "tabs, decimal comma": R.text("\t", ",").encode(),
    "UTF-16 without BOM": R.text().encode("utf-16-le"),
    "UTF-32": R.text().encode("utf-32"),
    "old Mac": R.text(newline="\r").encode(),
    "no last newline": R.text().rstrip().encode(),
    "comments": ("# rig 3\n\n" + R.text().replace("\n", "\n  # pause; , \n", 5)).encode(),
    "quoted": "\n".join(",".join(f'"{c}"' for c in line.split(",")) for line in R.text().split("\n")[:-1]).encode(),
    "blanks": R.text().replace(",", " , ").encode(),
    "empty rows and columns": (R.text().replace("\n", ",,\n") + ",,,,,\n,,,,,\n").encode(),
}


@pytest.mark.parametrize("raw", ENCODED.values(), ids=ENCODED.keys())
def test_the_same_table_however_it_is_written(tmp_path: Path, raw: bytes) -> None:
    m = next(m for m in read_folder(changed(tmp_path, {"response/1.csv": raw})).measurements if m.test == "response")
    np.testing.assert_allclose(m.time, R.column(0) * 1e-3, rtol=1e-14)
    np.testing.assert_array_equal(m.channels["voltage"].value, R.column(1))
    assert sorted(m.channels) == ["current", "position", "voltage"]


def wrong_rows(k: int, text: str) -> dict[str, str]:
    lines = R.text().split("\n")
    lines[k] = text
    return {"response/1.csv": "\n".join(lines)}


WRONG: dict[str, tuple[Mapping[str, str | bytes], str]] = {
    "failed formula": (only_response(R.with_cell(9, 0, "#NV")), r"1\.csv:11: '#NV' in column 'time \[ms\]'"),
    "text": (only_response(R.with_cell(9, 1, "n/a")), r"1\.csv:11: 'n/a' in column 'voltage \[V\]'"),
    "NaN": (only_response(R.with_cell(9, 1, "NaN")), r"1\.csv:11: 'NaN' in column.*leave it empty"),
    "inf": (only_response(R.with_cell(9, 1, "-inf")), r"1\.csv:11: '-inf' in column"),
    "too large": (only_response(R.with_cell(9, 1, "1e999")), r"1\.csv:11: '1e999' in column"),
    "underscore": (only_response(R.with_cell(9, 1, "1_0")), r"1\.csv:11: '1_0' in column"),
    "comments count": ({"response/1.csv": "#a\n\n" + R.with_cell(9, 1, "x").text()}, r"1\.csv:13: 'x' in column"),
    "row too long": (wrong_rows(5, "1,2,3,4,5"), r"1\.csv:6: 5 cells found\. The header has 4"),
    "row too short": (wrong_rows(5, "1,2,3"), r"1\.csv:6: 3 cells found"),
    "decimal comma in commas": (
        {"response/1.csv": R.text(",", ",").replace(R.text().split("\n")[0], ",".join(R.header))},
        r"1\.csv:2: 8 cells.*Decimal commas need ';'",
    ),
    "thousands": (
        {"response/1.csv": R.with_cell(3, 2, "1,800.5").text(";")},
        r"1\.csv:5: '1,800\.5', while other cells",
    ),
    "thousands or decimals": (
        {"response/1.csv": "time [ms];voltage [V]\n1,000;1,000\n2,000;2,000\n"},
        r"1\.csv:2: '1,000': the ',' may be",
    ),
    "broken quotes": (wrong_rows(5, '"1,2,3,4'), r"1\.csv:6: broken quotes"),
    "empty": ({"response/1.csv": ""}, r"1\.csv: the file is empty"),
    "comments only": ({"response/1.csv": "# nothing\n\n"}, r"1\.csv: the file is empty"),
    "header only": ({"response/1.csv": R.text().split("\n")[0]}, r"1\.csv:1: header only"),
    "no header": ({"response/1.csv": R.text().split("\n", 1)[1]}, r"1\.csv:1: numbers where the header must be"),
    "one column": ({"response/1.csv": "time [s]\n1\n2\n"}, r"1\.csv:1: only one column"),
    "two separators": ({"response/1.csv": "time [s],a;voltage [V]\n1,2;3\n2,3;4\n"}, r"1\.csv:1: both ',' and ';'"),
    "nameless column": ({"response/1.csv": R.text().replace("voltage [V]", "")}, r"1\.csv:2: column 2 holds numbers"),
    "binary": ({"response/1.csv": bytes(range(256)) * 4}, r"1\.csv.*must be text"),
    "spreadsheet": ({"response/1.csv": b"PK\x03\x04\x14\x00\x06\x00\x08\x00\x00\x00!\x00"}, r"must be text"),
    "cut UTF-16": ({"response/1.csv": R.text().encode("utf-16")[:-1]}, r"must be text"),
}


@pytest.mark.parametrize(("changes", "message"), WRONG.values(), ids=WRONG.keys())
def test_each_mistake_has_its_own_message(tmp_path: Path, changes: Mapping[str, str | bytes], message: str) -> None:
    assert_refused(tmp_path, changes, message)


ROWS = "1.5,2.25\n" * 30
TEXT = "time [s],voltage [V]\n" + ROWS


def assert_equal(fast: Table, careful: Table) -> None:
    assert (fast.header, fast.header_line) == (careful.header, careful.header_line)
    np.testing.assert_array_equal(fast.lines, careful.lines)
    assert fast.cells.shape == careful.cells.shape
    np.testing.assert_array_equal(fast.cells.view(np.int64), careful.cells.view(np.int64))  # -0.0 and NaN too


def gappy(sheet: Sheet) -> Sheet:
    return sheet.with_cell(3, 1, "").with_cell(7, 3, "").with_cell(7, 0, "").with_cell(59, 3, "")


PLAIN = {
    "commas": R.text(),
    "semicolons": R.text(";"),
    "decimal commas": R.text(";", ","),
    "tabs and decimal commas": R.text("\t", ","),
    "comments above": "# rig 3\n\n  # pause; ,\n" + R.text(),
    "Excel says sep": "sep=;\n" + R.text(";"),
    "gaps": gappy(R).text(),
    "gaps among tabs": gappy(R).text("\t"),
    "quoted header": ",".join(f'"{name}"' for name in R.header) + R.text()[len(",".join(R.header)) :],
    "blanks about the cells": R.text().replace(",", " , "),
    "trailing separators": R.text().replace("\n", ",\n"),
    "empty rows": R.text() + ",,,\n,,,\n",
    "blank lines below": R.text() + "\n\n\n",
    "no last newline": R.text().rstrip(),
    "integers": "time [s],voltage [V]\n" + "".join(f"{k},{k * 10**17}\n" for k in range(40)),
    "exponents": "time [s],voltage [V]\n" + "".join(f"{k}e-3,-{k}.E+2\n" for k in range(40)),
    "many digits": "time [s],voltage [V]\n" + "".join(f"{k / 7:.25f},{1 / (k + 3):.40e}\n" for k in range(40)),
    "signed zeros": TEXT.replace("2.25", "-0.0"),
    "smallest": TEXT.replace("2.25", "4.9406564584124654e-324"),
}


@pytest.mark.parametrize("text", PLAIN.values(), ids=PLAIN.keys())
def test_a_plain_table_is_read_fast_and_exactly(text: str) -> None:
    fast = parse_plain(text, "a.csv")
    assert fast is not None
    assert_equal(fast, parse_with_care(text, "a.csv"))


# text that the careful reader takes or refuses; either way the fast one has nothing to say
LEFT = {
    "comment among the rows": TEXT + "# pause\n" + ROWS,
    "blank line among the rows": TEXT + "\n" + ROWS,
    "quoted number": TEXT + '"3.5",1\n',
    "few rows": "time [s],voltage [V]\n1,2\n2,3\n",
    "much above the header": "# note\n" * 300 + TEXT,
    "word": TEXT + "n/a,1\n",
    "NaN": TEXT + "nan,1\n",
    "infinite": TEXT + "1e999,1\n",
    "huge": TEXT + "1e101,1\n",
    "underscore": TEXT + "1_0,1\n",
    "other digits": TEXT + "٣,1\n",
    "short row": TEXT + "1\n",
    "long row": TEXT + "1,2,3\n",
    "a short row and a long one": TEXT + "1\n1,2,3\n",
    "two numbers in a cell": TEXT + "1 2,3\n",
    "thousands": "time [s];voltage [V]\n" + "1,000;2,000\n" * 30,
    "thousands and decimals": "time [s];voltage [V]\n" + "1.5;2.5\n" * 30 + "1,800.5;3\n",
    "no header": ROWS,
    "one column": "time [s]\n" + "1\n" * 30,
    "two separators": "time [s],a;voltage [V]\n" + "1,2;3\n" * 30,
    "empty": "",
}


@pytest.mark.parametrize("text", LEFT.values(), ids=LEFT.keys())
def test_what_is_not_plain_is_left_to_the_careful_reader(text: str) -> None:
    assert parse_plain(text, "a.csv") is None


def test_every_short_cell_is_read_as_the_careful_reader_reads_it() -> None:
    """All cells of up to four characters that the fast reader's alphabet can spell."""
    cells = ["".join(letters) for n in range(5) for letters in product("07.e+- ", repeat=n)]
    taken = 0
    for cell in cells:
        fast = fast_cells(f"1,{cell}\n1.5,2\n", ",", 2)
        if fast is not None:
            taken += 1
            careful = parse_with_care(f"time [s],voltage [V]\n1,{cell}\n1.5,2\n", "a.csv").cells
            np.testing.assert_array_equal(fast.view(np.int64), careful.view(np.int64), repr(cell))
    assert taken > 50


def test_a_long_file_loses_no_message() -> None:
    """A million characters with one mistake at their end: the line is named."""
    text = "# long\n" + TEXT + ROWS * 4000
    lines = text.count("\n")
    assert len(parse(text, "a.csv").lines) == lines - 2
    for row, message in {"1.5,x\n": r"'x' in column 'voltage \[V\]'", "1,2,3\n": "3 cells found"}.items():
        with pytest.raises(MeasurementError, match=rf"a\.csv:{lines + 1}: {message}"):
            parse(text + row, "a.csv")


def test_numbers_without_a_name_are_refused_at_any_length() -> None:
    with pytest.raises(MeasurementError, match=r"a\.csv:2: column 2 holds numbers"):
        parse("time [s],,voltage [V]\n" + "1,2,3.5\n" * 50_000, "a.csv")
