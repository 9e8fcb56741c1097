"""Recordings as other programs write them, from columns in the units of a bench; nothing here knows the package.

The binary formats are written by their own programs' libraries. The texts of scopes are laid out byte by byte after
the makers' documentation: no scope was at hand.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

Columns = Mapping[str, tuple[str, np.ndarray]]  # name -> unit, values; the first is the time


def picoscope(path: Path, columns: Columns, separator: str = ",", decimal: str = ".") -> Path:
    """Names, units in brackets, a blank line (PicoScope 6 and 7)."""
    names = separator.join(columns)
    units = separator.join(f"({unit})" for unit, _ in columns.values())
    rows = [separator.join(f"{x:.8f}".replace(".", decimal) for x in row) for row in _rows(columns)]
    path.write_text("\r\n".join([names, units, "", *rows, ""]), encoding="utf-8", newline="")
    return path


def saleae(path: Path, columns: Columns) -> Path:
    """Logic 2's analog.csv."""
    header = ",".join(f"{name} [{unit}]" if k == 0 else name for k, (name, (unit, _)) in enumerate(columns.items()))
    rows = [",".join([f"{row[0]:.9f}", *(f"{x:.6f}" for x in row[1:])]) for row in _rows(columns)]
    path.write_text("\n".join([header, *rows, ""]), encoding="utf-8")
    return path


def rigol_ds1000z(path: Path, columns: Columns) -> Path:
    """Samples by number, start and increment beside the header."""
    time = next(iter(columns.values()))[1]
    channels = list(columns.items())[1:]
    names = ",".join(name for name, _ in channels)
    units = ",".join({"V": "Volt", "A": "Amp"}[unit] for _, (unit, _) in channels)
    head = [f"X,{names},Start,Increment,", f"Sequence,{units},{time[0]:e},{time[1] - time[0]:e}"]
    rows = [f"{k},{','.join(f'{x:.6e}' for x in row[1:])}," for k, row in enumerate(_rows(columns))]
    path.write_text("\n".join([*head, *rows, ""]), encoding="ascii")
    return path


def rigol_mso5000(path: Path, columns: Columns) -> Path:
    """The clock within the header, the time's cells empty."""
    time = next(iter(columns.values()))[1]
    channels = ",".join(f"{name}({unit})" for name, (unit, _) in list(columns.items())[1:])
    head = f"Time(s),{channels},t0 = {time[0]:e}, tInc = {time[1] - time[0]:e},"
    rows = [f",{','.join(f'{x:.6e}' for x in row[1:])},,," for row in _rows(columns)]
    path.write_text("\n".join([head, *rows, ""]), encoding="ascii")
    return path


def tektronix_tds(folder: Path, number: int, columns: Columns) -> list[Path]:
    """F0001CH1.CSV, F0001CH2.CSV: settings beside the samples, a file a channel."""
    (_, time), paths = next(iter(columns.values())), []
    for channel, (unit, values) in enumerate(list(columns.values())[1:], 1):
        settings = [("Record Length", f"{time.size:e}"), ("Sample Interval", f"{time[1] - time[0]:e}"),
                    ("Trigger Point", "0.0"), ("", ""), ("", ""), ("", ""), ("Source", f"CH{channel}"),
                    ("Vertical Units", unit), ("Vertical Scale", "1.0"), ("Vertical Offset", "0.0"),
                    ("Horizontal Units", "s"), ("Firmware Version", "FV:v24.26")]  # fmt: skip
        rows = [f"{key},{value},,{t:018.12f},{x:10.5f}," for (key, value), t, x in zip(
                [*settings, *[("", "")] * (time.size - len(settings))], time, values, strict=True)]  # fmt: skip
        paths.append(folder / f"F{number:04d}CH{channel}.CSV")
        paths[-1].write_text("\n".join([*rows, ""]), encoding="ascii")
    return paths


