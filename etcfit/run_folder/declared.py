"""JSON files, declared: each key once, with its type, its meaning and where it comes from; writer and schema follow.

    POINT = Record("One point.", rmse_pct=key("number", "Tracking error, of the travel.", "rmse"))
    POINT.written(point) -> {"rmse_pct": 1.2};  POINT.schema() -> its JSON schema

`python -m docs.made` writes the schemas anew. At the end stand the keys that many files have.
"""

from __future__ import annotations

import linecache
import platform
import re
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import is_dataclass
from importlib import metadata
from inspect import cleandoc, getfile
from types import NoneType, UnionType
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Union, get_args, get_origin, get_type_hints

import numpy as np

from .. import __version__
from ..files import plain
from ..model.figure import figures_of

if TYPE_CHECKING:
    from ..estimation.fitted_model import Fitted
    from ..estimation.result import FitResult


Source = str | Callable[[Any], Any] | None
_TYPES = {"number": "number", "text": "string", "flag": "boolean", "whole": "integer", "object": "object"}
_ABSENT = object()


class Record:
    """An object of a JSON file.

    Args:
        meaning: of the object, where the key that holds it says nothing else.
        ref: its name in `$defs` of the schema; "" where it is written out at each place.
        keys: made by `key`, in order; one without a source is the attribute of its own name.
    """

    def __init__(self, meaning: str = "", ref: str = "", /, **keys: Key) -> None:
        self.meaning, self.ref = meaning, ref
        self.keys = {name: each.taken_from(name) if each.source is None else each for name, each in keys.items()}
        self._closed = False

    def closed(self) -> Record:
        """The same, where no later version may add a key."""
        self._closed = True
        return self

    def within(self, path: str) -> dict[str, Key]:
        """Its keys, for a record of which it is a part: taken from that attribute, dotted, of what the other is of."""
        return {name: each.taken_from(lambda source, own=each.source: _taken(_taken(source, path), own))
                for name, each in self.keys.items()}  # fmt: skip

    def written(self, source: Any, *names: str) -> dict[str, Any]:
        """The object of what it is taken from, or these keys of it; a mapping that lacks a key leaves it out."""
        every = {name: self.keys[name].value(source) for name in names or self.keys}
        return {name: value for name, value in every.items() if value is not _ABSENT}

    def json(self, source: Any, *names: str) -> dict[str, Any]:
        """The same as a file has it, in plain types: a number that is not finite is null."""
        return plain(self.written(source, *names))

    def schema(self) -> dict[str, Any]:
        """Its JSON schema, without a description."""
        return {
            "type": "object",
            "properties": {name: each.schema() for name, each in self.keys.items()},
            "required": self.required,
            **({"additionalProperties": False} if self._closed else {}),
        }

    @property
    def required(self) -> list[str]:
        """Names of the keys that are always there."""
        return [name for name, each in self.keys.items() if not each.optional]

    def refs(self) -> dict[str, Record]:
        """The records in it that stand in `$defs`, by name."""
        inner = [each.kind.record if isinstance(each.kind, Many) else each.kind for each in self.keys.values()]
        below = {ref: found for each in inner if isinstance(each, Record) for ref, found in each.refs().items()}
        return below | ({self.ref: self} if self.ref else {})


class Many(NamedTuple):
    """Several records: a list, or, where `named`, an object of them by name."""

    record: Record
    named: bool
    meaning: str  # of one
    null: bool  # whether one may be null

    def written(self, source: Any) -> Any:
        if self.named:
            return {name: self._one(entry) for name, entry in source.items()}
        return [self._one(entry) for entry in source]

    def _one(self, entry: Any) -> dict[str, Any] | None:
        return None if entry is None and self.null else self.record.written(entry)

    def schema(self) -> dict[str, Any]:
        one = _schema_of(self.record, self.null) | ({"description": self.meaning} if self.meaning else {})
        return {"type": "object" if self.named else "array", "additionalProperties" if self.named else "items": one}


