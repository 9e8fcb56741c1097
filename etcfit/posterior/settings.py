"""The settings of `sample` that a user may change; other thresholds are constants of the files that use them.

tau is the integrated autocorrelation time of a chain, in steps: a chain of N steps and W walkers holds N W / tau
independent draws. R-hat compares the halves of all ensembles: 1 where they agree.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..ranges import check_ranges, real, whole, wholes


@dataclass(frozen=True)
class SamplingSettings:
    """The plan of a sampling.

    Args:
        seeds: of the random numbers, one independent ensemble each.
        walkers_per_coordinate: walkers of each ensemble for each sampled coordinate.
        most_steps: of each ensemble, after which sampling ends whether the chain has converged or not.
        length: tau that a chain must be long, after the burn-in.
        still: relative change of tau over the last fifth of the chain that is allowed.
        alike: R-hat that is allowed.
    """

    seeds: tuple[int, ...] = wholes((20230701, 20230702), 0, 2**32 - 1)
    walkers_per_coordinate: int = whole(3, 2, 1000)
    most_steps: int = whole(20_000, 0, 10**9)
    length: float = real(50.0, 1.0, 1e6)
    still: float = real(0.05, 0.0, 10.0)
    alike: float = real(1.01, 1.0, 10.0)

    __post_init__ = check_ranges
