"""RUN/: its JSON files and the state of a fit, each written whole or not at all."""

from __future__ import annotations

import hashlib
import json
import math
import os
import platform
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, is_dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from . import __version__
from .cure import sentence
from .errors import UsageError
from .fit import FitResult
from .intervals import LUMPS, Interval, intervals, lumped
from .parameters import Parameter
from .rig.base import Rig
from .score import Row

STATE = "fit_state.npz"
GEAR_RATIO = "gear ratio, motor turns per plate turn"


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """A scratch file beside `path` that takes its place once the block ends well; until then the old file stands."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.stem}-", suffix=path.suffix)
    os.close(handle)
    draft = Path(name)
    try:
        yield draft
        draft.chmod(0o644)  # mkstemp makes it private
        os.replace(draft, path)
    finally:
        draft.unlink(missing_ok=True)


def plain(value: Any) -> Any:
    """What JSON can hold: arrays become lists, dataclasses objects, and what is not finite null."""
    if isinstance(value, Mapping):
        return {str(key): plain(v) for key, v in value.items()}
    if is_dataclass(value) and not isinstance(value, type):
        return plain(asdict(value))
    if isinstance(value, (np.ndarray, np.generic)):
        return plain(value.tolist())
    if isinstance(value, (list, tuple, set, frozenset)):
        return [plain(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def write_json(path: Path, kind: str, content: Mapping[str, Any]) -> None:
    """Write one object of schema `etcfit.<kind>/1`: UTF-8, floats at full precision, null for what is not known."""
    stamped = {"schema": f"etcfit.{kind}/1", **plain(content)}
    text = json.dumps(stamped, indent=2, ensure_ascii=False, allow_nan=False)
    with whole(path) as draft:
        draft.write_text(text + "\n", encoding="utf-8")


def fit_json(result: FitResult) -> dict[str, Any]:
    """The object of fit.json (FORMAT.md), and what else a reader may want to know."""
    config = result.rig.config
    return {
        "schema": "etcfit.fit/1",
        "rig": config.name,
        "synthetic": config.synthetic,
        "converged": result.converged,
        "reason": result.reason,
        "model": {"effects": [effect.name for effect in result.unknowns.layout.types]},
        "parameters": parameters_json(result),
        "lumped": _lumped_json(result),
        "score": {
            "fit": [_row(row) for row in result.score_fit],
            "holdout": [_row(row) for row in result.score_holdout],
            "chi2_per_dof": plain(float(result.chi2_per_dof)),
        },
        "not_identifiable": _directions(result),
        "starts": plain(result.starts),
        "warnings": list(result.warnings),
        "noise": _noise(result.rig),
        "widening": plain(result.widening),
        "folder": result.rig.folder,
        "files": _hashes(result.rig),
        "versions": _versions(),
    }


def parameters_json(result: FitResult) -> dict[str, dict[str, Any]]:
    """Every parameter as FORMAT.md has it."""
    declared = {p.symbol: p for p in result.unknowns.layout.parameters}
    read = readings_of(result)
    return {symbol: _parameter(declared.get(symbol), interval, read.get(symbol))
            for symbol, interval in intervals(result).items()}  # fmt: skip


def readings_of(result: FitResult) -> dict[str, float]:
    """What the paper's graphs say, SI: read, not merely assumed, and finite."""
    readings = result.readings
    assumed = readings.nominal | {s for s, other in result.unknowns.layout.ties if other in readings.nominal}
    return {s: float(v) for s, v in readings.values.items() if s not in assumed and np.isfinite(v)}


def write_state(run: Path, result: FitResult) -> None:
    """RUN/fit_state.npz: what a later command needs to go on from this fit."""
    symbols = np.array(result.unknowns.layout.free)
    folder = _relative(Path(result.rig.folder), run)
    with whole(run / STATE) as draft:
        np.savez(draft, x=result.x, covariance=result.covariance, symbols=symbols, folder=np.array(folder))


@dataclass(frozen=True, eq=False)
class State:
    """Where a fit ended.

    Args:
        folder: the measurement folder.
        symbols: free parameters, P.
        x: coordinates, shape (P,).
        covariance: shape (P, P).
    """

    folder: Path
    symbols: tuple[str, ...]
    x: np.ndarray
    covariance: np.ndarray


def read_state(run: Path) -> State:
    """Take up a fit where `write_state` left it.

    Raises:
        UsageError: no fit has been written to `run`.
    """
    if not (run / STATE).is_file():
        raise UsageError(f"{run} holds no fit ({STATE} is missing). Run `etcfit fit FOLDER --out {run}` first.")
    with np.load(run / STATE, allow_pickle=False) as state:
        folder = Path(os.path.normpath(run / str(state["folder"])))
        return State(folder, tuple(map(str, state["symbols"])), state["x"], state["covariance"])


def _relative(folder: Path, run: Path) -> str:
    """The folder as seen from the run, so that both can be moved together."""
    try:
        return Path(os.path.relpath(folder, run)).as_posix()
    except ValueError:  # another drive
        return str(folder.resolve())


def _parameter(parameter: Parameter | None, interval: Interval, reading: float | None) -> dict[str, Any]:
    ci95 = None if interval.low is None else [interval.low, interval.high]
    return plain({
        "value": interval.value,
        "unit": parameter.unit if parameter else "1",
        "stderr": interval.stderr,
        "ci95": ci95,
        "status": interval.status,
        "reading": reading,
        "meaning": parameter.meaning if parameter else GEAR_RATIO,
        **({"remark": interval.remark} if interval.remark else {}),
    })  # fmt: skip


def _lumped_json(result: FitResult) -> dict[str, dict[str, Any]]:
    read = readings_of(result)
    return {
        symbol: plain({"value": i.value, "unit": LUMPS[symbol].unit, "stderr": i.stderr,
                       "ci95": None if i.low is None else [i.low, i.high], "status": i.status,
                       "reading": read.get(symbol), "meaning": LUMPS[symbol].meaning})
        for symbol, i in lumped(result).items()
    }  # fmt: skip


def _row(row: Row) -> dict[str, Any]:
    keys = ("file", "test", "channel", "unit", "n", "rms", "sigma")
    return plain({key: getattr(row, key) for key in keys})


def _directions(result: FitResult) -> list[dict[str, Any]]:
    return [
        plain({"symbols": d.symbols, "shares": d.shares, "null": d.null, "sd": None if d.null else d.sd,
               "says": sentence(d)})
        for d in result.identifiability.directions
    ]  # fmt: skip


def _noise(rig: Rig) -> list[dict[str, Any]]:
    """One entry for each sensor of each test, in SI."""
    seen: dict[tuple[str, str, float], dict[str, Any]] = {}
    for trace in rig.measurements:
        for name, channel in trace.channels.items():
            origin = "estimated" if channel.sigma_estimated else "given"
            seen.setdefault((trace.test, name, channel.sigma), {
                "test": trace.test, "channel": name, "sigma": channel.sigma, "quantum": channel.quantum,
                "origin": origin,
            })  # fmt: skip
    return plain(list(seen.values()))


def _hashes(rig: Rig) -> dict[str, str | None]:
    """SHA-256 of every file that was read; null for one that is no longer there."""
    files = ["rig.toml", *(trace.file for trace in rig.measurements)]
    return {file: _sha256(Path(rig.folder) / file) for file in files}


def _sha256(path: Path) -> str | None:
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else None


def _versions() -> dict[str, str]:
    ours = {"etcfit": __version__, "python": platform.python_version()}
    return ours | {name: metadata.version(name) for name in ("jax", "optimistix", "numpy", "scipy")}
