"""What a run folder knows beyond its models: gains, draws of the posterior, sine traces of the rig."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..estimation.fitted_model import Fitted
from ..estimation.result import FitResult
from ..rig.base import Measurement
from ..rig.sine import Sine
from .manifest import POSTERIOR, is_current, read_records


def sines_of(result: FitResult) -> tuple[Measurement, ...]:
    """The sine traces of the rig that was fitted."""
    return tuple(trace for trace in result.rig.measurements if trace.test == Sine.name)


def read_design(run: Path) -> Mapping[str, Any] | None:
    """The object of RUN/pid.json; None where no gains were designed for the model that lies there now."""
    if not is_current(run, "design", read_records(run)):
        return None
    return json.loads((run / "pid.json").read_text(encoding="utf-8"))


def read_draws(run: Path, fitted: Fitted, count: int, seed: int) -> np.ndarray | None:
    """Coordinates drawn from RUN/posterior.nc, shape (count, P); None where there is none of this very model.

    The file's group `posterior` has a variable for each free symbol, SI, over chain and draw.
    """
    path = run / POSTERIOR
    if not is_current(run, "sample", read_records(run)):
        return None
    import xarray

    free = fitted.free_parameters.layout.free
    with xarray.open_dataset(path, group="posterior", engine="h5netcdf") as data:
        if not set(free) <= set(data.data_vars):
            return None
        values = {symbol: data[symbol].to_numpy().reshape(-1) for symbol in free}
    pick = np.random.default_rng(seed).integers(len(values[free[0]]), size=count)
    return fitted.coordinates({symbol: value[pick] for symbol, value in values.items()})
