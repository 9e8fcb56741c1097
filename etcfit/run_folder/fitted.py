"""The best model that a run folder holds, and what is known of its parameters."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from ..effects import EFFECT_BY_NAME, EFFECTS, PAPER
from ..errors import UsageError
from ..fitted import Fitted
from ..rig.base import RigConfig
from ..rig.config import read_config
from ..unknowns import unknowns
from .state import DIAGNOSIS_STATE, FIT_STATE, State, read_state

POSTERIOR = "posterior.nc"


def read_fitted(run: Path) -> Fitted:
    """The final model of the diagnosis, or that of the fit where none was made.

    Raises:
        UsageError: no fit, its measurement folder is gone, or its rig.toml asks for another model.
        MeasurementError: rig.toml is wrong.
    """
    state = read_state(run, DIAGNOSIS_STATE if (run / DIAGNOSIS_STATE).is_file() else FIT_STATE)
    if not (state.folder / "rig.toml").is_file():
        raise UsageError(f"{state.folder}, which {run} was fitted to, is no longer there. Put it back, or run "
                         f"`etcfit fit FOLDER --out {run}` again.")  # fmt: skip
    config = read_config(state.folder / "rig.toml")
    return _in_order(state, config)


def _in_order(state: State, config: RigConfig) -> Fitted:
    """The state's coordinates in the order of the model built anew."""
    further = tuple(name for name in state.effects if EFFECT_BY_NAME.get(name) not in PAPER)
    unknown = sorted(set(further) - set(EFFECT_BY_NAME))
    names = tuple(effect.name for effect in EFFECTS if effect.name in further)
    known = unknowns(replace(config, effects=names))
    if unknown or set(known.layout.free) != set(state.symbols):
        differs = ", ".join([*unknown, *sorted({*known.layout.free} ^ {*state.symbols})])
        raise UsageError(f"{state.folder / 'rig.toml'} has changed since {state.run} was fitted: other parameters are "
                         f"free now ({differs}). Run `etcfit fit {state.folder} --out {state.run}` again.")  # fmt: skip
    place = [state.symbols.index(symbol) for symbol in known.layout.free]
    return Fitted(config, known, state.x[place], state.covariance[np.ix_(place, place)])


def read_draws(run: Path, fitted: Fitted, count: int, seed: int) -> np.ndarray | None:
    """Coordinates drawn from RUN/posterior.nc, shape (count, P); None where there is none of this very model.

    The file's group `posterior` has a variable for each free symbol, SI, over chain and draw.
    """
    path = run / POSTERIOR
    if not path.is_file():
        return None
    import xarray

    free = fitted.unknowns.layout.free
    with xarray.open_dataset(path, group="posterior", engine="h5netcdf") as data:
        if not set(free) <= set(data.data_vars):
            return None
        values = {symbol: data[symbol].to_numpy().reshape(-1) for symbol in free}
    pick = np.random.default_rng(seed).integers(len(values[free[0]]), size=count)
    return fitted.coordinates({symbol: value[pick] for symbol, value in values.items()})
