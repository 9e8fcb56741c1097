"""A production line: what its throttle bodies have in common, how they differ, and who measures them.

    theta_u = mean * exp(m + C z_u),  z_u ~ N(0, I)      "lognormal"; m and C give mean, spread, correlation
    theta_u = mean * (1 + C z_u)                         "normal"

The symbols are those that a fit of Eqs. 1-2 can tell: J_eq and B_eq in place of what motor and plate have of them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np

from .truth import Truth

DESIGN = Truth(R_a=1.56, L_a=1.40e-3, K_b=0.0184, K_m=0.0184, J_m=1.45e-6, J_L=5.8e-4, B_m=2.1e-5, B_L=1.1e-3,
               K_s=0.146, T_PL=0.368, T_f=0.221)  # fmt: skip
SYMBOLS = ("R_a", "L_a", "K_b", "K_s", "T_PL", "T_f", "J_eq", "B_eq")
SPREAD = {"R_a": 0.04, "L_a": 0.03, "K_b": 0.025, "K_s": 0.03, "T_PL": 0.03, "T_f": 0.06, "J_eq": 0.02, "B_eq": 0.08}
# thin wire has both more ohms and fewer turns; a spring wound too stiff is also wound too tight; grease shows twice
CORRELATION = {("R_a", "K_b"): 0.5, ("R_a", "L_a"): 0.4, ("K_s", "T_PL"): 0.6, ("T_f", "B_eq"): 0.4}


@dataclass(frozen=True)
class Population:
    """How the units of one design differ."""

    design: Truth = DESIGN  # its means
    # standard deviation over mean, by symbol; those without one are alike in all units
    spread: Mapping[str, float] = field(default_factory=lambda: dict(SPREAD))
    # between pairs of symbols; 0 where none is given
    correlation: Mapping[tuple[str, str], float] = field(default_factory=lambda: dict(CORRELATION))
    law: Literal["normal", "lognormal"] = "lognormal"  # of the distribution

    @property
    def mean(self) -> np.ndarray:
        """By SYMBOLS, SI."""
        return np.array([getattr(self.design, symbol) for symbol in SYMBOLS])

    @property
    def relative(self) -> np.ndarray:
        """Spreads by SYMBOLS."""
        return np.array([self.spread.get(symbol, 0.0) for symbol in SYMBOLS])

    @property
    def sd(self) -> np.ndarray:
        """By SYMBOLS, SI."""
        return self.mean * self.relative

    @property
    def matrix(self) -> np.ndarray:
        """The correlations, by SYMBOLS both ways.

        Raises:
            ValueError: no distribution has such correlations.
        """
        out = np.eye(len(SYMBOLS))
        for (a, b), r in self.correlation.items():
            out[SYMBOLS.index(a), SYMBOLS.index(b)] = out[SYMBOLS.index(b), SYMBOLS.index(a)] = r
        if np.linalg.eigvalsh(out)[0] <= 0.0:
            raise ValueError("correlation: the matrix is not positive definite")
        return out

    def unit(self, normal: np.ndarray) -> dict[str, float]:
        """Parameters of the unit that standard normal numbers stand for, one of them a symbol."""
        root, centre = self._law
        factor = 1.0 + root @ normal if self.law == "normal" else np.exp(root @ normal + centre)
        return dict(zip(SYMBOLS, (self.mean * factor).tolist(), strict=True))

    @cached_property
    def _law(self) -> tuple[np.ndarray, np.ndarray]:
        """C and m."""
        covariance = self.matrix * np.outer(self.relative, self.relative)
        if self.law == "lognormal":
            covariance = np.log1p(covariance)
        return _root(covariance), -0.5 * np.diag(covariance)


def _root(covariance: np.ndarray) -> np.ndarray:
    """A square root of a covariance that may have zeros in its diagonal."""
    values, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.maximum(values, 0.0))


def with_symbols(truth: Truth, values: Mapping[str, float]) -> Truth:
    """The truth with other values; J_eq and B_eq keep the shares that motor and plate have of them, K_m is K_b."""
    values = dict(values)
    inertia, damping = values.pop("J_eq", truth.J_eq) / truth.J_eq, values.pop("B_eq", truth.B_eq) / truth.B_eq
    shared = {"J_m": truth.J_m * inertia, "J_L": truth.J_L * inertia,
              "B_m": truth.B_m * damping, "B_L": truth.B_L * damping}  # fmt: skip
    changed = replace(truth, **shared, **values)
    return replace(changed, K_m=changed.K_b)


@dataclass(frozen=True)
class Drift:
    """From one part on a parameter is another by so much of its mean; a new supplier, a worn tool."""

    symbol: str  # one of SYMBOLS
    since: int  # number of the first part after the change, from 0
    size: float  # of the change, relative to the mean


Strength = Literal["low", "medium", "high"]
STRENGTH: dict[Strength, int] = {"low": 0, "medium": 1, "high": 2}


@dataclass(frozen=True)
class Odd:
    """One unit is not like the others."""

    unit: int  # its number, from 0
    kind: str  # an effect of `independent.strengths`, a mistake of `independent.line_mistakes`, or one of SYMBOLS
    strength: Strength = "medium"  # of it


@dataclass(frozen=True)
class Line:
    """One production line and its test bench."""

    population: Population = field(default_factory=Population)  # of the parts
    drift: Drift | None = None  # of one parameter, or None
    batch: int = 50  # parts in one; batch_share: standard deviation of a batch's mean, as a share of the population's
    batch_share: float = 0.0
    a_day: int = 120  # units that are measured in one
    # rigs, operators: how many take turns
    rigs: int = 1
    operators: int = 1
    # by channel, relative standard deviation of a rig's own gain error
    rig_gain: Mapping[str, float] = field(default_factory=dict)
    # by symbol, relative standard deviation of what an operator's handling does to a part
    operator_spread: Mapping[str, float] = field(default_factory=dict)
    # by symbol, relative standard deviation from one clamping of a part to the next
    mounting: Mapping[str, float] = field(default_factory=dict)
    # 0: each part is measured once, rigs and operators in turn; else how often every operator measures it on every rig
    repeats: int = 0
    temperature_C: tuple[float, float] = (22.0, 0.8)  # mean and standard deviation of the room
    copper: float = 0.0  # by how much R_a rises with the room, 1/K; the population's R_a is that at the room's mean
    odd: tuple[Odd, ...] = ()  # the units that are not like the others

    @property
    def a_part(self) -> int:
        """Units that are one part."""
        return max(self.rigs * self.operators * self.repeats, 1)

    def shares(self) -> tuple[float, float]:
        """Of a batch and of a part in a standard normal number."""
        return self.batch_share, math.sqrt(1.0 - self.batch_share**2)
