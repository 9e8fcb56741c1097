"""The stored result of one unit of a fleet, without traces: thousands can be sent, kept and read.

    L_u(theta) ~ exp(-1/2 (theta - estimate)^T information (theta - estimate))

`estimate` and `information` are from the unit's own data, in SI and without bounds: the estimate of a parameter that
must not be negative may be below zero, because a bound would push up the mean over many units. A direction that the
data do not determine has no information. `values` are the physical values, for users and predictions.

Also the interface of a fleet's work (`AbstractWork`) and the messages between client and workers, without Dask.
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
    # maximum of the likelihood, SI, shape (P,); any number in a direction without information
    estimate: Float[np.ndarray, " P"]
    # inverse of the covariance, shape (P, P), in 1/SI^2; singular where the data do not determine a direction
    information: Float[np.ndarray, "P P"]


@dataclass(frozen=True)
class UnitParameter:
    """A parameter of one unit by its own fit: see `estimation.intervals.Interval`."""

    value: float  # SI
    unit: str  # of measure, SI
    # stderr, low, high: None where there is none
    stderr: float | None
    low: float | None
    high: float | None
    status: str  # "estimated", "fixed", "tied", "not identifiable" or "compromise"


@dataclass(frozen=True)
class TraceMisfit:
    """The misfit of a trace under its unit's own model."""

    file: str  # below the unit's folder
    test: str  # the rig test
    misfit: float  # root mean square of the whitened residual; 1 where the model explains all


@dataclass(frozen=True, eq=False)
class UnitResult:
    """One unit, fitted."""

    own: UnitEstimate  # its data as a quadratic
    parameters: Mapping[str, UnitParameter]  # by symbol, including those that were not free
    traces: tuple[TraceMisfit, ...]  # misfits of its traces
    chi2_per_dof: float  # of the whitened residual
    # converged, reason: whether at an optimum, and in words
    converged: bool
    reason: str
    synthetic: bool  # whether its rig.toml declares it synthetic
    digest: str  # SHA-256 of its inputs, the settings and the version that it was fitted with
    seconds: float  # duration of the fit
    warnings: tuple[str, ...] = ()  # warnings of the fit
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
    why: str  # in words, as a person must read it
    # digest of the inputs; "" where they were never read. Wrong data are not tried again until they change
    digest: str = ""


class AbstractWork(abc.ABC):
    """The work of one fleet, sent to each worker process and called there for each unit; so it must pickle."""

    @abc.abstractmethod
    def prepare(self) -> None:
        """Called in each worker process before its first unit: slow imports, caches."""

    @abc.abstractmethod
    def digest(self, unit: str) -> str:
        """SHA-256 of all inputs of the unit's result; a unit whose stored result has this digest is not fitted
        again."""

    @abc.abstractmethod
    def fit(self, unit: str) -> UnitResult | FailedUnit:
        """The unit's result; the engine writes the digest into it. An error that it raises affects this unit alone."""


def digest_of(files: Mapping[str, str], **decides: Any) -> str:
    """SHA-256 over the digests of files, this version of etcfit, and further inputs of a result.

    Args:
        files: name -> SHA-256, in any order.
        decides: settings, start point, config: anything that `files.plain` converts to JSON.
    """
    held = {"version": __version__, "files": dict(sorted(files.items())), **plain(decides)}
    return hashlib.sha256(json.dumps(held, sort_keys=True, ensure_ascii=False).encode()).hexdigest()


class Order(NamedTuple):
    """A unit to fit, and the digest of its stored result, "" where there is none."""

    unit: str
    known: str


class Trouble(NamedTuple):
    """A unit got no result for a reason that may lie with its worker: no room on the disk, no memory."""

    why: str


class Portion(NamedTuple):
    """The results of some orders."""

    worker: str  # address of the worker
    seconds: float  # time that it took
    # results of the first orders; None where the stored result still holds. The other orders were not begun, because
    # these took longer than expected
    ends: tuple[UnitResult | FailedUnit | Trouble | None, ...]


class Lost(NamedTuple):
    """No result came back for some orders."""

    why: str  # the message for a unit that was alone
    deaths: int = 1  # workers that died; an existing scheduler may have tried several before it reported the loss
