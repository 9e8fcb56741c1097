"""What every format offers, and what it says when it cannot be read."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

from ...errors import MeasurementError, how_to_install
from ..sheet import Sheet


@dataclass(frozen=True)
class Source:
    """A file to be read.

    Args:
        path: of the file.
        where: what messages call it, as the user gave it.
        buses: DBC files that say what the frames of a bus log mean.
    """

    path: Path
    where: str
    buses: tuple[Path, ...] = ()


@dataclass(frozen=True)
class Format:
    """A kind of file.

    Args:
        name: for messages.
        suffixes: of its files, in lower case with the dot.
        read: every sheet of a file; imports what is heavy when it is called.
        needs: libraries that every file of this kind needs.
    """

    name: str
    suffixes: tuple[str, ...]
    read: Callable[[Source], list[Sheet]]
    needs: tuple[str, ...] = ()


def library(name: str, where: str) -> ModuleType:
    """A library that only this format needs.

    Raises:
        MeasurementError: it is not installed.
    """
    try:
        return importlib.import_module(name)
    except ImportError as err:
        raise MeasurementError(where, f"reading it needs the library {name.partition('.')[0]}, which is not installed.",
                               "Readers of some formats come with libraries of their own.",
                               how_to_install("import")) from err  # fmt: skip


def unreadable(where: str, found: str, kind: str, error: Exception | None = None) -> MeasurementError:
    """The message on a file that is not what its name says."""
    told = f"{found} ({error})" if error else found
    return MeasurementError(where, f"{told.rstrip('.')}.", f"It must be {kind}.", "Export it again, or as CSV.")
