"""JSON files and draws of a run folder read back: whole, of their kind, and with what their readers need."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..car_log.foretold import Foretold
from ..errors import UsageError, command
from .manifest import POSTERIOR, read_records, require

if TYPE_CHECKING:
    from ..estimation.fitted_model import Fitted


def object_in(path: Path, kind: str, needed: Sequence[str], cure: str, raw: bytes | None = None) -> Mapping[str, Any]:
    """The object of a file.

    Args:
        kind: of its schema, `etcfit.<kind>/1`.
        needed: keys that must be there.
        raw: its content, where it was read already.
    Raises:
        UsageError: it is no JSON, of another schema, or lacks a key.
        OSError: it cannot be read.
    """
    try:
        content = json.loads(path.read_bytes() if raw is None else raw)
    except (ValueError, RecursionError) as error:
        raise UsageError(f"{path} is no JSON ({error}). {cure}") from None
    schema = content.get("schema") if isinstance(content, dict) else None
    if schema != f"etcfit.{kind}/1":
        raise UsageError(f"{path} has schema {schema!r}, not 'etcfit.{kind}/1'. {cure}")
    if missing := [key for key in needed if key not in content]:
        raise UsageError(f"{path} lacks {', '.join(missing)}. {cure}")
    return content


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


HALF_WAY, PROPOSED, PRESENT = "half_way", "proposed", "present"  # steps of tune.json


def read_foretold(run: Path, made_with: str | None) -> tuple[Foretold, str, Mapping[str, Any]]:
    """What RUN/tune.json foretells of the gains that made a log, which of its steps these are, and the whole object.

    Args:
        run: of `etcfit tune`.
        made_with: name of the step; None for the half-way one, the proposed one where there is no other.
    Raises:
        UsageError: no gains were given there, or none of this name.
    """
    path, cure = run / "tune.json", "Name the run folder of an `etcfit tune` that gave gains."
    if not path.is_file():
        raise UsageError(f"--foretold {run}: there is no tune.json. {cure}")
    tuned = object_in(path, "tune", ("steps", "large_steps", "options"), cure)
    if tuned["why_not"] or not tuned["steps"]:
        raise UsageError(f"--foretold {run}: it gave no gains, so nothing was foretold. {cure}")
    steps = {step["name"]: step for step in tuned["steps"]}
    name = made_with or (HALF_WAY if HALF_WAY in steps else PROPOSED)
    if name not in steps:
        raise UsageError(f"--made-with {name}: {path} foretells {', '.join(steps)}.")
    step, before = steps[name], steps.get(PRESENT) if name != PRESENT else None
    levels = tuned["large_steps"]
    found = Foretold(levels["low_pct"], levels["high_pct"], levels["hold_s"], _range(step["overshoot_pct"]),
                     _range(step["settling_s"]), _range(step["error_pct"]),
                     None if before is None else _range(before["error_pct"]), tuned["held_out"]["rms_pct"])  # fmt: skip
    return found, name, tuned


def _range(each: Sequence[float | None]) -> tuple[float, float, float]:
    """Three numbers of a file, in which null is never."""
    low, middle, high = (float("inf") if value is None else value for value in each)
    return low, middle, high


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
