"""RUN/parts/ends.log: the result of each unit so far, in blocks that are appended and never changed.

    block    length and CRC-32 of what follows, 32 bit each, big-endian; then by zlib two lines of JSON:
             [[unit, digest], ...]
             [row, ...]

A later row of a unit replaces an earlier one. A killed client loses the results of the last second. Memory holds the
digests, the results of the last second and one block. A failed unit has a `why` and no data; a matrix is stored as the
list of its numbers. JSON has the shortest text of each number that restores it bit for bit.
"""

from __future__ import annotations

import json
import os
import struct
import threading
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from io import BytesIO
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from ...files import held, named, put_aside, whole
from ..unit import FailedUnit, TraceMisfit, UnitEstimate, UnitParameter, UnitResult

_HEAD = struct.Struct(">II")  # of a block


class Store:
    """with Store(folder) as store: every result added is on disk a second later, and when the block ends.

    One process at a time can write; reading needs no `with`. A file with a damaged block, or with a last block that is
    cut off, is moved aside on entry and its sound blocks are kept: `remark` says so, and the units of the other blocks
    are fitted again.

    Args:
        folder: created where it is missing.
        flush: s after which results are on disk: a killed client loses no more than that.
    """

    remark: str = ""

    def __init__(self, folder: Path, flush: float = 1.0) -> None:
        self.folder, self.path, self._flush_after = folder, folder / "ends.log", flush
        self._waiting: list[UnitResult | FailedUnit] = []
        self._lock, self._writing, self._ended = threading.Lock(), threading.Lock(), threading.Event()
        self._error: OSError | None = None
        self._hold = ExitStack()
        folder.mkdir(parents=True, exist_ok=True)

    def __enter__(self) -> Store:
        self._hold.enter_context(held(self.folder, again=False))
        try:
            self._mend()
        except BaseException:
            self._hold.close()
            raise
        self._ended.clear()
        self._clock = threading.Thread(target=self._flush_often, name="etcfit store", daemon=True)
        self._clock.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None):
        self._ended.set()
        self._clock.join()
        try:
            self.flush()
        finally:
            self._hold.close()

    def add(self, ends: Iterable[UnitResult | FailedUnit]) -> None:
        """Keep these; they replace earlier results of their units.

        Raises:
            OSError: earlier additions could not be written.
        """
        if self._error is not None:
            raise self._error
        with self._lock:
            self._waiting.extend(ends)

    def flush(self) -> None:
        """Write the additions that are not on disk yet.

        Raises:
            OSError: it cannot be written.
        """
        with self._writing:
            with self._lock:
                ends, self._waiting = self._waiting, []
            try:
                if ends:
                    self._append(_block(ends))
            except BaseException:
                with self._lock:
                    self._waiting = ends + self._waiting
                raise

    def digests(self) -> dict[str, str]:
        """Unit -> digest of its result; "" for a unit that must be tried again."""
        return dict(pair for index, _ in self._read() for pair in index)

    def ends(self, units: Sequence[str] | None = None) -> Iterator[UnitResult | FailedUnit]:
        """The latest result of each of these units, or of all, in the order of arrival."""
        self.flush()
        wanted = None if units is None else set(units)
        newest = {unit: (k, n) for k, (index, _) in enumerate(self._read()) for n, (unit, _) in enumerate(index)}
        for k, (index, rows) in enumerate(self._read()):
            counts = [n for n, (unit, _) in enumerate(index)
                      if newest.get(unit) == (k, n) and (wanted is None or unit in wanted)]  # fmt: skip
            every = json.loads(rows) if counts else []
            yield from (_end(every[n]) for n in counts)

    def _flush_often(self) -> None:
        while not self._ended.wait(self._flush_after):
            try:
                self.flush()
            except OSError as error:
                self._error = error
                return

    def _append(self, block: bytes) -> None:
        """Append the whole block, or nothing."""
        with named(self.path, self.folder):
            handle = os.open(self.path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
            try:
                before = os.fstat(handle).st_size
                try:
                    while block:
                        block = block[os.write(handle, block) :]
                except OSError:
                    os.ftruncate(handle, before)
                    raise
            finally:
                os.close(handle)

    def _mend(self) -> None:
        if all(_blocks(self.path)):
            return
        aside = put_aside(self.path)
        with whole(self.path) as draft, draft.open("wb") as file:
            file.writelines(block for block in _blocks(aside) if block)
        self.remark = (f"{self.path} is damaged and was moved to {aside}: units that cannot be read from it are fitted "
                       "again.")  # fmt: skip

    def _read(self) -> Iterator[tuple[list[tuple[str, str]], bytes]]:
        """Units and digests of each sound block, and its rows as JSON."""
        for block in _blocks(self.path):
            if block:
                index, _, rows = zlib.decompress(block[_HEAD.size :]).partition(b"\n")
                yield json.loads(index), rows


def _blocks(path: Path) -> Iterator[bytes]:
    """Each block of a file with its head; b"" for a block that is damaged or cut off."""
    size = path.stat().st_size if path.exists() else 0
    with path.open("rb") if size else BytesIO() as file:
        while head := file.read(_HEAD.size):
            length, check = _HEAD.unpack(head.ljust(_HEAD.size, b"\0"))
            packed = file.read(min(length, size))
            yield head + packed if len(packed) == length > 0 and zlib.crc32(packed) == check else b""


def _block(ends: Sequence[UnitResult | FailedUnit]) -> bytes:
    lines = [[(end.unit, end.digest) for end in ends], [_row(end) for end in ends]]
    packed = zlib.compress("\n".join(json.dumps(line, default=np.generic.item) for line in lines).encode())
    return _HEAD.pack(len(packed), zlib.crc32(packed)) + packed


_ALIKE = ("chi2_per_dof", "converged", "reason", "synthetic", "seconds", "warnings")


def _row(end: UnitResult | FailedUnit) -> dict[str, Any]:
    """One unit's row."""
    if isinstance(end, FailedUnit):
        return vars(end)
    return {
        "unit": end.unit,
        "digest": end.digest,
        "symbols": end.own.symbols,
        "estimate": end.own.estimate.tolist(),
        "information": end.own.information.ravel().tolist(),
        "parameters": {symbol: vars(each) for symbol, each in end.parameters.items()},
        "traces": [vars(each) for each in end.traces],
        "widening": dict(end.widening),
        **{name: getattr(end, name) for name in _ALIKE},
    }


def _end(row: Mapping[str, Any]) -> UnitResult | FailedUnit:
    """The inverse of `_row`."""
    if "why" in row:
        return FailedUnit(**row)
    estimate = np.array(row["estimate"], dtype=float)
    information = np.array(row["information"], dtype=float).reshape(estimate.size, estimate.size)
    alike: dict[str, Any] = {name: row[name] for name in _ALIKE} | {"warnings": tuple(row["warnings"])}
    return UnitResult(
        own=UnitEstimate(row["unit"], tuple(row["symbols"]), estimate, information),
        parameters={symbol: UnitParameter(**each) for symbol, each in row["parameters"].items()},
        traces=tuple(TraceMisfit(**each) for each in row["traces"]),
        digest=row["digest"],
        widening=row["widening"],
        **alike,
    )
