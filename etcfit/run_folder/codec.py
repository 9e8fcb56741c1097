"""Any frozen object of this package as one file, and back, bit for bit: no stage re-derives what an earlier one knew.

    object -> a tree of plain JSON, its arrays beside it -> one zip file of `.npy` and `tree.json`

Dataclasses, named tuples, enums and classes of etcfit are written by their name and their fields, so a field that is
added later is saved without another line. An array, or an object, that stands in several places is written once and is
one again when it is read. Nothing is pickled: only names of this package are looked up, and nothing of them is called.
"""

from __future__ import annotations

import dataclasses
import enum
import filecmp
import importlib
import io
import json
import tempfile
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..files import whole
from ..kernels.machine import available
from ..model.rig_effects import AbstractRigEffect, Place
from ..problem.records import Grouped

FORMAT = 1  # of these files; one of another is refused
_TREE = "tree.json"
_PACKAGE = __name__.partition(".")[0]
_LEVEL = 1  # of compression: most of the room goes to padding, which the lowest level takes away


class Unreadable(ValueError):
    """The file is not one that this version wrote."""


def save(path: Path, value: Any, known: Mapping[str, Any] | None = None) -> None:
    """Write an object, whole or not at all.

    Args:
        known: objects that are saved elsewhere, by name; where one of them is met its name is written.
    Raises:
        TypeError: part of it is of a kind that cannot be written.
    """
    with whole(path) as draft:
        _write(draft, value, known or {})


