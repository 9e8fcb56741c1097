"""MCAP, by mcap: channels whose messages are JSON, nested numbers by dotted names, `/topic.field.inner`.

Channels that were logged at their own rates become one sheet: every instant of any of them a row, gaps elsewhere.
The time is the log time, one clock for all channels; the publish time where messages of a channel share a log time.

Source: MCAP specification, version 0; units from `unit` in a channel's JSON Schema, else from its metadata.
Differs from source: texts, truth values and lists are left out; so are channels of other encodings, which is said.
"""

from __future__ import annotations

import json
import struct
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from ...errors import MeasurementError
from ..labels import column
from ..sheet import Column, Sheet, time_base
from .base import Format, Source, unreadable

_KIND = "an MCAP file"
_MAGIC = b"\x89MCAP0\r\n"  # at both ends of a whole file
_RECORD, _CHUNK, _COUNT = struct.Struct("<BQ"), struct.Struct("<QQQ"), struct.Struct("<Q")  # heads of records
_IS_CHUNK, _IS_STATISTICS = 0x06, 0x0B  # a chunk: first and last time, bytes unpacked; statistics: messages
_UNITS = ("unit", "units", "Unit")
_NAMELESS = ("data", "value")  # fields that say nothing: the topic does
_TICK = 1000  # ns: instants nearer than a microsecond are one


@dataclass
class _Channel:
    """Messages of one topic, in the order of the log; times in ns, of each number the message's place and its value."""

    topic: str
    units: dict[str, str]
    logged: array[int] = field(default_factory=lambda: array("Q"))
    published: array[int] = field(default_factory=lambda: array("Q"))
    numbers: dict[str, tuple[array[int], array[float]]] = field(default_factory=dict)


def _read(source: Source) -> list[Sheet]:
    from mcap import reader

    _check_ends(source)
    counts = _counts(source)
    source.refuse_larger(counts.unpacked)
    channels: dict[int, _Channel] = {}
    others: dict[str, str] = {}
    read = 0
    try:
        with source.path.open("rb") as stream:
            for schema, channel, message in reader.make_reader(stream, validate_crcs=True).iter_messages():
                read += 1
                if channel.message_encoding != "json":
                    others[channel.topic] = channel.message_encoding
                    continue
                if channel.id not in channels:
                    channels[channel.id] = _Channel(channel.topic, _units(schema, channel))
                _add(channels[channel.id], message)
    except Exception as err:  # whatever its parser makes of damaged bytes, or json of a message that is none
        raise unreadable(source.where, "it cannot be read", _KIND, err) from err
    if counts.messages is not None and read != counts.messages:
        raise unreadable(source.where, f"it says that it has {counts.messages} messages, and holds {read}", _KIND)
    told = ", ".join(f"'{topic}' ({encoding or 'none named'})" for topic, encoding in others.items())
    if others and not channels:
        raise MeasurementError(source.where, f"no channel can be read; message encodings: {told}.",
                               "The message encoding 'json' is required.",
                               "Record these topics as JSON, or export them as CSV or Parquet.")  # fmt: skip
    together, remarks = _united(source, [each for each in channels.values() if each.numbers])
    unread = (f"channels cannot be read, of an encoding other than json: {told}",) if others else ()
    return [Sheet(source.where, "", together, remarks, missing=unread)]


class _Counts(NamedTuple):
    """What a file says of itself: bytes of its chunks, unpacked, and messages; None where it does not say."""

    unpacked: int
    messages: int | None


def _counts(source: Source) -> _Counts:
    """By the heads of its records, none of which is unpacked.

    Raises:
        MeasurementError: the records do not fill the file.
    """
    size, at = source.path.stat().st_size, len(_MAGIC)
    unpacked, messages = size, None
    with source.path.open("rb") as stream:
        while at < size - len(_MAGIC):
            stream.seek(at)
            head = stream.read(_RECORD.size + _CHUNK.size)
            if len(head) < _RECORD.size + _CHUNK.size:
                break
            kind, length = _RECORD.unpack_from(head)
            if kind == _IS_CHUNK:
                unpacked += _CHUNK.unpack_from(head, _RECORD.size)[2]
            elif kind == _IS_STATISTICS:
                messages = _COUNT.unpack_from(head, _RECORD.size)[0]
            at += _RECORD.size + length
    if at != size - len(_MAGIC):
        raise unreadable(source.where, "its records do not fill it", _KIND)
    return _Counts(unpacked, messages)


def _check_ends(source: Source) -> None:
    size = source.path.stat().st_size
    with source.path.open("rb") as stream:
        begin = stream.read(len(_MAGIC))
        stream.seek(max(0, size - len(_MAGIC)))
        end = stream.read()
    if begin != _MAGIC:
        raise unreadable(source.where, "it does not begin as one", _KIND)
    if size < 2 * len(_MAGIC) or end != _MAGIC:
        raise MeasurementError(source.where, "it is truncated: the mark at its end is missing.",
                               f"It must be {_KIND} that was closed.",
                               "Copy it again, or save what is whole: mcap recover FILE -o WHOLE.mcap.")  # fmt: skip


def _add(channel: _Channel, message: Any) -> None:
    place = len(channel.logged)
    channel.logged.append(message.log_time)
    channel.published.append(message.publish_time)
    for name, number in _numbers(json.loads(message.data), ""):
        places, values = channel.numbers.setdefault(name, (array("q"), array("d")))
        places.append(place)
        values.append(number)


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


def _united(source: Source, channels: list[_Channel]) -> tuple[tuple[Column, ...], tuple[str, ...]]:
    if not channels:
        return (), ()
    remarks = []
    by_publishing = any(_shared(each.logged) for each in channels) and not any(_shared(c.published) for c in channels)
    if by_publishing:
        remarks.append("messages share a log time: the publish time is taken")
    times = [np.array(each.published if by_publishing else each.logged, dtype=np.uint64) for each in channels]
    first = min(each.min() for each in times)
    instants = [((each - first + np.uint64(_TICK // 2)) // np.uint64(_TICK)).astype(np.int64) for each in times]
    ticks = np.unique(np.concatenate(instants))
    names = [name for each in channels for name in each.numbers]
    source.refuse_larger(8 * ticks.size * (1 + len(names)))
    columns = []
    for channel, own in zip(channels, instants, strict=True):
        if lost := own.size - np.unique(own).size:
            remarks.append(f"'{channel.topic}': of messages at one instant the last counts; {lost} left out")
        rows = np.searchsorted(ticks, own)
        for name, (places, numbers) in channel.numbers.items():
            values = np.full(ticks.size, np.nan)
            values[rows[np.array(places)]] = numbers
            columns.append(_column(channel, name, values, alone=names.count(name) == 1))
    return (time_base(1e-9 * _TICK * ticks), *columns), tuple(remarks)


def _shared(times: Sequence[int]) -> bool:
    return len({time // _TICK for time in times}) < len(times)


def _column(channel: _Channel, name: str, values: np.ndarray, alone: bool) -> Column:
    """Called by its path; guessed by its field, and by its topic where the field does not tell."""
    path = f"{channel.topic}.{name}" if name else channel.topic
    unit = channel.units.get(name) or channel.units[""]
    told = name if alone and name and name not in _NAMELESS else path
    return replace(column(told, values, unit), label=path)


FORMAT = Format("MCAP", (".mcap",), _read, "mcap")
