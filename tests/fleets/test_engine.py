"""A fleet on real worker processes: whatever happens to a worker or to the client, each unit ends once, by name."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from etcfit.errors import UsageError
from etcfit.fleets.engine.cluster import FIRST_WORKER, Crew, ExistingScheduler, LocalWorkers, crew
from etcfit.fleets.engine.run import Agenda, Tally, run_units
from etcfit.fleets.engine.store import Store
from etcfit.fleets.settings import EngineSettings
from etcfit.fleets.unit import FailedUnit, Lost, Order, Portion, Trouble
from fleet_works import (
    CountingWork,
    Habit,
    always_full,
    broken,
    cores_here,
    divides,
    eats,
    full_disk,
    kills,
    kills_once,
    loops,
    result_of,
    sleeps,
)

QUICK = EngineSettings(time_limit=2.0)
PORTIONS = EngineSettings(portion=0.4)
ROOT = Path(__file__).parents[2]
ENVIRONMENT = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "tests")])}


@pytest.fixture(scope="module")
def workers() -> Iterator[Crew]:
    with crew(LocalWorkers(2, 500 * 2**20)) as made:
        yield made


@pytest.fixture
def counts(tmp_path: Path) -> Path:
    (tmp_path / "counts").mkdir()
    return tmp_path / "counts"


def names(count: int) -> list[str]:
    return [f"u{k:04d}" for k in range(count)]


def run(units: list[str], work: CountingWork, workers: Crew, parts: Path, settings: EngineSettings = QUICK) -> Tally:
    with suppress(TimeoutError):  # those that a test before killed come back, most often
        workers.client.wait_for_workers(max(workers.workers, 1), timeout=10.0)
    with Store(parts) as store:
        return run_units(units, work, workers, store, lambda *_: None, settings)


def failures(parts: Path) -> dict[str, str]:
    return {end.unit: end.why for end in Store(parts).ends() if isinstance(end, FailedUnit)}


def test_every_unit_ends_once_and_is_not_done_again_until_it_changes(workers: Crew, counts: Path, tmp_path: Path):
    parts, units = tmp_path / "parts", names(60)
    said: list[float] = []
    with Store(parts) as store:
        work = CountingWork(counts)
        assert run_units(units, work, workers, store, lambda _, done: said.append(done), QUICK) == Tally(60, 0, 0)
    assert said == sorted(said)
    assert said[-1] == 1.0
    assert work.counted() == dict.fromkeys(units, 1)
    assert len(list(counts.glob(".prepared-*"))) <= 2  # the work was sent to each worker once
    assert {file.read_text() for file in counts.glob(".prepared-*")} == {"x"}
    ends = {end.unit: end for end in Store(parts).ends()}
    assert ends["u0007"].digest == "u0007:1"
    assert ends["u0007"].own.estimate.tolist() == result_of("u0007").own.estimate.tolist()  # type: ignore[union-attr]

    assert run(units, work, workers, parts) == Tally(0, 60, 0)
    assert run(units, CountingWork(counts, edition={"u0031": "2"}), workers, parts) == Tally(1, 59, 0)
    assert work.counted() == {**dict.fromkeys(units, 1), "u0031": 2}


def test_ten_broken_among_a_hundred_cost_themselves_alone(workers: Crew, counts: Path, tmp_path: Path) -> None:
    parts, units = tmp_path / "parts", names(100)
    habits: dict[str, Habit] = {units[k]: broken if k % 20 else divides for k in range(0, 100, 10)}
    work = CountingWork(counts, habits)
    assert run(units, work, workers, parts) == Tally(90, 0, 10)
    assert work.counted() == dict.fromkeys(units, 1)
    said = failures(parts)
    assert set(said) == set(habits)
    assert said["u0010"] == "response/3.csv:118: time falls. It must rise. Sort it."
    assert said["u0020"].startswith("u0020: ZeroDivisionError: division by zero (in fleet_works.py:")
    assert run(units, work, workers, parts) == Tally(0, 100, 0)  # what is wrong stays wrong: not tried again


def test_a_full_disk_is_left_to_another_worker_and_a_slow_unit_is_stopped(workers: Crew, counts: Path, tmp_path: Path):
    parts, units = tmp_path / "parts", names(12)
    work = CountingWork(counts, {"u0002": full_disk(tmp_path / "mark"), "u0004": always_full, "u0006": loops})
    assert run(units, work, workers, parts) == Tally(10, 0, 2)
    assert work.counted() == {**dict.fromkeys(units, 1), "u0002": 2, "u0004": 2}
    said = failures(parts)
    assert said["u0004"] == "u0004: OSError: [Errno 28] No space left on device. It was tried 2 times."
    assert said["u0006"] == ("u0006: stopped, it took longer than 2 s. Allow more time, or shorten its traces.")
    mended = CountingWork(counts)
    assert run(units, mended, workers, parts) == Tally(2, 10, 0)  # these may go better today


def test_a_unit_that_found_no_room_waits_for_another_worker_while_that_is_busy(
    workers: Crew, counts: Path, tmp_path: Path
) -> None:
    units = names(2)
    work = CountingWork(counts, {"u0000": sleeps(1.5), "u0001": full_disk(tmp_path / "mark")})
    assert run(units, work, workers, tmp_path / "parts") == Tally(2, 0, 0)
    assert work.counted() == {"u0000": 1, "u0001": 2}


@pytest.mark.slow
def test_a_worker_that_dies_costs_a_try_and_one_that_always_dies_its_unit(workers: Crew, counts: Path, tmp_path: Path):
    parts, units = tmp_path / "parts", names(40)
    work = CountingWork(counts, {"u0005": kills, "u0020": kills_once(tmp_path / "mark")}, sleeps(0.35))
    assert run(units, work, workers, parts) == Tally(39, 0, 1)
    assert list(failures(parts)) == ["u0005"]
    assert "its worker process ended while it fitted this unit" in failures(parts)["u0005"]
    # nobody else was on those workers: each took longer than a portion, so it had a task of its own
    assert work.counted() == {**dict.fromkeys(units, 1), "u0005": 2, "u0020": 2}


@pytest.mark.slow
def test_a_portion_that_dies_is_taken_apart(workers: Crew, counts: Path, tmp_path: Path) -> None:
    parts, units = tmp_path / "parts", names(400)
    work = CountingWork(counts, {"u0300": kills})
    assert run(units, work, workers, parts) == Tally(399, 0, 1)
    assert list(failures(parts)) == ["u0300"]
    assert work.counted()["u0300"] in (2, 3)


@pytest.mark.slow
def test_a_unit_that_eats_memory_is_ended_and_named(workers: Crew, counts: Path, tmp_path: Path) -> None:
    parts, units = tmp_path / "parts", names(10)
    work = CountingWork(counts, {"u0003": eats}, sleeps(0.35))
    assert run(units, work, workers, parts, EngineSettings(time_limit=60.0)) == Tally(9, 0, 1)
    assert "exceeded its memory limit" in failures(parts)["u0003"]
    assert work.counted()["u0003"] == 2  # another one may be done again: its answer can be lost with the worker


@pytest.mark.slow
def test_a_unit_that_no_exception_reaches_is_ended_with_its_worker(workers: Crew, counts: Path, tmp_path: Path) -> None:
    parts, units = tmp_path / "parts", names(6)
    work = CountingWork(counts, {"u0003": sleeps(3600.0)}, sleeps(0.35))  # one call that does not come back to Python
    settings = EngineSettings(time_limit=1.0, grace=0.5)
    assert run(units, work, workers, parts, settings) == Tally(5, 0, 1)
    assert list(failures(parts)) == ["u0003"]
    assert work.counted() == {**dict.fromkeys(units, 1), "u0003": 2}


@pytest.mark.slow
def test_a_worker_uses_one_core(workers: Crew, counts: Path, tmp_path: Path) -> None:
    run(names(4), CountingWork(counts), workers, tmp_path / "parts")
    assert set(workers.client.run(cores_here).values()) == {1}  # type: ignore[union-attr]


CLIENT = """
import signal
import sys
from pathlib import Path
from fleet_works import CountingWork, sleeps
from etcfit.fleets.engine.cluster import LocalWorkers, crew
from etcfit.fleets.engine.run import run_units
from etcfit.fleets.engine.store import Store
if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell ignores it for what it starts with &
    units = [f"u{k:04d}" for k in range(int(sys.argv[3]))]
    counts, parts = Path(sys.argv[1]), Path(sys.argv[2])
    told = open(sys.argv[4], "a")
    with crew(LocalWorkers(2)) as workers, Store(parts) as store:
        print("begun", flush=True)
        try:
            print(run_units(units, CountingWork(counts, {}, sleeps(0.2)), workers, store,
                            lambda _, share: print(round(share * len(units)), file=told, flush=True)))
        except KeyboardInterrupt:
            print("interrupted")
            sys.exit(130)
