"""Names of rigs, files and folders, which go into reports, JSON files and exported code: UTF-8 that can be seen."""

from __future__ import annotations

import os
from pathlib import PurePath

from ..errors import MeasurementError, unseen
from .comments import one_line

VISIBLE = "A name must hold no control characters and no marks of direction: they hide what is written."


def refuse_foreign_names(folder: str, *names: str) -> None:
    r"""Refuse a name that is no UTF-8, or holds what nobody sees; Linux allows any bytes.

    Args:
        folder: where they lie, as the user gave it; its own name counts too.
        names: of what lies in it.
    Raises:
        MeasurementError: at the first, its foreign bytes written as \xe9, its unseen characters as (U+202E).
    """
    for path in (folder, *(f"{folder}/{name}" for name in names)):
        if not _is_utf8(path):
            raise MeasurementError(escaped(path), "the name is no UTF-8.",
                                   "Names of files and folders must be UTF-8; reports and JSON files repeat them.",
                                   "Rename it; plain letters, digits, - and _ are always right.")  # fmt: skip
        if found := unseen(PurePath(path).name):
            raise MeasurementError(one_line(path), f"{found} in the name.", VISIBLE, "Rename it.")


def escaped(path: str) -> str:
    """The path with every byte that is no UTF-8 written out."""
    try:
        return os.fsencode(path).decode("utf-8", "backslashreplace")
    except UnicodeEncodeError:  # half a character that no file system made
        return path.encode("utf-8", "backslashreplace").decode("utf-8")


def _is_utf8(path: str) -> bool:
    try:
        path.encode("utf-8")
    except UnicodeEncodeError:
        return False
    return True
