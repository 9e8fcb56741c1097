"""What an export leaves to choose."""

from __future__ import annotations

from dataclasses import dataclass

from ..ranges import check_ranges, real


@dataclass(frozen=True)
class ExportSettings:
    """What is left to choose.

    Args:
        step: of the plant in C and of the FMU, s; the loop in which gains are tried takes the same.
        share: of the travel, about which the transfer function is taken.
    """

    step: float = real(5e-4, 1e-6, 0.01)
    share: float = real(0.25, 0.0, 1.0)

    __post_init__ = check_ranges
