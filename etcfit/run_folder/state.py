"""Where a fit or a diagnosis ended, for the command that goes on from there."""

from __future__ import annotations

import os
import zipfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..diagnosis.findings import Diagnosis
from ..errors import UsageError
from ..estimation.joint_fit import FitResult
from ..files import whole
from ..model.effects import COMMANDING, EFFECT_BY_NAME, PAPER
from ..problem.free_parameters import free_parameters
from ..rig.base import FRAMES, Rig, RigConfig
from ..rig.reader import read_folder
from .fit import effects_of

FIT_STATE = "fit_state.npz"
DIAGNOSIS_STATE = "diagnosis_state.npz"


@dataclass(frozen=True, eq=False)
class State:
    """A model at its optimum.

    Args:
        run: the run folder it was read from.
        folder: the measurement folder.
        effects: names of all effects of the model.
        symbols: free parameters, P.
        x: coordinates, shape (P,).
        covariance: shape (P, P).
        far: the model is far from the data and was fitted free-running.
        formulas: effects whose formulas the covariance allows to be off.
    """

    run: Path
    folder: Path
    effects: tuple[str, ...]
    symbols: tuple[str, ...]
    x: np.ndarray
    covariance: np.ndarray
    far: bool
    formulas: tuple[str, ...]


def write_state(run: Path, result: FitResult) -> None:
    """RUN/fit_state.npz. The state of a diagnosis that began from another fit goes: nothing may start from it."""
    (run / DIAGNOSIS_STATE).unlink(missing_ok=True)
    _write(run / FIT_STATE, result)


def write_diagnosis_state(run: Path, diagnosis: Diagnosis) -> None:
    """RUN/diagnosis_state.npz: the final model."""
    _write(run / DIAGNOSIS_STATE, diagnosis.after)


def _write(path: Path, result: FitResult) -> None:
    with whole(path) as draft:
        np.savez(
            draft,
            x=result.x,
            covariance=result.covariance,
            symbols=np.array(result.free_parameters.layout.free, dtype=str),
            effects=np.array(effects_of(result), dtype=str),
            folder=np.array(_relative(Path(result.rig.folder), path.parent)),
            far=np.array(result.far),
            formulas=np.array(result.formulas, dtype=str),
        )


def read_state(run: Path, name: str = FIT_STATE) -> State:
    """Take up a model where `write_state` or `write_diagnosis_state` left it.

    Args:
        run: the run folder.
        name: FIT_STATE or DIAGNOSIS_STATE.
    Raises:
        UsageError: it is not there, or not one that this version wrote.
    """
    path = run / name
    if not path.is_file():
        raise UsageError(f"{run} holds no {_KIND[name]} ({name} is missing). Run `{_COMMAND[name].format(run)}` first.")
    try:
        return _read(path)
    except (OSError, KeyError, ValueError, EOFError, zipfile.BadZipFile) as error:
        found = f"{path} cannot be read as the state of a {_KIND[name]} ({error})."
        raise UsageError(f"{found} Run `{_COMMAND[name].format(run)}` again.") from None


_KIND = {FIT_STATE: "fit", DIAGNOSIS_STATE: "diagnosis"}
_COMMAND = {FIT_STATE: "etcfit fit FOLDER --out {}", DIAGNOSIS_STATE: "etcfit diagnose {}"}


def _read(path: Path) -> State:
    with np.load(path, allow_pickle=False) as state:
        return State(
            run=path.parent,
            folder=Path(os.path.normpath(path.parent / str(state["folder"]))),
            effects=tuple(map(str, state["effects"])),
            symbols=tuple(map(str, state["symbols"])),
            x=state["x"],
            covariance=state["covariance"],
            far=bool(state["far"]),
            formulas=tuple(map(str, state.get("formulas", ()))),  # older files lack it
        )


def rig_of(state: State) -> Rig:
    """The measurement folder of a fit, as it lies there now.

    Raises:
        UsageError: it is gone, or its rig.toml asks for another model than the one that was fitted.
        MeasurementError: it is wrong.
    """
    rig = _folder_of(state)
    layout = free_parameters(rig.config).layout
    if layout.free != state.symbols or tuple(effect.name for effect in layout.types) != state.effects:
        raise changed(state, {*layout.free} ^ {*state.symbols})
    return rig


def final_state(run: Path) -> State:
    """The final model of the diagnosis where RUN holds one, else the fit.

    Raises:
        UsageError: neither is there.
    """
    return read_state(run, DIAGNOSIS_STATE if (run / DIAGNOSIS_STATE).is_file() else FIT_STATE)


def final_config(state: State, config: RigConfig) -> tuple[RigConfig, list[int]]:
    """rig.toml as if it named every effect of a model, and where the state has each of its free parameters, in order.

    Raises:
        UsageError: it asks for another model by now.
    """
    unnamed = {effect.name for effect in (*PAPER, *COMMANDING)}  # those that are there without being asked for
    effects = tuple(name for name in state.effects if name not in unnamed)
    if gone := {*effects} - {*EFFECT_BY_NAME}:
        raise changed(state, gone)
    whole = replace(config, effects=effects)
    free = free_parameters(whole).layout.free
    if {*free} != {*state.symbols}:
        raise changed(state, {*free} ^ {*state.symbols})
    return whole, [state.symbols.index(symbol) for symbol in free]


def final_rig(state: State) -> tuple[Rig, np.ndarray]:
    """The measurement folder as if rig.toml named every effect of a model, and the model's coordinates in that order.

    Raises:
        UsageError: the folder is gone, or its rig.toml asks for another model by now.
        MeasurementError: it is wrong.
    """
    rig = _folder_of(state)
    config, place = final_config(state, rig.config)
    if not {*rig.config.effects} <= {*config.effects}:
        raise changed(state, set())
    return replace(rig, config=config), state.x[place]


def _folder_of(state: State) -> Rig:
    if not state.folder.is_dir():
        raise missing(state)
    return read_folder(state.folder)


def missing(state: State) -> UsageError:
    """The measurements of a run were taken away, or never lay in a folder."""
    if state.folder.name == FRAMES:
        return UsageError(f"{state.run} was fitted to data frames, which no folder holds. Go on in Python, or write "
                          f"them as CSV and run `etcfit fit FOLDER --out {state.run}`.")  # fmt: skip
    return UsageError(f"{state.folder}, which {state.run} was fitted to, is no longer there. Put it back, or run "
                      f"`etcfit fit FOLDER --out {state.run}` again.")  # fmt: skip


def changed(state: State, names: set[str]) -> UsageError:
    """The measurements of a run ask for another model by now, which differs in these names."""
    differs = ", ".join(sorted(names)) or "their order"
    return UsageError(f"{state.folder / 'rig.toml'} has changed since {state.run} was fitted: other parameters are "
                      f"free now ({differs}). Run `etcfit fit {state.folder} --out {state.run}` again.")  # fmt: skip


def fitted_values(run: Path, rig: Rig) -> np.ndarray:
    """Coordinates at which the fit in a run folder ended, for whoever looks at its measurements once more.

    Raises:
        UsageError: no fit there, or of another folder or model.
    """
    state = read_state(run)
    if state.folder.resolve() != Path(rig.folder).resolve():
        raise UsageError(f"{run} was fitted to {state.folder}, not to {rig.folder}. Name a run of these measurements.")
    rig_of(state)
    return state.x


def _relative(folder: Path, run: Path) -> str:
    """The folder as seen from the run, so that both can be moved together."""
    try:
        return Path(os.path.relpath(folder, run)).as_posix()
    except ValueError:  # another drive
        return str(folder.resolve())
