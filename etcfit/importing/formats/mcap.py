"""MCAP, by mcap: channels whose messages are JSON, nested numbers by dotted names, `/topic.field.inner`.

Channels that were logged at their own rates become one sheet: every instant of any of them a row, gaps elsewhere.
The time is the log time, one clock for all channels; the publish time where messages of a channel share a log time.

Source: MCAP specification, version 0; units from `unit` in a channel's JSON Schema, else from its metadata.
Differs from source: texts, truth values and lists are left out; so are channels of other encodings, which is said.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ...errors import MeasurementError
from ..labels import column
from ..sheet import Column, Sheet, time_base
from .base import Format, Source, unreadable

_KIND = "an MCAP file"
_MAGIC = b"\x89MCAP0\r\n"  # at both ends of a whole file
_UNITS = ("unit", "units", "Unit")
_NAMELESS = ("data", "value")  # fields that say nothing: the topic does
_TICK = 1000  # ns: instants nearer than a microsecond are one


@dataclass
class _Channel:
    """Messages of one topic, in the order of the log; times in ns, numbers by the message's place."""

    topic: str
    units: dict[str, str]
    logged: list[int] = field(default_factory=list)
    published: list[int] = field(default_factory=list)
    numbers: dict[str, dict[int, float]] = field(default_factory=dict)


def _read(source: Source) -> list[Sheet]:
    from mcap import reader

    _check_ends(source)
    channels: dict[int, _Channel] = {}
    others: dict[str, str] = {}
    try:
        with source.path.open("rb") as stream:
            for schema, channel, message in reader.make_reader(stream, validate_crcs=True).iter_messages():
                if channel.message_encoding != "json":
                    others[channel.topic] = channel.message_encoding
                    continue
                if channel.id not in channels:
                    channels[channel.id] = _Channel(channel.topic, _units(schema, channel))
                _add(channels[channel.id], message)
    except Exception as err:  # whatever its parser makes of damaged bytes, or json of a message that is none
        raise unreadable(source.where, "it cannot be read", _KIND, err) from err
    told = ", ".join(f"'{topic}' ({encoding or 'none named'})" for topic, encoding in others.items())
    if others and not channels:
        raise MeasurementError(source.where, f"no channel can be read; message encodings: {told}.",
                               "The message encoding 'json' is required.",
                               "Record these topics as JSON, or export them as CSV or Parquet.")  # fmt: skip
    together, remarks = _united([each for each in channels.values() if each.numbers])
    left_out = (f"left out, of an encoding other than json: {told}",) if others else ()
    return [Sheet(source.where, "", together, (*remarks, *left_out))]


def _check_ends(source: Source) -> None:
    content = source.path.read_bytes()
    if not content.startswith(_MAGIC):
        raise unreadable(source.where, "it does not begin as one", _KIND)
    if len(content) < 2 * len(_MAGIC) or not content.endswith(_MAGIC):
        raise MeasurementError(source.where, "it is truncated: the mark at its end is missing.",
                               f"It must be {_KIND} that was closed.",
                               "Copy it again, or save what is whole: mcap recover FILE -o WHOLE.mcap.")  # fmt: skip


def _add(channel: _Channel, message: Any) -> None:
    place = len(channel.logged)
    channel.logged.append(message.log_time)
    channel.published.append(message.publish_time)
    for name, number in _numbers(json.loads(message.data), ""):
        channel.numbers.setdefault(name, {})[place] = number


def _numbers(value: Any, name: str) -> Iterator[tuple[str, float]]:
    """Dotted names and numbers of a message."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _numbers(inner, f"{name}.{key}" if name else key)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield name, float(value)


def _units(schema: Any, channel: Any) -> dict[str, str]:
    """By dotted name; what holds for the whole channel under ""."""
    found = {"": next((channel.metadata[key] for key in _UNITS if key in channel.metadata), "")}
    if schema is not None and schema.encoding == "jsonschema" and schema.data:
        found |= dict(_units_of_fields(json.loads(schema.data), ""))
    return found


def _units_of_fields(schema: Any, name: str) -> Iterator[tuple[str, str]]:
    if not isinstance(schema, dict):
        return
    if unit := next((schema[key] for key in _UNITS if isinstance(schema.get(key), str)), ""):
        yield name, unit
    fields = schema.get("properties")
    for key, inner in fields.items() if isinstance(fields, dict) else ():
        yield from _units_of_fields(inner, f"{name}.{key}" if name else key)


def _united(channels: list[_Channel]) -> tuple[tuple[Column, ...], tuple[str, ...]]:
    if not channels:
        return (), ()
    remarks = []
    by_publishing = any(_shared(each.logged) for each in channels) and not any(_shared(c.published) for c in channels)
    if by_publishing:
        remarks.append("messages share a log time: the publish time is taken")
    times = [np.array(each.published if by_publishing else each.logged, dtype=object) for each in channels]
    first = min(min(each) for each in times)
    instants = [((each - first + _TICK // 2) // _TICK).astype(np.int64) for each in times]
    ticks = np.unique(np.concatenate(instants))
    names = [name for each in channels for name in each.numbers]
    columns = []
    for channel, own in zip(channels, instants, strict=True):
        if lost := own.size - np.unique(own).size:
            remarks.append(f"'{channel.topic}': of messages at one instant the last counts; {lost} left out")
        rows = np.searchsorted(ticks, own)
        for name, numbers in channel.numbers.items():
            values = np.full(ticks.size, np.nan)
            values[rows[list(numbers)]] = list(numbers.values())
            columns.append(_column(channel, name, values, alone=names.count(name) == 1))
    return (time_base(1e-9 * _TICK * ticks), *columns), tuple(remarks)


def _shared(times: list[int]) -> bool:
    return len({time // _TICK for time in times}) < len(times)


def _column(channel: _Channel, name: str, values: np.ndarray, alone: bool) -> Column:
    """Called by its path; guessed by its field, and by its topic where the field does not tell."""
    path = f"{channel.topic}.{name}" if name else channel.topic
    unit = channel.units.get(name) or channel.units[""]
    told = name if alone and name and name not in _NAMELESS else path
    return replace(column(told, values, unit), label=path)


FORMAT = Format("MCAP", (".mcap",), _read, "mcap")
