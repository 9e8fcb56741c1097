"""Logs as ECUs write them: CSV, .msl and .mlg of a made-up drive; written without the package's readers."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence

import numpy as np

CODES = {"U08": (0, "B"), "S08": (1, "b"), "U16": (2, "H"), "S16": (3, "h"), "U32": (4, "I"), "S32": (5, "i"),
         "S64": (6, "q"), "F32": (7, "f"), "U08_BITS": (10, "B")}  # fmt: skip
Column = tuple[str, str, str, float, float]  # name, unit, type, scale, transform


def drive(seconds: float = 60.0, lag: float = 0.08, rate: float = 100.0, hertz: float = 1.0) -> dict[str, np.ndarray]:
    """A foot that moves at `hertz` about 25 %, and a plate that comes `lag` s later; time in s, the rest in %."""
    time = np.arange(round(seconds * rate)) / rate

    def foot(t: np.ndarray) -> np.ndarray:
        return 25.0 + 12.0 * np.sin(2 * np.pi * hertz * t) + 4.0 * np.sin(2 * np.pi * 0.05 * t)

    return {"time": time, "setpoint": foot(time), "position": foot(time - lag)}


def csv(log: Mapping[str, np.ndarray], headers: Mapping[str, str]) -> str:
    """A CSV with these headers; NaN is an empty cell."""
    rows = ["" if not np.isfinite(x) else f"{x:.4f}" for x in np.stack([log[k] for k in headers], axis=1).ravel()]
    lines = [",".join(rows[k : k + len(headers)]) for k in range(0, len(rows), len(headers))]
    return "\n".join([",".join(headers.values()), *lines, ""])


def msl(log: Mapping[str, np.ndarray], marks: Sequence[int] = ()) -> str:
    """TunerStudio's text, with a switch in words and marks before some rows."""
    lines = ['"rusEFI 20230701"', '"Capture Date: Sat Jul 01 12:00:00 UTC 2023"',
             "Time\tRPM\tTPS\tETB: position target\tFan", "s\tRPM\t%\t%\t"]  # fmt: skip
    for k, (t, y, r) in enumerate(zip(log["time"], log["position"], log["setpoint"], strict=True)):
        if k in marks:
            lines.append(f"MARK {marks.index(k):03d} - {t:.3f} - lap")
        lines.append(f"{t:.3f}\t3000\t{y:.4f}\t{r:.4f}\tOn")
    return "\n".join([*lines, ""])


def mlg(
    values: Mapping[str, np.ndarray],
    columns: Sequence[Column],
    ticks: np.ndarray,
    version: int = 2,
    markers: Sequence[int] = (),
) -> bytes:
    """MegaLogViewer's binary: header, fields, blocks.

    Args:
        values: by column name.
        columns: in the order of the record.
        ticks: of each block, 10 us, as counted (they are written modulo 2^16).
        version: of the format.
        markers: rows before which a marker is written.
    """
    extra = 34 if version == 2 else 0
    fields = b"".join(
        struct.pack(">B34s10sBffb", CODES[kind][0], name.encode(), unit.encode(), 0, scale, shift, 2) + bytes(extra)
        for name, unit, kind, scale, shift in columns
    )
    record = struct.Struct(">" + "".join(CODES[kind][1] for _, _, kind, _, _ in columns))
    info = b"rusEFI 20230701\0"
    head = 24 if version == 2 else 22
    begin = head + len(fields)
    layout = ">6sHIIIHH" if version == 2 else ">6sHIHIHH"
    out = [struct.pack(layout, b"MLVLG\0", version, 1_688_212_800, begin, begin + len(info), record.size, len(columns)),
           fields, info]  # fmt: skip
    for k, tick in enumerate(ticks):
        stamp = struct.pack(">BH", k % 256, int(tick) % 65536)
        if k in markers:
            out.append(b"\1" + stamp + b"lap".ljust(50, b"\0"))
        raw = [values[name][k] / scale - shift for name, _, _, scale, shift in columns]
        body = record.pack(
            *(x if CODES[kind][1] == "f" else round(x) for x, (_, _, kind, _, _) in zip(raw, columns, strict=True))
        )
        out += [b"\0" + stamp + body, bytes([sum(body) % 256])]
    return b"".join(out)