def load(path: Path, known: Mapping[str, Any] | None = None) -> Any:
    """Read an object that `save` wrote.

    Args:
        known: objects that were saved elsewhere, by the names given to `save`.
    Raises:
        Unreadable: no such file, not whole, or written by another version.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            tree = json.loads(archive.read(_TREE))
            if tree.get("format") != FORMAT:
                raise Unreadable(f"it has format {tree.get('format')!r}, not {FORMAT}")
            names = [name for name in archive.namelist() if name != _TREE]
            read = np.lib.format.read_array
            arrays = {name.removesuffix(".npy"): read(io.BytesIO(archive.read(name)), allow_pickle=False)
                      for name in names}  # fmt: skip
        return _Reader(arrays, known or {}).decode(tree["value"])
    except Unreadable:
        raise
    except Exception as error:  # whatever a file of any bytes makes zipfile, NumPy and JSON say
        raise Unreadable(str(error) or type(error).__name__) from error


def same(path: Path, value: Any) -> bool:
    """Whether a file is the one that `save` would write of this object: the same object makes the same file."""
    with tempfile.TemporaryDirectory() as scratch:
        again = Path(scratch) / path.name
        _write(again, value, {})
        return filecmp.cmp(path, again, shallow=False)


def _write(path: Path, value: Any, known: Mapping[str, Any]) -> None:
    writer = _Writer(known)
    tree = {"format": FORMAT, "value": writer.encode(value)}
    with zipfile.ZipFile(path, "w") as archive:
        # no date in it: the same object makes the same file
        archive.writestr(zipfile.ZipInfo(_TREE), json.dumps(tree), zipfile.ZIP_DEFLATED, _LEVEL)
        for k, array in enumerate(writer.arrays):
            content = io.BytesIO()
            np.lib.format.write_array(content, array, allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(f"{k}.npy"), content.getbuffer(), zipfile.ZIP_DEFLATED, _LEVEL)


def _name(kind: type) -> str:
    """`module:qualified name` of a class of this package."""
    if kind.__module__.partition(".")[0] != _PACKAGE or "<locals>" in kind.__qualname__:
        raise TypeError(f"{kind.__module__}.{kind.__qualname__} cannot be saved: it is no class of {_PACKAGE}.")
    # `@` alone is the effect of the whole rig: the family itself has no `name`
    place = f"@{kind.place}" if issubclass(kind, AbstractRigEffect) and "name" in vars(kind) else ""
    return f"{kind.__module__}:{kind.__qualname__}{place}"


def _class(name: str) -> type:
    """The class of this package that `_name` calls so."""
    module, _, rest = name.partition(":")
    path, placed, place = rest.partition("@")
    if module.partition(".")[0] != _PACKAGE:
        raise Unreadable(f"it names {name}, which is not part of {_PACKAGE}")
    found: Any = importlib.import_module(module)
    for part in path.split("."):
        found = getattr(found, part)
    if not isinstance(found, type) or found.__module__.partition(".")[0] != _PACKAGE:
        raise Unreadable(f"it names {name}, which is no class of {_PACKAGE}")
    if placed and issubclass(found, AbstractRigEffect):
        return found.at(Place.named(place))
    return found


class _Writer:
    """Plain JSON of an object; arrays are put aside.

    A value of JSON's own stays what it is; all else is a list that begins with its kind.
    """

    def __init__(self, known: Mapping[str, Any]) -> None:
        self.arrays: list[np.ndarray] = []
        self._known = {id(value): name for name, value in known.items()}
        self._seen: dict[int, int] = {}
        self._held: list[Any] = []  # an id is told apart only while its object lives

    def encode(self, value: Any) -> Any:
        if value is None or type(value) in (bool, str, int, float):
            return value  # JSON of Python holds every float to the last bit, nan and inf too
        if id(value) in self._known:
            return ["known", self._known[id(value)]]
        if id(value) in self._seen:
            return ["again", self._seen[id(value)]]
        written = self._encode(value)
        # objects that hold others count once they are written: the reader meets them in the same order
        self._seen[id(value)] = len(self._held)
        self._held.append(value)
        return written

    def _encode(self, value: Any) -> list[Any]:
        if isinstance(value, enum.Enum):
            return ["enum", _name(type(value)), value.name]
        if isinstance(value, (np.ndarray, np.generic, jax.Array)):
            return self._array(value)
        if isinstance(value, type):
            return ["class", _name(value)]
        if dataclasses.is_dataclass(value):
            fields = [field.name for field in dataclasses.fields(value)]
            return ["object", _name(type(value)), {name: self.encode(getattr(value, name)) for name in fields}]
        if isinstance(value, tuple) and (by_name := getattr(value, "_asdict", None)):
            return ["named", _name(type(value)), {name: self.encode(v) for name, v in by_name().items()}]
        if type(value).__module__.partition(".")[0] == _PACKAGE and not getattr(value, "__dict__", {}):
            return ["plain", _name(type(value))]
        if isinstance(value, Mapping):
            return ["mapping", [[self.encode(key), self.encode(v)] for key, v in value.items()]]
        for kind in (tuple, list, frozenset, set):
            if type(value) is kind:
                ordered = sorted(value) if kind in (frozenset, set) else value
                return [kind.__name__, [self.encode(v) for v in ordered]]
        raise TypeError(f"{type(value).__module__}.{type(value).__qualname__} cannot be saved.")

    def _array(self, value: Any) -> list[Any]:
        kind = "jax" if isinstance(value, jax.Array) else "number" if isinstance(value, np.generic) else "array"
        array = np.asarray(value)
        if kind == "array" and array.size > 1 and 0 in array.strides:  # a number repeated takes the room of one
            kept = array[tuple(slice(1) if stride == 0 else slice(None) for stride in array.strides)]
            return ["repeated", self._put(kept), list(array.shape)]
        return [kind, self._put(array)]

    def _put(self, array: np.ndarray) -> str:
        self.arrays.append(array)
        return str(len(self.arrays) - 1)


_SEQUENCES = {"tuple": tuple, "list": list, "frozenset": frozenset, "set": set}


class _Reader:
    """What `_Writer` wrote, as objects again."""

    def __init__(self, arrays: Mapping[str, np.ndarray], known: Mapping[str, Any]) -> None:
        self._arrays = arrays
        self._known = known
        self._seen: list[Any] = []

    def decode(self, tree: Any) -> Any:
        if not isinstance(tree, list):
            return tree
        kind, content = tree[0], tree[1:]
        if kind == "known":
            return self._known[content[0]]
        if kind == "again":
            return self._seen[content[0]]
        value = self._decode(kind, content)
        self._seen.append(value)
        return value

    def _decode(self, kind: str, content: list[Any]) -> Any:
        if kind in ("array", "number", "jax"):
            array = self._arrays[content[0]]
            return array if kind == "array" else array[()] if kind == "number" else jnp.asarray(array)
        if kind == "repeated":
            return np.broadcast_to(self._arrays[content[0]], content[1])
        if kind in ("class", "plain"):
            return _class(content[0]) if kind == "class" else object.__new__(_class(content[0]))
        if kind == "enum":
            return _class(content[0])[content[1]]  # pyright: ignore[reportIndexIssue]
        if kind in ("object", "named"):
            made = self._made(_class(content[0]), {name: self.decode(v) for name, v in content[1].items()})
            return np.asarray(made) if isinstance(made, Grouped) and not available() else made  # JAX takes arrays
        if kind == "mapping":
            return {self.decode(key): self.decode(v) for key, v in content[0]}
        return _SEQUENCES[kind](self.decode(v) for v in content[0])

    @staticmethod
    def _made(kind: Any, fields: dict[str, Any]) -> Any:
        """An object of these very fields: made, not computed again, as what its class does on the way in was done."""
        is_tuple = issubclass(kind, tuple)
        expected = kind._fields if is_tuple else [field.name for field in dataclasses.fields(kind)]  # pyright: ignore
        if set(expected) != set(fields):
            differs = ", ".join(sorted(set(expected) ^ set(fields)))
            raise Unreadable(f"{kind.__name__} has other fields in this version ({differs})")
        if is_tuple:
            return kind(**fields)
        made = object.__new__(kind)
        for name, value in fields.items():
            object.__setattr__(made, name, value)
        return made
