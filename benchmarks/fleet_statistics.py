"""Statistics of a fleet on linear-Gaussian fleets with known answer: coverage, shrinkage, odd units, time.

    python -m benchmarks.fleet_statistics coverage --fleets 300 --first-seed 100
    python -m benchmarks.fleet_statistics shrinkage --fleets 100 --first-seed 1000
    python -m benchmarks.fleet_statistics odd --fleets 20 --first-seed 2000
    python -m benchmarks.fleet_statistics time

Units are drawn theta ~ N(mu, Omega), estimates about them with correlated errors of their own size: no throttle, no
fit. So the figures say how good the statistics are where the quadratic of each unit's likelihood is exact, and nothing
of where it is not; the fleet of the independent generator says that.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from etcfit.fleets.settings import FleetSettings, PopulationSettings
from etcfit.fleets.statistics.odd import odd_units
from etcfit.fleets.statistics.population import population, shrink
from etcfit.fleets.statistics.stack import Stack

NO_PROFILES = FleetSettings(PopulationSettings(wald=10.0))  # where intervals are not looked at


@dataclass(frozen=True)
class Design:
    """What is drawn.

    Args:
        units, symbols: how many.
        weak: standard deviation of a unit's own error over the spread between units.
        correlation: between neighbouring symbols' spreads, falling off as a power; of the errors it is minus that.
        spread: standard deviation between units, in units of a tenth of the mean; 0 for a fleet of equal units.
        tails: degrees of freedom of Student's t of the errors (their stated variance kept); 0 for the normal.
        stated: stated over true standard deviation of the errors.
    """

    units: int = 12
    symbols: int = 4
    weak: float = 1.0
    correlation: float = 0.5
    spread: float = 1.0
    tails: int = 0
    stated: float = 1.0


@dataclass(frozen=True, eq=False)
class Drawn:
    """A fleet and its truth, SI: values (N, P), mean (P,), standard deviation (P,), covariance (P, P)."""

    stack: Stack
    values: np.ndarray
    mean: np.ndarray
    sd: np.ndarray
    covariance: np.ndarray


def draw(design: Design, seed: int) -> Drawn:
    """One fleet; symbols of sizes from 1e-5 to 100, errors of units within a factor of two of each other."""
    rng, n, p = np.random.default_rng(seed), design.units, design.symbols
    size = 10.0 ** rng.uniform(-5.0, 2.0, p)
    lag = np.abs(np.subtract.outer(np.arange(p), np.arange(p)))
    between = (0.1 * design.spread) ** 2 * design.correlation**lag
    values = 1.0 + rng.standard_normal((n, p)) @ _root(between).T
    noise = 0.1 * design.weak * rng.uniform(0.7, 1.4, (n, 1, 1))
    error = noise**2 * (-design.correlation) ** lag
    raw = rng.standard_normal((n, p, 1))
    if design.tails:
        raw = rng.standard_t(design.tails, (n, p, 1)) * np.sqrt(1.0 - 2.0 / design.tails)
    estimate = values + (np.linalg.cholesky(error) @ raw)[:, :, 0]
    information = np.linalg.inv(design.stated**2 * error) / np.outer(size, size)
    names = tuple(f"unit_{u:05d}" for u in range(n)), tuple(f"s_{k}" for k in range(p))
    return Drawn(Stack(*names, estimate * size, information), values * size, size, 0.1 * design.spread * size,
                 between * np.outer(size, size))  # fmt: skip


def _root(covariance: np.ndarray) -> np.ndarray:
    value, vector = np.linalg.eigh(covariance)
    return vector * np.sqrt(np.maximum(value, 0.0))


@dataclass(frozen=True, eq=False)
class Coverage:
    """Share of 95 % intervals that hold the truth, over fleets and symbols, and the mean of estimated over true sd."""

    mean: float
    sd: float
    ratio: float


def coverage(design: Design, fleets: int, first_seed: int) -> Coverage:
    """Over as many fleets."""
    means, sds, ratios = [], [], []
    for seed in range(first_seed, first_seed + fleets):
        drawn = draw(design, seed)
        found = population(drawn.stack)
        means.append(_within(drawn.mean, found.mean_interval))
        sds.append(_within(drawn.sd, found.sd_interval))
        ratios.append(found.sd / np.where(drawn.sd > 0.0, drawn.sd, drawn.mean))
    return Coverage(float(np.mean(means)), float(np.mean(sds)), float(np.mean(ratios)))


def _within(truth: np.ndarray, interval: np.ndarray) -> np.ndarray:
    return (interval[:, 0] <= truth) & (truth <= interval[:, 1])


def shrinkage(design: Design, fleets: int, first_seed: int) -> float:
    """Root mean square error of shrunk values over that of each unit's own, symbols in units of their spread."""
    own = shrunk = 0.0
    for seed in range(first_seed, first_seed + fleets):
        drawn = draw(design, seed)
        found = shrink(drawn.stack, population(drawn.stack, settings=NO_PROFILES))
        own += float(np.sum(((drawn.stack.estimate - drawn.values) / drawn.mean) ** 2))
        shrunk += float(np.sum(((found.estimate - drawn.values) / drawn.mean) ** 2))
    return float(np.sqrt(shrunk / own))


