"""What `fit` refuses `check` refuses too: exit status 1 and the same message on stderr, never a traceback."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

import folders
from etcfit.cli import app
from etcfit.errors import MeasurementError
from etcfit.rig.reader import read_folder
from etcfit.rig.user_text import escaped

SYMBOLS = ("R_a", "L_a", "K_b", "J_m", "J_L", "B_m", "B_L", "K_s", "T_PL", "T_f")
EFFECTS = "\n[model]\neffects = {}\n"
REFUSED = {
    "every parameter fixed": (
        "\n[parameters]\n" + "".join(f"{s} = {{ fixed = 0.01 }}\n" for s in SYMBOLS),
        "rig.toml: [parameters]: nothing is left to fit: every parameter is fixed or tied. At least one must be free.",
    ),
    "no such effect": (EFFECTS.format("['gravity_lode']"), "rig.toml: [model] effects: names 'gravity_lode'."),
    "no such parameter": ("\n[parameters]\nK_x = 0.02\n", "rig.toml: [parameters]: names 'K_x'."),
    "tied to nothing": ("\n[parameters]\nK_m = 'K_x'\n", "rig.toml: [parameters]: ties K_m to 'K_x'."),
    "negative": ("\n[parameters]\nR_a = -1.5\n", "rig.toml: [parameters]: R_a is -1.5 ohm."),
    "an effect twice": (
        EFFECTS.format("['gravity_load', 'gravity_load']"),
        "rig.toml: [model] effects: names 'gravity_load' 2 times. An effect acts once. Delete the others.",
    ),
    "nothing but held out": ("\n[holdout]\nfiles = ['response/1.csv']\n", "has no trace that can be fitted."),
}


def invoke(*words: str) -> Result:
    return CliRunner().invoke(app, [*words, "--quiet"])


def both(folder: Path) -> list[Result]:
    return [invoke("check", str(folder)), invoke("fit", str(folder), "--out", str(folder.parent / "run"))]


@pytest.mark.parametrize(("addition", "message"), REFUSED.values(), ids=REFUSED.keys())
def test_check_refuses_what_fit_refuses(tmp_path: Path, addition: str, message: str) -> None:
    files = {"rig.toml": folders.TOML + addition, "response/1.csv": folders.response().text()}
    done = both(folders.write(tmp_path / "rig", files))
    for each in done:
        assert each.exit_code == 1
        assert message in each.stderr
    assert done[0].stderr == done[1].stderr
    assert not (tmp_path / "run").exists()


def test_traces_that_cannot_be_fitted_are_shown_all_the_same(tmp_path: Path) -> None:
    toml = folders.TOML + "\n[holdout]\nfiles = ['response/1.csv']\n"
    folder = folders.write(tmp_path, {"rig.toml": toml, "response/1.csv": folders.response().text()})
    assert "response/1.csv" in invoke("check", str(folder)).stdout


NO_UTF8 = "the name is no UTF-8."
ODD = {
    "trace": ("response/", b"gr\xf6\xdfe.csv", r"response/gr\xf6\xdfe.csv", NO_UTF8),
    "folder of traces": ("", b"r\xe9ponse/1.csv", r"r\xe9ponse", NO_UTF8),
    "loose trace": ("", b"1\xff.csv", r"1\xff.csv", NO_UTF8),
    "a line end": ("response/", b"1\n.csv", "response/1 .csv", "U+000A in the name."),
    "an escape": ("response/", b"1\x1b[31m.csv", "response/1(U+001B)[31m.csv", "U+001B in the name."),
    "a mark of direction": ("", "resp\u202eesno/1.csv".encode(), "resp(U+202E)esno", "U+202E in the name."),
}


@pytest.mark.parametrize(("place", "name", "shown", "said"), ODD.values(), ids=ODD.keys())
def test_a_name_that_is_no_utf8_or_hides_something_is_refused_and_written_out(
    tmp_path: Path, place: str, name: bytes, shown: str, said: str
) -> None:
    folder = folders.changed(tmp_path / "rig", {})
    write_bytes(os.fsencode(folder / place) + b"/" + name, folders.response().text().encode())
    for done in both(folder):
        assert done.exit_code == 1
        assert done.stderr.startswith(f"etcfit: {folder}/{shown}: {said} ")
        assert "Rename it" in done.stderr
        assert done.stdout == ""


def test_so_is_the_folder_itself(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = Path(os.fsdecode(os.fsencode(tmp_path) + b"/b\xe4nch"))
    try:
        folders.changed(folder, {})
    except OSError:
        pytest.skip("this file system takes UTF-8 alone")
    with pytest.raises(MeasurementError, match=r"b\\xe4nch: the name is no UTF-8") as caught:
        read_folder(folder)
    str(caught.value).encode("utf-8")
    monkeypatch.chdir(folder)
    with pytest.raises(MeasurementError, match=r"^b\\xe4nch: the name is no UTF-8"):
        read_folder(".")


def test_names_in_any_script_are_fine(tmp_path: Path) -> None:
    name = "response/größe Ω 節.csv"
    rig = read_folder(folders.changed(tmp_path, {name: folders.response(seed=9).text()}))
    assert name in [m.file for m in rig.measurements]
    assert escaped(name) == name


def test_so_is_a_log_from_the_car(tmp_path: Path) -> None:
    write_bytes(os.fsencode(tmp_path) + b"/drive/\xe9t\xe9.csv", b"time [s],position [%]\n0,1\n1,2\n")
    done = invoke("drive", str(tmp_path))
    assert done.exit_code == 1
    assert r"drive/\xe9t\xe9.csv: the name is no UTF-8" in done.stderr


def write_bytes(path: bytes, content: bytes) -> None:
    try:
        os.makedirs(os.path.dirname(path), exist_ok=True)
        with open(path, "wb") as file:
            file.write(content)
    except OSError:
        pytest.skip("this file system takes UTF-8 alone")
