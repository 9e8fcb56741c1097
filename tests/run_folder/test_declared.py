"""A declared object: what is written of a source fits the schema that follows from the same lines, and says no more."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import pytest
from jsonschema import Draft202012Validator, ValidationError

from etcfit.run_folder.declared import Record, by_name, key, list_of, record_of

INNER = Record("One part.", size=key("number", "Of it.", scale=100.0)).closed()
OUTER = Record(
    "The whole.",
    own=key("text", "A name of its own.", "deep.name"),
    gone=key("number", "Left out where there is none.", optional=True),
    empty=key("number?", "Null where there is none.", optional=True),
    parts=key(list_of(INNER, null=True), "Some of which may be unknown."),
    named=key(by_name(INNER), "By name."),
    hashes=key("{text}", "By file.", each={"pattern": "^[0-9a-f]+$"}),
    **Record(meaning=key("text", "Taken from a part of the source.")).within("deep"),
)


class Deep(NamedTuple):
    name: str = "it"
    meaning: str = "what it means"


class Part(NamedTuple):
    size: float


class Source(NamedTuple):
    deep: Deep = Deep()
    gone: float | None = None
    empty: float | None = None
    parts: tuple[Part | None, ...] = (Part(0.25), None)
    named: Mapping[str, Any] = {"a.b": {"size": 0.5}}
    hashes: Mapping[str, str] = {"x.csv": "0f"}


SOURCE = Source()


def test_each_key_is_taken_from_where_its_line_says() -> None:
    assert OUTER.written(SOURCE) == {
        "own": "it", "empty": None, "parts": [{"size": 25.0}, None], "named": {"a.b": {"size": 50.0}},
        "hashes": {"x.csv": "0f"}, "meaning": "what it means",
    }  # fmt: skip
    assert OUTER.required == ["own", "parts", "named", "hashes", "meaning"]


def test_an_attribute_that_is_not_there_is_a_mistake_of_the_declaration() -> None:
    with pytest.raises(AttributeError, match="deep"):
        OUTER.written(Deep())


@pytest.mark.parametrize(
    "wrong",
    [{"own": None}, {"gone": None}, {"parts": [{"size": "25"}]}, {"hashes": {"x.csv": "no hash"}},
     {"named": {"a": {"size": 1.0, "of tomorrow": 2.0}}}],
    ids=lambda wrong: next(iter(wrong)),
)  # fmt: skip
def test_the_schema_takes_what_is_written_and_nothing_wrong(wrong: dict[str, Any]) -> None:
    validator, written = Draft202012Validator(OUTER.schema()), OUTER.written(SOURCE)
    validator.validate(written)
    with pytest.raises(ValidationError):
        validator.validate(written | wrong)


@dataclass(frozen=True)
class Shown:
    """What a log shows."""

    # low, high: ends, per cent
    low: float
    high: float | None
    first: float = 0.0  # of all, s
    kind: Literal["quick", "slow"] = "slow"  # which; None of the others
    # of the time, which goes on behind
    # the end of a line
    share: float = 0.5
    pair: tuple[float, float] = (0.0, math.inf)  # both
    hidden: int = 0

    def low_or_high(self) -> float:
        return self.low


def test_fields_of_a_class_are_keys_with_the_meaning_that_stands_at_them() -> None:
    record = record_of(Shown, null=("pair",), shares=("share",), without=("hidden",), extra=key("flag", "More."))
    found = record.schema()
    said = {name: each["description"] for name, each in found["properties"].items()}
    assert said == {
        "low": "Ends, per cent.", "high": "Ends, per cent.", "first": "Of all, s.",
        "kind": "Which; null of the others.",
        "share": "Of the time, which goes on behind the end of a line.", "pair": "Both.", "extra": "More.",
    }  # fmt: skip
    assert record.meaning == "What a log shows."
    assert found["properties"]["low"]["type"] == "number"
    assert found["properties"]["high"]["type"] == ["number", "null"]
    assert found["properties"]["kind"]["enum"] == ["quick", "slow"]
    assert (found["properties"]["share"]["minimum"], found["properties"]["share"]["maximum"]) == (0, 1)
    assert found["properties"]["pair"]["items"]["type"] == ["number", "null"]
    assert found["properties"]["pair"]["minItems"] == 2
    assert found["required"] == ["low", "high", "first", "kind", "share", "pair", "extra"]
