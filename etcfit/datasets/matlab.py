"""Vectors out of a MATLAB file."""

from __future__ import annotations

from pathlib import Path

import numpy as np


def read_vectors(path: Path, *names: str) -> tuple[np.ndarray, ...]:
    """The named variables, each flattened, shape (n,), in the units of the file."""
    import scipy.io

    content = scipy.io.loadmat(path)
    return tuple(np.asarray(content[name], dtype=float).ravel() for name in names)
