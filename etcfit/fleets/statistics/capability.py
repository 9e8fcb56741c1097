"""How much room a line leaves within its specification, with what is not known of it.

    Cp = (high - low) / (6 sd),   Cpk = min(high - mean, mean - low) / (3 sd)
    outside = Phi((low - mean) / sd) + Phi((mean - high) / sd)

sd is that between units, their own uncertainty taken off: a rig that measures badly does not make a line incapable.
With one limit Cp is none and Cpk is towards that limit. The intervals come from the confidence distributions of mean
(Student's t) and sd (log-normal on either side of its interval, which need not be symmetric), taken as independent as
they are for the normal, and integrated on a grid of their quantiles: no random numbers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from .population import Population, population
from .settings import DEFAULT, FleetSettings
from .stack import Stack

GRID = 401  # quantiles of each distribution


@dataclass(frozen=True)
class Line:
    """What is known of one quantity over the units, SI.

    Args:
        mean, stderr, degrees: of the mean and of freedom.
        sd: between units.
        sd_interval: lower and upper bound.
    """

    mean: float
    stderr: float
    degrees: float
    sd: float
    sd_interval: tuple[float, float]

    @classmethod
    def from_population(cls, found: Population, symbol: str) -> Line:
        """A symbol of the population."""
        k = found.symbols.index(symbol)
        low, high = (float(v) for v in found.sd_interval[k])
        return cls(float(found.mean[k]), float(found.mean_stderr[k]), float(found.degrees[k]), float(found.sd[k]),
                   (low, high))  # fmt: skip

    @classmethod
    def from_values(cls, value: np.ndarray, stderr: np.ndarray, settings: FleetSettings = DEFAULT) -> Line:
        """A figure of the line: one value a unit, shape (N,), with its standard error, shape (N,); 0 where exact."""
        seen = np.isfinite(value) & np.isfinite(stderr)
        value, stderr = value[seen], stderr[seen]
        least = 1e-6 * (float(np.std(value)) + 1e-9 * float(np.max(np.abs(value), initial=1e-300)))
        information = 1.0 / np.maximum(stderr, max(least, 1e-150)) ** 2
        names = tuple(f"{u}" for u in range(len(value)))
        stack = Stack(names, ("figure",), value[:, None], information[:, None, None])
        return cls.from_population(population(stack, settings=settings), "figure")


@dataclass(frozen=True)
class Capability:
    """Of one quantity; None where there is none.

    Args:
        low, high: the specification, SI; infinite where a side is open.
        mean, sd: of the line, SI.
        cp, cpk: indices; infinite where units are not seen to differ.
        outside: share of units expected outside.
        cp_ci95, cpk_ci95, outside_ci95: lower and upper bound of each, at the level of the settings.
    """

    low: float
    high: float
    mean: float
    sd: float
    cp: float | None
    cp_ci95: tuple[float, float] | None
    cpk: float
    cpk_ci95: tuple[float, float]
    outside: float
    outside_ci95: tuple[float, float]


def capability(line: Line, low: float, high: float, level: float = DEFAULT.population.level) -> Capability:
    """Judge a line.

    Args:
        line: mean and spread.
        low, high: limits, SI; -inf and inf where a side is open.
        level: coverage of the intervals.
    Raises:
        ValueError: the line's symbol is shared, or its mean or spread has no interval.
    """
    if not np.all(np.isfinite([line.mean, line.stderr, line.sd, line.sd_interval[0]])):
        raise ValueError(
            "capability needs a mean and a spread with intervals: two units or more, and no shared symbol."
        )
    q = (np.arange(GRID) + 0.5) / GRID
    mean = line.mean + line.stderr * stats.t.ppf(q, line.degrees)[:, None]
    sd = _sd_quantiles(line, q, level)[None, :]
    both = np.isfinite(high - low)
    wide = line.sd_interval[::-1]
    return Capability(
        low, high, line.mean, line.sd,
        _ratio(high - low, 6.0 * line.sd) if both else None,
        (_ratio(high - low, 6.0 * wide[0]), _ratio(high - low, 6.0 * wide[1])) if both else None,
        _ratio(min(high - line.mean, line.mean - low), 3.0 * line.sd),
        _central(np.minimum(high - mean, mean - low) / (3.0 * sd), level),
        float(_outside(np.array(line.mean), np.array(max(line.sd, 1e-300)), low, high)),
        _central(_outside(mean, sd, low, high), level),
    )  # fmt: skip


def _ratio(room: float, width: float) -> float:
    if width > 0.0:
        return room / width
    return float(np.copysign(np.inf, room)) if room else 0.0


def _outside(mean: np.ndarray, sd: np.ndarray, low: float, high: float) -> np.ndarray:
    return stats.norm.cdf((low - mean) / sd) + stats.norm.sf((high - mean) / sd)


def _sd_quantiles(line: Line, q: np.ndarray, level: float) -> np.ndarray:
    """Of the confidence distribution of sd: its interval's ends at theirs, the estimate in the middle.

    Logarithmic towards an end above nought; a lower end at nought, or an estimate there, is approached straight.
    """
    z = stats.norm.ppf(q) / stats.norm.ppf(0.5 + 0.5 * level)
    low, high = line.sd_interval
    least = 1e-9 * max(line.sd, min(high, 1e300), 1e-280)
    middle = max(line.sd, least)
    up = middle * (high / middle) ** z if line.sd > 0.0 else high * np.maximum(z, 0.0)
    down = middle * (middle / low) ** z if low > 0.0 else middle * (1.0 + z)
    return np.maximum(np.where(z > 0.0, up, down), least)


def _central(value: np.ndarray, level: float) -> tuple[float, float]:
    low, high = np.quantile(value, [0.5 - 0.5 * level, 0.5 + 0.5 * level])
    return float(low), float(high)