def tektronix_mso(path: Path, columns: Columns) -> Path:
    """Settings above, all channels below."""
    names, units = list(columns)[1:], [unit for unit, _ in columns.values()][1:]
    head = ["Model,MSO44", "Firmware Version,2.0.3", "Waveform Type,ANALOG" + "," * len(names),
            "Horizontal Units,s", f"Vertical Units,{','.join(units)}", "", f"TIME,{','.join(names)}"]  # fmt: skip
    rows = [",".join(f"{x:.9e}" for x in row) for row in _rows(columns)]
    path.write_text("\r\n".join([*head, *rows, ""]), encoding="ascii", newline="")
    return path


def labview(path: Path, columns: Columns, x_columns: str = "One", decimal: str = ".") -> Path:
    """A LabVIEW measurement file, by lvmio."""
    import lvmio

    time = next(iter(columns.values()))[1]
    channels = [lvmio.Channel(name, values.tolist(), unit=unit, delta_x=float(time[1] - time[0]), x0=float(time[0]))
                for name, (unit, values) in list(columns.items())[1:]]  # fmt: skip
    text = lvmio.format_lvm(channels, x_columns=x_columns, decimal_separator=decimal, precision=9)
    path.write_text(text, encoding="utf-8", newline="")
    return path


def matlab_5(path: Path, columns: Columns, structure: str = "") -> Path:
    """A level 5 MAT-file by SciPy, its vectors alone or in a structure; units go into the names."""
    import scipy.io

    vectors = {f"{name}_{unit}": values[:, None] for name, (unit, values) in columns.items()}
    scipy.io.savemat(path, {structure: vectors} if structure else vectors)
    return path


def matlab_73(path: Path, columns: Columns, structure: str = "") -> Path:
    """A v7.3 MAT-file: HDF5 by h5py behind MATLAB's block of 512 bytes, arrays the other way round."""
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        group = file.create_group(structure) if structure else file
        for name, (unit, values) in columns.items():
            made = group.create_dataset(f"{name}_{unit}", data=values[None, :])
            made.attrs["MATLAB_class"] = np.bytes_("double")
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Mon Nov 23 2026 HDF5 schema 1.00 ."
    with path.open("r+b") as file:
        file.write(head.ljust(124) + b"\x00\x02IM")
    return path


def mdf4(path: Path, columns: Columns, slower: int = 1) -> Path:
    """By asammdf; the last channel in a group of its own, at every so many-th sample."""
    from asammdf import MDF, Signal

    time = next(iter(columns.values()))[1]
    signals = [Signal(values, time, unit=unit, name=name) for name, (unit, values) in list(columns.items())[1:]]
    with MDF(version="4.10") as mdf:
        mdf.append(signals[:-1])
        last = signals[-1]
        mdf.append([Signal(last.samples[::slower], time[::slower], unit=last.unit, name=last.name)])
        mdf.save(path, overwrite=True)
    return path


def bus_log(path: Path, dbc: Path, columns: Columns) -> Path:
    """A bus log by python-can, one frame a sample, encoded by cantools after the DBC that is written beside it."""
    import can
    import cantools.database.can

    channels = list(columns.items())[1:]
    places = [(f"{16 * k}|16@1-", name, unit) for k, (name, (unit, _)) in enumerate(channels)]
    lines = [f' SG_ {name} : {place} (0.001,0) [0|0] "{unit}" ECU' for place, name, unit in places]
    dbc.write_text("\n".join(['VERSION ""', "", "BS_:", "", "BU_: ECU", "", "BO_ 291 Throttle: 8 ECU", *lines, ""]))
    database = cantools.database.load_file(str(dbc))
    assert isinstance(database, cantools.database.can.Database)
    message = database.get_message_by_name("Throttle")
    time = next(iter(columns.values()))[1]
    with can.MF4Writer(str(path)) as writer:
        for k, t in enumerate(time):
            data = message.encode({name: float(values[k]) for name, (_, values) in channels})
            writer.on_message_received(
                can.Message(timestamp=1.7e9 + t, arbitration_id=291, data=data, is_extended_id=False, is_rx=True)
            )
    return path


def tdms(path: Path, columns: Columns, group: str = "Record") -> Path:
    """By nptdms' writer: waveform properties and units as LabVIEW writes them."""
    from nptdms import ChannelObject, TdmsWriter

    time = next(iter(columns.values()))[1]
    clock = {"wf_increment": float(time[1] - time[0]), "wf_start_offset": float(time[0]), "wf_samples": time.size}
    with TdmsWriter(path) as writer:
        writer.write_segment([
            ChannelObject(group, name, values, properties={**clock, "unit_string": unit})
            for name, (unit, values) in list(columns.items())[1:]
        ])  # fmt: skip
    return path