def list_of(record: Record, null: bool = False) -> Many:
    """A list of records."""
    return Many(record, False, record.meaning, null)


def by_name(record: Record, meaning: str = "", null: bool = False) -> Many:
    """An object of records by name."""
    return Many(record, True, meaning or record.meaning, null)


class Key(NamedTuple):
    """See `key`."""

    kind: str | Record | Many
    meaning: str
    source: Source
    scale: float
    null: bool
    optional: bool
    each: dict[str, Any]
    more: dict[str, Any]

    def taken_from(self, source: Source) -> Key:
        """The same key, taken from elsewhere."""
        return self._replace(source=source)

    def value(self, source: Any) -> Any:
        """What is written; `_ABSENT` for nothing."""
        value = _taken(source, self.source)
        if value is None and self.optional and not self.null:
            return _ABSENT
        if value is None or value is _ABSENT:
            return value
        if isinstance(self.kind, Record | Many):
            return self.kind.written(value)
        if self.scale == 1.0:
            return value
        return [self.scale * entry for entry in value] if isinstance(value, tuple) else self.scale * value

    def schema(self) -> dict[str, Any]:
        about = {"description": self.meaning} if self.meaning else {}
        if isinstance(self.kind, Record):
            return about | _schema_of(self.kind, self.null) | self.more
        found = self.kind.schema() if isinstance(self.kind, Many) else _plain_schema(self.kind, self.each)
        return about | _nullable(found, self.null) | self.more


