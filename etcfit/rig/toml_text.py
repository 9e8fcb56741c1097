"""The text of a rig.toml: as it was written, or as one file where it was laid together from several."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from .comments import toml_string
from .toml import Toml


def written(toml: Toml) -> str:
    """A text that `toml.parse` makes the same tables of."""
    if not toml.layers:
        return toml.source
    lines = [f"{toml_string(name)} = {_value(value)}" for name, value in toml.tables.items() if not _is_table(value)]
    for name, table in toml.tables.items():
        if _is_table(table):
            lines += ["", f"[{toml_string(name)}]"]
            lines += [f"{toml_string(key)} = {_value(value)}" for key, value in table.items()]
    return "\n".join([*lines, ""]).lstrip("\n")


def _is_table(value: Any) -> bool:
    return isinstance(value, Mapping)


def _value(value: Any) -> str:
    """Tables within a table inline."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{toml_string(key)} = {_value(inner)}" for key, inner in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_value, value)) + "]"
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if isinstance(value, str):
        return toml_string(value)
    if isinstance(value, bool):
        return str(value).lower()
    return repr(value) if isinstance(value, (int, float)) else str(value)
