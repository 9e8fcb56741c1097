"""Where a fleet is worked on: worker processes of this machine, or whatever an existing Dask scheduler has."""

from __future__ import annotations

import asyncio
import importlib.util
import logging
import multiprocessing
import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ...errors import UsageError, require_extra

if TYPE_CHECKING:
    from distributed import Client

CONNECT = 2.5  # s to wait for a scheduler's answer
FIRST_WORKER = 60.0  # s to wait for the first worker of a scheduler, and for one to come back when all have died

# Dask's own habits that do not fit: a task is given back to us at once when its worker dies, for we know which unit
# it was; a worker that holds compiled programs must not be paused for their memory, only ended at its limit
_DASK = {
    "distributed.scheduler.allowed-failures": 0,
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
    "distributed.worker.memory.terminate": 0.95,
    "distributed.worker.memory.monitor-interval": "50ms",
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.limit": "1h",
}


@dataclass(frozen=True)
class LocalWorkers:
    """Worker processes on this machine, one core each."""

    workers: int  # how many
    memory: int = 2 * 1024**3  # of each, bytes; a process that grows beyond is ended, and its unit tried once more


@dataclass(frozen=True)
class ExistingScheduler:
    """A scheduler that somebody else started, with its workers; its address is "tcp://10.0.0.1:8786", say."""

    address: str


@dataclass(frozen=True)
class Crew:
    """Workers that wait for work."""

    client: Client  # Dask's
    local: bool  # whether their processes are ours
    workers: int = 0  # processes of ours that were asked for

    @property
    def address(self) -> str:
        """What to open to watch them: Dask's dashboard where bokeh is installed, else the scheduler's address."""
        scheduler: Any = self.client.scheduler_info(n_workers=0)
        page = self.client.dashboard_link if importlib.util.find_spec("bokeh") else None
        return str(page or scheduler["address"])

    def renew(self) -> None:
        """Start as many new workers of ours, where all are gone: Dask's nannies do not always bring theirs back."""
        if self.local:
            cluster: Any = self.client.cluster
            cluster.scale(len(cluster.worker_spec) + self.workers)


@contextmanager
def crew(place: LocalWorkers | ExistingScheduler) -> Iterator[Crew]:
    """Workers, for as long as the block lasts.

    Raises:
        UsageError: a library of the extra `fleet` is not installed, no scheduler or no worker answers, or a script
            lacks its main guard.
    """
    require_workers()
    import dask.config
    import distributed  # noqa: F401  its defaults must be in dask.config before ours are laid over them

    with (
        dask.config.set(_DASK),
        _quiet(),
        _local(place) if isinstance(place, LocalWorkers) else _existing(place) as made,
    ):
        yield made


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def require_workers() -> None:
    """Dask is here, and what keeps the results of its workers; else a UsageError."""
    require_extra("fleet", "A fleet", "distributed", "pyarrow")


@contextmanager
def _local(place: LocalWorkers) -> Iterator[Crew]:
    from distributed import Client, LocalCluster

    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise SystemExit(1)  # a worker that runs its client's script from the top: the client says what is wrong
    try:
        started = LocalCluster(
            n_workers=place.workers,
            threads_per_worker=1,
            processes=True,
            memory_limit=place.memory,
            dashboard_address="127.0.0.1:0",  # any free port: Dask warns on the terminal where its usual one is taken
            silence_logs=logging.CRITICAL,
        )
    except RuntimeError as error:
        raise UsageError("the worker processes do not start. Each of them first imports the script that you started: "
                         'put what it does under `if __name__ == "__main__":`.') from error  # fmt: skip
    with started as cluster, Client(cluster, set_as_default=False) as client:
        yield Crew(client, local=True, workers=place.workers)


@contextmanager
def _existing(place: ExistingScheduler) -> Iterator[Crew]:
    from distributed import Client

    _must_answer(place.address)
    client = Client(place.address, set_as_default=False, timeout=FIRST_WORKER)
    with client:
        try:
            client.wait_for_workers(1, timeout=FIRST_WORKER)
        except TimeoutError as error:
            raise UsageError(
                f"the scheduler at {place.address} has no worker: start one with `dask worker {place.address}` where "
                "etcfit and the libraries of its extra `fleet` are installed"
            ) from error
        yield Crew(client, local=False)


def _must_answer(address: str) -> None:
    """Refuse an address without a scheduler: Dask's own client waits for ever for one that listens and says nothing."""
    from distributed.comm.core import connect
    from distributed.security import Security

    async def identity() -> Any:
        line: Any = await connect(address, timeout=0.9 * CONNECT, **Security().get_connection_args("client"))
        try:
            await line.write({"op": "identity"})
            return await line.read()
        finally:
            line.abort()

    with ThreadPoolExecutor(1) as aside:  # a notebook's thread has a loop of its own
        try:
            aside.submit(asyncio.run, asyncio.wait_for(identity(), CONNECT)).result()
        except Exception as error:  # whatever the answer of something else makes Dask say
            why = str(error) or "it says nothing"
            raise UsageError(f"no Dask scheduler answers at {address} within {CONNECT:g} s: {why}. Start one with "
                             "`dask scheduler`, or leave --scheduler out.") from error  # fmt: skip


@contextmanager
def _quiet() -> Iterator[None]:
    """Nothing of Dask's log on the terminal: what matters to a person comes as the message of a unit."""
    loggers = [logging.getLogger(name) for name in ("distributed", "tornado", "asyncio")]
    before = [each.level for each in loggers]
    for each in loggers:
        each.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for each, level in zip(loggers, before, strict=True):
            each.setLevel(level)
