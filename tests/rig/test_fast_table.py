"""The fast reader of plain tables and the careful one read the same numbers, bit for bit, or the fast one declines."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from etcfit.errors import MeasurementError
from etcfit.rig.fast_table import fast_cells
from etcfit.rig.table import HUGE, Table, parse, parse_plain, parse_with_care
from folders import Sheet, response

R = response(60)
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
        fast = fast_cells(f"1,{cell}\n1.5,2\n", ",", 2, HUGE)
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