"""


def started(tmp_path: Path, counts: Path, units: int) -> subprocess.Popen[str]:
    script = tmp_path / "client.py"
    script.write_text(CLIENT)
    command = [sys.executable, str(script), str(counts), str(tmp_path / "parts"), str(units), str(tmp_path / "told")]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=ENVIRONMENT,
                            start_new_session=True)  # fmt: skip


def told(tmp_path: Path) -> int:
    """How many units the client says have come back; a busy machine may let it wait while its workers go on."""
    file = tmp_path / "told"
    lines = file.read_text().split() if file.exists() else []
    return int(lines[-1]) if lines else 0


def until(true: Callable[[], bool]) -> None:
    end = time.monotonic() + 60
    while not true():
        assert time.monotonic() < end
        time.sleep(0.05)


@pytest.mark.slow
def test_a_client_that_is_killed_and_started_again_does_nothing_twice_that_was_kept(tmp_path: Path, counts: Path):
    parts = tmp_path / "parts"
    first = started(tmp_path, counts, 100)
    until(lambda: bool(parts.is_dir() and Store(parts).digests()))  # on disk while it runs, not only when it ends
    seen = set(Store(parts).digests())
    first.send_signal(signal.SIGKILL)
    first.communicate()
    time.sleep(1.0)  # workers see that their client is gone, and end
    kept = set(Store(parts).digests())
    assert seen <= kept < set(names(100))
    before = CountingWork(counts).counted()
    again = started(tmp_path, counts, 100)
    out, err = again.communicate(timeout=60)
    assert f"Tally(fitted={100 - len(kept)}, unchanged={len(kept)}, failed=0)" in out
    assert err == ""
    after = CountingWork(counts).counted()
    assert set(after) == set(names(100))
    assert [unit for unit in kept if after[unit] > before[unit]] == []  # nothing that was kept is done again


@pytest.mark.slow
def test_an_interrupted_client_keeps_what_is_done_and_says_nothing_else(tmp_path: Path, counts: Path) -> None:
    client = started(tmp_path, counts, 200)  # twenty seconds of work: a busy machine is not done before it is told
    until(lambda: told(tmp_path) >= 12)
    os.killpg(client.pid, signal.SIGINT)  # as Ctrl-C: to the workers too
    out, err = client.communicate(timeout=60)
    assert client.returncode == 130
    assert out == "begun\ninterrupted\n"
    assert err == ""
    assert len(Store(tmp_path / "parts").digests()) >= told(tmp_path)


@pytest.mark.slow
def test_a_scheduler_that_somebody_else_started(tmp_path: Path, counts: Path) -> None:
    file = tmp_path / "scheduler.json"
    command = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0",
               "--no-dashboard", "--scheduler-file", str(file)]  # fmt: skip
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "env": ENVIRONMENT, "cwd": tmp_path}
    with subprocess.Popen(command, **quiet) as scheduler:  # type: ignore[call-overload]
        try:
            until(file.exists)
            worker = [sys.executable, "-m", "distributed.cli.dask_worker", "--scheduler-file", str(file), "--nthreads",
                      "1", "--nworkers", "2", "--no-dashboard", "--local-directory", str(tmp_path)]  # fmt: skip
            with subprocess.Popen(worker, **quiet) as hands:  # type: ignore[call-overload]
                try:
                    _with_scheduler(file, tmp_path, counts)
                finally:
                    hands.send_signal(signal.SIGTERM)
        finally:
            scheduler.send_signal(signal.SIGTERM)


def _with_scheduler(file: Path, tmp_path: Path, counts: Path) -> None:
    import json

    address = json.loads(file.read_text())["address"]
    assert address.startswith("tcp://")
    parts, units = tmp_path / "parts", names(20)
    work = CountingWork(counts, {"u0003": kills_once(tmp_path / "mark")}, sleeps(0.35))
    with crew(ExistingScheduler(address)) as workers:
        assert workers.address == address
        assert run(units, work, workers, parts) == Tally(20, 0, 0)
    assert work.counted() == {**dict.fromkeys(units, 1), "u0003": 2}
    assert run_again(address, work, parts, units) == Tally(0, 20, 0)


def run_again(address: str, work: CountingWork, parts: Path, units: list[str]) -> Tally:
    with crew(ExistingScheduler(address)) as workers:
        return run(units, work, workers, parts)


@pytest.mark.parametrize("listens", [False, True], ids=["nobody", "a silent one"])
def test_no_scheduler_is_said_within_seconds_with_a_cure(listens: bool) -> None:
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        if listens:
            silent.listen()
        nowhere = ExistingScheduler(f"tcp://127.0.0.1:{silent.getsockname()[1]}")
        began = time.monotonic()
        said = r"no Dask scheduler answers at tcp://127.0.0.1:\d+ .* `dask scheduler`"
        with pytest.raises(UsageError, match=said), crew(nowhere):
            pass
        assert time.monotonic() - began < FIRST_WORKER / 2  # it does not wait for a worker


@pytest.mark.slow
def test_a_script_without_a_main_guard_is_told_so(tmp_path: Path) -> None:
    script = tmp_path / "client.py"
    script.write_text(
        "from etcfit.fleets.engine.cluster import LocalWorkers, crew\nwith crew(LocalWorkers(1)):\n    pass\n"
    )
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, env=ENVIRONMENT, timeout=60)
    assert (
        done.stderr.strip().splitlines()[-1].startswith("etcfit.errors.UsageError: the worker processes do not start.")
    )


# in which portions units are handed out, and when one is given up; no worker needed


def orders(count: int) -> tuple[Order, ...]:
    return tuple(Order(f"u{k}", "") for k in range(count))


def portion(seconds: float, *ends: Trouble) -> Portion:
    return Portion("tcp://a", seconds, ends or (result_of("d"),))


def test_units_are_handed_out_in_order_first_one_by_one() -> None:
    agenda = Agenda(orders(5), PORTIONS)
    assert [agenda.next_portion(2)[0].unit for _ in range(5)] == ["u0", "u1", "u2", "u3", "u4"]
    assert not agenda.waiting


@pytest.mark.parametrize(("seconds", "least", "most"), [(1e-4, 256, 256), (0.1, 3, 4), (0.4, 1, 1), (60.0, 1, 1)])
def test_a_portion_is_as_large_as_its_time_allows(seconds: float, least: int, most: int) -> None:
    agenda = Agenda(orders(1000), PORTIONS)
    for _ in range(30):
        agenda.take_back(orders(1), portion(seconds))
    assert least <= len(agenda.next_portion(2)) <= most


def test_the_last_units_are_shared_out_evenly() -> None:
    agenda = Agenda(orders(10), PORTIONS)
    for _ in range(30):
        agenda.take_back(orders(1), portion(1e-5))
    assert len(agenda.next_portion(4)) == 3


def test_what_a_worker_did_not_begin_comes_next() -> None:
    agenda = Agenda(orders(3), PORTIONS)
    first = agenda.next_portion(1)
    agenda.take_back((Order("w", ""), Order("x", ""), Order("y", "")), portion(1.0))
    assert first[0].unit == "u0"
    assert [agenda.next_portion(1)[0].unit for _ in range(4)] == ["x", "y", "u1", "u2"]


def test_trouble_is_taken_elsewhere_once_and_then_told() -> None:
    agenda = Agenda((), PORTIONS)
    order, trouble = Order("u", "k"), Trouble("u: no room.")
    assert agenda.take_back((order,), portion(0.1, trouble)) == ([], 0)
    again = agenda.next_portion(1)
    assert again == (order,)
    assert agenda.refused(again) == "tcp://a"
    (failed,), _ = agenda.take_back((order,), portion(0.1, trouble))
    assert isinstance(failed, FailedUnit)
    assert (failed.unit, failed.why, failed.digest) == ("u", "u: no room. It was tried 2 times.", "")
    assert not agenda.waiting


def test_units_of_a_portion_that_died_go_alone_without_blame() -> None:
    agenda = Agenda(orders(100), PORTIONS)
    for _ in range(30):
        agenda.take_back(orders(1), portion(1e-5))
    dead = agenda.next_portion(2)
    assert len(dead) == 50
    assert agenda.take_back(dead, Lost("died")) == ([], 0)
    assert [agenda.next_portion(2) for _ in range(50)] == [(order,) for order in dead]
    assert len(agenda.next_portion(2)) > 1
    assert agenda.take_back(dead[:1], Lost("died")) == ([], 0)  # its first own
    assert [failed.unit for failed in agenda.take_back(dead[:1], Lost("died"))[0]] == ["u0"]


def test_a_scheduler_that_tried_four_workers_itself_needs_no_more() -> None:
    agenda = Agenda((), PORTIONS)
    (failed,), _ = agenda.take_back(orders(1), Lost("died.", 4))
    assert isinstance(failed, FailedUnit)
    assert failed.why == "died. It was tried 4 times."
