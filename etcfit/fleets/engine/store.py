"""RUN/parts: what is known of each unit so far, in Parquet files that are whole or not there.

    00000017-00000017.parquet   what was written the 17th time
    00000000-00000015.parquet   what was written the first 16 times, made one file

Whatever comes later counts. A killed client loses what came back in the last second. Files of the same size are made
one, as in a log-structured merge tree: n flushes leave about merge log_merge(n) files, and each row is rewritten
log_merge(n) times. Memory holds the digests, what came back in the last second and one row group. A failed unit has a
`why` and no data; matrices lie in a row as the list of their numbers, and come back bit for bit.
"""

from __future__ import annotations

import re
import threading
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from ...files import held, put_aside, whole
from ..unit import FailedUnit, TraceMisfit, UnitEstimate, UnitParameter, UnitResult

_NAME = re.compile(r"(\d{8,})-(\d{8,})\.parquet")


@dataclass(frozen=True)
class _Part:
    """A file: what was written the `first` to the `last` time."""

    first: int
    last: int

    @property
    def name(self) -> str:
        return f"{self.first:08d}-{self.last:08d}.parquet"

    def holds(self, other: _Part) -> bool:
        """Whether the other is one of those it was made of."""
        return self != other and self.first <= other.first and other.last <= self.last


class Store:
    """with Store(folder) as store: every result added is on disk a second later, and when the block ends.

    One process at a time can write; reading needs no `with`. A file that cannot be read any more, for the disk was full
    or a copy was cut off, is put aside when the block begins: `remark` says so, and its units are worked on again.

    Args:
        folder: made where it is not there.
        flush: s after which what came back is on disk, so that a killed client loses no more.
        merge: files of one size that are made one; n units leave about merge log_merge(n) files.
        rows: of a Parquet row group, and held in memory when files are made one.
    """

    remark: str = ""

    def __init__(self, folder: Path, flush: float = 1.0, merge: int = 16, rows: int = 1000) -> None:
        self.folder, self._flush_after, self._merged, self._rows = folder, flush, merge, rows
        self._waiting: list[UnitResult | FailedUnit] = []
        self._lock, self._writing, self._ended = threading.Lock(), threading.Lock(), threading.Event()
        self._error: OSError | None = None
        self._hold = ExitStack()
        folder.mkdir(parents=True, exist_ok=True)

    def __enter__(self) -> Store:
        self._hold.enter_context(held(self.folder, again=False))
        try:
            said = "{} cannot be read any more and was moved to {}: the units in it are worked on again."
            self.remark = " ".join(said.format(part, put_aside(part)) for part in self._damaged())
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
        """Keep these; what was known of their units before no longer counts.

        Raises:
            OSError: what was added before could not be written.
        """
        if self._error is not None:
            raise self._error
        with self._lock:
            self._waiting.extend(ends)

    def flush(self) -> None:
        """Write what has been added and is not on disk yet.

        Raises:
            OSError: it cannot be written.
        """
        import pyarrow as pa

        with self._writing:
            with self._lock:
                ends, self._waiting = self._waiting, []
            if not ends:
                return
            parts = self._parts()
            number = parts[-1].last + 1 if parts else 0
            try:
                self._write(
                    _Part(number, number), [pa.Table.from_pylist([_row(end) for end in ends], schema=_schema())]
                )
            except BaseException:
                with self._lock:
                    self._waiting = ends + self._waiting
                raise
            self._merge()

    def digests(self) -> dict[str, str]:
        """Unit -> digest of what is known of it; "" for one that must be tried again."""
        known: dict[str, str] = {}
        for table in self._tables(["unit", "digest"]):
            known.update(zip(table["unit"].to_pylist(), table["digest"].to_pylist(), strict=True))
        return known

    def ends(self, units: Sequence[str] | None = None) -> Iterator[UnitResult | FailedUnit]:
        """What is known last of each of these units, or of all, in the order in which it became known."""
        self.flush()
        wanted = None if units is None else set(units)
        newest: dict[str, int] = {}
        for k, unit in enumerate(u for table in self._tables(["unit"]) for u in table["unit"].to_pylist()):
            newest[unit] = k
        k = 0
        for table in self._tables(None):
            for row in table.to_pylist():
                if newest.get(row["unit"]) == k and (wanted is None or row["unit"] in wanted):
                    yield _end(row)
                k += 1

    def _flush_often(self) -> None:
        while not self._ended.wait(self._flush_after):
            try:
                self.flush()
            except OSError as error:
                self._error = error
                return

    def _parts(self) -> list[_Part]:
        """The files that count, in order; those that were made part of another are deleted."""
        found = [_NAME.fullmatch(file.name) for file in self.folder.iterdir()]
        parts = [_Part(int(match[1]), int(match[2])) for match in found if match]
        left: list[_Part] = []
        for part in sorted(parts, key=lambda p: (p.first, -p.last)):
            if left and left[-1].holds(part):  # the client was killed between making one file and deleting the others
                (self.folder / part.name).unlink(missing_ok=True)
            else:
                left.append(part)
        return left

    def _damaged(self) -> list[Path]:
        """Files of which not every row can be read."""
        import pyarrow as pa

        found = []
        for part in self._parts():
            try:
                for _ in self._groups(part, None):
                    pass
            except (pa.ArrowException, OSError):
                found.append(self.folder / part.name)
        return found

    def _tables(self, columns: list[str] | None) -> Iterator[Any]:
        """Row group by row group, oldest first."""
        for part in self._parts():
            yield from self._groups(part, columns)

    def _groups(self, part: _Part, columns: list[str] | None) -> Iterator[Any]:
        """The row groups of a file, each held against its checksum."""
        import pyarrow.parquet as pq

        with pq.ParquetFile(self.folder / part.name, page_checksum_verification=True) as file:
            for group in range(file.num_row_groups):
                yield file.read_row_group(group, columns=columns)

    def _write(self, part: _Part, tables: Iterable[Any]) -> None:
        import pyarrow.parquet as pq

        with (
            whole(self.folder / part.name) as draft,
            pq.ParquetWriter(draft, _schema(), compression="zstd", write_page_checksum=True) as writer,
        ):
            for table in tables:
                writer.write_table(table, row_group_size=self._rows)

    def _merge(self) -> None:
        """The last `merge` files made one, as long as they hold the same number of flushes."""
        while True:
            last = self._parts()[-self._merged :]
            sizes = {self._level(part) for part in last}
            if len(last) < self._merged or len(sizes) > 1:
                return
            self._write(_Part(last[0].first, last[-1].last), self._thick(last))
            self._parts()

    def _level(self, part: _Part) -> int:
        level, flushes = 0, part.last - part.first + 1
        while flushes >= self._merged:
            level, flushes = level + 1, flushes // self._merged
        return level

    def _thick(self, parts: Sequence[_Part]) -> Iterator[Any]:
        """The rows of these files in row groups of full size."""
        import pyarrow as pa

        thick: list[Any] = []
        for group in (group for part in parts for group in self._groups(part, None)):
            thick.append(group)
            if sum(table.num_rows for table in thick) >= self._rows:
                yield pa.concat_tables(thick)
                thick = []
        if thick:
            yield pa.concat_tables(thick)


