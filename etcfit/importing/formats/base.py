"""What every format offers, and what it says when it cannot be read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ...errors import MeasurementError
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
        library: of the extra `import` that reads it; "" where the main install does.
    """

    name: str
    suffixes: tuple[str, ...]
    read: Callable[[Source], list[Sheet]]
    library: str = ""


def unreadable(where: str, found: str, kind: str, error: Exception | None = None) -> MeasurementError:
    """The message on a file that is not what its name says."""
    told = f"{found} ({error})" if error else found
    return MeasurementError(where, f"{told.rstrip('.')}.", f"It must be {kind}.", "Export it again, or as CSV.")
