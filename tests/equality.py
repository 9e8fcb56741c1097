"""Whether two objects are equal to the last bit."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Any

import jax
import numpy as np


def equal(a: Any, b: Any) -> bool:
    """Of one kind and one content, to the last bit; nan is nan."""
    if type(a) is not type(b) and not (isinstance(a, jax.Array) and isinstance(b, jax.Array)):
        return False
    if isinstance(a, (np.ndarray, np.generic, jax.Array)):
        one, other = np.asarray(a), np.asarray(b)
        return one.dtype == other.dtype and one.shape == other.shape and one.tobytes() == other.tobytes()
    if isinstance(a, type):
        return a is b
    if is_dataclass(a):
        return all(equal(getattr(a, field.name), getattr(b, field.name)) for field in fields(a))
    if isinstance(a, dict):
        return list(a) == list(b) and all(equal(a[key], b[key]) for key in a)
    if isinstance(a, (tuple, list)):
        return len(a) == len(b) and all(map(equal, a, b))
    if type(a) is float:
        return a.hex() == float(b).hex()
    return a == b or vars(a) == vars(b) == {}
