"""Writes numbers for people: `Digits` with the significant digits by the uncertainty, `short` with a few digits.

Tables, pictures, pages and the output of `api` in a notebook use it. It imports no other module of etcfit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Digits:
    """The form of a quantity: decimals of value/10^exponent."""

    decimals: int  # number of decimals
    exponent: int = 0  # power of ten split off; 0 if the number is readable without it

    @classmethod
    def of_value(cls, value: float, spread: float | None) -> Digits:
        """Two digits of the spread (such as a standard error); four significant digits without a spread."""
        size = max(abs(value), spread or 0.0)
        if size == 0.0 or not math.isfinite(size):
            return cls(3)
        top = math.floor(math.log10(size) + 1e-12)
        # after rounding: 0.0996 becomes 0.10
        last = int(f"{spread:.1e}".partition("e")[2]) - 1 if spread and math.isfinite(spread) else top - 3
        last = min(last, top)
        exponent = 0 if -4 <= top <= 4 else top
        return cls(max(0, exponent - last), exponent)

    def __call__(self, value: float | None) -> str:
        if value is None or not math.isfinite(value):
            return "-"
        text = f"{value / 10.0**self.exponent:.{self.decimals}f}"
        return f"{text}e{self.exponent:+03d}" if self.exponent else text

    def span(self, low: float | None, high: float | None) -> str:
        """Both ends of an interval."""
        if low is None or high is None:
            return "-"
        return f"{self(low)} ... {self(high)}"


def mean_digits(row: Mapping[str, Any]) -> Digits:
    """Digits of `mean` of a record, by its `sd`."""
    return Digits.of_value(row["mean"] or 0.0, row["sd"])


def short(value: float | None, digits: int = 3) -> str:
    """A few significant digits, without an exponent if the number is readable without it."""
    if value is None or not math.isfinite(value):
        return "-"
    if value == 0.0:
        return "0"
    top = int(f"{value:.{digits - 1}e}".partition("e")[2])  # after rounding: 99.99 becomes 100
    if -4 <= top < 5:
        return f"{value:.{max(0, digits - 1 - top)}f}"
    return f"{value:.{digits - 1}e}"


def is_share(symbol: str, unit: str) -> bool:
    """Whether a symbol is a ratio of one trace, test or channel, such as a gain or phase: no unit, a dot in its name.

    Pictures and the verdict leave these out: a ratio near 0 has no meaningful error in per cent.
    """
    return "." in symbol and not unit


def with_error(value: float, stderr: float | None, spread: float | None = None) -> str:
    """ "1.513 ± 0.012": the significant digits by the error or, without one, by the spread."""
    digits = Digits.of_value(value, spread if stderr is None else stderr)
    return digits(value) + ("" if stderr is None else f" ± {digits(stderr)}")


def or_never(value: float | None, digits: int = 3) -> str:
    """A time; "never" if infinite, which is null in JSON."""
    return "never" if value is None or math.isinf(value) else short(value, digits)


def between(low: float | None, high: float | None, digits: int = 3) -> str:
    """ "0.1..0.3", or one number if both ends are printed alike; an infinite end is "never"."""
    ends = dict.fromkeys(or_never(end, digits) for end in (low, high))
    return "..".join(ends)


def counted(count: int, thing: str) -> str:
    """ "1 unit", "2,000 units"."""
    return f"{count:,} {thing}{'' if count == 1 else 's'}"


SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
