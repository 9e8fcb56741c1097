"""Units are found and fetched wherever they lie, and a rig.toml is laid over what is common."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import fsspec
import pytest

from etcfit.errors import MeasurementError, UsageError
from etcfit.fleets.config import read_fleet
from etcfit.fleets.folder import local_copy, refuse_inside, text_of, units_of
from etcfit.rig.reader import read_folder
from folders import TOML, response


@pytest.fixture
def memory() -> Iterator[str]:
    """A fleet in an object store: no real folders, only keys with slashes."""
    system = fsspec.filesystem("memory")
    for unit in ("u2", "u1"):
        system.pipe(f"/line/{unit}/rig.toml", TOML.encode())
        system.pipe(f"/line/{unit}/response/1.csv", response(seed=len(unit)).text().encode())
        system.pipe(f"/line/{unit}/response/.hidden.csv", b"x")
    system.pipe("/line/fleet.toml", b'[fleet]\nname = "far"\n')
    yield "memory://line"
    system.rm("/line", recursive=True)


def local(folder: Path) -> Path:
    for unit in ("u1", "u2"):
        (folder / unit / "response").mkdir(parents=True)
        (folder / unit / "response/1.csv").write_text(response().text())
        (folder / unit / "rig.toml").write_text(TOML)
    return folder


def test_units_of_this_machine_are_their_folders_and_not_copied(tmp_path: Path) -> None:
    (local(tmp_path) / "notes.txt").write_text("x")
    assert units_of(tmp_path) == ("u1", "u2")
    assert text_of(tmp_path, "fleet.toml") is None
    with local_copy(tmp_path, "u1") as folder:
        assert folder == tmp_path / "u1"


def test_units_elsewhere_are_fetched_for_as_long_as_they_are_needed(memory: str) -> None:
    assert units_of(memory) == ("u1", "u2")
    found = read_fleet(f"{memory}/")
    assert (found.name, found.location) == ("far", memory)
    with local_copy(found.location, "u2") as folder:
        rig = read_folder(folder, found.common)
        assert folder.name == "u2"
        assert rig.measurements[0].file == "response/1.csv"
        assert sorted(p.name for p in folder.rglob("*") if p.is_file()) == ["1.csv", "rig.toml"]
    assert not folder.exists()


def test_a_file_address_is_the_folder_it_names(tmp_path: Path) -> None:
    local(tmp_path)
    assert units_of(f"file://{tmp_path}") == ("u1", "u2")
    with local_copy(f"file://{tmp_path}", "u1") as folder:
        assert (folder / "rig.toml").read_text() == TOML


def test_what_is_not_there_is_said(tmp_path: Path, memory: str) -> None:
    with pytest.raises(MeasurementError, match="no such folder"):
        units_of(tmp_path / "none")
    with pytest.raises(MeasurementError, match="no folder in it"):
        units_of(tmp_path)
    with pytest.raises(MeasurementError, match="memory://nowhere: nothing is there"):
        units_of("memory://nowhere")
    with pytest.raises(MeasurementError, match="no file in it"), local_copy(memory, "u9"):
        pass
    with pytest.raises(UsageError, match="gopher://x cannot be opened"):
        units_of("gopher://x")


def test_a_message_about_a_unit_elsewhere_names_its_address_and_no_scratch_folder(memory: str) -> None:
    with pytest.raises(MeasurementError) as wrong, local_copy(memory, "u1") as folder:
        raise MeasurementError(f"{folder}/rig.toml:3", "found 1.", "It must be 2.", f"Mend {folder}.")
    assert str(wrong.value) == f"{memory}/u1/rig.toml:3: found 1. It must be 2. Mend {memory}/u1."
    with pytest.raises(OSError, match="gone") as lost, local_copy(memory, "u1") as folder:
        raise OSError(2, "gone", str(folder / "a.csv"))
    assert lost.value.filename == f"{memory}/u1/a.csv"


@pytest.mark.parametrize(("out", "inside"), [("line", True), ("line/u1/run", True), ("line/../line/x", True),
                                             ("runs", False), ("line_2", False), ("line/.runs/a", False)])  # fmt: skip
def test_a_run_folder_must_lie_outside_of_the_fleet(tmp_path: Path, out: str, inside: bool) -> None:
    if not inside:
        return refuse_inside(tmp_path / "line", tmp_path / out)
    with pytest.raises(UsageError, match=r"is inside the fleet .* --out runs/line"):
        refuse_inside(tmp_path / "line", tmp_path / out)
