"""A folder that is written whole or not at all."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path

from ..errors import UsageError


def refuse_to_overwrite(to: Path) -> None:
    """Nobody's files are replaced.

    Raises:
        UsageError: `to` is a file, or a folder with something in it.
    """
    if to.is_dir() and not any(to.iterdir()):
        return
    if to.exists():
        raise UsageError(f"{to} is already there and not an empty folder. Remove it, or name another.")


def write_folder(to: Path, files: Mapping[str, str]) -> Path:
    """Write every file beside `to`, then rename: a reader sees all of the folder or none of it.

    Args:
        to: the folder; must not exist, or be empty.
        files: path inside the folder -> text.
    """
    refuse_to_overwrite(to)
    to.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=to.parent, prefix=f".{to.name}-") as scratch:
        draft = Path(scratch) / to.name
        for path, text in files.items():
            (draft / path).parent.mkdir(parents=True, exist_ok=True)
            (draft / path).write_text(text, encoding="utf-8")
        if to.is_dir():
            to.rmdir()  # empty, as checked above; renaming onto a folder fails on some systems
        draft.rename(to)
    return to