@cache
def _schema() -> Any:
    """The columns, for pyarrow."""
    import pyarrow as pa

    text, number = pa.string(), pa.float64()
    parameter = [("symbol", text), ("value", number), ("unit", text), ("stderr", number), ("low", number),
                 ("high", number), ("status", text)]  # fmt: skip
    trace = [("file", text), ("test", text), ("misfit", number)]
    return pa.schema(
        [
            ("unit", text),
            ("digest", text),
            ("why", text),
            ("symbols", pa.list_(text)),
            ("estimate", pa.list_(number)),
            ("information", pa.list_(number)),
            ("parameters", pa.list_(pa.struct(parameter))),
            ("traces", pa.list_(pa.struct(trace))),
            ("chi2_per_dof", number),
            ("converged", pa.bool_()),
            ("reason", text),
            ("synthetic", pa.bool_()),
            ("seconds", number),
            ("warnings", pa.list_(text)),
            ("widening", pa.list_(number)),
        ]
    )


def _row(end: UnitResult | FailedUnit) -> dict[str, Any]:
    """One unit's row."""
    if isinstance(end, FailedUnit):
        return {"unit": end.unit, "digest": end.digest, "why": end.why}
    return {
        "unit": end.unit,
        "digest": end.digest,
        "why": None,
        "symbols": end.own.symbols,
        "estimate": end.own.estimate,
        "information": end.own.information.ravel(),
        "parameters": [{"symbol": symbol, **vars(each)} for symbol, each in end.parameters.items()],
        "traces": [vars(each) for each in end.traces],
        **{name: getattr(end, name) for name in _ALIKE},
        "warnings": end.warnings,
        "widening": [end.widening[symbol] for symbol in end.own.symbols] if end.widening else None,
    }


def _end(row: Mapping[str, Any]) -> UnitResult | FailedUnit:
    """What `_row` made a row of."""
    if row["why"] is not None:
        return FailedUnit(row["unit"], row["why"], row["digest"])
    estimate = np.array(row["estimate"], dtype=float)
    information = np.array(row["information"], dtype=float).reshape(estimate.size, estimate.size)
    return UnitResult(
        own=UnitEstimate(row["unit"], tuple(row["symbols"]), estimate, information),
        parameters={each.pop("symbol"): UnitParameter(**each) for each in row["parameters"]},
        traces=tuple(TraceMisfit(**each) for each in row["traces"]),
        digest=row["digest"],
        warnings=tuple(row["warnings"]),
        widening=dict(zip(row["symbols"], row["widening"], strict=True)) if row["widening"] else {},
        **{name: row[name] for name in _ALIKE},
    )


_ALIKE = ("chi2_per_dof", "converged", "reason", "synthetic", "seconds")