def key(
    kind: str | Record | Many,
    meaning: str,
    source: Source = None,
    scale: float = 1.0,
    *,
    null: bool = False,
    optional: bool = False,
    each: Mapping[str, Any] | None = None,
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
        each: further keywords of the JSON schema of each entry, of a plain list or object.
        more: likewise of its own.
    """
    if isinstance(kind, str) and kind.endswith("?"):
        kind, null = kind.removesuffix("?"), True
    return Key(kind, meaning, source, scale, null, optional, dict(each or {}), more)


def figures(result: Any, meaning: str, symbols: Iterable[str] | None = None, ref: str = "") -> Record:
    """The figures that a class declares (`model.figure`), or some of them; null where one is not known."""
    declared = figures_of(result)
    shown = list(declared if symbols is None else symbols)
    return Record(meaning, ref, **{s: key("number?", f"{declared[s].meaning} In {declared[s].unit}.") for s in shown})


def record_of(
    result: Any,
    null: Collection[str] = (),
    optional: Collection[str] = (),
    without: Collection[str] = (),
    shares: Collection[str] = (),
    ref: str = "",
    called: Mapping[str, str] | None = None,
    percent: Collection[str] = (),
    meaning: str | None = None,
    **others: Key,
) -> Record:
    """The fields of a class, each with its type and, as its meaning, the comment that stands at it.

    Args:
        result: the class, a dataclass or a named tuple.
        null: fields that may be infinite or NaN, or hold such numbers, which JSON has as null.
        optional: that may be absent, see `key`.
        without: that are not written.
        shares: that lie from 0 to 1, or hold such numbers.
        ref: see `Record`.
        called: field -> key, where the key has another name, as one that ends in its unit.
        percent: fields that are shares and are written in %; their keys end in `_pct`.
        meaning: see `Record`; the first line of the class' docstring where None.
        others: keys in place of a field's, or behind them.
    """
    said, hints, keys = _said_of_fields(result), get_type_hints(result), {}
    names = {name: f"{name}_pct" for name in percent} | dict(called or {})
    for name in (each for each in result.__annotations__ if each not in without):
        if name not in others:
            kind, more = _kind(hints[name], name in null)
            if name in shares:
                within = {"minimum": 0, "maximum": 1}
                more |= {"each": within} if isinstance(kind, str) and kind[0] in "[{" else within
            scale, text = (100.0 if name in percent else 1.0), said.get(name, "")
            text = re.sub(r"\bshares? of\b", "% of", text) if name in percent else text
            others[name] = key(kind, text, name, scale, optional=name in optional, **more)
        keys[names.get(name, name)] = others.pop(name)
    meaning = cleandoc(result.__doc__).partition("\n")[0] if meaning is None else meaning
    return Record(meaning, ref, **keys | others)


def _said_of_fields(result: Any) -> dict[str, str]:
    """What the docstring of a class has under Args, or else the comment behind a field or above it.

    A comment that begins with names is of all of these. What is None, NaN or infinite there is null in JSON.
    """
    section = cleandoc(result.__doc__).partition("Args:\n")[2]
    listed = re.findall(r"^    (\w[\w, ]*): (.*(?:\n {8}.*)*)", section, re.MULTILINE)
    said = {name: " ".join(text.split()) for names, text in listed for name in names.split(", ")}
    source = "".join(linecache.getlines(getfile(result))).partition(f"\nclass {result.__name__}")[2]
    body, own, above = re.split(r"\n    (?:def|@)|\n(?=\S)", source)[0], result.__annotations__, list[str]()
    for line in body.splitlines():
        field = re.match(r"    (\w+): [^#]*(?:#  ?(.*))?", line)
        if comment := re.match(r"    # (.*)", line):
            above.append(comment[1])
        elif field and field[1] in own:
            text = " ".join(above) or field[2] or ""
            several = re.match(r"((?:\w+, )*\w+): (.*)", text)
            names = several[1].split(", ") if several else []
            of_names = bool(names) and all(name in own for name in names)
            said |= dict.fromkeys(names, several[2]) if several and of_names else {field[1]: text} if text else {}
            above = []
    return {name: _sentence(text) for name, text in said.items()}


def _sentence(text: str) -> str:
    text = re.sub(r", shape \([^)]*\)", "", re.sub(r"\b(None|NaN|infinite)\b", "null", text)).removesuffix(".") + "."
    return text if re.match(r"s\b", text) else text[0].upper() + text[1:]


_KINDS = {float: "number", int: "whole", bool: "flag", str: "text", np.ndarray: "[number]"}


def _kind(hint: Any, null: bool = False) -> tuple[str | Record | Many, dict[str, Any]]:
    """What `key` calls a type, of which a number may be null, and further keywords for it."""
    inner = [each for each in get_args(hint) if each not in (NoneType, Ellipsis)]
    if hint in _KINDS:
        return re.sub(r"\w+", r"\g<0>?", _KINDS[hint]) if null else _KINDS[hint], {}
    if get_origin(hint) in (Union, UnionType) and len(inner) > 1:  # a number, or an array of them
        return _kind(float, null)
    if get_origin(hint) is Literal:
        return ("text?" if null else "text"), {"enum": inner}
    if NoneType in get_args(hint):
        kind, more = _kind(inner[0], null and get_origin(inner[0]) is not None)
        return (f"{kind.removesuffix('?')}?", more) if isinstance(kind, str) else (kind, {"null": True})
    if is_dataclass(hint):
        return record_of(hint), {}
    kind, _ = _kind(inner[-1], null)
    listed = get_origin(hint) is tuple
    if isinstance(kind, Record):
        return (list_of if listed else by_name)(kind), {}
    pair = {} if not listed or Ellipsis in get_args(hint) else {"minItems": len(inner), "maxItems": len(inner)}
    return f"[{kind}]" if listed else f"{{{kind}}}", pair


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


def _taken(source: Any, where: Source) -> Any:
    if callable(where):
        return where(source)
    for part in filter(None, (where or "").split(".")):
        source = source.get(part, _ABSENT) if isinstance(source, Mapping) else getattr(source, part)
        if source is None or source is _ABSENT:
            return source
    return source


def _schema_of(record: Record, null: bool = False) -> dict[str, Any]:
    if not record.ref:
        return _nullable(record.schema(), null)
    ref = {"$ref": f"#/$defs/{record.ref}"}
    return {"anyOf": [ref, {"type": "null"}]} if null else ref


def _plain_schema(kind: str, each: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """ "[number?]" -> {"type": "array", "items": {"type": ["number", "null"], **each}}"""
    bare = kind.removesuffix("?")
    if bare[0] in "[{":
        inner = _plain_schema(bare[1:-1]) | dict(each or {})
        found = (
            {"type": "array", "items": inner} if bare[0] == "[" else {"type": "object", "additionalProperties": inner}
        )
    else:
        found = {"type": _TYPES[bare]}
    return _nullable(found, kind != bare)


def _nullable(schema: dict[str, Any], null: bool) -> dict[str, Any]:
    return schema | {"type": [schema["type"], "null"]} if null else schema


def effects_of(result: FitResult | Fitted) -> list[str]:
    """Names of all effects of a model, those of Eqs. 1-2 among them."""
    return [effect.name for effect in result.free_parameters.layout.types]


def versions() -> dict[str, str]:
    """Of etcfit, Python and the numerical libraries."""
    ours = {"etcfit": __version__, "python": platform.python_version()}
    return ours | {name: metadata.version(name) for name in ("jax", "optimistix", "numpy", "scipy")}


SYMBOL = {"pattern": "^[A-Za-z][A-Za-z0-9_.]*$"}
RIG = key("text", "Name of the rig, from rig.toml.")
SYNTHETIC = key("flag", "The data came from a simulation.")
VERSIONS = key("{text}", "Versions of etcfit, Python and the numerical libraries that made this file.",
    lambda _: versions())  # fmt: skip
CONVERGED = key("flag", "Whether the end is an optimum. False also means exit status 3.")
REASON = key("text", "Why (not), in words.")
WARNINGS = key("[text]", "What a reader must know, one sentence each.")
MODEL = Record(
    effects=key("[text]", "Names of all its effects, those of Eqs. 1-2 among them (see the catalogue of effects).",
        effects_of),
)  # fmt: skip
FIT_STATE = Record(
    chi2_per_dof=key("number?", "Of its residual, per degree of freedom; 1 where only noise is left."),
    converged=key("flag", "Whether it is at an optimum."),
    reason=key("text", "In words why (not)."),
    compromise=key("text?", "Why its parameters are no estimates; null where they are. Else errors and draws are as "
        "wide as the ranges that subsets of the data give, and a share of draws is no probability."),
)  # fmt: skip
MEASURED = Record(
    folder=key("text", "The measurement folder as it was given."),
    files=key("{text?}", "SHA-256 of every measurement file that was read, by its path in the measurement folder; null "
        "for one that was gone by then.", "digests", each={"pattern": "^[0-9a-f]{64}$"}),
)  # fmt: skip


def file_of(
    meaning: str, config: str, made_from: str = "", measured: str = "", called: str = "rig", /, **keys: Key
) -> Record:
    """A file: the rig, the model behind it, its own keys, the measurements, and the versions that made it.

    Args:
        config: attribute, dotted, with the configuration of the rig.
        made_from: with the fitted model that it was made from; "" for none.
        measured: with the rig whose measurements it shows; "" for none.
        called: its key for the name of the rig.
    """
    of_fit = Record(
        model=key(MODEL, "The model.", ""),
        fit=key(FIT_STATE, "State of the fit that this was made from.", "state", optional=True),
    )
    begin = {called: RIG.taken_from(f"{config}.name"), "synthetic": SYNTHETIC.taken_from(f"{config}.synthetic")}
    begin |= of_fit.within(made_from) if made_from else {}
    end = MEASURED.within(measured) if measured else {}
    return Record(meaning, "", **begin, **keys, **end, versions=VERSIONS)
