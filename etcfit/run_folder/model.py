"""The best model that a run folder holds, and what is known of its parameters."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..estimation.fitted_model import Fitted
from ..problem.free_parameters import free_parameters
from ..rig.base import Measurement
from ..rig.config import read_config
from ..rig.sine import Sine
from .state import final_config, final_rig, final_state, missing

POSTERIOR = "posterior.nc"


def read_fitted(run: Path) -> Fitted:
    """The final model of the diagnosis, or that of the fit where none was made.

    Raises:
        UsageError: no fit, its measurement folder is gone, or its rig.toml asks for another model.
        MeasurementError: rig.toml is wrong.
    """
    state = final_state(run)
    toml = state.folder / "rig.toml"
    if not toml.is_file():
        raise missing(state)
    config = read_config(toml)
    whole, place = final_config(state, config)
    return Fitted(config, free_parameters(whole), state.x[place], state.covariance[np.ix_(place, place)])


def read_sines(run: Path) -> tuple[Measurement, ...]:
    """The sine traces of the folder that RUN was fitted to; none, and nothing read, where it has no folder of them.

    Raises:
        UsageError, MeasurementError: as `final_rig`.
    """
    state = final_state(run)
    if not any((state.folder / Sine.name).glob("*")):
        return ()
    rig, _ = final_rig(state)
    return tuple(trace for trace in rig.measurements if trace.test == Sine.name)


def read_draws(run: Path, fitted: Fitted, count: int, seed: int) -> np.ndarray | None:
    """Coordinates drawn from RUN/posterior.nc, shape (count, P); None where there is none of this very model.

    The file's group `posterior` has a variable for each free symbol, SI, over chain and draw.
    """
    path = run / POSTERIOR
    if not path.is_file():
        return None
    import xarray

    free = fitted.free_parameters.layout.free
    with xarray.open_dataset(path, group="posterior", engine="h5netcdf") as data:
        if not set(free) <= set(data.data_vars):
            return None
        values = {symbol: data[symbol].to_numpy().reshape(-1) for symbol in free}
    pick = np.random.default_rng(seed).integers(len(values[free[0]]), size=count)
    return fitted.coordinates({symbol: value[pick] for symbol, value in values.items()})
