"""Finds and copies the folders of units: on this machine, or at any address that fsspec opens (s3://, memory://,
file://)."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from shlex import quote
from typing import Any

from ..errors import MeasurementError, UsageError, require_extra
from ..rig.user_text import refuse_foreign_names


def is_url(location: str | Path) -> bool:
    """Whether a location is an address that fsspec must open."""
    return isinstance(location, str) and "://" in location


def units_of(location: str | Path) -> tuple[str, ...]:
    """Names of the units, in order: every folder in FLEET whose name does not begin with a dot.

    Raises:
        MeasurementError: there is no such folder, or none in it.
    """
    folder = Path(location)
    if is_url(location):
        names = _folders_at(str(location))
    elif folder.is_dir():
        names = [each.name for each in folder.iterdir() if each.is_dir()]
    else:
        raise MeasurementError(str(location), "no such folder.", "A fleet is a folder of measurement folders.",
                               "Check the path.")  # fmt: skip
    units = tuple(sorted(name for name in names if not name.startswith(".")))
    if not units:
        raise MeasurementError(str(location), "no folder in it.", "A fleet has a measurement folder for each unit.",
                               "Put them there: FLEET/<unit>/rig.toml, FLEET/<unit>/response/1.csv.")  # fmt: skip
    refuse_foreign_names(str(location), *units)
    return units


def text_of(location: str | Path, name: str) -> bytes | None:
    """The bytes of a file in the fleet's own folder; None where there is none."""
    if not is_url(location):
        path = Path(location) / name
        return path.read_bytes() if path.is_file() else None
    system, root = _system(str(location))
    try:
        return system.cat_file(f"{root}/{name}")
    except FileNotFoundError:
        return None


@contextmanager
def local_copy(location: str | Path, unit: str) -> Iterator[Path]:
    """A unit's folder as a path of this machine: the folder itself where it is local, otherwise a temporary copy.

    The copy has the name of the unit, because a rig without a name takes that of its folder.

    Raises:
        MeasurementError: there is no such folder; or the block's own, with the unit's address for the copy's path.
        OSError: it cannot be fetched; likewise.
    """
    if not is_url(location):
        yield Path(location) / unit
        return
    address = address_of(location, unit)
    with tempfile.TemporaryDirectory(prefix="etcfit-") as scratch:
        folder = Path(scratch) / unit
        # fetch the files that a reader may need: those of the folder itself and of the folders in it
        system, root = _system(address)
        files = [file for file in system.find(root, maxdepth=2) if not PurePosixPath(file).name.startswith(".")]
        if not files:
            raise MeasurementError(address, "no file in it.", "A measurement folder is required.", "Check the address.")
        for file in files:
            to = folder / PurePosixPath(file).relative_to(root)
            to.parent.mkdir(parents=True, exist_ok=True)
            system.get_file(file, str(to))
        try:
            yield folder
        except MeasurementError as error:
            parts = (error.where, error.found, error.required, error.mend)
            raise MeasurementError(*(part.replace(str(folder), address) for part in parts)) from None
        except OSError as error:
            if error.filename is None:
                raise
            named = str(error.filename).replace(str(folder), address)
            raise type(error)(error.errno, error.strerror, named) from None


def address_of(location: str | Path, unit: str) -> str:
    """The path or address of a unit, as the user knows it."""
    return f"{str(location).rstrip('/')}/{unit}"


def refuse_inside(location: str | Path, run: Path) -> None:
    """Raise a UsageError where a run folder is inside the fleet: every folder there is a unit, every file may be a
    trace."""
    if is_url(location):
        return
    fleet, target = Path(location).resolve(), run.resolve()
    if not target.is_relative_to(fleet):
        return
    below = target.relative_to(fleet).parts
    if not below or not below[0].startswith("."):
        raise UsageError(f"{run} is inside the fleet {location}, where every folder is a unit. Name a run folder "
                         f"outside it: --out {quote(str(Path('runs') / fleet.name))}.")  # fmt: skip


def _folders_at(url: str) -> list[str]:
    system, root = _system(url)
    try:
        found = system.ls(root, detail=True)
    except FileNotFoundError:
        raise MeasurementError(url, "nothing is there.", "A fleet is a folder of measurement folders.",
                               "Check the address.") from None  # fmt: skip
    return [PurePosixPath(each["name"].rstrip("/")).name for each in found if each["type"] == "directory"]


def _system(url: str) -> tuple[Any, str]:
    """The file system of an address, and the path in it; a UsageError where no library opens such an address."""
    require_extra("fleet", url, "fsspec")
    import fsspec

    try:
        system, root = fsspec.core.url_to_fs(url)
    except (ImportError, ValueError) as error:
        raise UsageError(f"{url} cannot be opened: {error}") from error
    return system, str(root).rstrip("/")
