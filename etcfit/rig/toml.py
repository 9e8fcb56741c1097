"""A TOML file with error messages that name the line and the cure."""

from __future__ import annotations

import difflib
import math
import re
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

from ..errors import MeasurementError
from ..files import read_regular
from .table import decode
from .toml_slips import DOTS_FOUND, DOTS_REQUIRED, filled, left_blank, slip
from .user_text import toml_string

MOST_BYTES = 16_000_000  # largest rig.toml: an import notes every guess in it, about 100 bytes a column


class Limits(NamedTuple):
    """Least and greatest value, and the cure for a value beyond them."""

    low: float
    high: float
    unit: str
    mend: str


@dataclass(frozen=True)
class Toml:
    """A parsed rig.toml with its path and its text, from which the line of each key is found."""

    path: str  # its name in messages
    source: str  # its text
    tables: Mapping[str, Any]  # its content
    layers: tuple[Toml, ...] = ()  # the files from which it was merged, uppermost first; () for one file

    def over(self, common: Toml) -> Toml:
        """This file merged over another: each key of a table is taken from this file, otherwise from the other."""
        names = dict.fromkeys([*common.tables, *self.tables])
        tables = {name: _laid(self.tables.get(name), common.tables.get(name)) for name in names}
        return Toml(self.path, self.source, tables, (self, common))

    def place(self, key: str) -> str:
        """File and line of `table.key`, in the uppermost file that has it."""
        file = next((layer for layer in self.layers if _holds(layer.tables, key)), self)
        return place_of(file.path, file.source, key)

    def wrong(self, key: str, found: str, required: str, mend: str) -> MeasurementError:
        """The error for `table.key`, with its line if it can be found."""
        return MeasurementError(self.place(key), f"{key}: {found}", required, mend)

    def refused(self, key: str, value: Any, required: str, mend: str) -> MeasurementError:
        """The error for the value of `table.key`."""
        return self.wrong(key, f"found {shown(value)}.", required, mend)

    def table(self, name: str, keys: Iterable[str] | None = None) -> Mapping[str, Any]:
        """The table of that name, {} where absent; keys other than the given ones are refused."""
        value = self.tables.get(name, {})
        if not isinstance(value, dict):
            raise self.refused(name, value, "It must be a table.", f"Write [{name}] on a line of its own.")
        if keys is not None:
            self.only(value, tuple(keys), f"{name}.")
        return value

    def only(self, value: Mapping[str, Any], keys: tuple[str, ...], prefix: str = "") -> None:
        """Refuse unknown keys."""
        for key in value:
            if key not in keys:
                raise self.wrong(f"{prefix}{key}", "unknown key.", f"Known here: {', '.join(keys)}.",
                                 closest(key, keys, "Delete it."))  # fmt: skip

    def number(self, key: str, value: Any) -> float:
        """A number, infinity allowed."""
        if isinstance(value, bool) or not isinstance(value, (int, float)) or value != value:
            raise self.refused(key, value, "It must be a number.", f"Write {key.split('.')[-1]} = 1.0.")
        try:
            return float(value)
        except OverflowError:
            return math.inf if value > 0 else -math.inf

    def finite(self, key: str, value: Any) -> float:
        """A finite number."""
        number = self.number(key, value)
        if math.isinf(number):
            raise self.refused(key, value, "It must be finite.", "Correct it, or leave the key out.")
        return number

    def positive(self, key: str, value: Any) -> float:
        """A finite number above 0."""
        number = self.finite(key, value)
        if number <= 0:
            raise self.refused(key, value, "It must be above 0.", "Correct it, or leave the key out.")
        return number

    def within(self, key: str, value: Any, limits: Limits) -> float:
        """A number that a rig can have."""
        number = self.positive(key, value) if limits.low > 0.0 else self.finite(key, value)
        if not limits.low <= number <= limits.high:
            raise self.refused(key, value, f"It must lie between {limits.low:g} and {limits.high:g}{limits.unit}.",
                               limits.mend)  # fmt: skip
        return number

    def string(self, key: str, value: Any) -> str:
        """A text."""
        if not isinstance(value, str):
            raise self.refused(key, value, "It must be a text.", 'Put it in quotes, as "bench".')
        return value

    def strings(self, table: str, key: str) -> tuple[str, ...]:
        """A list of texts; empty where absent."""
        values = self.table(table, (key,)).get(key, [])
        if not isinstance(values, list) or not all(isinstance(v, str) for v in values):
            raise self.refused(f"{table}.{key}", values, "It must be a list of texts.",
                               f'Write {key} = ["first", "second"].')  # fmt: skip
        return tuple(values)


def _laid(own: Any, common: Any) -> Any:
    """Merge tables key by key; a value that is a table in only one of them is taken from the upper one and refused
    later."""
    if isinstance(own, Mapping) and isinstance(common, Mapping):
        return {**common, **own}
    return common if own is None else own


