"""The store of a fleet gives back bit for bit what it was given, whatever moment its writer died at."""

from __future__ import annotations

import os
import signal
import struct
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from etcfit.errors import UsageError
from etcfit.fleets.engine.store import Store
from etcfit.fleets.unit import FailedUnit, UnitResult
from fleet_works import result_of


def bits(value: object) -> object:
    """Equal for equal bits only: NaN is itself, -0 is not 0."""
    if isinstance(value, float):
        return struct.pack("d", value)
    if isinstance(value, np.ndarray):
        return value.shape, value.dtype.str, value.tobytes()
    if isinstance(value, dict):
        return [(k, bits(v)) for k, v in value.items()]
    if isinstance(value, tuple):
        return tuple(bits(v) for v in value)
    return bits(vars(value)) if hasattr(value, "__dict__") else (type(value), value)


def odd() -> UnitResult:
    """Numbers that a careless format would change."""
    result = result_of("odd", ("a", "b", "c"))
    result.own.estimate[:] = -0.0, 0.1 + 0.2, 5e-324
    result.own.information[:] = 0.0
    result.own.information[0, 0] = np.nan
    return replace(result, chi2_per_dof=float("inf"), warnings=(), traces=(), converged=False, digest="d" * 64)


def bare() -> UnitResult:
    """No free parameter at all."""
    return replace(result_of("bare", ()), parameters={})


@pytest.mark.parametrize("end", [result_of("u1"), odd(), bare(), FailedUnit("u2", "a: ö, 'x'\nno", "ab"),
                                 FailedUnit("u3", "")], ids=lambda end: end.unit)  # fmt: skip
def test_what_comes_back_has_the_same_bits(tmp_path: Path, end: UnitResult | FailedUnit) -> None:
    with Store(tmp_path / "parts") as store:
        store.add([end])
    (back,) = Store(tmp_path / "parts").ends()
    assert type(back) is type(end)
    assert bits(back) == bits(end)


def test_the_last_word_on_a_unit_counts_and_the_order_is_that_of_the_words(tmp_path: Path) -> None:
    with Store(tmp_path) as store:
        store.add([replace(result_of(unit), digest="1") for unit in "abc"])
        store.flush()
        store.add([FailedUnit("a", "no", "2")])
        assert [end.unit for end in store.ends()] == ["b", "c", "a"]
    store = Store(tmp_path)
    assert store.digests() == {"a": "2", "b": "1", "c": "1"}
    assert [end.unit for end in store.ends(["c", "a"])] == ["c", "a"]
    assert isinstance(list(store.ends())[-1], FailedUnit)


def test_many_flushes_leave_few_files_and_lose_nothing(tmp_path: Path) -> None:
    sizes = {"merge": 4, "rows": 7}
    with Store(tmp_path, **sizes) as store:
        for k in range(150):
            store.add([replace(result_of(f"u{k % 100}"), digest=str(k))])
            store.flush()
    assert len(list(tmp_path.glob("*.parquet"))) <= 3 * 4 + 1  # at most 3 of each of 4 sizes: 150 < 4^4
    known = Store(tmp_path, **sizes).digests()
    assert known == {f"u{k % 100}": str(k) for k in range(150)}
    assert len(list(Store(tmp_path, **sizes).ends())) == 100


def test_a_client_killed_between_merging_and_deleting_leaves_no_row_twice(tmp_path: Path) -> None:
    sizes = {"merge": 2}
    with Store(tmp_path, **sizes) as store:
        store.add([result_of("a")])
        store.flush()
        (first,) = tmp_path.glob("*.parquet")
        kept = first.read_bytes()
        store.add([result_of("b")])
    (merged,) = tmp_path.glob("*.parquet")
    assert merged != first
    first.write_bytes(kept)
    (tmp_path / ".draft-00000002-abc.parquet").write_bytes(b"half")
    with Store(tmp_path, **sizes) as store:
        assert sorted(end.unit for end in store.ends()) == ["a", "b"]
    assert {*tmp_path.iterdir()} == {merged}


def test_a_file_that_was_cut_off_or_changed_goes_aside_with_a_word_and_its_units_are_done_again(tmp_path: Path) -> None:
    with Store(tmp_path, merge=1000) as store:
        for unit in ("a", "b", "c"):
            store.add([replace(result_of(unit), digest=unit)])
            store.flush()
    first, second, _ = sorted(tmp_path.glob("*.parquet"))
    first.write_bytes(first.read_bytes()[:-20])
    changed = bytearray(second.read_bytes())
    changed[len(changed) // 4] ^= 1
    second.write_bytes(changed)
    with Store(tmp_path) as store:
        assert store.digests() == {"c": "c"}
        assert (
            f"{first} cannot be read any more and was moved to {tmp_path / 'superseded' / first.name}" in store.remark
        )
        store.add([replace(result_of("a"), digest="new")])
    assert (tmp_path / "superseded" / second.name).read_bytes() == changed
    with Store(tmp_path) as store:
        assert (store.digests(), store.remark) == ({"c": "c", "a": "new"}, "")


def test_two_cannot_write_at_once_and_both_can_read(tmp_path: Path) -> None:
    with Store(tmp_path / "parts") as store:
        store.add([result_of("a")])
        store.flush()
        with pytest.raises(UsageError, match=r"another etcfit .*works on it"), Store(tmp_path / "parts"):
            pass
        assert Store(tmp_path / "parts").digests() == {"a": ""}
    with Store(tmp_path / "parts") as store:
        assert store.digests() == {"a": ""}


def test_what_was_added_is_on_disk_without_anybody_asking(tmp_path: Path) -> None:
    with Store(tmp_path, flush=0.05) as store:
        store.add([result_of("a")])
        until = time.monotonic() + 5
        while not any(tmp_path.glob("0*.parquet")) and time.monotonic() < until:
            time.sleep(0.02)
        assert Store(tmp_path).digests() == {"a": ""}


def test_a_disk_that_is_full_is_said_to_who_adds_the_next(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    with Store(tmp_path, flush=0.02) as store:
        monkeypatch.setattr(pq.ParquetWriter, "write_table", full)
        store.add([result_of("a")])
        time.sleep(0.3)
        with pytest.raises(OSError, match="No space"):
            store.add([result_of("b")])
        monkeypatch.undo()
    assert [end.unit for end in Store(tmp_path).ends()] == ["a"]  # kept until there was room


ADDS = """
import sys, time
from pathlib import Path
from fleet_works import result_of
from etcfit.fleets.engine.store import Store
with Store(Path(sys.argv[1]), flush=0.01, merge=2) as store:
    for k in range(1_000_000):
        store.add([result_of(f"u{k}")])
        print(k, flush=True)
        time.sleep(0.002)
"""


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_a_killed_writer_leaves_only_whole_files(tmp_path: Path, seed: int) -> None:
    paths = os.pathsep.join([str(Path(__file__).parents[1]), str(Path(__file__).parents[2])])
    with subprocess.Popen([sys.executable, "-c", ADDS, str(tmp_path)], stdout=subprocess.PIPE, text=True,
                          env={**os.environ, "PYTHONPATH": paths}) as writer:  # fmt: skip
        assert writer.stdout is not None
        for _ in range(200 + 37 * seed):
            said = int(writer.stdout.readline())
        writer.send_signal(signal.SIGKILL)
    units = [end.unit for end in Store(tmp_path).ends()]
    assert units == [f"u{k}" for k in range(len(units))]  # without a gap
    assert len(units) > said - 100  # at 2 ms each: what came in the last fifth of a second
