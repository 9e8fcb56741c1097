"""The binary log's layout, byte by byte from the tables that others have published, not from our reader.

Header and scalar field: rusEFI, firmware/console/binary_mlg_log/mlg_types.h, which quotes EFI Analytics' format 2.0.
Version 1 and the bit field: mlg-converter, src/parser.ts. Blocks: rusEFI's binary_mlg_logging.cpp. Markers among the
records, spoilt records, pauses, a clock that steps back: what LibreTune (pull request 283) met in 34 logs of cars.
"""

from __future__ import annotations

import struct

import numpy as np
import pytest

from etcfit.errors import MeasurementError
from etcfit.rig.mlg import read_mlg


def scalar(kind: int, name: bytes, unit: bytes, scale: float, transform: float = 0.0, category: bytes = b"") -> bytes:
    """Type 0, name 1 to 34, units 35 to 44, style 45, scale 46, transform 50, digits 54, category 55 to 88."""
    laid = bytearray(89)
    laid[0] = kind
    laid[1 : 1 + len(name)] = name
    laid[35 : 35 + len(unit)] = unit
    laid[46:50] = struct.pack(">f", scale)
    laid[50:54] = struct.pack(">f", transform)
    laid[54] = 2
    laid[55 : 55 + len(category)] = category
    return bytes(laid)


def bits(kind: int, name: bytes) -> bytes:
    """In place of scale, transform and digits: style 46, index of the names 47, number of bits 51, unused 52 to 54."""
    laid = bytearray(scalar(kind, name, b"", 0.0))
    laid[46:55] = b"\x04" + (0xFFFFFFFF).to_bytes(4, "big") + b"\x08" + b"\xff\xff\xff"
    return bytes(laid)


def file(version: int, fields: list[bytes], size: int, blocks: list[bytes], info: bytes = b"") -> bytes:
    """Magic 0, version 6, time stamp 8, start of info 12 (4 bytes, 2 in version 1), start of data 16 (14), bytes of a
    record 20 (18), number of fields 22 (20); fields of 89 bytes (55)."""
    wide = 4 if version == 2 else 2
    width = 89 if version == 2 else 55
    named = 18 + wide + 2 + width * len(fields)
    begin = named + len(info)
    head = b"MLVLG\x00" + version.to_bytes(2, "big") + (0x66AABBCC).to_bytes(4, "big")
    head += (named if info else 0).to_bytes(wide, "big") + begin.to_bytes(4, "big")
    head += size.to_bytes(2, "big") + len(fields).to_bytes(2, "big")
    assert len(head) == (24 if version == 2 else 22)
    return head + b"".join(field[:width] for field in fields) + info + b"".join(blocks)


def record(counter: int, tick: int, values: bytes, out: int = 0) -> bytes:
    """Type 0, rolling counter, time in 10 us, the values, the sum of their bytes (wrong by `out`)."""
    return bytes([0, counter % 256]) + tick.to_bytes(2, "big") + values + bytes([(sum(values) + out) % 256])


def marker(counter: int, tick: int, text: bytes) -> bytes:
    """Type 1, rolling counter, time, 50 bytes of text, no sum."""
    return bytes([1, counter % 256]) + tick.to_bytes(2, "big") + text.ljust(50, b"\0")


TPS = scalar(3, b"TPS", b"%", 0.01, category=b"Throttle")
FLAGS = bits(10, b"Flags")
BODY = [bytes.fromhex("1194") + b"\x55", bytes.fromhex("ff9c") + b"\x00", bytes.fromhex("01f4") + b"\xff"]
SHOWN = [45.0, -1.0, 5.0]  # 0x1194, -100 and 500 hundredths


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("info", [b"", b'"rusEFI"\n<msq>\x00\x01</msq>\0'])
def test_both_versions_with_a_bit_field_and_a_tune_before_the_data(version: int, info: bytes) -> None:
    blocks = [record(k, 1000 * k, body) for k, body in enumerate(BODY)]
    table = read_mlg(file(version, [TPS, FLAGS], 3, blocks, info), "a.mlg")
    assert table.header == ("Time [s]", "TPS [%]")
    assert table.cells[:, 0] == pytest.approx([0.0, 0.01, 0.02])
    assert table.cells[:, 1] == pytest.approx(SHOWN)


def test_every_type_is_big_endian_and_is_shifted_before_it_is_scaled() -> None:
    raw = {0: "c8", 1: "fb", 2: "2225", 3: "fb2e", 4: "00011170", 5: "fffeee90", 6: "fffffffed5fa0e00", 7: "3f800000"}
    values = (200, -5, 8741, -1234, 70_000, -70_000, -5_000_000_000, 1.0)
    fields = [scalar(kind, f"f{kind}".encode(), b"", 100.0, -1.0) for kind in raw]
    body = bytes.fromhex("".join(raw.values()))
    table = read_mlg(file(2, fields, len(body), [record(0, 0, body), record(1, 9, body)]), "a.mlg")
    assert table.cells[0, 1:] == pytest.approx([100.0 * (value - 1.0) for value in values])


