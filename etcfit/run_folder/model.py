"""What a run folder knows beyond its models: gains, draws of the posterior, sine traces of the rig."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import UsageError, command
from ..estimation.fitted_model import Fitted
from ..estimation.result import FitResult
from ..rig.base import Measurement
from ..rig.driven import Sine
from .manifest import POSTERIOR, read_records, require
from .reading import object_in


def sines_of(result: FitResult) -> tuple[Measurement, ...]:
    """The sine traces of the rig that was fitted."""
    return tuple(trace for trace in result.rig.measurements if trace.test == Sine.name)


def read_design(run: Path) -> Mapping[str, Any] | None:
    """The object of RUN/pid.json; None where no gains were designed.

    Raises:
        UsageError: it is not the file that `etcfit design` wrote, or is of another model than lies there now.
    """
    path = run / "pid.json"
    if "design" not in read_records(run) and not path.is_file():
        return None
    require(run, "design")
    content = object_in(path, "pid", ("gains",), f"Run `{command('design', run)}` again.")
    if not isinstance(content["gains"], dict) or not {"Kp", "Ki", "Kd"} <= set(content["gains"]):
        raise UsageError(f"{path} holds no gains Kp, Ki and Kd. Run `{command('design', run)}` again.")
    return content


def read_draws(run: Path, fitted: Fitted, count: int, seed: int) -> np.ndarray | None:
    """Coordinates drawn from RUN/posterior.nc, shape (count, P); None where there is none of this very model.

    The file's group `posterior` has a variable for each free symbol, SI, over chain and draw.

    Raises:
        UsageError: it is not the file that `etcfit sample` wrote, is of another model than lies there now, or cannot be
            read.
    """
    path = run / POSTERIOR
    if "sample" not in read_records(run):
        return None
    require(run, "sample")
    import xarray

    free = fitted.free_parameters.layout.free
    try:
        with xarray.open_dataset(path, group="posterior", engine="h5netcdf") as data:
            if not set(free) <= set(data.data_vars):
                return None
            values = {symbol: data[symbol].to_numpy().reshape(-1) for symbol in free}
    except (OSError, ValueError, KeyError) as error:
        raise UsageError(f"{path} cannot be read ({error}). Run `{command('sample', run)}` again.") from None
    pick = np.random.default_rng(seed).integers(len(values[free[0]]), size=count)
    return fitted.coordinates({symbol: value[pick] for symbol, value in values.items()})
