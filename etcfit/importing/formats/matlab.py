"""MATLAB's .mat, up to v7 by scipy and v7.3 by h5py: vectors, structures of vectors, Simulink's structures with time.

    time, u, i                       vectors of one length make a sheet
    run.t, run.u                     so do those of each structure
    log.time, log.signals.values     a Simulink structure with time
    theta.Time, theta.Data           a time series saved as a structure; those of equal times are one sheet
    Tstart, Tinterval, Length        a PicoScope's time base: t_k = Tstart + k Tinterval; so do Ts, dt, fs

Source: MathWorks, MAT-file level 5 format and `save -v7.3`; Pico Technology, PicoScope 6 help, "MATLAB file".
Differs from source: tables, timetables and time series that were not saved as structures are MATLAB objects, which
neither library reads.
"""

from __future__ import annotations

import math
import struct
import warnings
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..sheet import Column, Sheet, column, time_base
from .base import Format, Source, reading, unreadable

_KIND = "a MATLAB file of vectors or structures of vectors"
_STEP = ("Tinterval", "Ts", "dt", "T_s", "sample_time")
_RATE = ("fs", "Fs", "f_s", "sample_rate")
_START = ("Tstart", "t0")
_FEWEST = 3  # least number of values of a signal
_WIDEST = 64  # largest number of columns of a matrix of signals
_DEEPEST = 32  # largest depth of structures within structures
_ODD = {"MATLAB_object_decode": "a MATLAB object", "MATLAB_sparse": "sparse"}
_HEADER = 128
_ARRAY, _COMPRESSED = 14, 15
_SIZES_AT = 24  # offset in an array: after its own tag and its flags
_ENOUGH = 512  # bytes of an array that contain its tags
_MOST_SHRUNK = 100
_NUMERIC = range(6, 16)  # classes: double to uint64
_APART = 0.9  # share of a vector's length: a vector above it ends too early, one below it is another signal


def _read(source: Source) -> list[Sheet]:
    missing: list[str] = []
    with reading(source, _KIND):
        with source.path.open("rb") as file:
            is_hdf5 = b"MATLAB 7.3" in file.read(128)  # after a block of 512 bytes
        inside = _hdf5(source, missing) if is_hdf5 else _level_5(source, missing)
        sheets = [sheet for part, scope in _scopes(inside) for sheet in _sheets(source.where, part, scope, missing)]
    if missing and not sheets:
        raise unreadable(source.where, "; ".join(missing), _KIND)
    return sheets


def _level_5(source: Source, missing: list[str]) -> dict[str, Any]:
    import scipy.io

    source.refuse_larger(_unpacked(source.path))
    with warnings.catch_warnings(record=True) as odd:
        warnings.simplefilter("always")
        content = scipy.io.loadmat(source.path, simplify_cells=True)
    missing += [str(each.message) for each in odd]
    return _plain(source, missing, {name: value for name, value in content.items() if not name.startswith("__")}, "")


def _plain(source: Source, missing: list[str], scope: Mapping[str, Any], part: str) -> dict[str, Any]:
    """The structure with its numbers, texts and structures only; sparse arrays become full."""
    out: dict[str, Any] = {}
    for name, value in scope.items():
        path = f"{part}.{name}" if part else name
        if isinstance(value, Mapping):
            out[name] = _plain(source, missing, value, path)
        elif hasattr(value, "toarray"):
            source.refuse_larger(8 * math.prod(value.shape))
            out[name] = value.toarray()
        elif isinstance(value, np.ndarray | np.generic) and value.dtype.kind in "cV":
            missing.append(f"'{path}' cannot be read: it is complex, or a MATLAB object (save a structure of vectors)")
        elif isinstance(value, np.ndarray) and value.dtype.kind == "O" and any(_is_vector(each) for each in value.flat):
            missing.append(f"'{path}' cannot be read: it is a cell array of vectors")
        else:
            out[name] = value
    return out


def _is_vector(value: Any) -> bool:
    dtype = getattr(value, "dtype", None)
    return dtype is not None and dtype.kind in "iuf" and value.size >= _FEWEST


