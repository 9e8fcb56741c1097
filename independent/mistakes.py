"""What people get wrong on a rig, done to a folder that `make_folder` wrote: its CSVs and its rig.toml, as text.

Every mistake is a function of a folder and a random generator, which draws where and how large; it says what it did.
Some are made where the data are: a resistor that nobody declared, one clock for output and logger, a supply that sags
behind a bridge whose duty is all that was logged, a trace whose winding was warm, a trace of another body.
"""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from .effects import NONE, Effects
from .folder import make_folder
from .instruments import CLOSED_V, UNITS, Bench
from .truth import Truth


@dataclass(frozen=True)
class Mistake:
    """What was done."""

    kind: str  # its name
    test: str | None  # where; None: to the whole rig
    channel: str | None  # to which; None: none in particular
    size: float  # how much, in the kind's own measure
    file: str = ""  # of the one trace to which it was done; "": to more than one


@dataclass(frozen=True)
class Sheet:
    """A CSV: its comment, its header and its numbers, shape (n, columns)."""

    comment: str
    header: tuple[str, ...]
    rows: np.ndarray

    @classmethod
    def read(cls, path: Path) -> Sheet:
        comment, header, *lines = path.read_text(encoding="utf-8").splitlines()
        return cls(comment, tuple(header.split(",")), np.array([line.split(",") for line in lines], dtype=float))

    def write(self, path: Path) -> None:
        decimals = [max(UNITS[name[name.index("[") + 1 : -1]][1], 5) for name in self.header]
        lines = [",".join(f"{x:.{d}f}" for x, d in zip(row, decimals, strict=True)) for row in self.rows]
        path.write_text("\n".join([self.comment, ",".join(self.header), *lines, ""]), encoding="utf-8", newline="\n")

    def at(self, quantity: str) -> int:
        """Which column holds a quantity."""
        return next(k for k, name in enumerate(self.header) if name.startswith(f"{quantity} ["))

    def scaled(self, quantity: str, factor: float, name: str | None = None) -> Sheet:
        """A column times a factor, under its own or another header."""
        k, rows = self.at(quantity), self.rows.copy()
        rows[:, k] *= factor
        return replace(self, rows=rows, header=(*self.header[:k], name or self.header[k], *self.header[k + 1 :]))


def edited(folder: Path, test: str, change: Callable[[Sheet], Sheet]) -> None:
    """Every trace of a test, changed."""
    for path in sorted((folder / test).glob("*.csv")):
        change(Sheet.read(path)).write(path)


def swapped_columns(folder: Path, rng: np.random.Generator) -> Mistake:
    """Voltage and current, both in V and A, under each other's header in one test."""
    test = str(rng.choice(["resistance", "inductance", "static_load", "viscous", "response"]))

    def change(sheet: Sheet) -> Sheet:
        if "current [mA]" in sheet.header:
            sheet = sheet.scaled("current", 1e-3, "current [A]")
        names = {"voltage [V]": "current [A]", "current [A]": "voltage [V]"}
        return replace(sheet, header=tuple(names.get(name, name) for name in sheet.header))

    edited(folder, test, change)
    return Mistake("swapped_columns", test, "voltage", 1.0)


def channel_sign(folder: Path, rng: np.random.Generator) -> Mistake:
    """One channel of one test turned round."""
    test, channel = CHOICES_OF_SIGN[rng.integers(len(CHOICES_OF_SIGN))]
    edited(folder, test, lambda sheet: sheet.scaled(channel, -1.0))
    return Mistake("channel_sign", test, channel, -1.0)


CHOICES_OF_SIGN = (
    *((test, "current") for test in ("resistance", "inductance", "static_load", "viscous", "response")),
    *(("back_emf", "emf"), ("inertia", "emf"), ("viscous", "motor_speed"), ("response", "voltage")),
)


def unit_scale(folder: Path, rng: np.random.Generator) -> Mistake:
    """A header names a unit that the numbers are not in, and they stay plausible."""
    choices = (("response", "current", 1e-3), ("inertia", "emf", 1e-3), ("viscous", "motor_speed", np.pi / 30))
    test, channel, factor = choices[rng.integers(len(choices))]
    edited(folder, test, lambda sheet: sheet.scaled(channel, factor))
    return Mistake("unit_scale", test, channel, factor)


