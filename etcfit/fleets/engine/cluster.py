"""Starts the workers of a fleet: processes of this machine, or those of an existing Dask scheduler."""

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
FIRST_WORKER = 60.0  # s to wait for the first worker of a scheduler, and for a new one when all have died

# settings of Dask that are changed here: a task whose worker dies is returned at once, because we know its unit; a
# worker that holds compiled programs must not be paused for their memory, only ended at its limit
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

    workers: int  # number of processes
    memory: int = 2 * 1024**3  # limit of each, bytes; a process that exceeds it is ended, and its unit is tried again


@dataclass(frozen=True)
class ExistingScheduler:
    """A scheduler that was started elsewhere, with its workers; its address is, for example, "tcp://10.0.0.1:8786"."""

    address: str


@dataclass(frozen=True)
class Crew:
    """Workers that wait for work."""

    client: Client  # Dask's client
    local: bool  # whether this program started the processes
    workers: int = 0  # number of processes that this program started

    @property
    def address(self) -> str:
        """Address to watch the workers: Dask's dashboard where bokeh is installed, otherwise that of the scheduler."""
        scheduler: Any = self.client.scheduler_info(n_workers=0)
        page = self.client.dashboard_link if importlib.util.find_spec("bokeh") else None
        return str(page or scheduler["address"])

    def renew(self) -> None:
        """Start new local workers where all have died: Dask's nannies do not always restart them."""
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
    import distributed  # noqa: F401  its defaults must be in dask.config before ours override them

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
    """Raise a UsageError unless Dask and pyarrow, which stores the results, are installed."""
    require_extra("fleet", "A fleet", "distributed", "pyarrow")


@contextmanager
def _local(place: LocalWorkers) -> Iterator[Crew]:
    from distributed import Client, LocalCluster

    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise SystemExit(1)  # a worker that runs its client's script from the top: the client reports the mistake
    try:
        started = LocalCluster(
            n_workers=place.workers,
            threads_per_worker=1,
            processes=True,
            memory_limit=place.memory,
            dashboard_address="127.0.0.1:0",  # any free port: Dask warns on the terminal where its usual port is in use
            silence_logs=logging.CRITICAL,
        )
    except RuntimeError as error:
        raise UsageError("the worker processes do not start. Each of them first imports the script that you started: "
                         'put its statements under `if __name__ == "__main__":`.') from error  # fmt: skip
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
    """Refuse an address without a scheduler: Dask's own client waits for ever where something listens and never
    answers."""
    from distributed.comm.core import connect
    from distributed.security import Security

    async def identity() -> Any:
        line: Any = await connect(address, timeout=0.9 * CONNECT, **Security().get_connection_args("client"))
        try:
            await line.write({"op": "identity"})
            return await line.read()
        finally:
            line.abort()

    with ThreadPoolExecutor(1) as aside:  # a notebook's thread already runs an event loop
        try:
            aside.submit(asyncio.run, asyncio.wait_for(identity(), CONNECT)).result()
        except Exception as error:  # any error that the answer of another program causes in Dask
            why = str(error) or "no answer"
            raise UsageError(f"no Dask scheduler answers at {address} within {CONNECT:g} s: {why}. Start one with "
                             "`dask scheduler`, or leave --scheduler out.") from error  # fmt: skip


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep Dask's log off the terminal: the messages of units report what matters to a user."""
    loggers = [logging.getLogger(name) for name in ("distributed", "tornado", "asyncio")]
    before = [each.level for each in loggers]
    for each in loggers:
        each.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for each, level in zip(loggers, before, strict=True):
            each.setLevel(level)