def _hdf5(source: Source, missing: list[str]) -> dict[str, Any]:
    import h5py

    with h5py.File(source.path, "r") as file:
        source.refuse_larger(8 * sum(each.size or 0 for each in _datasets(source, h5py, file, "", 0)))
        return _branch(missing, h5py, file, "")


def _datasets(source: Source, h5py: Any, group: Any, part: str, depth: int) -> Iterator[Any]:
    """Every array of numbers, before any is read. MATLAB writes no links: a link is circular or leaves the file."""
    for name in group:
        path = f"{part}.{name}" if part else name
        link = group.get(name, getlink=True)
        if not isinstance(link, h5py.HardLink) or depth > _DEEPEST:
            raise unreadable(source.where, f"'{path}' is a link, or holds itself", _KIND)
        value = group[name]
        if isinstance(value, h5py.Group):
            yield from () if name.startswith("#") else _datasets(source, h5py, value, path, depth + 1)
        elif isinstance(value, h5py.Dataset):
            if value.external or value.is_virtual:
                raise unreadable(source.where, f"'{path}' lies in another file", _KIND)
            yield value


def _branch(missing: list[str], h5py: Any, group: Any, part: str) -> dict[str, Any]:
    """A structure; MATLAB writes arrays transposed, and texts as numbers of letters."""
    out: dict[str, Any] = {}
    for name, value in group.items():
        path = f"{part}.{name}" if part else name
        odd = next((told for mark, told in _ODD.items() if mark in value.attrs), "")
        if name.startswith("#") or "MATLAB_empty" in value.attrs or not isinstance(value, h5py.Group | h5py.Dataset):
            continue
        if odd or getattr(getattr(value, "dtype", None), "kind", "") == "V":
            missing.append(f"'{path}' cannot be read: it is {odd or 'complex'}")
        elif isinstance(value, h5py.Group):
            out[name] = _branch(missing, h5py, value, path)
        elif value.attrs.get("MATLAB_class", b"") == b"char":
            # an invalid character becomes a question mark
            out[name] = np.asarray(np.ravel(value[()]), dtype="<u2").tobytes().decode("utf-16-le", "replace")
        elif value.dtype.kind in "iuf":
            out[name] = np.asarray(value[()]).T
        elif value.attrs.get("MATLAB_class", b"") == b"cell" and any(_refers_to_vectors(value)):
            missing.append(f"'{path}' cannot be read: it is a cell array of vectors")
    return out


def _refers_to_vectors(cell: Any) -> Iterator[bool]:
    """Whether each array that a cell array refers to is a vector of numbers."""
    for reference in np.ravel(cell[()]):
        value = cell.file[reference]
        yield value.attrs.get("MATLAB_class", b"") != b"char" and _is_vector(value)


def _scopes(tree: Mapping[str, Any], part: str = "") -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Each structure with its own fields; a Simulink structure is flattened."""
    series = {
        name: value for name, value in tree.items() if isinstance(value, Mapping) and {"Time", "Data"} <= set(value)
    }
    if is_simulink := {"time", "signals"} <= set(tree):
        signals = tree["signals"]
        listed = [signals] if isinstance(signals, Mapping) else list(signals)
        named = {str(each.get("label") or f"signal {k + 1}"): each["values"] for k, each in enumerate(listed)}
        yield part, {"time": tree["time"], **named}
    else:
        yield part, tree
    yield from ((part, each) for each in _of_equal_times(series))
    for name, value in tree.items():
        if name not in series and isinstance(value, Mapping) and not is_simulink:
            yield from _scopes(value, f"{part}.{name}" if part else name)


def _of_equal_times(series: Mapping[str, Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Time series with equal times, each under its structure's name with its unit."""
    found: dict[bytes, dict[str, Any]] = {}
    for name, each in series.items():
        unit = each.get("Units") or (each["DataInfo"].get("Units") if isinstance(each.get("DataInfo"), Mapping) else "")
        label = f"{name} [{unit}]" if isinstance(unit, str) and unit else name
        found.setdefault(np.ravel(each["Time"]).tobytes(), {"time": each["Time"]})[label] = each["Data"]
    return list(found.values())


