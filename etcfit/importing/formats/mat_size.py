"""How large a level 5 MAT-file unpacks, by its own tags: a few bytes of each variable are unpacked for that.

    file      128 bytes, the last two "IM" or "MI" for the order of bytes; then variables
    variable  type, length, content: an array (14), or one compressed (15)
    array     type 14, length; flags (6, 8, class, 0); sizes (5, 4 n, n_1 .. n_n); name; content

Source: MathWorks, MAT-file level 5 format. Differs from source: no.
"""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

_HEADER = 128
_ARRAY, _COMPRESSED = 14, 15
_SIZES_AT = 24  # in an array: behind its own tag and its flags
_ENOUGH = 512  # bytes of an array that hold its tags
_MOST_SHRUNK = 100
_NUMERIC = range(6, 16)  # classes: double to uint64


def unpacked(path: Path) -> int:
    """Bytes in memory of all its variables, numbers as float64; the file's own size where it is no such file."""
    size, at, total = path.stat().st_size, _HEADER, 0
    with path.open("rb") as file:
        order = {b"IM": "<", b"MI": ">"}.get(file.read(_HEADER)[-2:])
        while order and at + 8 <= size:
            file.seek(at)
            kind, length = struct.unpack(f"{order}II", file.read(8))
            head = file.read(min(length, _ENOUGH))
            if kind == _COMPRESSED:
                head = zlib.decompressobj().decompress(head, _ENOUGH)
            elif kind == _ARRAY:
                head = struct.pack(f"{order}II", kind, length) + head
            total += _of_array(head, order, length)
            at += 8 + length
    return total or size


def _of_array(head: bytes, order: str, stored: int) -> int:
    """Bytes of one array: what it says of its numbers, or of its whole content where it holds other arrays.

    These may be numbers of a byte, eight in memory; nobody's measurements shrink to a hundredth.
    """
    if len(head) < _SIZES_AT + 8:
        return len(head)
    content, kind = struct.unpack_from(f"{order}I", head, 4)[0], head[16 if order == "<" else 19]
    n = struct.unpack_from(f"{order}I", head, _SIZES_AT + 4)[0] // 4
    if kind not in _NUMERIC or len(head) < _SIZES_AT + 8 + 4 * n:
        return content if content < _MOST_SHRUNK * stored else 8 * content
    count = 1
    for each in struct.unpack_from(f"{order}{n}I", head, _SIZES_AT + 8):
        count *= each
    return max(content, 8 * count)
