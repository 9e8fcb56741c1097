"""Numbers in a page: binary, in base64, a twentieth of their size as text.

    value = zero + step q,    q a 16-bit integer, little endian; -32768 for a missing value

A step is the span of the values over 65 000, far below a pixel. Instants have 32 bits, because they must rise strictly.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

NOTHING = -32768
_MOST = 32_500  # largest integer


def instants(time: np.ndarray) -> dict[str, Any]:
    """Times, s, shape (n,), relative to the first one, as 32-bit floats."""
    begin = float(time[0]) if time.size else 0.0
    return {"from": begin, "f32": _text((time - begin).astype("<f4"))}


def values(value: np.ndarray) -> dict[str, Any]:
    """Any numbers, shape (n,); values that are not finite are missing."""
    finite = np.isfinite(value)
    low, high = (float(np.min(value[finite])), float(np.max(value[finite]))) if finite.any() else (0.0, 0.0)
    step = (high - low) / (2.0 * _MOST) or 1.0
    zero = 0.5 * (low + high)
    level = np.round((np.where(finite, value, zero) - zero) / step)
    return {"zero": zero, "step": step, "i16": _text(np.where(finite, level, NOTHING).astype("<i2"))}


def floats(value: np.ndarray) -> dict[str, Any]:
    """Numbers without quantisation, such as constants: 32-bit floats; shape (n,), all finite."""
    return {"from": 0.0, "f32": _text(value.astype("<f4"))}


def numbers(value: np.ndarray) -> dict[str, Any]:
    """Figures with seven digits: 32-bit floats, NaN for a missing one; shape (n,)."""
    return {"from": 0.0, "f32": _text(np.where(np.isfinite(value), value, np.nan).astype("<f4"))}


def with_nan(value: Iterable[float | None]) -> np.ndarray:
    """Numbers with NaN for each None, shape (n,)."""
    return np.array([np.nan if each is None else each for each in value], dtype=float)


def codes(value: Sequence[int] | np.ndarray) -> dict[str, Any]:
    """Whole numbers of 0 to 2^31 - 1, such as indices; shape (n,)."""
    return {"i32": _text(np.asarray(value, dtype="<i4"))}


def _text(array: np.ndarray) -> str:
    return b64encode(array.tobytes()).decode("ascii")
