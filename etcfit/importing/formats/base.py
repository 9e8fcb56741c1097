"""What every format offers, and what it says when it cannot be read."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...errors import MeasurementError
from ..sheet import Sheet

MOST_BYTES = 256 * 10**6  # of a recording, unpacked: six channels at 50 kHz for 100 s


@dataclass(frozen=True)
class Source:
    """A file to be read.

    Args:
        path: of the file.
        where: what messages call it, as the user gave it.
        buses: DBC files that say what the frames of a bus log mean.
        most: bytes that its numbers may take in memory.
        motor: the one to take of a file that has several; None where nobody said.
        servo: family whose registers the columns are, see `servo`; None where they are quantities.
    """

    path: Path
    where: str
    buses: tuple[Path, ...] = ()
    most: int = MOST_BYTES
    motor: str | None = None
    servo: str | None = None

    def refuse_larger(self, size: int) -> None:
        """Refuse a recording by its own counts, before it is unpacked.

        Args:
            size: bytes that its numbers will take.
        Raises:
            MeasurementError: more than `most`.
        """
        if size > self.most:
            raise MeasurementError(self.where, f"its numbers take {_shown(size)} in memory.",
                                   f"At most {_shown(self.most)} of one recording are read.",
                                   "Export a shorter stretch or fewer channels, or raise the limit: "
                                   f"--limit {_shown(size, up=True)}.")  # fmt: skip


def _shown(size: int, up: bool = False) -> str:
    """A number of bytes in words; `up` rounds it to what an option can be given."""
    if size >= 10**9:
        return f"{-(-size // 10**9)}GB" if up else f"{size / 1e9:.1f} GB"
    return f"{-(-size // 10**6)}MB" if up else f"{size / 1e6:.0f} MB"


@dataclass(frozen=True)
class Format:
    """A kind of file.

    Args:
        name: for messages.
        suffixes: of its files, in lower case with the dot.
        read: every sheet of a file; imports what is heavy when it is called.
        library: of the extra `import` that reads it; "" where the main install does.
        motors: its parts are motors, `motor` or `motor: test`, of which one makes a rig.
    """

    name: str
    suffixes: tuple[str, ...]
    read: Callable[[Source], list[Sheet]]
    library: str = ""
    motors: bool = False


def unreadable(where: str, found: str, kind: str, error: Exception | None = None) -> MeasurementError:
    """The message on a file that is not what its name says."""
    told = f"{found} ({' '.join(str(error).split())[:200]})" if error else found
    return MeasurementError(where, f"{told.rstrip('.')}.", f"It must be {kind}.", "Export it again, or as CSV.")


@contextmanager
def warnings_of(*names: str) -> Iterator[list[str]]:
    """What libraries warn of while they read, kept from the terminal.

    Args:
        names: of their loggers.
    """
    heard: list[str] = []
    handler = logging.Handler(logging.WARNING)
    handler.emit = lambda record: heard.append(record.getMessage())
    before = [(each, each.handlers, each.propagate) for each in map(logging.getLogger, names)]
    for each, _, _ in before:
        each.handlers, each.propagate = [handler], False
    try:
        yield heard
    finally:
        for each, handlers, propagate in before:
            each.handlers, each.propagate = handlers, propagate


def seconds(instants: np.ndarray) -> np.ndarray:
    """Seconds since the first instant, shape (n,); NaN where there is none."""
    there = ~np.isnat(instants)
    if not there.any():
        return np.full(instants.size, np.nan)
    return np.where(there, (instants - instants[there][0]) / np.timedelta64(1, "s"), np.nan)
