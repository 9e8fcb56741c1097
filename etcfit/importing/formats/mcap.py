"""MCAP, by mcap: channels whose messages are JSON, nested numbers by dotted names, `/topic.field.inner`.

Channels with different rates become one sheet: one row for every instant of any of them, with gaps elsewhere.
The time is the log time, one clock for all channels, or the publish time if messages of a channel share a log time.

Source: MCAP specification, version 0; units from `unit` in a channel's JSON Schema, else from its metadata.
Differs from source: texts, truth values and lists are left out; so are channels of other encodings, with a remark.
"""

from __future__ import annotations

import json
import struct
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ...errors import MeasurementError
from ..sheet import Column, Sheet, column, time_base
from .base import Format, Source, common_rows, flat_numbers, reading, unreadable, with_gaps

_KIND = "an MCAP file"
_MAGIC = b"\x89MCAP0\r\n"  # at both ends of a whole file
_RECORD, _CHUNK, _COUNT = struct.Struct("<BQ"), struct.Struct("<QQQ"), struct.Struct("<Q")  # heads of records
_IS_CHUNK, _IS_STATISTICS = 0x06, 0x0B  # a chunk: first and last time, bytes unpacked; statistics: messages
_UNITS = ("unit", "units", "Unit")
_NAMELESS = ("data", "value")  # fields without a meaningful name: the topic names them
_TICK = 1000  # ns: instants nearer than a microsecond are equal


@dataclass
class _Channel:
    """Messages of one topic, in the order of the log; times in ns, and for each number the message's index and its
    value."""

    topic: str
    units: dict[str, str]
    logged: array[int] = field(default_factory=lambda: array("Q"))
    published: array[int] = field(default_factory=lambda: array("Q"))
    numbers: dict[str, tuple[array[int], array[float]]] = field(default_factory=dict)

    def add(self, message: Any) -> None:
        place = len(self.logged)
        self.logged.append(message.log_time)
        self.published.append(message.publish_time)
        for name, number in flat_numbers(json.loads(message.data)):
            places, values = self.numbers.setdefault(name, (array("q"), array("d")))
            places.append(place)
            values.append(number)


def _read(source: Source) -> list[Sheet]:
    from mcap import reader

    _check_ends(source)
    unpacked, messages = _counts(source)
    source.refuse_larger(unpacked)
    channels: dict[int, _Channel] = {}
    others: dict[str, str] = {}
    read = 0
    with reading(source, _KIND), source.path.open("rb") as stream:
        for schema, channel, message in reader.make_reader(stream, validate_crcs=True).iter_messages():
            read += 1
            if channel.message_encoding != "json":
                others[channel.topic] = channel.message_encoding
                continue
            if channel.id not in channels:
                # units by dotted name; the unit of the whole channel under ""
                units = {"": next((channel.metadata[key] for key in _UNITS if key in channel.metadata), "")}
                if schema is not None and schema.encoding == "jsonschema" and schema.data:
                    units |= dict(_units_of_fields(json.loads(schema.data), ""))
                channels[channel.id] = _Channel(channel.topic, units)
            channels[channel.id].add(message)
    if messages is not None and read != messages:
        raise unreadable(source.where, f"it says that it has {messages} messages, and holds {read}", _KIND)
    told = ", ".join(f"'{topic}' ({encoding or 'none named'})" for topic, encoding in others.items())
    if others and not channels:
        raise MeasurementError(source.where, f"no channel can be read; message encodings: {told}.",
                               "The message encoding 'json' is required.",
                               "Record these topics as JSON, or export them as CSV or Parquet.")  # fmt: skip
    together, remarks = _united(source, [each for each in channels.values() if each.numbers])
    unread = (f"channels cannot be read, of an encoding other than json: {told}",) if others else ()
    return [Sheet(source.where, "", together, remarks, missing=unread)]


def _counts(source: Source) -> tuple[int, int | None]:
    """Unpacked bytes of the file's chunks and number of messages, as the file states them; None if it does not.

    Only the heads of its records are read.
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
    return unpacked, messages


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
    names = [name for each in channels for name in each.numbers]
    ticks, places = common_rows(source, instants, len(names))
    columns = []
    for channel, rows in zip(channels, places, strict=True):
        if lost := rows.size - np.unique(rows).size:
            remarks.append(f"'{channel.topic}': of messages at one instant the last counts; {lost} left out")
        for name, (own, numbers) in channel.numbers.items():
            values = with_gaps(ticks.size, rows[np.array(own)], numbers)
            # its label is its path; its meaning is guessed from its field, or from the path if the field has no name
            path = f"{channel.topic}.{name}" if name else channel.topic
            told = name if names.count(name) == 1 and name and name not in _NAMELESS else path
            made = column(told, values, channel.units.get(name) or channel.units[""])
            columns.append(replace(made, label=path))
    return (time_base(1e-9 * _TICK * ticks), *columns), tuple(remarks)


def _shared(times: Sequence[int]) -> bool:
    return len({time // _TICK for time in times}) < len(times)


FORMAT = Format("MCAP", (".mcap",), _read, "mcap")
