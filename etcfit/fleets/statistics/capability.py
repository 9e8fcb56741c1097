"""Capability of a line within its specification, and gauge R and R: the share of the measurement in the scatter.

    Cp = (high - low) / (6 sd),   Cpk = min(high - mean, mean - low) / (3 sd)
    outside = Phi((low - mean) / sd) + Phi((mean - high) / sd)

sd is the standard deviation between units without their own uncertainty: an inexact rig does not make a line incapable.
With one limit there is no Cp, and Cpk is towards that limit. The intervals come from the confidence distributions of
mean (Student's t) and sd (log-normal on either side of its interval, which need not be symmetric), taken as independent
as they are for the normal, and integrated on a grid of their quantiles: no random numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy import stats
from scipy.optimize import minimize

from ..settings import DEFAULT, FleetSettings
from .population import Population, population
from .stack import Stack

GRID = 401  # quantiles of each distribution
LEAST_RATIO = 1e-6  # ratio of a variance to that of a single measurement, below which it counts as 0

Names = Sequence[str | None]


@dataclass(frozen=True)
class Line:
    """Mean and spread of one quantity over the units, SI."""

    # mean, stderr, degrees: the mean, its standard error and its degrees of freedom
    mean: float
    stderr: float
    degrees: float
    sd: float  # between units
    sd_interval: tuple[float, float]  # lower and upper bound

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
    """The capability of one quantity; None for an index that does not exist."""

    # low, high: the specification, SI; infinite where a side is open
    low: float
    high: float
    # mean, sd: of the line, SI
    mean: float
    sd: float
    # cp, cpk: indices; infinite where the data show no difference of units
    cp: float | None
    # cp_ci95, cpk_ci95, outside_ci95: lower and upper bound of each, at the level of the settings
    cp_ci95: tuple[float, float] | None
    cpk: float
    cpk_ci95: tuple[float, float]
    outside: float  # share of units expected outside
    outside_ci95: tuple[float, float]


def capability(line: Line, low: float, high: float, level: float = DEFAULT.population.level) -> Capability:
    """Compare a line with its limits, SI, -inf and inf where a side is open; `level` is that of the intervals.

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
    """Quantiles of the confidence distribution of sd, which has the ends of its interval and the estimate as the
    median.

    Logarithmic towards an end above 0, linear towards a lower end, or an estimate, of 0.
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


@dataclass(frozen=True)
class Gauge:
    """Standard deviations of one symbol, SI; None where the measurements do not determine it."""

    repeatability: float  # for the same part, rig and operator
    # rig, operator: between rigs, and between operators
    rig: float | None
    operator: float | None
    reproducibility: float | None  # of rig and operator together
    part: float  # between parts
    total: float  # of all
    rr_percent: float  # 100 R&R / total
    ndc: int  # number of distinct categories
    # parts, measurements: numbers used
    parts: int
    measurements: int
    untold: tuple[str, ...]  # a sentence for each source that the measurements do not determine


def gauge(value: Float[np.ndarray, " N"], parts: Names, rigs: Names, operators: Names) -> Gauge | None:
    """Gauge R and R of one symbol; None where no part was measured twice, or all measurements are of one part.

        y_m = mu + part + rig + operator + e,   each with a variance, by restricted likelihood, balanced or not

    Repeated measurements of one throttle show the scatter of the measurement alone. Repeatability is the scatter e of
    measurements of one part, by one rig and operator; reproducibility is sqrt(rig^2 + operator^2). A unit's stated
    standard error is not subtracted from e: it belongs to the measurement, and e shows whether it was stated right.

        R&R = sqrt(repeatability^2 + reproducibility^2),   %R&R = 100 R&R / total,   ndc = floor(1.41 part / R&R)

    Source: AIAG, Measurement Systems Analysis, 4th ed. 2010, ch. III; Searle, Casella and McCulloch 1992, ch. 6 (REML).
    Differs from source: REML instead of ANOVA, so that a part may be measured any number of times; no interaction.

    Args:
        value: SI, shape (N,); values that are not finite are left out.
        parts, rigs, operators: names for each of N measurements; None where it is unknown.
    """
    used = [m for m, part in enumerate(parts) if part is not None and np.isfinite(value[m])]
    part = _columns([parts[m] for m in used])
    if len(used) < 3 or part.shape[1] < 2 or part.shape[1] == len(used):
        return None
    sources, undetermined = _sources(part, [rigs[m] for m in used], [operators[m] for m in used])
    y = np.asarray(value, dtype=float)[used]
    found = _components((y - y.mean()) / (y.std() or 1.0), [part, *sources.values()]) * (y.std() ** 2)
    sd = dict(zip(("e", "part", *sources), map(float, np.sqrt(found)), strict=True))
    reproducibility = float(np.hypot(sd.get("rig", 0.0), sd.get("operator", 0.0))) if sources else None
    measuring = float(np.hypot(sd["e"], reproducibility or 0.0))
    total = float(np.hypot(measuring, sd["part"]))
    return Gauge(
        repeatability=sd["e"],
        rig=sd.get("rig"),
        operator=sd.get("operator"),
        reproducibility=reproducibility,
        part=sd["part"],
        total=total,
        rr_percent=100.0 * measuring / total if total else 0.0,
        ndc=int(min(1.41 * sd["part"] / measuring, 1e6)) if measuring else 1_000_000,
        parts=part.shape[1],
        measurements=len(used),
        untold=undetermined,
    )


def _columns(names: Names) -> np.ndarray:
    """One column for each level, shape (N, L); a missing name is a row of zeros."""
    levels = sorted({n for n in names if n is not None})
    return np.array([[n == level for level in levels] for n in names], dtype=float).reshape(len(names), len(levels))


def _sources(part: np.ndarray, rigs: Names, operators: Names) -> tuple[dict[str, np.ndarray], tuple[str, ...]]:
    """The sources whose levels differ within a part, and a sentence for each of the others on why it is left out."""
    sources: dict[str, np.ndarray] = {}
    undetermined, known = [], part
    for source, names in (("rig", rigs), ("operator", operators)):
        columns = _columns(names)
        if columns.shape[1] < 2:
            one = (
                f"only one {source} ({next(n for n in names if n is not None)})" if columns.shape[1] else f"no {source}"
            )
            undetermined.append(f"{one} is named: the difference between {source}s is unknown")
        elif _gain(part, columns) == 0:
            undetermined.append(f"each part was measured by one {source} only: {source} and part cannot be told apart")
        elif _gain(known, columns) == 0:
            undetermined.append(f"{source} and rig change together: the scatter of the rig may be that of the {source}")
        else:
            sources[source], known = columns, np.hstack([known, columns])
    if _gain(known, np.eye(len(part))) == 0:
        undetermined.append("no part was measured twice by one rig and operator: repeatability cannot be separated")
    return sources, tuple(undetermined)


def _gain(known: np.ndarray, more: np.ndarray) -> int:
    """Number of contrasts of `more` that `known` does not contain."""
    return int(np.linalg.matrix_rank(np.hstack([known, more])) - np.linalg.matrix_rank(known))


def _components(y: np.ndarray, designs: list[np.ndarray]) -> np.ndarray:
    """Variances of e and of each design, shape (1 + D,): the ratios to e by search, e by its closed form."""
    z = np.hstack(designs)
    sizes = [d.shape[1] for d in designs]
    one = np.ones(len(y))
    inner, zy, z1 = z.T @ z, z.T @ y, z.T @ one

    def profiled(roots: np.ndarray) -> tuple[float, float]:
        """-2 log L and the variance of e at ratios roots^2; V = I + Z G Z^T by its inner matrix."""
        g = np.repeat(np.abs(roots), sizes)
        m = np.eye(len(g)) + g[:, None] * inner * g[None, :]
        solved = np.linalg.solve(m, np.stack([g * zy, g * z1], axis=1))
        yy, y1, l1 = (y @ y - (g * zy) @ solved[:, 0], y @ one - (g * z1) @ solved[:, 0],
                      one @ one - (g * z1) @ solved[:, 1])  # fmt: skip
        left = max(yy - y1**2 / l1, 1e-300)
        free = len(y) - 1
        return float(free * np.log(left) + np.linalg.slogdet(m)[1] + np.log(l1)), float(left / free)

    starts = (np.full(len(sizes), start) for start in (0.3, 3.0))
    tries = [minimize(lambda r: profiled(r)[0], s, method="L-BFGS-B", bounds=[(0.0, 1e6)] * len(sizes)) for s in starts]
    best = min(tries, key=lambda t: t.fun).x
    ratio = np.where(best**2 > LEAST_RATIO, best**2, 0.0)
    return profiled(np.sqrt(ratio))[1] * np.concatenate([[1.0], ratio])
