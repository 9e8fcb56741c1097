"""What every format offers, what it says when it cannot be read, and what several of them do alike."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import MeasurementError
from ..sheet import Sheet

MOST_BYTES = 256 * 10**6  # of a recording, unpacked: six channels at 50 kHz for 100 s
_ANOTHER_RATE = 0.5  # of the longest channel's values: fewer are another rate, not an end that is missing


@dataclass(frozen=True)
class Source:
    """A file to be read."""

    path: Path  # of the file
    where: str  # what messages call it, as the user gave it
    buses: tuple[Path, ...] = ()  # DBC files that say what the frames of a bus log mean
    most: int = MOST_BYTES  # bytes that its numbers may take in memory
    motor: str | None = None  # the one to take of a file that has several; None where nobody said
    servo: str | None = None  # family whose registers the columns are, see `servo`; None where they are quantities

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
    """A kind of file."""

    name: str  # for messages
    suffixes: tuple[str, ...]  # of its files, in lower case with the dot
    read: Callable[[Source], list[Sheet]]  # every sheet of a file; imports what is heavy when it is called
    library: str = ""  # of the extra `import` that reads it; "" where the main install does
    motors: bool = False  # its parts are motors, `motor` or `motor: test`, of which one makes a rig


def unreadable(where: str, found: str, kind: str, error: Exception | None = None) -> MeasurementError:
    """The message on a file that is not what its name says."""
    told = f"{found} ({' '.join(str(error).split())[:200]})" if error else found
    return MeasurementError(where, f"{told.rstrip('.')}.", f"It must be {kind}.", "Export it again, or as CSV.")


@contextmanager
def reading(source: Source, kind: str) -> Iterator[None]:
    """Whatever a library's parser makes of bytes that are no such file becomes a message on it.

    Raises:
        MeasurementError: in place of any other exception.
    """
    try:
        yield
    except MeasurementError:
        raise
    except Exception as err:
        raise unreadable(source.where, "it cannot be read", kind, err) from err


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


def flat_numbers(value: Any, name: str = "") -> Iterator[tuple[str, float]]:
    """Dotted names and numbers of nested dictionaries."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from flat_numbers(inner, f"{name}.{key}" if name else key)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield name, float(value)


def common_rows(source: Source, instants: Sequence[np.ndarray], columns: int) -> tuple[np.ndarray, list[np.ndarray]]:
    """Channels at rates of their own as one table: every instant of any of them a row.

    Args:
        source: whose numbers these are.
        instants: of each channel.
        columns: that the table will have besides its time.
    Returns:
        all instants, rising, shape (n,), and the rows of each channel's own.
    Raises:
        MeasurementError: the table would be too large.
    """
    every = np.unique(np.concatenate(instants))
    source.refuse_larger(8 * every.size * (1 + columns))
    return every, [np.searchsorted(every, own) for own in instants]


def with_gaps(count: int, rows: np.ndarray, values: Any) -> np.ndarray:
    """Values in these rows, shape (count,); NaN elsewhere."""
    out = np.full(count, np.nan)
    out[rows] = values
    return out


def common_ends(names: Sequence[str], found: Sequence[int], said: Sequence[int]) -> tuple[list[int], tuple[str, ...]]:
    """Where channels end that were recorded together, in a file that may be cut off or damaged.

    Channels of which the file says the same number of values belong together; so do those of about one length.

    Args:
        names: of the channels.
        found: values of each.
        said: values that the file itself says each has; 0 where it says nothing.
    Returns:
        rows of each that all of its group have, and what the others lack, each in a sentence.
    """
    longest = max((n for n, each in zip(found, said, strict=True) if not each), default=0)
    keys = [(each, each or (0 if n >= _ANOTHER_RATE * longest else n)) for n, each in zip(found, said, strict=True)]
    groups = {key: [k for k, each in enumerate(keys) if each == key] for key in keys}
    missing = []
    for group in groups.values():
        short, full = (pick(group, key=lambda k: found[k]) for pick in (min, max))
        if found[short] < said[short]:
            missing.append(f"it says that '{names[short]}' has {said[short]} values, and holds {found[short]}")
        elif found[short] < found[full]:
            missing.append(f"'{names[full]}' has {found[full]} values, '{names[short]}' has {found[short]}")
    return [min(found[k] for k in groups[key]) for key in keys], tuple(f"rows are missing: {each}" for each in missing)
