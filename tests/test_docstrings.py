"""What `model` and `problem` offer is explained where it is defined, or by what it overrides."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from collections.abc import Iterator
from typing import Any

import jax

from etcfit import model, problem

COMPILED = type(jax.jit(abs))


def modules() -> Iterator[Any]:
    for room in (model, problem):
        yield room
        for each in pkgutil.walk_packages(room.__path__, f"{room.__name__}."):
            yield importlib.import_module(each.name)


def offered(owner: Any, name: str) -> Iterator[tuple[str, Any]]:
    """Public functions, classes, and methods of these, that a module defines."""
    for key, value in vars(owner).items():
        inner = value.fget if isinstance(value, property) else getattr(value, "func", getattr(value, "__func__", value))
        mine = inspect.isfunction(inner) or inspect.isclass(value) or isinstance(value, COMPILED)
        if key.startswith("_") or not mine or getattr(inner, "__module__", None) != name:
            continue
        yield f"{owner.__name__}.{key}", getattr(owner, key)
        if inspect.isclass(value):
            yield from offered(value, name)


def test_everything_public_is_explained() -> None:
    told = {module.__name__: inspect.getdoc(module) for module in modules()}
    for module in modules():
        told |= {f"{module.__name__}: {name}": inspect.getdoc(v) for name, v in offered(module, module.__name__)}
    assert len(told) > 350  # there is something to explain
    assert [name for name, words in told.items() if not words] == []