def clocked(*blocks: bytes) -> list[float]:
    """Times of the records, ms."""
    return (1e3 * read_mlg(file(2, [TPS, FLAGS], 3, list(blocks)), "a.mlg").cells[:, 0]).round(6).tolist()


def test_the_clock_starts_anew_every_65536_ticks_and_does_not_for_a_small_step_back() -> None:
    assert clocked(record(0, 65_000, BODY[0]), record(1, 200, BODY[1])) == [0.0, 7.36]
    assert clocked(*(record(k, tick, BODY[0]) for k, tick in enumerate((1000, 900, 1100)))) == [0.0, -1.0, 1.0]


def test_markers_and_spoilt_records_carry_the_clock_on() -> None:
    for between in (marker(1, 60_000, b"MARK 000 - Going Offline"), record(1, 60_000, BODY[1], out=1)):
        assert clocked(record(0, 1000, BODY[0]), between, record(2, 200, BODY[2])) == [0.0, 647.36]


def test_a_writer_whose_sum_is_another_is_believed() -> None:
    blocks = [record(k, 100 * k, body, out=k + 3) for k, body in enumerate(BODY)]
    assert read_mlg(file(1, [TPS, FLAGS], 3, blocks), "a.mlg").cells[:, 1] == pytest.approx(SHOWN)


@pytest.mark.parametrize("unwritten", [b"\0", b"\xff"])
@pytest.mark.parametrize("cut", [0, 4])
def test_a_card_whose_rest_was_never_written_ends_the_log(unwritten: bytes, cut: int) -> None:
    blocks = [record(k, 100 * k, body) for k, body in enumerate(BODY)]
    raw = file(2, [TPS, FLAGS], 3, blocks)
    assert len(read_mlg(raw[: len(raw) - cut] + 4000 * unwritten, "a.mlg").cells) == (2 if cut else 3)


def test_what_is_no_number_is_none() -> None:
    ratio = scalar(7, b"Lambda", b"", 1.0)
    bodies = [struct.pack(">f", x) for x in (1.0, np.nan, np.inf, 2.0)]
    table = read_mlg(file(2, [ratio], 4, [record(k, k, body) for k, body in enumerate(bodies)]), "a.mlg")
    assert table.cells[:, 1] == pytest.approx([1.0, np.nan, np.nan, 2.0], nan_ok=True)


@pytest.mark.parametrize("degrees", [b"\xb0", "\N{DEGREE SIGN}".encode()])
def test_a_degree_sign_of_any_age(degrees: bytes) -> None:
    angle = scalar(7, b"Blade", degrees, 1.0)
    blocks = [record(k, k, struct.pack(">f", 1.0)) for k in range(2)]
    assert read_mlg(file(2, [angle], 4, blocks), "a.mlg").header[1] == "Blade [\N{DEGREE SIGN}]"


def test_a_length_that_is_not_that_of_the_fields_says_so() -> None:
    with pytest.raises(MeasurementError, match="its records have 4 bytes, its fields 3"):
        read_mlg(file(2, [TPS, FLAGS], 4, []), "a.mlg")


ODD = scalar(16, b"Odd", b"%", 0.5)  # as a field of the public v2.mlg of mlg-converter has it


@pytest.mark.parametrize(("width", "count"), [(1, 1), (2, 1), (8, 1), (1, 3), (4, 2)])
@pytest.mark.parametrize("first", [True, False])
def test_a_field_of_unknown_type_takes_what_the_others_leave_of_a_record(width: int, count: int, first: bool) -> None:
    # built byte by byte after the published layout: v2.mlg itself (LFS, 0.9 MB) is not among what tests can reach
    fields = [ODD] * count + [TPS, FLAGS] if first else [TPS, FLAGS] + [ODD] * count
    odd = b"\xab" * (width * count)
    blocks = [record(k, 1000 * k, odd + body if first else body + odd) for k, body in enumerate(BODY)]
    table = read_mlg(file(2, fields, 3 + width * count, blocks), "v2.mlg")
    assert table.header == ("Time [s]", "TPS [%]")
    assert table.cells[:, 1] == pytest.approx(SHOWN)


def test_unknown_types_share_a_byte_each_and_no_more() -> None:
    two = [ODD, scalar(9, b"Other", b"", 1.0), TPS, FLAGS]
    blocks = [record(k, 1000 * k, b"\xab\xcd" + body) for k, body in enumerate(BODY)]
    assert read_mlg(file(2, two, 5, blocks), "a.mlg").cells[:, 1] == pytest.approx(SHOWN)
    with pytest.raises(MeasurementError, match="unknown types 9 and 16, whose widths"):
        read_mlg(file(2, two, 9, []), "a.mlg")


@pytest.mark.parametrize("size", [2, 3, 8])
def test_what_cannot_be_the_width_of_unknown_fields_says_so(size: int) -> None:
    with pytest.raises(MeasurementError, match=rf"records have {size} bytes, its fields 3, 2 more of unknown type 16"):
        read_mlg(file(2, [ODD, ODD, TPS, FLAGS], size, []), "a.mlg")
