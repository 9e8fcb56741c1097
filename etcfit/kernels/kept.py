"""Results of tracing, kept on disk as text, so that a known model is not traced again.

    key = SHA-256 of (sources of etcfit, releases of the tracing libraries, function, arguments)

A kept text has numbers, names of etcfit's own classes, and names of object files (`machine`), which contain a check of
their own completeness. No part of it is executed. Arguments without a text, such as an effect that is defined in a
notebook, have no key: they are traced each time.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
from collections.abc import Callable
from contextlib import suppress
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from importlib import import_module
from inspect import isfunction
from pathlib import Path
from typing import Any

import equinox
import jax
import numpy as np
from jaxlib.version import __version__ as _jaxlib

from .. import IMPORTED_AT
from ..backend import own_folder
from ..files import write_text
from .machine import Kernel, ObjectCode, available, processor

_PACKAGE = __name__.partition(".")[0]
_always_traced = False


class NotWrittenError(Exception):
    """A value without a text; the message describes it."""


def trace_always(always: bool = True) -> None:
    """From now on this process neither reads nor writes kept results: for tests that replace functions of the
    sources."""
    global _always_traced
    _always_traced = always


def kept(make: Callable[[], Any], *known: Any) -> Any:
    """The result of `make`, from disk if it was made before.

    Args:
        make: makes numbers, tuples, trees of JAX and kernels that depend only on `known`.
        known: the key of the result.
    """
    folder = None if _always_traced or not available() else own_folder("traces")
    if folder is None:
        return make()
    try:
        key = json.dumps([program(), written(known)])
    except NotWrittenError:
        return make()
    path = folder / hashlib.sha256(key.encode()).hexdigest()
    with suppress(OSError, ValueError, LookupError, TypeError):  # missing, incomplete, or its object file is missing
        found = read(json.loads(path.read_text("utf-8")))
        os.utime(path)  # mark it as used last, see `backend.own_folder`
        return found
    made = make()
    with suppress(OSError, NotWrittenError):
        write_text(path, json.dumps(written(made)))
    return made


@cache
def program(root: Path = Path(__file__).parents[1], since: float = IMPORTED_AT) -> str:
    """A hash of everything that a trace depends on except its arguments.

    Args:
        root: folder of etcfit's sources.
        since: when this process began to import them, s since the epoch.
    Raises:
        NotWrittenError: a source changed after that, so that it is unknown which version runs here.
    """
    digest = hashlib.sha256()
    releases = (platform.python_version(), np.__version__, jax.__version__, _jaxlib, equinox.__version__)
    digest.update(repr((releases, processor())).encode())
    for path in sorted(root.rglob("*.py")):
        source, about = path.read_bytes(), path.stat()
        if max(about.st_mtime, about.st_ctime) > since:
            raise NotWrittenError(str(path))
        digest.update(f"{path.relative_to(root).as_posix()} {len(source)}\n".encode() + source)
    return digest.hexdigest()


def written(value: Any) -> Any:
    """A value in the form for JSON; different values give different texts.

    Raises:
        NotWrittenError: the value is or contains something without a name in etcfit.
    """
    match value:
        case Enum():
            return {"member": [_name(type(value)), value.name]}
        case None | bool() | int() | str():
            return value
        case float():
            return {"float": float(value).hex()}
        case list():
            return [written(each) for each in value]
        case tuple() if type(value) is tuple:
            return {"tuple": [written(each) for each in value]}
        case tuple():
            return {"new": _name(type(value)), "of": [written(each) for each in value]}
        case dict():
            return {"dict": [[written(key), written(each)] for key, each in value.items()]}
        case type():
            return {"class": _class(value)}
        case Kernel():
            return {"kernel": list(value.code)}
        case jax.tree_util.PyTreeDef():
            return {"tree": written(jax.tree.unflatten(value, map(_Leaf, range(value.num_leaves))))}
        case _Leaf():
            return {"leaf": value.number}
    if isfunction(value):
        return {"function": _name(value)}
    if is_dataclass(value):
        return {"new": _name(type(value)), "of": [written(getattr(value, field.name)) for field in fields(value)]}
    raise NotWrittenError(repr(value))


class _Leaf:
    """In the place of a leaf of a tree."""

    def __init__(self, number: int) -> None:
        self.number = number


def _name(defined: Any) -> str:
    """Module and name of a class or a function of etcfit."""
    module, name = defined.__module__, defined.__qualname__
    found = getattr(import_module(module), name, None) if module.startswith(f"{_PACKAGE}.") else None
    if found is not defined:
        raise NotWrittenError(f"{module}.{name}")
    return f"{module}:{name}"


def _class(cls: Any) -> Any:
    """Name of a class; for an effect at a place of the rig its family and the place."""
    if "place" not in vars(cls) or not hasattr(cls, "at"):
        return _name(cls)
    family = cls.__base__
    if family.at(cls.place) is not cls:
        raise NotWrittenError(repr(cls))
    return [_name(family), written(cls.place)]


def read(text: Any) -> Any:
    """The value of a text by `written`, for values that `kept` may return.

    Raises:
        LookupError, TypeError, ValueError: a named object does not exist, or the text is invalid.
    """
    match text:
        case {"tuple": [*parts]}:
            return tuple(map(read, parts))
        case {"new": str(name), "of": [*parts]}:
            module, _, own = name.partition(":")
            if not module.startswith(f"{_PACKAGE}."):
                raise LookupError(name)
            return vars(import_module(module))[own](*map(read, parts))
        case {"dict": [*pairs]}:
            return {read(key): read(each) for key, each in pairs}
        case {"kernel": [*parts]}:
            return Kernel.of_object_code(ObjectCode(*parts))
        case {"tree": tree}:
            return jax.tree.structure(read(tree))
        case {"leaf": int(number)}:
            return _Leaf(number)
        case None | bool() | int() | str():
            return text
    raise ValueError(f"{text!r} is nothing that is kept")
