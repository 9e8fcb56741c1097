"""An object of a class of the package with some of its fields alone: what a function reads of a large result."""

from __future__ import annotations

import dataclasses
from typing import Any, TypeVar

T = TypeVar("T")


def partial(kind: type[T], **fields: Any) -> T:
    """The object; any other field of it is not there, and a field that the class does not have is refused."""
    known = {field.name for field in dataclasses.fields(kind)}  # pyright: ignore[reportArgumentType]
    assert set(fields) <= known, set(fields) - known
    made = object.__new__(kind)
    for name, value in fields.items():
        object.__setattr__(made, name, value)
    return made