def gear_ratio(folder: Path, rng: np.random.Generator) -> Mistake:
    """rig.toml has half, twice, or the inverse of the ratio, or one miscounted by a third."""
    factor = float(rng.choice([0.5, 2.0, 0.7, 1.3, 20.68**-2]))
    toml = (folder / "rig.toml").read_text(encoding="utf-8")
    changed = re.sub(r"gear_ratio = (\S+)", lambda m: f"gear_ratio = {float(m[1]) * factor:.6g}", toml)
    (folder / "rig.toml").write_text(changed, encoding="utf-8", newline="\n")
    return Mistake("gear_ratio", None, None, factor)


def time_scale(folder: Path, rng: np.random.Generator) -> Mistake:
    """The clock of one of the two releases runs 2 to 6 % fast or slow."""
    test, factor = str(rng.choice(["back_emf", "inertia"])), 1.0 + float(rng.choice([-1, 1])) * rng.uniform(0.02, 0.06)
    edited(folder, test, lambda sheet: sheet.scaled("time", factor))
    return Mistake("time_scale", test, "time", factor)


def time_scale_under_hum(folder: Path, rng: np.random.Generator) -> Mistake:
    """The clock of the driven responses runs 1.5 to 5 % fast or slow, and the mains hums in their current."""
    factor = 1.0 + float(rng.choice([-1, 1])) * rng.uniform(0.015, 0.05)
    _hums(folder, rng, "response", "current", 0.012)
    edited(folder, "response", lambda sheet: sheet.scaled("time", factor))
    return Mistake("time_scale", "response", "time", factor)


def hum(folder: Path, rng: np.random.Generator) -> Mistake:
    """The mains in one channel of one test, amplitude once to three times its noise."""
    choices = (("response", "current", 0.008), ("static_load", "current", 0.008), ("resistance", "voltage", 0.010),
               ("back_emf", "emf", 0.010), ("viscous", "voltage", 0.010), ("response", "tps", 0.003))  # fmt: skip
    test, channel, sigma = choices[rng.integers(len(choices))]
    amplitude = sigma * rng.uniform(1.0, 3.0)
    _hums(folder, rng, test, channel, amplitude)
    return Mistake("hum", test, channel, amplitude)


def _hums(folder: Path, rng: np.random.Generator, test: str, channel: str, amplitude: float) -> None:
    frequency = float(rng.choice([50.0, 60.0])) * (1.0 + 5e-4 * rng.standard_normal())

    def change(sheet: Sheet) -> Sheet:
        k, rows = sheet.at(channel), sheet.rows.copy()
        name, clock = sheet.header[k], 1e-3 if sheet.header[0].endswith("[ms]") else 1.0
        wave = np.sin(2.0 * np.pi * frequency * clock * rows[:, 0] + rng.uniform(0.0, 2.0 * np.pi))
        rows[:, k] += amplitude * UNITS[name[name.index("[") + 1 : -1]][0] * wave
        return replace(sheet, rows=rows)

    edited(folder, test, change)


def channel_offset(folder: Path, rng: np.random.Generator) -> Mistake:
    """Current or EMF of one test does not read zero at zero."""
    choices = (("response", "current", 0.04), ("static_load", "current", 0.04), ("viscous", "current", 0.04),
               ("back_emf", "emf", 0.04), ("inertia", "emf", 0.04))  # fmt: skip
    test, channel, usual = choices[rng.integers(len(choices))]
    size = float(rng.choice([-1, 1])) * usual * rng.uniform(0.5, 2.0)

    def change(sheet: Sheet) -> Sheet:
        k, rows = sheet.at(channel), sheet.rows.copy()
        name = sheet.header[k]
        rows[:, k] += size * UNITS[name[name.index("[") + 1 : -1]][0]
        return replace(sheet, rows=rows)

    edited(folder, test, change)
    return Mistake("channel_offset", test, channel, size)


def channel_gain(folder: Path, rng: np.random.Generator) -> Mistake:
    """One channel of one test reads 2 to 10 % too much or too little."""
    choices = (("response", "current"), ("static_load", "current"), ("viscous", "current"), ("static_load", "voltage"),
               ("response", "voltage"), ("inertia", "emf"))  # fmt: skip
    test, channel = choices[rng.integers(len(choices))]
    factor = 1.0 + float(rng.choice([-1, 1])) * rng.uniform(0.02, 0.1)
    edited(folder, test, lambda sheet: sheet.scaled(channel, factor))
    return Mistake("channel_gain", test, channel, factor)