def false_odd(design: Design, fleets: int, first_seed: int) -> tuple[float, float]:
    """Share of healthy units called odd, and of fleets with any."""
    counts = []
    for seed in range(first_seed, first_seed + fleets):
        drawn = draw(design, seed)
        counts.append(len(odd_units(drawn.stack, population(drawn.stack, settings=NO_PROFILES))))
    return float(np.mean(counts)) / design.units, float(np.mean(np.array(counts) > 0))


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("table", choices=("coverage", "shrinkage", "odd", "time"))
    parser.add_argument("--fleets", type=int, default=100)
    parser.add_argument("--first-seed", type=int, default=100)
    asked = parser.parse_args()
    {"coverage": _coverages, "shrinkage": _shrinkages, "odd": _odds, "time": _times}[asked.table](
        asked.fleets, asked.first_seed
    )


def _coverages(fleets: int, first_seed: int) -> None:
    print("units symbols weak spread | mean   sd    sd/true (or sd/mean where there is none)")
    for units, symbols in ((12, 4), (40, 4)):
        for weak in (0.3, 1.0, 2.0, 3.0):
            _coverage_row(Design(units, symbols, weak), fleets, first_seed)
        _coverage_row(Design(units, symbols, 1.0, spread=0.0), fleets, first_seed)
    _coverage_row(Design(200, 8, 1.0), max(fleets // 10, 3), first_seed)


def _coverage_row(design: Design, fleets: int, first_seed: int) -> None:
    c = coverage(design, fleets, first_seed)
    print(f"{design.units:5d} {design.symbols:7d} {design.weak:4.1f} {design.spread:6.1f} | "
          f"{c.mean:.3f} {c.sd:.3f} {c.ratio:.3f}", flush=True)  # fmt: skip


def _shrinkages(fleets: int, first_seed: int) -> None:
    print("units symbols weak | error of shrunk over that of units by themselves")
    for units, symbols in ((12, 4), (12, 10), (100, 10)):
        for weak in (0.03, 0.1, 0.3, 1.0, 2.0, 3.0):
            ratio = shrinkage(Design(units, symbols, weak), fleets, first_seed)
            print(f"{units:5d} {symbols:7d} {weak:4.2f} | {ratio:.3f}", flush=True)


def _odds(fleets: int, first_seed: int) -> None:
    print("healthy fleet             | units called odd, fleets with any")
    kinds = {"as in the book": Design(1000, 10, 0.5), "12 units": Design(12, 8, 0.5), "60 units": Design(60, 8, 0.5)}
    kinds |= {"tails of t with 5": replace(kinds["as in the book"], tails=5, weak=2.0)}
    kinds |= {"tails of t with 3": replace(kinds["as in the book"], tails=3, weak=2.0)}
    kinds |= {"errors stated half": replace(kinds["as in the book"], stated=0.5, weak=2.0)}
    for name, design in kinds.items():
        units, any_in = false_odd(design, fleets, first_seed)
        print(f"{name:25s} | {units:.4f} {any_in:.2f}", flush=True)


def _times(fleets: int, first_seed: int) -> None:
    print("units symbols | population, s")
    for units, symbols in ((12, 4), (100, 12), (1000, 12), (10_000, 12)):
        drawn, begin = draw(Design(units, symbols), first_seed), time.perf_counter()
        population(drawn.stack)
        print(f"{units:5d} {symbols:7d} | {time.perf_counter() - begin:.2f}", flush=True)


def expected_range(share: float, draws: int) -> tuple[float, float]:
    """Where an observed share of independent draws lies with 99.9 %."""
    low, high = stats.binom.ppf([0.0005, 0.9995], draws, share) / draws
    return float(low), float(high)


if __name__ == "__main__":
    main()
