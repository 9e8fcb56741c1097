"""MATLAB's .mat, up to v7 by scipy and v7.3 by h5py: vectors, structures of vectors, Simulink's structures with time.

    time, u, i                       vectors of one length make a sheet
    run.t, run.u                     so do those of each structure
    log.time, log.signals.values     a Simulink structure with time
    Tstart, Tinterval, Length        a PicoScope's time base: t_k = Tstart + k Tinterval; so do Ts, dt, fs

Source: MathWorks, MAT-file level 5 format and `save -v7.3`; Pico Technology, PicoScope 6 help, "MATLAB file".
Differs from source: tables, timetables and time series are MATLAB objects, which neither library reads.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..labels import column
from ..sheet import Column, Sheet, time_base
from .base import Format, Source, unreadable

_KIND = "a MATLAB file of vectors or structures of vectors"
_STEP = ("Tinterval", "Ts", "dt", "T_s", "sample_time")
_RATE = ("fs", "Fs", "f_s", "sample_rate")
_START = ("Tstart", "t0")
_FEWEST = 3  # values of a vector to be a signal
_WIDEST = 64  # columns of a matrix of signals


def _read(source: Source) -> list[Sheet]:
    tree = _hdf5(source) if _is_hdf5(source.path) else _level_5(source)
    return [sheet for part, scope in _scopes(tree) for sheet in _sheets(source.where, part, scope)]


def _is_hdf5(path: Path) -> bool:
    """A v7.3 file is HDF5 behind a block of 512 bytes."""
    with path.open("rb") as file:
        return b"MATLAB 7.3" in file.read(128)


def _level_5(source: Source) -> Mapping[str, Any]:
    import scipy.io

    try:
        content = scipy.io.loadmat(source.path, simplify_cells=True)
    except Exception as err:  # whatever its parser makes of bytes that are no such file
        raise unreadable(source.where, "it cannot be read", _KIND, err) from err
    return {name: value for name, value in content.items() if not name.startswith("__")}


def _hdf5(source: Source) -> Mapping[str, Any]:
    import h5py

    try:
        with h5py.File(source.path, "r") as file:
            return _branch(file, h5py)
    except OSError as err:
        raise unreadable(source.where, "it cannot be read", _KIND, err) from err


def _branch(group: Any, h5py: Any) -> dict[str, Any]:
    """A structure; MATLAB writes arrays the other way round, and texts as numbers of letters."""
    out: dict[str, Any] = {}
    for name, value in group.items():
        if isinstance(value, h5py.Group):
            out |= {} if name.startswith("#") else {name: _branch(value, h5py)}
        elif value.attrs.get("MATLAB_class", b"") == b"char":
            out[name] = "".join(chr(int(letter)) for letter in np.ravel(value[()]))
        elif value.dtype.kind in "iuf":
            out[name] = np.asarray(value[()]).T
    return out


def _scopes(tree: Mapping[str, Any], part: str = "") -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Each structure with what it holds itself; a Simulink structure flattened."""
    yield part, _simulink(tree) if {"time", "signals"} <= set(tree) else tree
    for name, value in tree.items():
        if isinstance(value, Mapping) and not ({"time", "signals"} <= set(tree)):
            yield from _scopes(value, f"{part}.{name}" if part else name)


def _simulink(tree: Mapping[str, Any]) -> Mapping[str, Any]:
    signals = tree["signals"]
    listed = [signals] if isinstance(signals, Mapping) else list(signals)
    named = {str(each.get("label") or f"signal {k + 1}"): each["values"] for k, each in enumerate(listed)}
    return {"time": tree["time"], **named}


def _sheets(where: str, part: str, scope: Mapping[str, Any]) -> list[Sheet]:
    """Vectors of one length belong together."""
    by_length: dict[int, list[Column]] = {}
    for name, value in scope.items():
        for label, vector in _vectors(name, value):
            by_length.setdefault(vector.size, []).append(column(label, vector))
    clock = _clock(scope)
    several = len(by_length) > 1
    out = []
    for length, columns in by_length.items():
        made = columns if clock is None else [time_base(clock[0] + clock[1] * np.arange(length)), *columns]
        told = f"{part} ({length} samples)".strip() if several else part
        out.append(Sheet(where, told, tuple(made)))
    return out


def _vectors(name: str, value: Any) -> Iterator[tuple[str, np.ndarray]]:
    """A vector, or the columns of a matrix."""
    array = np.asarray(value) if not isinstance(value, (Mapping, str)) else np.empty(0)
    if array.dtype.kind not in "iuf" or array.size < _FEWEST:
        return
    array = np.squeeze(array.astype(float))
    if array.ndim == 1:
        yield name, array
    elif array.ndim == 2 and min(array.shape) <= _WIDEST:
        tall = array if array.shape[0] >= array.shape[1] else array.T
        yield from ((f"{name}(:,{k + 1})", tall[:, k]) for k in range(tall.shape[1]))


def _clock(scope: Mapping[str, Any]) -> tuple[float, float] | None:
    """Start and step, s, where the file gives them as numbers."""
    step = _number(scope, _STEP)
    rate = _number(scope, _RATE)
    if step is None and rate:
        step = 1.0 / rate
    return None if not step else (_number(scope, _START) or 0.0, step)


def _number(scope: Mapping[str, Any], names: tuple[str, ...]) -> float | None:
    found = (np.asarray(scope[name]) for name in names if name in scope and not isinstance(scope[name], Mapping))
    return next((float(each.ravel()[0]) for each in found if each.size == 1 and each.dtype.kind in "iuf"), None)


FORMAT = Format("MATLAB", (".mat",), _read)
