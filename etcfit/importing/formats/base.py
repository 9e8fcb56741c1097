"""The interface of a format, its errors, and functions shared by several formats."""

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

MOST_BYTES = 256 * 10**6  # largest size of an unpacked recording: six channels at 50 kHz for 100 s
_ANOTHER_RATE = 0.5  # share of the longest channel's values: fewer are another rate, not a missing end


@dataclass(frozen=True)
class Source:
    """A file to read."""

    path: Path  # path of the file
    where: str  # its name in messages, as the user gave it
    buses: tuple[Path, ...] = ()  # DBC files with the meaning of a bus log's frames
    most: int = MOST_BYTES  # largest size of its numbers in memory, bytes
    motor: str | None = None  # the motor to read from a file that has several; None if not given
    servo: str | None = None  # family whose registers the columns hold, see `servo`; None for physical quantities

    def refuse_larger(self, size: int) -> None:
        """Refuse a recording that is too large by its own counts, before it is unpacked.

        Args:
            size: size of its numbers, bytes.
        Raises:
            MeasurementError: larger than `most`.
        """
        if size > self.most:
            raise MeasurementError(self.where, f"its numbers take {_shown(size)} in memory.",
                                   f"At most {_shown(self.most)} of one recording are read.",
                                   "Export a shorter stretch or fewer channels, or raise the limit: "
                                   f"--limit {_shown(size, up=True)}.")  # fmt: skip


def _shown(size: int, up: bool = False) -> str:
    """A number of bytes in words; `up` rounds it up to a value for an option."""
    if size >= 10**9:
        return f"{-(-size // 10**9)}GB" if up else f"{size / 1e9:.1f} GB"
    return f"{-(-size // 10**6)}MB" if up else f"{size / 1e6:.0f} MB"


@dataclass(frozen=True)
class Format:
    """A kind of file."""

    name: str  # name in messages
    suffixes: tuple[str, ...]  # suffixes of its files, in lower case with the dot
    read: Callable[[Source], list[Sheet]]  # reads every sheet of a file; imports heavy modules when called
    library: str = ""  # library of the extra `import` that it needs; "" for the main install
    motors: bool = False  # whether its parts are motors, `motor` or `motor: test`, one of which is the rig


def unreadable(where: str, found: str, kind: str, error: Exception | None = None) -> MeasurementError:
    """The error for a file that is not what its name says."""
    sentence = f"{found} ({' '.join(str(error).split())[:200]})" if error else found
    return MeasurementError(where, f"{sentence.rstrip('.')}.", f"It must be {kind}.", "Export it again, or as CSV.")


@contextmanager
def reading(source: Source, kind: str) -> Iterator[None]:
    """Turn any exception of a library's parser into an error about the file.

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
    """Collect the warnings of libraries while they read, instead of printing them."""
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
    """Seconds since the first instant, shape (n,); NaN for a missing instant."""
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
    """Channels with different rates as one table: one row for every instant of any of them.

    Args:
        instants: instants of each channel.
        columns: number of columns of the table in addition to the time.
    Returns:
        All instants, rising, shape (n,), and the rows of each channel.
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
    """The common end of channels that were recorded together, in a file that may be cut off or damaged.

    Channels with the same stated number of values belong together; so do those of about the same length.

    Args:
        found: number of values of each.
        said: number of values of each according to the file; 0 if it does not state it.
    Returns:
        For each channel the number of rows that all of its group have, and sentences on the missing rows.
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
