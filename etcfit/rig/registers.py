"""Whole numbers whose sign stands in a bit of its own."""

from __future__ import annotations

import numpy as np

_BITS = {"duty": (15, 10)}  # of the load; a setpoint may step across half of a converter's range
_ANY = (15,)
_FULL = 0.75  # of the range below the bit that neither part reaches: a count that grows through it is no sign


def without_sign_bit(values: np.ndarray, bit: int) -> np.ndarray:
    """raw below 2^bit, -(raw - 2^bit) from there on, shape (n,); what is negative already stays."""
    most = float(2**bit)
    return np.where(values >= most, most - values, values)


def sign_bit(values: np.ndarray, quantity: str) -> int | None:
    """The bit that holds the sign of these numbers; None where they are no such register.

    Both parts must lie well below the bit, with one sample beside the other across it.

    Args:
        values: as logged, shape (n,).
        quantity: that they are.
    """
    there = values[np.isfinite(values)]
    if there.size < 3 or np.any(there < 0) or np.any(there != np.round(there)):
        return None
    for bit in _BITS.get(quantity, _ANY):
        most = float(2**bit)
        high = there >= most
        if not high.any() or high.all() or there.max() >= 2.0 * most:
            continue
        size = np.where(high, there - most, there)
        if np.max(size) < _FULL * most and np.any(np.diff(high.astype(int)) != 0):
            return bit
    return None