def sensor_end_points(folder: Path, rng: np.random.Generator) -> Mistake:
    """The open end of the position sensor was written down 2 to 10 % off."""
    factor = 1.0 + float(rng.choice([-1, 1])) * rng.uniform(0.02, 0.1)
    toml = (folder / "rig.toml").read_text(encoding="utf-8")
    changed = re.sub(r"open_V = (\S+)", lambda m: f"open_V = {float(m[1]) * factor:.6g}", toml)
    (folder / "rig.toml").write_text(changed, encoding="utf-8", newline="\n")
    return Mistake("sensor_end_points", None, "position", factor)


def saturation(folder: Path, rng: np.random.Generator) -> Mistake:
    """The current's ADC ends at 60 to 90 % of its peak in one test."""
    test = str(rng.choice(["response", "static_load", "viscous"]))
    share = rng.uniform(0.6, 0.9)
    sheets = [Sheet.read(path) for path in sorted((folder / test).glob("*.csv"))]
    rail = share * max(float(sheet.rows[:, sheet.at("current")].max()) for sheet in sheets)

    def change(sheet: Sheet) -> Sheet:
        k, rows = sheet.at("current"), sheet.rows.copy()
        rows[:, k] = np.minimum(rows[:, k], rail)
        return replace(sheet, rows=rows)

    edited(folder, test, change)
    return Mistake("saturation", test, "current", share)


def lost_samples(folder: Path, rng: np.random.Generator) -> Mistake:
    """One row in a hundred was never written, in one test."""
    test = str(rng.choice(["response", "static_load", "viscous", "back_emf"]))

    def change(sheet: Sheet) -> Sheet:
        return replace(sheet, rows=sheet.rows[rng.uniform(size=len(sheet.rows)) > 0.01])

    edited(folder, test, change)
    return Mistake("lost_samples", test, "time", 0.01)