def _sheets(where: str, part: str, scope: Mapping[str, Any], missing: Sequence[str]) -> list[Sheet]:
    """One sheet for the vectors of each length."""
    by_length: dict[int, list[Column]] = {}
    for name, value in scope.items():
        for label, vector in _vectors(name, value):
            by_length.setdefault(vector.size, []).append(column(label, vector))
    clock = _clock(scope)
    lacking = _cut_to_one_length(by_length)
    several = len(by_length) > 1
    out = []
    for length, columns in by_length.items():
        made = columns if clock is None else [time_base(clock[0] + clock[1] * np.arange(length)), *columns]
        told = f"{part} ({length} samples)".strip() if several else part
        out.append(Sheet(where, told, tuple(made), missing=(*missing, *lacking)))
    return out


def _cut_to_one_length(by_length: dict[int, list[Column]]) -> list[str]:
    """Cut vectors without a time of their own, of nearly the same length, to the common length; return remarks on
    it."""
    lacking = []
    timed = {n for n, columns in by_length.items() if any(np.all(np.diff(each.values) > 0.0) for each in columns)}
    for length in [n for n in by_length if n not in timed]:
        near = [n for n in by_length if n != length and min(n, length) >= _APART * max(n, length)]
        if near and length in by_length:
            other = min(near, key=lambda n: abs(n - length))
            names = {n: by_length[n][0].name for n in (other, length)}
            lacking.append(f"rows are missing: '{names[other]}' has {other} values, '{names[length]}' has {length}")
            columns = [*by_length.pop(other), *by_length.pop(length)]
            kept = min(other, length)
            by_length.setdefault(kept, []).extend(replace(each, values=each.values[:kept]) for each in columns)
    return lacking


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
    """Start and step, s, if the file gives them as numbers."""

    def number(names: tuple[str, ...]) -> float | None:
        found = (np.asarray(scope[name]) for name in names if name in scope and not isinstance(scope[name], Mapping))
        return next((float(each.ravel()[0]) for each in found if each.size == 1 and each.dtype.kind in "iuf"), None)

    step, rate = number(_STEP), number(_RATE)
    if step is None and rate:
        step = 1.0 / rate
    return None if not step else (number(_START) or 0.0, step)


def _unpacked(path: Path) -> int:
    """Unpacked size of a level 5 file by its own tags; only a few bytes of each variable are unpacked.

        file      128 bytes, the last two "IM" or "MI" for the order of bytes; then variables
        variable  type, length, content: an array (14), or one compressed (15)
        array     type 14, length; flags (6, 8, class, 0); sizes (5, 4 n, n_1 .. n_n); name; content

    Source: MathWorks, MAT-file level 5 format. Differs from source: no.
    Returns:
        Size in memory of all its variables, bytes, with numbers as float64; the file's own size if it is no such file.
    """
    size, at, total = path.stat().st_size, _HEADER, 0
    with path.open("rb") as file:
        order = {b"IM": "<", b"MI": ">"}.get(file.read(_HEADER)[-2:])
        while order and at + 8 <= size:
            file.seek(at)
            kind, length = struct.unpack(f"{order}II", file.read(8))
            head = file.read(min(length, _ENOUGH))
            if kind == _COMPRESSED:
                head = zlib.decompressobj().decompress(head, _ENOUGH)
            elif kind == _ARRAY:
                head = struct.pack(f"{order}II", kind, length) + head
            total += _of_array(head, order, length)
            at += 8 + length
    return total or size


def _of_array(head: bytes, order: str, stored: int) -> int:
    """Bytes of one array: from its count of numbers, or from its whole content if it contains other arrays.

    These may be numbers of one byte, eight in memory; measurements do not compress to a hundredth.
    """
    if len(head) < _SIZES_AT + 8:
        return len(head)
    content, kind = struct.unpack_from(f"{order}I", head, 4)[0], head[16 if order == "<" else 19]
    n = struct.unpack_from(f"{order}I", head, _SIZES_AT + 4)[0] // 4
    if kind not in _NUMERIC or len(head) < _SIZES_AT + 8 + 4 * n:
        return content if content < _MOST_SHRUNK * stored else 8 * content
    return max(content, 8 * math.prod(struct.unpack_from(f"{order}{n}I", head, _SIZES_AT + 8)))


FORMAT = Format("MATLAB", (".mat",), _read)
