"""What the advice on the next measurement decides by."""

from __future__ import annotations

from dataclasses import dataclass

from ..ranges import check_ranges, real


@dataclass(frozen=True)
class AdviceSettings:
    """When two parameters are entangled, and when one more trace tells them apart.

    rho is the correlation of two estimates. 1 / (1 - rho^2) is the factor by which it makes the variance of either
    larger than it would be were the other one known.

    Args:
        entangled: rho^2 above which two parameters are said to be entangled; dimensionless.
        apart: share of 1 / (1 - rho^2) that may be left if a trace is to be said to separate them; dimensionless.
    """

    entangled: float = real(0.5, 0.0, 1.0)
    apart: float = real(0.9, 0.0, 1.0)

    __post_init__ = check_ranges