def duplicate(folder: Path, rng: np.random.Generator) -> Mistake:
    """One trace lies there a second time, whole or a third of it with its time begun anew."""
    path = sorted(folder.glob("*/*.csv"))[rng.integers(len(sorted(folder.glob("*/*.csv"))))]
    sheet = Sheet.read(path)
    if rng.uniform() < 0.5:
        count = len(sheet.rows)
        rows = sheet.rows[count // 3 : 2 * count // 3].copy()
        rows[:, 0] -= rows[0, 0]
        sheet = replace(sheet, rows=rows)
    replace(sheet, comment="# logged again").write(path.with_name("once_more.csv"))
    return Mistake("duplicate", path.parent.name, None, float(len(sheet.rows)))


def channel_late(folder: Path, rng: np.random.Generator) -> Mistake:
    """One channel of one test comes one to four samples late, s."""
    choices = (("response", "current"), ("response", "tps"), ("response", "voltage"), ("viscous", "current"),
               ("viscous", "motor_speed"), ("inductance", "current"))  # fmt: skip
    test, quantity = choices[rng.integers(len(choices))]
    by, late = int(rng.integers(1, 5)), 0.0

    def change(sheet: Sheet) -> Sheet:
        nonlocal late
        late = by * _interval(sheet)
        return shifted(sheet, [sheet.at(quantity)], by)

    edited(folder, test, change)
    return Mistake("channel_late", test, "position" if quantity == "tps" else quantity, late)


def trace_late(folder: Path, rng: np.random.Generator) -> Mistake:
    """All that was measured in one trace comes 3 to 15 samples later than the voltage that drove it, s."""
    files = fitted_files(folder, ("response", "viscous"))
    file, by = files[rng.integers(len(files))], int(rng.integers(3, 16))
    path = folder / file
    sheet = Sheet.read(path)
    measured = [k for k in range(1, len(sheet.header)) if k != sheet.at("voltage")]
    shifted(sheet, measured, by).write(path)
    return Mistake("trace_late", path.parent.name, None, by * _interval(sheet), file)


def fitted_files(folder: Path, tests: tuple[str, ...]) -> list[str]:
    """Files of some tests that are not held out."""
    held_out = (folder / "rig.toml").read_text(encoding="utf-8").partition("[holdout]")[2]
    every = [f"{test}/{path.name}" for test in tests for path in sorted((folder / test).glob("*.csv"))]
    return [file for file in every if file not in held_out]


def _interval(sheet: Sheet) -> float:
    """Between two samples, s."""
    return float(np.median(np.diff(sheet.rows[:, 0]))) * (1e-3 if sheet.header[0].endswith("[ms]") else 1.0)


def shifted(sheet: Sheet, columns: list[int], by: int) -> Sheet:
    """Some columns so many rows later than the others; rows that then lack a value are gone."""
    rows = sheet.rows[by:].copy()
    rows[:, columns] = sheet.rows[:-by, columns]
    return replace(sheet, rows=rows)


def of_another_body(path: Path, other: Truth, seed: int, effects: Effects, size: str, file: str) -> None:
    """A trace of a folder replaced by the one that another body gave in a folder like it."""
    with tempfile.TemporaryDirectory() as beside:
        make_folder(Path(beside), other, seed, effects, size)  # pyright: ignore[reportArgumentType]
        shutil.copy(Path(beside) / file, path / file)


def warm_start(path: Path, truth: Truth, seed: int, effects: Effects, size: str, rng: np.random.Generator) -> Mistake:
    """One trace was begun with a winding 20 to 60 K warmer than the others were."""
    file = str(rng.choice(fitted_files(path, ("static_load", "viscous", "response"))))
    ohm = 0.0039 * truth.R_a * float(rng.uniform(20.0, 60.0))
    of_another_body(path, replace(truth, R_a=truth.R_a + ohm), seed, effects, size, file)
    return Mistake("warm_start", file.partition("/")[0], None, ohm, file)


def other_rig(path: Path, truth: Truth, seed: int, effects: Effects, size: str, rng: np.random.Generator) -> Mistake:
    """One trace is of another body of the same make: its parameters 5 to 25 % off, each by itself."""
    file = str(rng.choice(fitted_files(path, ("static_load", "viscous", "response"))))
    off = rng.choice([-1, 1], size=len(_MAKE)) * rng.uniform(0.05, 0.25, size=len(_MAKE))
    values = {s: getattr(truth, s) * (1.0 + d) for s, d in zip(_MAKE, off, strict=True)}
    other = replace(truth, **values, K_m=values["K_b"])
    of_another_body(path, other, seed, effects, size, file)
    return Mistake("other_rig", file.partition("/")[0], None, float(np.max(np.abs(off))), file)


_MAKE = ("R_a", "L_a", "K_b", "J_m", "J_L", "B_m", "B_L", "K_s", "T_PL", "T_f")

# ---- one channel of one trace


def one_channel_late(folder: Path, rng: np.random.Generator) -> Mistake:
    """One channel of one trace comes four samples late, s."""
    file, quantity = _drawn(folder, rng, (("response", "current"), ("response", "tps"), ("viscous", "motor_speed")))
    sheet = Sheet.read(folder / file)
    shifted(sheet, [sheet.at(quantity)], _SAMPLES_LATE).write(folder / file)
    return _in_file("channel_late", file, quantity, _SAMPLES_LATE * _interval(sheet))


def one_channel_gain(folder: Path, rng: np.random.Generator) -> Mistake:
    """One channel of one trace reads 8 % too much or too little."""
    file, quantity = _drawn(folder, rng, _MEASURED)
    factor = 1.0 + 0.08 * float(rng.choice([-1, 1]))
    sheet = Sheet.read(folder / file)
    k, rows = sheet.at(quantity), sheet.rows.copy()
    zero = CLOSED_V if quantity == "tps" else 0.0  # an angle is what the sensor shows above the closed stop
    rows[:, k] = zero + factor * (rows[:, k] - zero)
    replace(sheet, rows=rows).write(folder / file)
    return _in_file("channel_gain", file, quantity, factor)


def one_channel_offset(folder: Path, rng: np.random.Generator) -> Mistake:
    """A current of one trace does not read zero at zero, A."""
    file, quantity = _drawn(folder, rng, [each for each in _MEASURED if each[1] == "current"])
    size = 0.06 * float(rng.choice([-1, 1]))
    sheet = Sheet.read(folder / file)
    k = sheet.at(quantity)
    name, rows = sheet.header[k], sheet.rows.copy()
    rows[:, k] += size * UNITS[name[name.index("[") + 1 : -1]][0]
    replace(sheet, rows=rows).write(folder / file)
    return _in_file("channel_offset", file, quantity, size)


def one_channel_sign(folder: Path, rng: np.random.Generator) -> Mistake:
    """One channel of one trace turned round."""
    file, quantity = _drawn(folder, rng, [each for each in _MEASURED if each[1] != "tps"])
    Sheet.read(folder / file).scaled(quantity, -1.0).write(folder / file)
    return _in_file("channel_sign", file, quantity, -1.0)


_SAMPLES_LATE = 4
_MEASURED = (("response", "current"), ("response", "tps"), ("viscous", "current"), ("viscous", "motor_speed"),
             ("static_load", "current"))  # fmt: skip


def _drawn(folder: Path, rng: np.random.Generator, choices: Sequence[tuple[str, str]]) -> tuple[str, str]:
    """A file that is not held out, of a test among some, and the quantity of it."""
    test, quantity = choices[int(rng.integers(len(choices)))]
    files = fitted_files(folder, (test,))
    return files[int(rng.integers(len(files)))], quantity


def _in_file(kind: str, file: str, quantity: str, size: float) -> Mistake:
    return Mistake(kind, file.partition("/")[0], "position" if quantity == "tps" else quantity, size, file)


IN_ONE_FILE = (one_channel_late, one_channel_gain, one_channel_offset, one_channel_sign)

AFTERWARDS: Mapping[str, Callable[[Path, np.random.Generator], Mistake]] = {
    change.__name__: change
    for change in (swapped_columns, channel_sign, unit_scale, gear_ratio, time_scale, time_scale_under_hum, hum,
                   channel_offset, saturation, lost_samples, duplicate, channel_gain, sensor_end_points, channel_late,
                   trace_late, *IN_ONE_FILE)
}  # fmt: skip
# traces that another body gave
ELSEWHERE = {change.__name__: change for change in (warm_start, other_rig)}
_LATER = tuple(change.__name__ for change in IN_ONE_FILE)
_EARLIER = tuple(name for name in AFTERWARDS if name not in _LATER)
# each draws by its place here: a new one goes to the end
MISTAKES = ("series_resistance", "synchronous_edges", *_EARLIER, "supply_sag", *ELSEWHERE, *_LATER)
# a few per cent, or samples, that no trace shows by itself
ONLY_BY_A_FIT = ("channel_gain", "sensor_end_points", "channel_late", "trace_late", "supply_sag", *ELSEWHERE, *_LATER)


def make_mistaken(
    path: Path, truth: Truth, seed: int, mistake: str, size: str = "small", effects: Effects = NONE
) -> Mistake:
    """A folder with one mistake in it.

    Args:
        path: the folder; made if absent.
        truth, effects: the body.
        seed: of everything random in it.
        mistake: one of MISTAKES.
        size: a key of SIZES.
    """
    rng = np.random.default_rng([seed, 1 + MISTAKES.index(mistake)])
    bench = Bench()
    done = Mistake(mistake, None, None, 0.0)
    if mistake == "series_resistance":
        done = Mistake(mistake, "inductance", None, float(rng.uniform(0.3, 2.0)))
        bench = replace(bench, series_ohm=done.size)
    elif mistake == "synchronous_edges":
        done = Mistake(mistake, "response", "voltage", float(rng.uniform(0.05, 0.95)))
        bench = replace(bench, edge_phase=done.size)
    elif mistake == "supply_sag":
        done = Mistake(mistake, None, None, float(rng.uniform(0.15, 0.6)))
        bench = replace(bench, supply_ohm=done.size)
    make_folder(path, truth, seed, effects, size, bench=bench)  # pyright: ignore[reportArgumentType]
    if mistake == "series_resistance":
        toml = (path / "rig.toml").read_text(encoding="utf-8")
        text = toml.replace('[tests.inductance]\nseries_ohm = "free"\n', "")
        (path / "rig.toml").write_text(text, encoding="utf-8", newline="\n")
    if mistake in ELSEWHERE:
        return ELSEWHERE[mistake](path, truth, seed, effects, size, rng)
    return AFTERWARDS[mistake](path, rng) if mistake in AFTERWARDS else done