def _holds(tables: Mapping[str, Any], key: str) -> bool:
    head, _, rest = key.partition(".")
    inner = tables.get(head)
    return key in tables or (isinstance(inner, Mapping) and _holds(inner, rest))


def read_text(path: str | Path) -> str:
    """The text of a rig.toml in any Unicode encoding.

    Raises:
        MeasurementError: it cannot be read, is no file, or is too large for a rig.toml.
    """
    try:
        return decode(read_regular(Path(path), str(path), MOST_BYTES), str(path)).removeprefix("\ufeff")
    except OSError as err:
        folder = Path(path).parent  # rig.toml may be one level down, or the folder may be of another kind
        below = sorted(place.parent.name for place in folder.glob("*/rig.toml"))
        mend = 'Create it with two lines: [rig] and name = "bench".'
        if (folder / "run.json").is_file():
            mend = "This is a run folder, which `etcfit fit` made: name the folder of the measurements instead."
        elif below:
            mend = f"One level down there is one: {folder / below[0]}. Name that folder."
        raise MeasurementError(str(path), f"no rig.toml can be read here ({err.strerror}).",
                               "Every measurement folder needs one.", mend) from err  # fmt: skip


def parse(text: str, path: str) -> dict[str, Any]:
    """The tables of a TOML text.

    Raises:
        MeasurementError: it is no TOML, or a value is still to be filled in; names the line.
    """
    try:
        tables = tomllib.loads(text)
    except (ValueError, RecursionError) as err:
        message = str(err)
        required = f"{PurePosixPath(path.replace(chr(92), '/')).name} must be valid TOML."
        line = re.search(r"line (\d+)", message)
        number = int(line[1]) if line else text.count("\n") + 1
        if made := slip(text, message, number):
            raise MeasurementError(f"{path}:{made.line}", made.found, made.required or required, made.mend) from err
        place = f"{path}:{number}" if line or "end of document" in message else path
        raise MeasurementError(place, f"{message.split(' (at ')[0]}.", required,
                               "Correct this line; texts need quotes, decimals a point.") from err  # fmt: skip
    if blank := left_blank(tables):
        raise MeasurementError(place_of(path, text, blank), f"{blank}: {DOTS_FOUND}", DOTS_REQUIRED, filled(blank))
    return tables


def closest(name: str, known: Iterable[str], otherwise: str) -> str:
    """A cure for a misspelt name."""
    known = tuple(known)
    folded = {k.casefold(): k for k in known}
    match = difflib.get_close_matches(name.casefold(), folded, n=1, cutoff=0.6)
    return f"Did you mean '{folded[match[0]]}'?" if match else otherwise


def shown(value: Any) -> str:
    """A value in a message, shortened."""
    try:
        text = repr(value)
    except ValueError:  # Python refuses to print integers of thousands of digits
        text = "a huge number"
    return text if len(text) <= 60 else f"{text[:57]}..."


def place_of(path: str, source: str, key: str) -> str:
    """File and line of `table.key`, for a message: `path:line`, or the path alone where no line is found."""
    line = _line_of(source, key)
    return f"{path}:{line}" if line else path


def _line_of(text: str, key: str) -> int | None:
    """The line of `table.key` by a simple search, good enough for a message."""
    parts = key.split(".")
    whole = [(parts[:k], ".".join(parts[k:])) for k in range(len(parts) - 1, -1, -1)]  # a key may have points in quotes
    for tables, sought in (*whole, (parts[:-2], ".".join(parts[-2:-1]))):
        here: list[str] = []
        for number, line in enumerate(text.split("\n"), 1):
            if header := re.match(r"\s*\[+\s*([^\]]+?)\s*\]", line):
                here = [part.strip("\"' ") for part in header[1].split(".")]
                if here == [*tables, sought]:
                    return number
            elif here == tables and re.match(rf"\s*[\"']?{re.escape(sought)}[\"']?\s*[=.]", line):
                return number
    return None


def written(toml: Toml) -> str:
    """A text from which `toml.parse` gives the same tables."""
    if not toml.layers:
        return toml.source
    plain = {name: value for name, value in toml.tables.items() if not isinstance(value, Mapping)}
    lines = [f"{toml_string(name)} = {_value(value)}" for name, value in plain.items()]
    for name, table in toml.tables.items():
        if isinstance(table, Mapping):
            lines += ["", f"[{toml_string(name)}]"]
            lines += [f"{toml_string(key)} = {_value(value)}" for key, value in table.items()]
    return "\n".join([*lines, ""]).lstrip("\n")


def _value(value: Any) -> str:
    """A value in TOML; tables within a table are inline."""
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
