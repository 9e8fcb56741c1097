"""JSON files, declared: each key once, with its type, its meaning and where it comes from; writer and schema follow.

    POINT = Record("One point.", rmse_pct=key("number", "Tracking error, of the travel.", "rmse"))
    POINT.written(point) -> {"rmse_pct": 1.2};  POINT.schema() -> its JSON schema

`python -m docs.made` writes the schemas anew.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

from ..model.figure import figures_of

_TYPES = {"number": "number", "text": "string", "flag": "boolean", "whole": "integer", "object": "object"}
_ABSENT = object()


class Record:
    """An object of a JSON file.

    Args:
        meaning: of the object, where the key that holds it says nothing else.
        ref: its name in `$defs` of the schema; "" where it is written out at each place.
        keys: made by `key`, in order.
    """

    def __init__(self, meaning: str = "", ref: str = "", **keys: Key) -> None:
        self.meaning, self.ref, self.keys = meaning, ref, keys

    def written(self, source: Any) -> dict[str, Any]:
        """The object of what it is taken from; a mapping that lacks a key leaves it out."""
        every = {name: each.value(source, name) for name, each in self.keys.items()}
        return {name: value for name, value in every.items() if value is not _ABSENT}

    def schema(self) -> dict[str, Any]:
        """Its JSON schema, without a description."""
        return {
            "type": "object",
            "properties": {name: each.schema() for name, each in self.keys.items()},
            "required": [name for name, each in self.keys.items() if not each.optional],
        }

    def refs(self) -> dict[str, Record]:
        """The records in it that stand in `$defs`, by name."""
        inner = [each.kind.record if isinstance(each.kind, Many) else each.kind for each in self.keys.values()]
        below = {ref: found for each in inner if isinstance(each, Record) for ref, found in each.refs().items()}
        return below | ({self.ref: self} if self.ref else {})


class Many(NamedTuple):
    """Several records: a list, or, where `named`, an object of them by name; `meaning` is that of one."""

    record: Record
    named: bool
    meaning: str


def list_of(record: Record) -> Many:
    """A list of records."""
    return Many(record, False, record.meaning)


def by_name(record: Record, meaning: str = "") -> Many:
    """An object of records by name."""
    return Many(record, True, meaning or record.meaning)


class Key(NamedTuple):
    """See `key`."""

    kind: str | Record | Many
    meaning: str
    source: str | Callable[[Any], Any] | None
    scale: float
    null: bool
    optional: bool
    more: dict[str, Any]

    def value(self, source: Any, name: str) -> Any:
        """What is written under a name; `_ABSENT` for nothing."""
        value = _taken(source, name if self.source is None else self.source)
        if value is None and self.optional and not self.null:
            return _ABSENT
        if value is None or value is _ABSENT:
            return value
        if isinstance(self.kind, Record):
            return self.kind.written(value)
        if isinstance(self.kind, Many):
            if self.kind.named:
                return {symbol: self.kind.record.written(entry) for symbol, entry in value.items()}
            return [self.kind.record.written(entry) for entry in value]
        if self.scale == 1.0:
            return value
        return [self.scale * entry for entry in value] if isinstance(value, tuple) else self.scale * value

    def schema(self) -> dict[str, Any]:
        about = {"description": self.meaning} if self.meaning else {}
        if isinstance(self.kind, Record):
            return about | _schema_of(self.kind, self.null) | self.more
        if isinstance(self.kind, Many):
            entry = _schema_of(self.kind.record) | ({"description": self.kind.meaning} if self.kind.meaning else {})
            inner = {"additionalProperties" if self.kind.named else "items": entry}
            return about | _nullable({"type": "object" if self.kind.named else "array", **inner}, self.null) | self.more
        return about | _nullable(_plain_schema(self.kind), self.null) | self.more


def key(
    kind: str | Record | Many,
    meaning: str,
    source: str | Callable[[Any], Any] | None = None,
    scale: float = 1.0,
    *,
    null: bool = False,
    optional: bool = False,
    **more: Any,
) -> Key:
    """A key of a record.

    Args:
        kind: "number", "text", "flag", "whole" or "object"; "[number]" for a list, "{number}" for an object by name; a
            "?" behind it for what may be null; or a record, `list_of` or `by_name` of one.
        meaning: a sentence.
        source: attribute of what the record is taken from, dotted; "" for itself, or a function of it; None: the key's.
        scale: times which it is written, 100 for a share in %.
        null: whether it may be null.
        optional: whether it may be absent: readers of older files must do without. One that cannot be null is left out
            where there is none.
        more: further keywords of its JSON schema.
    """
    if isinstance(kind, str) and kind.endswith("?"):
        return Key(kind.removesuffix("?"), meaning, source, scale, True, optional, more)
    return Key(kind, meaning, source, scale, null, optional, more)


def figures(result: Any, meaning: str, symbols: Iterable[str] | None = None, ref: str = "") -> Record:
    """The figures that a class declares (`model.figure`), or some of them; null where one is not known."""
    declared = figures_of(result)
    shown = list(declared if symbols is None else symbols)
    return Record(meaning, ref, **{s: key("number?", f"{declared[s].meaning} In {declared[s].unit}.") for s in shown})


def schema_of_file(kind: str, record: Record) -> dict[str, Any]:
    """The JSON schema of a file of one kind; it welcomes keys of later versions."""
    stamp = key("text", "Kind and version of this file.", const=f"etcfit.{kind}/1").schema()
    found = record.schema()
    refs = {name: {"description": each.meaning, **each.schema()} for name, each in record.refs().items()}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": f"urn:etcfit:{kind}:1",
        "title": f"{kind}.json",
        "description": record.meaning,
        "type": "object",
        "properties": {"schema": stamp, **found["properties"]},
        "required": ["schema", *found["required"]],
        "additionalProperties": True,
        **({"$defs": refs} if refs else {}),
    }


def _taken(source: Any, where: str | Callable[[Any], Any]) -> Any:
    if not isinstance(where, str):
        return where(source)
    for part in filter(None, where.split(".")):
        source = source.get(part, _ABSENT) if isinstance(source, Mapping) else getattr(source, part)
        if source is None or source is _ABSENT:
            return source
    return source


def _schema_of(record: Record, null: bool = False) -> dict[str, Any]:
    if not record.ref:
        return _nullable(record.schema(), null)
    ref = {"$ref": f"#/$defs/{record.ref}"}
    return {"anyOf": [ref, {"type": "null"}]} if null else ref


def _plain_schema(kind: str) -> dict[str, Any]:
    """ "[number?]" -> {"type": "array", "items": {"type": ["number", "null"]}}"""
    bare = kind.removesuffix("?")
    if bare[0] in "[{":
        inner = _plain_schema(bare[1:-1])
        found = (
            {"type": "array", "items": inner} if bare[0] == "[" else {"type": "object", "additionalProperties": inner}
        )
    else:
        found = {"type": _TYPES[bare]}
    return _nullable(found, kind != bare)


def _nullable(schema: dict[str, Any], null: bool) -> dict[str, Any]:
    return schema | {"type": [schema["type"], "null"]} if null else schema
