"""What a compiled program depends on besides the package's own source, as text that every process writes alike.

Names of functions and classes stand for what they do: where they lie in this package its source is hashed beside the
text (`executables.py`), and others are refused. A class that was made while running, a rig effect at its place, is
spelled by what it was made from and what it was given.
"""

from __future__ import annotations

import dataclasses
import functools
import sys
import types
from collections.abc import Mapping
from typing import Any

import equinox as eqx

_KNOWN = ("builtins", "etcfit")  # packages whose source the text may stand for


class UnspeakableError(Exception):
    """A value that another process might not write alike, or that does not say all that it does."""


def constant(value: Any) -> str:
    """A hashable argument that a program is compiled for, to the last digit.

    Raises:
        UnspeakableError: a function without a name, an array, an object that is no dataclass.
    """
    match value:
        case None | bool() | int() | float() | str() | bytes():
            return f"{type(value).__name__} {value!r}"
        case type():
            return _class(value)
        case types.FunctionType():
            return f"function {_named(value)}"
        case functools.partial():
            return f"partial{_joined(constant, (value.func, value.args, value.keywords))}"
        case tuple():
            return constant(type(value)) + _joined(constant, value)
        case Mapping():
            return "mapping" + _joined(constant, value.items())
    if dataclasses.is_dataclass(value):
        return constant(type(value)) + _joined(constant, _fields(value).values())
    raise UnspeakableError(repr(type(value)))


def shape(value: Any) -> str:
    """An argument that a program is given: arrays by type and shape, whatever is in them.

    Raises:
        UnspeakableError: a tree of other nodes than tuples, lists, mappings and modules.
    """
    if hasattr(value, "shape") and hasattr(value, "dtype"):  # a NumPy scalar among them, which is a float too
        return f"{value.dtype}{tuple(value.shape)}"
    match value:
        case None:
            return "None"
        case bool() | int() | float() | complex():
            return type(value).__name__
        case list() | tuple():
            return constant(type(value)) + _joined(shape, value)
        case dict() if type(value) is dict:  # JAX orders the entries of others otherwise
            return "dict" + ",".join(f"{constant(key)}: {shape(each)}" for key, each in value.items()) + ";"
        case eqx.Module():
            static = {f.name for f in dataclasses.fields(value) if f.metadata.get("static")}
            parts = (constant(each) if name in static else shape(each) for name, each in _fields(value).items())
            return constant(type(value)) + f"({', '.join(parts)})"
    raise UnspeakableError(repr(type(value)))


def _joined(spelled: Any, values: Any) -> str:
    return f"({', '.join(spelled(each) for each in values)})"


def _fields(value: Any) -> dict[str, Any]:
    return {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}


def _named(value: Any) -> str:
    """Where a function or a class is found under its name, by itself or in what decorates it."""
    module, name = value.__module__, value.__qualname__
    found: Any = sys.modules.get(module)
    for part in name.split("."):
        found = getattr(found, part, None)
    itself = found is value or getattr(found, "__wrapped__", None) is value
    if not itself or module.partition(".")[0] not in _KNOWN:
        raise UnspeakableError(f"{module}.{name}")
    return f"{module}.{name}"


def _class(value: type) -> str:
    """By its name; one that was made while running by its bases and what it was given, names with `_` left out."""
    try:
        return f"class {_named(value)}"
    except UnspeakableError:
        given = {name: each for name, each in vars(value).items() if not name.startswith("_")}
        if value.__module__.partition(".")[0] not in _KNOWN or "<locals>" in value.__qualname__:
            raise
        return f"made{_joined(_class, value.__bases__)}{_joined(constant, sorted(given.items()))}"
