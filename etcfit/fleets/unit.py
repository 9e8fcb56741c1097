"""What one unit of a fleet leaves behind: small enough to be sent, kept and read by the thousand; no traces.

    L_u(theta) ~ exp(-1/2 (theta - estimate)^T information (theta - estimate))

`estimate` and `information` say what the unit's own data tell of its parameters, in SI and without bounds: a parameter
that must not be negative may be estimated below zero, as the mean over many units must not be pushed up by a bound. A
direction that the data do not determine has no information; `values` are the physical ones, for people and predictions.

Also what the engine wants of a fit, and what client and workers say to each other; nothing here knows of Dask.
"""

from __future__ import annotations

import abc
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from .. import __version__
from ..files import plain


@dataclass(frozen=True, eq=False)
class UnitEstimate:
    """A unit's own data, as a quadratic in its free parameters."""

    unit: str  # its name, that of its folder
    symbols: tuple[str, ...]  # of the free parameters
    # where the likelihood is highest, SI, shape (P,); any number in a direction without information
    estimate: Float[np.ndarray, " P"]
    # inverse of the covariance, shape (P, P), in 1/SI^2; singular where nothing is told
    information: Float[np.ndarray, "P P"]


@dataclass(frozen=True)
class UnitParameter:
    """A parameter of one unit as its own fit has it: see `estimation.intervals.Interval`."""

    value: float  # SI
    unit: str  # of measure, SI
    # stderr, low, high: None where there is none
    stderr: float | None
    low: float | None
    high: float | None
    status: str  # "estimated", "fixed", "tied", "not identifiable" or "compromise"


@dataclass(frozen=True)
class TraceMisfit:
    """How far a trace is from its unit's own model."""

    file: str  # below the unit's folder
    test: str  # the rig test
    misfit: float  # root mean square of the whitened residual; 1 where the model explains all


@dataclass(frozen=True, eq=False)
class UnitResult:
    """One unit, fitted."""

    own: UnitEstimate  # its data as a quadratic
    parameters: Mapping[str, UnitParameter]  # by symbol, those that were not free among them
    traces: tuple[TraceMisfit, ...]  # as the unit's model has them
    chi2_per_dof: float  # of the whitened residual
    # converged, reason: whether at an optimum, and in words
    converged: bool
    reason: str
    synthetic: bool  # whether its rig.toml says so
    digest: str  # SHA-256 of its inputs, the settings and the version that it was fitted with
    seconds: float  # that the fit took
    warnings: tuple[str, ...] = ()  # what a reader must know
    # widening of the standard error that the fit states, by symbol of `own`, where residuals are correlated or traces
    # disagree; `own` is without it: see `statistics.stack.robust`
    widening: Mapping[str, float] = field(default_factory=dict)

    @property
    def unit(self) -> str:
        """Its name."""
        return self.own.unit


@dataclass(frozen=True)
class FailedUnit:
    """One unit that has no result."""

    unit: str  # its name
    why: str  # the message, as a person must read it
    # digest of what was tried; "" where it was never read. Data that are wrong stay wrong, and are not tried again
    digest: str = ""


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
