"""Which mistakes anybody could tell from the spread of the parts, were population and units known exactly.

    P(D^2 > c) with D^2 ~ chi2'(P, delta^T Sigma^-1 delta),  c the threshold of Benjamini and Hochberg

    python -m benchmarks.fleet.power [--units 1000] [--odd 8] [--rate 0.05]

Only of mistakes that fit: they look like a throttle with other parameters and leave no misfit. `delta` is what they add
to the parameters, relative. L_a is left out, as recordings of 500 samples a second hardly tell it.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping

import numpy as np
from scipy.stats import chi2, ncx2

from independent.line import DESIGN, SYMBOLS, Population
from independent.line_mistakes import IN_THE_LOG, ON_THE_BENCH

TOLD = [k for k, symbol in enumerate(SYMBOLS) if symbol != "L_a"]
AT_THE_PLATE = ("K_s", "T_PL", "T_f", "J_eq", "B_eq")


def current_gain(factor: float) -> dict[str, float]:
    """v = R i + k w and K_m = K_b: every torque and inertia times the factor, R_a over it."""
    return {"R_a": 1.0 / factor - 1.0} | dict.fromkeys(AT_THE_PLATE, factor - 1.0)


def gear_ratio(factor: float) -> dict[str, float]:
    """N K_b is told, N believed; the motor's inertia and damping come through the square."""
    motor = {"J_eq": DESIGN.N**2 * DESIGN.J_m / DESIGN.J_eq, "B_eq": DESIGN.N**2 * DESIGN.B_m / DESIGN.B_eq}
    return {"K_b": factor - 1.0} | {symbol: share * (factor**2 - 1.0) for symbol, share in motor.items()}


def series_resistance(ohm: float) -> dict[str, float]:
    """As R_a."""
    return {"R_a": ohm / DESIGN.R_a}


FITTING: Mapping[str, Callable[[float], dict[str, float]]] = {
    "current_gain": current_gain,
    "gear_ratio": gear_ratio,
    "series_resistance": series_resistance,
}


def distance(shift: Mapping[str, float], population: Population) -> float:
    """delta^T Sigma^-1 delta over what is told."""
    delta = np.array([shift.get(symbol, 0.0) for symbol in SYMBOLS])[TOLD]
    covariance = (population.matrix * np.outer(population.relative, population.relative))[np.ix_(TOLD, TOLD)]
    return float(delta @ np.linalg.solve(covariance, delta))


def power(squared: float, level: float) -> float:
    """Share of units so far off whose p lies below the level."""
    return float(ncx2.sf(chi2.isf(level, len(TOLD)), len(TOLD), squared))


def table(units: int, odd: int, rate: float) -> str:
    level = rate * odd / units
    lines = [f"| mistake | size | distance | found at p < {level:.1e} |", "|---|---|---|---|"]
    for name, shift in FITTING.items():
        for size in (ON_THE_BENCH if name in ON_THE_BENCH else IN_THE_LOG)[name][1]:
            squared = distance(shift(size), Population())
            lines.append(f"| {name} | {size:g} | {np.sqrt(squared):.1f} | {100 * power(squared, level):.0f} % |")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--units", type=int, default=1000)
    parser.add_argument("--odd", type=int, default=8)
    parser.add_argument("--rate", type=float, default=0.05, help="false discoveries of all")
    asked = parser.parse_args()
    print(table(asked.units, asked.odd, asked.rate))


if __name__ == "__main__":
    main()
