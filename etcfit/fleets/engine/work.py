"""What the engine wants of a fit, and what client and workers say to each other; knows nothing of Dask."""

from __future__ import annotations

import abc
import hashlib
import json
from collections.abc import Mapping
from typing import Any, NamedTuple

from ... import __version__
from ...files import plain
from ..unit import FailedUnit, UnitResult


class AbstractWork(abc.ABC):
    """One fleet's work, sent once to every worker process and called there for each unit; so it must pickle."""

    @abc.abstractmethod
    def prepare(self) -> None:
        """Once in every worker process, before its first unit: imports that take long, caches."""

    @abc.abstractmethod
    def digest(self, unit: str) -> str:
        """SHA-256 of all that decides the unit's result; a unit whose stored result has it is not fitted again."""

    @abc.abstractmethod
    def fit(self, unit: str) -> UnitResult | FailedUnit:
        """The unit's result; the engine writes the digest into it. Whatever error it raises costs this unit alone."""


def digest_of(files: Mapping[str, str], **decides: Any) -> str:
    """SHA-256 over the digests of files, this version of etcfit, and what else decides a result.

    Args:
        files: name -> SHA-256, in any order.
        decides: settings, start point, config: whatever `files.plain` makes JSON of.
    """
    held = {"version": __version__, "files": dict(sorted(files.items())), **plain(decides)}
    return hashlib.sha256(json.dumps(held, sort_keys=True, ensure_ascii=False).encode()).hexdigest()


class Order(NamedTuple):
    """A unit to work on, and the digest of the result that is stored, "" where there is none."""

    unit: str
    known: str


class Trouble(NamedTuple):
    """A unit got no result for a reason that may lie with its worker: no room on the disk, no memory."""

    why: str


class Portion(NamedTuple):
    """What came of some orders."""

    worker: str  # address of who did it
    seconds: float  # that it took
    # ends of the first orders; None where the stored result still holds. The other orders were not begun, because
    # these took longer than expected
    ends: tuple[UnitResult | FailedUnit | Trouble | None, ...]


class Lost(NamedTuple):
    """Nothing came back of some orders."""

    why: str  # what to say of a unit that was alone
    deaths: int = 1  # workers that it cost; an existing scheduler may have tried several before it said so
