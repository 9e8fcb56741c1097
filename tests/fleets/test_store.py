"""The store of a fleet gives back bit for bit what it was given, whatever moment its writer died at."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from equality import equal
from etcfit.errors import UsageError
from etcfit.fleets.engine.store import Store
from etcfit.fleets.unit import FailedUnit, UnitResult
from fleet_works import result_of


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
    assert equal(back, end)


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


def test_many_flushes_lose_nothing(tmp_path: Path) -> None:
    with Store(tmp_path) as store:
        for k in range(150):
            store.add([replace(result_of(f"u{k % 100}"), digest=str(k))])
            store.flush()
    assert Store(tmp_path).digests() == {f"u{k % 100}": str(k) for k in range(150)}
    assert [end.unit for end in Store(tmp_path).ends()] == [f"u{k % 100}" for k in range(50, 150)]


def written(folder: Path) -> tuple[Path, list[bytes]]:
    """A store of the units a, b and c, and its blocks."""
    ends = [0]
    with Store(folder) as store:
        for unit in ("a", "b", "c"):
            store.add([replace(result_of(unit), digest=unit)])
            store.flush()
            ends.append(store.path.stat().st_size)
    whole = store.path.read_bytes()
    return store.path, [whole[a:b] for a, b in pairwise(ends)]


def flipped(block: bytes) -> bytes:
    """A block with one wrong bit in its middle."""
    changed = bytearray(block)
    changed[len(changed) // 2] ^= 1
    return bytes(changed)


@pytest.mark.parametrize(("harm", "left"), [
    (lambda a, b, c: a + flipped(b) + c, {"a": "a", "c": "c"}),
    (lambda a, b, c: a + b + c[:-20], {"a": "a", "b": "b"}),
    (lambda a, b, c: a + b + c[:3], {"a": "a", "b": "b"}),
    (lambda a, b, c: b"\xff" + a[1:] + b + c, {}),
], ids=["a bit", "cut off", "cut off in a head", "a length"])  # fmt: skip
def test_a_damaged_file_goes_aside_with_a_word_and_only_what_is_lost_is_done_again(
    tmp_path: Path, harm: Callable[[bytes, bytes, bytes], bytes], left: dict[str, str]
) -> None:
    path, blocks = written(tmp_path)
    path.write_bytes(harm(*blocks))
    damaged = path.read_bytes()
    with Store(tmp_path) as store:
        assert store.digests() == left
        assert f"{path} is damaged and was moved to {tmp_path / 'superseded' / path.name}" in store.remark
        store.add([replace(result_of("d"), digest="new")])
    assert (tmp_path / "superseded" / path.name).read_bytes() == damaged
    with Store(tmp_path) as store:
        assert (store.digests(), store.remark) == ({**left, "d": "new"}, "")


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
        while not Store(tmp_path).digests() and time.monotonic() < until:
            time.sleep(0.02)
        assert Store(tmp_path).digests() == {"a": ""}


def test_a_disk_that_is_full_is_said_to_who_adds_the_next(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with Store(tmp_path, flush=0.02) as store:
        monkeypatch.setattr(os, "write", full)
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
with Store(Path(sys.argv[1]), flush=0.01) as store:
    for k in range(1_000_000):
        store.add([result_of(f"u{k}")])
        print(k, flush=True)
        time.sleep(0.002)
"""


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_a_killed_writer_leaves_all_but_the_last_moment(tmp_path: Path, seed: int) -> None:
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
