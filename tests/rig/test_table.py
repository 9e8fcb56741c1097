"""One table, however it is written; and what is no table, by line."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from etcfit.rig.reader import read_folder
from folders import back_emf, changed, inductance, only_response, resistance, response
from mistakes import assert_refused

R, BACK_EMF, RESISTANCE, INDUCTANCE = response(), back_emf(), resistance(), inductance()

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