def parquet(path: Path, columns: Columns) -> Path:
    """By pyarrow; a unit in the metadata of its field."""
    import pyarrow
    import pyarrow.parquet

    fields = [pyarrow.field(name, pyarrow.float64(), metadata={"unit": unit}) for name, (unit, _) in columns.items()]
    arrays = [pyarrow.array(values) for _, values in columns.values()]
    pyarrow.parquet.write_table(pyarrow.Table.from_arrays(arrays, schema=pyarrow.schema(fields)), path)
    return path


def mcap(path: Path, columns: Columns, slower: int = 1, encoding: str = "json", last_encoding: str = "") -> Path:
    """By mcap's writer: nested messages, units in the schema; the last channel at every so many-th sample."""
    import json

    from mcap.writer import Writer

    (_, time), *channels = columns.values()
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        for k, (name, (unit, values)) in enumerate(zip(list(columns)[1:], channels, strict=True)):
            last = k == len(channels) - 1
            inner = {"type": "object", "properties": {name: {"type": "number", "unit": unit}}}
            schema = {"type": "object", "properties": {"probe": inner}}
            number = writer.register_schema(f"Probe{k}", "jsonschema", json.dumps(schema).encode())
            channel = writer.register_channel(f"/bench/{k}", (last and last_encoding) or encoding, number)
            step = slower if last else 1
            for t, x in zip(time[::step], values[::step], strict=True):
                at = 1_700_000_000_000_000_000 + round(1e9 * t)
                data = json.dumps({"probe": {name: float(x), "ok": True}, "note": "a"}).encode()
                writer.add_message(channel, log_time=at, data=data, publish_time=at)
        writer.finish()
    return path


def semicolons(path: Path, columns: Columns) -> Path:
    """A German spreadsheet: semicolons, decimal commas, units within the names, Windows-1252."""
    header = ";".join(f"{name} in {unit}" for name, (unit, _) in columns.items())
    rows = [";".join(f"{x:.6f}".replace(".", ",") for x in row) for row in _rows(columns)]
    path.write_bytes("\r\n".join(["Prüfstand 3, Drosselklappe", "", header, *rows, ""]).encode("cp1252"))
    return path


def _rows(columns: Columns) -> np.ndarray:
    return np.column_stack([values for _, values in columns.values()])


def wpilog(path: Path, entries: Mapping[str, tuple[str, str, list[tuple[int, object]]]], extra: bytes = b"") -> Path:
    """WPILib's data log of entries (type, metadata, [(us, value)]), with the shortest lengths that hold each number."""
    import struct

    def least(number: int) -> bytes:
        return number.to_bytes(max(1, (number.bit_length() + 7) // 8), "little")

    def record(entry: int, time: int, payload: bytes) -> bytes:
        parts = least(entry), least(len(payload)), least(time)
        lengths = (len(parts[0]) - 1) | (len(parts[1]) - 1) << 2 | (len(parts[2]) - 1) << 4
        return bytes([lengths]) + b"".join(parts) + payload

    def text(words: str) -> bytes:
        return struct.pack("<I", len(words.encode())) + words.encode()

    packed = {"double": "<d", "float": "<f", "int64": "<q", "boolean": "<?"}
    out, values = b"WPILOG" + struct.pack("<HI", 0x0100, len(extra)) + extra, []
    for k, (name, (kind, metadata, samples)) in enumerate(entries.items(), 1):
        start = b"\0" + struct.pack("<I", k) + text(name) + text(kind) + text(metadata)
        out += record(0, samples[0][0] if samples else 0, start)
        for time, value in samples:
            payload = str(value).encode() if kind == "string" else struct.pack(packed[kind], value)
            values.append((time, k, payload))
    for time, k, payload in sorted(values, key=lambda each: each[0]):
        out += record(k, time, payload)
    path.write_bytes(out)
    return path
