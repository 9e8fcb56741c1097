"""A folder that is written whole or not at all."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from ..errors import UsageError
from ..files import require_writable


def refuse_to_overwrite(to: Path) -> None:
    """A folder can be written, and nobody's files are replaced.

    Raises:
        UsageError: `to` is a file, or a folder with something in it.
        OSError: no file can be written there.
    """
    if to.exists() and not (to.is_dir() and not any(to.iterdir())):
        raise UsageError(f"{to} is already there and not an empty folder. Remove it, or name another.")
    require_writable(to)


@contextmanager
def whole_folder(to: Path) -> Iterator[Path]:
    """A draft beside `to`, to be filled, then renamed: a reader sees all of the folder or none of it.

    Args:
        to: the folder; must not exist, or be empty.
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
    """Write every file, or none of them.

    Args:
        to: the folder; must not exist, or be empty.
        files: path inside the folder -> text.
    """
    with whole_folder(to) as draft:
        write_files(draft, files)
    return to
