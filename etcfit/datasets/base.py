"""What a public data set is: where its files lie, and how they become a measurement folder."""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import MeasurementError, UsageError
from ..files import require_writable

VARIABLE = "ETCFIT_DATA"  # names a folder of local copies


@dataclass(frozen=True)
class Source:
    """One published file, pinned to a commit and to its content."""

    local: str  # path below a folder of local copies
    url: str  # public address
    sha256: str  # of the content, hexadecimal


@dataclass(frozen=True)
class Dataset:
    """A public data set."""

    name: str  # what `etcfit fetch` calls it
    title: str  # one line
    sources: tuple[Source, ...]  # every published file it is made from
    # local path -> file, to path in the measurement folder -> text; writes nothing itself
    convert: Callable[[Mapping[str, Path]], Mapping[str, str]]


def on_github(repo: str, commit: str, path: str) -> str:
    """The public address of a file of a GitHub repository at one commit."""
    return f"https://raw.githubusercontent.com/{repo}/{commit}/{path}"


def csv_text(remark: str, columns: Mapping[str, np.ndarray]) -> str:
    """A trace as CSV: a comment, the header, and 12 significant digits a cell (more than any sensor here has)."""
    rows = np.column_stack(list(columns.values()))
    lines = [",".join(f"{cell:.12g}" for cell in row) for row in rows]
    return "\n".join([f"# {remark}", ",".join(columns), *lines, ""])


def licence_text(dataset: str) -> str:
    """The licence that came with a data set, word for word."""
    return (Path(__file__).parent / "licences" / f"{dataset}.txt").read_text(encoding="utf-8")


def obtain(source: Source, data: Path | None = None) -> Path:
    """The file, checked against its SHA-256.

    Args:
        data: folder of local copies; without it, the one that the environment variable ETCFIT_DATA names.

    Raises:
        MeasurementError: the local copy is not the published file, or the download failed.
    """
    folder = data or (Path(named) if (named := os.environ.get(VARIABLE)) else None)
    copy = folder / source.local if folder else None
    if copy and copy.is_file():
        found = hashlib.sha256(copy.read_bytes()).hexdigest()
        if found != source.sha256:
            raise MeasurementError(str(copy), f"its SHA-256 is {found}.",
                                   f"It must be {source.sha256}, that of the published file.",
                                   f"Delete the copy, or replace it with {source.url}.")  # fmt: skip
        return copy
    import pooch

    pooch.get_logger().setLevel("WARNING")  # the command line shows its own progress
    try:
        return Path(pooch.retrieve(source.url, known_hash=f"sha256:{source.sha256}", path=pooch.os_cache("etcfit")))
    except (OSError, ValueError) as error:  # no network, no such page; a content that is not the published one
        raise MeasurementError(source.url, f"the download failed: {error}.", "The published file is required.",
                               f"Try again, or put a copy at FOLDER/{source.local} and name FOLDER with --data or in "
                               f"{VARIABLE}.") from error  # fmt: skip


def refuse_to_overwrite(to: Path) -> None:
    """Refuse a folder that cannot be written, or has files in it.

    Raises:
        UsageError: `to` is a file, or a folder with something in it.
        OSError: no file can be written there.
    """
    if to.exists() and not (to.is_dir() and not any(to.iterdir())):
        raise UsageError(f"{to} is already there and not an empty folder. Remove it, or name another.")
    require_writable(to)


@contextmanager
def whole_folder(to: Path) -> Iterator[Path]:
    """A draft next to `to`, to be filled, then renamed: a reader sees all of the folder or none of it.

    Raises:
        UsageError: it holds something already.
    """
    refuse_to_overwrite(to)
    to.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=to.parent, prefix=f".{to.name}-") as scratch:
        draft = Path(scratch) / to.name
        draft.mkdir()
        yield draft
        if to.is_dir():
            to.rmdir()  # empty, as checked above; renaming onto a folder fails on some systems
        draft.rename(to)


def write_files(folder: Path, files: Mapping[str, str]) -> None:
    """Write every file; path inside the folder -> text."""
    for path, text in files.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(text, encoding="utf-8")


def write_folder(to: Path, files: Mapping[str, str]) -> Path:
    """Write every file, or none of them."""
    with whole_folder(to) as draft:
        write_files(draft, files)
    return to


def read_vectors(path: Path, *names: str) -> tuple[np.ndarray, ...]:
    """The named variables, each flattened, shape (n,), in the units of the file."""
    import scipy.io

    content = scipy.io.loadmat(path)
    return tuple(np.asarray(content[name], dtype=float).ravel() for name in names)
