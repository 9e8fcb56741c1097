"""What sampling a posterior decides by: ensembles, budgets, and when a chain is long enough to be called a posterior.

tau is the integrated autocorrelation time of a chain, in steps: a chain of N steps and W walkers holds N W / tau
independent draws. R-hat compares the halves of all ensembles: 1 where they agree.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..ranges import check_ranges, real, reals, whole, wholes


@dataclass(frozen=True)
class SamplingSettings:
    """The plan of a sampling.

    Args:
        seeds: of the random numbers, one independent ensemble each.
        walkers_per_coordinate: walkers of each ensemble for each sampled coordinate.
        least_walkers: of each ensemble however few the coordinates; the snooker move needs three others in each half.
        draws_per_coordinate: draws, for each coordinate, that a normal density near the one sampled is sought with.
        most_rounds: times that so many are drawn at most.
        alike_weights: share of them that their weights must be worth.
        refinement: factor on the draws of the last round.
        typical: a walker is no start where log-probability lies below that of a normal density by more than this many
            standard deviations of its chi2.
        halvings: times that such a walker's distance from the mode is halved at most.
        most_steps: of each ensemble, after which sampling ends whether the chain has converged or not.
        block: steps between two writings of the chain to its file.
        length: tau that a chain must be long, after the burn-in.
        burn: tau that are thrown away first.
        earlier: share of the chain with whose tau that of the whole is compared.
        still: relative change of tau over the rest of the chain that is allowed.
        alike: R-hat that is allowed.
        fewest: steps before which nothing is said of tau.
        margin: factor on the steps that are said to be still needed: tau grows with the chain it is estimated from.
        tolerance: relative change of chi2 that ends the descent to the mode.
        profile_tolerance: relative change of chi2 that ends each refit of a profile.
        profile_offsets: distances from the mode at which a profile is looked at first, standard deviations, rising.
        profile_widenings: times that the last of them is widened further while chi2 has not risen enough.
        profile_factor: by which it is widened each time.
        predictive_draws: of the posterior that predictive bands are computed from.
        apart: relative difference of standard deviations from fit, profile and posterior that is flagged.
        draws_per_tau: draws of each walker kept in the file for each tau.
    """

    seeds: tuple[int, ...] = wholes((20230701, 20230702), 0, 2**32 - 1)
    walkers_per_coordinate: int = whole(4, 2, 1000)
    least_walkers: int = whole(8, 8, 10_000)
    draws_per_coordinate: int = whole(40, 8, 100_000)
    most_rounds: int = whole(20, 0, 10_000)
    alike_weights: float = real(0.25, 0.01, 0.99)
    refinement: int = whole(4, 1, 1000)
    typical: float = real(6.0, 0.0, 1000.0)
    halvings: int = whole(30, 0, 1000)
    most_steps: int = whole(20_000, 0, 10**9)
    block: int = whole(50, 1, 10**6)
    length: float = real(50.0, 1.0, 1e6)
    burn: float = real(5.0, 0.0, 1e6)
    earlier: float = real(0.8, 0.1, 0.99)
    still: float = real(0.05, 0.0, 10.0)
    alike: float = real(1.01, 1.0, 10.0)
    fewest: int = whole(100, 10, 10**6)
    margin: float = real(1.1, 1.0, 100.0)
    tolerance: float = real(3e-6, 1e-15, 1.0)
    profile_tolerance: float = real(1e-4, 1e-15, 1.0)
    profile_offsets: tuple[float, ...] = reals((0.5, 1.0, 1.5, 2.0, 2.6), 1e-6, 100.0)
    profile_widenings: int = whole(8, 0, 100)
    profile_factor: float = real(1.6, 1.01, 100.0)
    predictive_draws: int = whole(32, 1, 100_000)
    apart: float = real(0.2, 0.0, 100.0)
    draws_per_tau: int = whole(4, 1, 1000)

    __post_init__ = check_ranges
