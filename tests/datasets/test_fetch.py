"""Fetching, with a tiny made-up data set: what is refused, what is checked, what is left behind."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path

import pytest

from etcfit.datasets import DATASETS, Dataset, Source, fetch
from etcfit.errors import MeasurementError, UsageError

CONTENT = b"three words here"
FILES = {"rig.toml", "response/three.csv", "response/words.csv", "response/here.csv"}
SOURCE = Source("tiny/words.txt", "https://example.invalid/words.txt", hashlib.sha256(CONTENT).hexdigest())


def _one_file_a_word(files: Mapping[str, Path]) -> dict[str, str]:
    words = files[SOURCE.local].read_text().split()
    return {"rig.toml": "[rig]\n", **{f"response/{word}.csv": word for word in words}}


@pytest.fixture
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of local copies that holds the published file of the data set `tiny`."""
    monkeypatch.setitem(DATASETS, "tiny", Dataset("tiny", "a made-up data set", (SOURCE,), _one_file_a_word))
    monkeypatch.delenv("ETCFIT_DATA", raising=False)
    copy = tmp_path / "data" / SOURCE.local
    copy.parent.mkdir(parents=True)
    copy.write_bytes(CONTENT)
    return tmp_path / "data"


@pytest.fixture(autouse=True)
def _no_network(monkeypatch: pytest.MonkeyPatch) -> None:
    def offline(*args: object, **kwargs: object) -> str:
        raise ConnectionError("no network in tests")

    monkeypatch.setattr("pooch.retrieve", offline)


def left_in(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


def test_folder_is_written(data: Path, tmp_path: Path) -> None:
    to = tmp_path / "new" / "tiny"
    assert fetch("tiny", to, data) == to
    assert left_in(to.parent) == {f"tiny/{name}" for name in FILES}


@pytest.mark.parametrize(("variable", "argument"), [("data", None), ("nowhere", "data")])
def test_local_copies_are_where_the_argument_says_else_the_variable_and_an_empty_folder_is_filled(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, variable: str, argument: str | None
) -> None:
    (tmp_path / "to").mkdir()
    monkeypatch.setenv("ETCFIT_DATA", str(tmp_path / variable))
    assert left_in(fetch("tiny", tmp_path / "to", tmp_path / argument if argument else None)) == FILES


def test_a_folder_with_something_in_it_is_left_as_it_is(data: Path, tmp_path: Path) -> None:
    (tmp_path / "to").mkdir()
    (tmp_path / "to" / "mine.txt").write_text("precious")
    with pytest.raises(UsageError, match="not an empty folder"):
        fetch("tiny", tmp_path / "to", data)
    assert left_in(tmp_path / "to") == {"mine.txt"}


def test_a_local_copy_that_is_not_the_published_file(data: Path, tmp_path: Path) -> None:
    (data / SOURCE.local).write_bytes(CONTENT + b"!")
    with pytest.raises(MeasurementError, match=SOURCE.sha256) as error:
        fetch("tiny", tmp_path / "to", data)
    assert error.value.where == str(data / SOURCE.local)
    assert not (tmp_path / "to").exists()


def test_without_a_copy_and_without_a_network_the_cure_is_named(data: Path, tmp_path: Path) -> None:
    (data / SOURCE.local).unlink()
    with pytest.raises(MeasurementError, match=r"ETCFIT_DATA") as error:
        fetch("tiny", tmp_path / "to", data)
    assert error.value.where == SOURCE.url
    assert not (tmp_path / "to").exists()


def test_a_conversion_that_breaks_midway_leaves_nothing(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written: list[Path] = []
    write_text = Path.write_text

    def disk_full(path: Path, text: str, **kwargs: str) -> int:
        if len(written) == 2:
            raise OSError(28, "No space left on device")
        written.append(path)
        return write_text(path, text, **kwargs)

    monkeypatch.setattr(Path, "write_text", disk_full)
    with pytest.raises(OSError, match="No space"):
        fetch("tiny", tmp_path / "out" / "to", data)
    assert len(written) == 2
    assert list((tmp_path / "out").iterdir()) == []


def test_unknown_name_lists_the_known_ones(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"kassel-throttle, wintec-throttle, emps, bam-xl330"):
        fetch("kassel", tmp_path / "to")
