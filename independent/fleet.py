"""A fleet of synthetic throttle bodies: FLEET/<unit>/, fleet.toml and units.csv as docs/fleet.md has them.

The truth is returned, never written beside the data unless it is asked for.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from datetime import date, timedelta
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from .effects import NONE, Effects
from .folder import Series
from .instruments import CLOSED_V, OPEN_V, UNITS, Bench
from .line import STRENGTH, SYMBOLS, Line, Odd, with_symbols
from .line_mistakes import IN_THE_LOG, LINE_MISTAKES, ON_THE_BENCH, drawn_gains, scaled
from .protocols import PROTOCOLS, Session, Trace, unit
from .strengths import STRENGTHS
from .truth import RETURN_MARGIN, Truth

LINE_TESTS: dict[str, Series] = {  # 5 traces, 2,300 samples
    "static_load": Series(2, 4.0, 100),
    "response": Series(2, 1.0, 500),
    "inertia": Series(1, 0.4, 1000),
}
WEAK_TESTS: dict[str, Series] = {  # 2 traces, 250 samples: a unit's own data tell little
    "static_load": Series(1, 2.0, 50),
    "response": Series(1, 0.3, 250),
}
BENCH = Bench(time_step=1e-4)
# with WEAK_TESTS: standard errors from a tenth of the population's spread (R_a) to several times it (L_a)
WEAK_BENCH = replace(BENCH, sensors={name: replace(s, sigma=4.0 * s.sigma) for name, s in BENCH.sensors.items()})
LOGGED = ("voltage", "current", "tps", "emf")
DIGITS = {"s": 4, "ms": 1, "V": 4, "A": 4, "mA": 1, "mV": 1}
FIRST_DAY = date(2026, 3, 2)
COLUMNS = ("unit", "serial", "date", "batch", "rig", "operator", "temperature_C", "part")


@dataclass(frozen=True)
class Limits:
    """What a specification allows of one parameter; None: that side is free."""

    # low, high: in `unit`
    low: float | None
    high: float | None
    unit: str  # of measure

    @property
    def toml(self) -> str:
        """As an inline table."""
        sides = [f"{side} = {value}" for side, value in (("low", self.low), ("high", self.high)) if value is not None]
        return "{ " + ", ".join([*sides, f'unit = "{self.unit}"']) + " }"


NO_LIMITS: Mapping[str, Limits] = {}


@dataclass(frozen=True)
class UnitTruth:
    """What one unit is."""

    name: str  # of its folder
    part: int  # number of the physical throttle, from 0
    # rig, operator: numbers, from 0
    rig: int
    operator: int
    temperature_C: float  # of the room
    truth: Truth  # Eqs. 1-2's parameters while it was measured.
    odd: Odd | None  # what it has of its own, or None
    seed: tuple[int, int]  # of its noise

    @property
    def values(self) -> dict[str, float]:
        """By SYMBOLS, SI; of the throttle, not of what a mistaken bench sees of it."""
        return {symbol: getattr(self.truth, symbol) for symbol in SYMBOLS}


@dataclass(frozen=True)
class FleetTruth:
    """What a fit of the fleet should find."""

    line: Line  # that made it
    units: tuple[UnitTruth, ...]  # in the order of units.csv
    gains: tuple[Mapping[str, float], ...]  # of each rig, by channel
    seed: int  # of all of it

    @property
    def mean(self) -> dict[str, float]:
        """Of the population, before any drift, SI."""
        return dict(zip(SYMBOLS, self.line.population.mean.tolist(), strict=True))

    @property
    def sd(self) -> dict[str, float]:
        """Of the population, before any drift, SI."""
        return dict(zip(SYMBOLS, self.line.population.sd.tolist(), strict=True))

    @property
    def odd(self) -> dict[str, str]:
        """Name of each odd unit -> its kind."""
        return {unit.name: unit.odd.kind for unit in self.units if unit.odd}

    def write(self, path: Path) -> None:
        """All of it as JSON."""
        known = {
            "seed": self.seed,
            "population": {
                "mean": self.mean,
                "sd": self.sd,
                "symbols": SYMBOLS,
                "correlation": self.line.population.matrix.tolist(),
                "law": self.line.population.law,
            },
            "drift": asdict(self.line.drift) if self.line.drift else None,
            "gains": self.gains,
            "odd": self.odd,
            "units": {unit.name: unit.values for unit in self.units},
        }
        path.write_text(json.dumps(known, indent=1) + "\n", encoding="utf-8")


def make_fleet(
    path: Path | str,
    line: Line,
    units: int,
    seed: int,
    *,
    tests: Mapping[str, Series] = LINE_TESTS,
    bench: Bench = BENCH,
    name: str = "synthetic line",
    limits: Mapping[str, Limits] = NO_LIMITS,
    own_rig_toml: bool = False,
    processes: int = 1,
) -> FleetTruth:
    """Write a fleet.

    Args:
        path: the folder; made if absent.
        line: that makes and measures the parts.
        units: folders.
        seed: of everything random in it; the first units of a longer fleet are those of a shorter one.
        tests: that each unit has.
        bench: the instruments of every rig, before a rig's own gain.
        name: of the fleet.
        limits: what the specification allows, by symbol.
        own_rig_toml: give each unit the common tables as a rig.toml of its own, so that it can be fitted alone.
        processes: that write units side by side.

    Raises:
        ValueError: the units are not whole parts, an odd kind is unknown, or a plate drawn would not close by itself.
    """
    truth = draw_fleet(line, units, seed)
    folder, common = Path(path), common_toml(line.population.design.N, bench)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "fleet.toml").write_text(_fleet_toml(name, limits, common), encoding="utf-8", newline="\n")
    _write_table(folder / "units.csv", truth)
    write = partial(write_unit, folder, truth.gains, tests, bench, common if own_rig_toml else "")
    if processes == 1:
        for one in truth.units:
            write(one)
    else:
        with ProcessPoolExecutor(processes, get_context("spawn")) as pool:  # threads of others survive no fork
            list(pool.map(write, truth.units, chunksize=8))
    return truth


def draw_fleet(line: Line, units: int, seed: int) -> FleetTruth:
    """The truth of a fleet, nothing written.

    Raises:
        ValueError: as `make_fleet`.
    """
    if units % line.a_part:
        raise ValueError(f"units: {units} are not whole parts of {line.a_part} measurements each")
    if unknown := {odd.kind for odd in line.odd} - {*STRENGTHS, *LINE_MISTAKES, *SYMBOLS}:
        raise ValueError(f"odd: unknown kind {', '.join(sorted(unknown))}")
    parts = _parts(line, units // line.a_part, seed)
    handling = [_handling(line.operator_spread, seed, 3, operator) for operator in range(line.operators)]
    digits = max(len(str(units)), 4)
    odd = {odd.unit: odd for odd in line.odd}
    drawn = []
    for number in range(units):
        rng = np.random.default_rng([seed, 4, number])
        part, (rig, operator) = number // line.a_part, _who(line, number)
        room = line.temperature_C[0] + line.temperature_C[1] * rng.standard_normal()
        clamped = {symbol: 1.0 + share * rng.standard_normal() for symbol, share in line.mounting.items()}
        warm = {"R_a": 1.0 + line.copper * (room - line.temperature_C[0])}
        values = _times(parts[part], handling[operator], clamped, warm)
        truth = with_symbols(line.population.design, _odd_values(line, values, odd.get(number)))
        if truth.T_PL - truth.T_f <= RETURN_MARGIN:
            raise ValueError(f"unit {number}: its plate would not close by itself; a smaller spread of T_PL and T_f")
        drawn.append(UnitTruth(f"SYN{number + 1:0{digits}d}", part, rig, operator, room, truth, odd.get(number),
                               (seed, number)))  # fmt: skip
    gains = tuple(drawn_gains(np.random.default_rng([seed, 2, rig]), line.rig_gain) for rig in range(line.rigs))
    return FleetTruth(line, tuple(drawn), gains, seed)


def _parts(line: Line, count: int, seed: int) -> list[dict[str, float]]:
    """Parameters of each part."""
    of_batch, of_part = line.shares()
    out = []
    for part in range(count):
        batch = np.random.default_rng([seed, 0, part // line.batch]).standard_normal(len(SYMBOLS))
        own = np.random.default_rng([seed, 1, part]).standard_normal(len(SYMBOLS))
        values = line.population.unit(of_batch * batch + of_part * own)
        if line.drift is not None and part >= line.drift.since:
            values[line.drift.symbol] += line.drift.size * getattr(line.population.design, line.drift.symbol)
        out.append(values)
    return out


def _handling(spread: Mapping[str, float], *seed: int) -> dict[str, float]:
    rng = np.random.default_rng(seed)
    return {symbol: 1.0 + share * rng.standard_normal() for symbol, share in spread.items()}


def _who(line: Line, number: int) -> tuple[int, int]:
    """Rig and operator of a unit."""
    turn = number % line.a_part // max(line.repeats, 1) if line.repeats else number
    return turn % line.rigs, turn // line.rigs % line.operators


def _times(values: Mapping[str, float], *factors: Mapping[str, float]) -> dict[str, float]:
    out = dict(values)
    for by in factors:
        for symbol, factor in by.items():
            out[symbol] *= factor
    return out


def _odd_values(line: Line, values: Mapping[str, float], odd: Odd | None) -> dict[str, float]:
    """With one parameter 5, 8 or 12 standard deviations above, where that is what is odd."""
    out = dict(values)
    if odd is not None and odd.kind in SYMBOLS:
        sd = line.population.sd[SYMBOLS.index(odd.kind)]
        out[odd.kind] += (5.0, 8.0, 12.0)[STRENGTH[odd.strength]] * sd
    return out


def write_unit(
    folder: Path,
    gains: tuple[Mapping[str, float], ...],
    tests: Mapping[str, Series],
    bench: Bench,
    rig_toml: str,
    one: UnitTruth,
) -> None:
    """The folder of one unit; rig_toml: of its own, or ""."""
    kind, size = (one.odd.kind, STRENGTH[one.odd.strength]) if one.odd else ("", 1)
    effects: Effects = STRENGTHS[kind][size] if kind in STRENGTHS else NONE
    seen = one.truth
    if kind in ON_THE_BENCH:
        change, sizes = ON_THE_BENCH[kind]
        seen = change(seen, sizes[size])
    session = Session(np.random.default_rng([one.seed[0], 5, one.seed[1]]), seen, effects, bench)
    for test, series in tests.items():
        (folder / one.name / test).mkdir(parents=True, exist_ok=True)
        for trace in PROTOCOLS[test](session, series):
            logged = _through_the_rig(trace, gains[one.rig])
            if kind in IN_THE_LOG:
                spoil, sizes = IN_THE_LOG[kind]
                logged = spoil(logged, sizes[size])
            _write_trace(folder / one.name, logged, one.seed[0])
    if rig_toml:
        text = rig_toml.replace("[rig]\n", f'[rig]\nname = "{one.name} (synthetic)"\n')
        (folder / one.name / "rig.toml").write_text(f"# SYNTHETIC: made by independent\n{text}", encoding="utf-8",
                                                    newline="\n")  # fmt: skip


def _through_the_rig(trace: Trace, gains: Mapping[str, float]) -> Trace:
    for channel, gain in gains.items():
        trace = scaled(trace, channel, gain)
    return trace


def _write_trace(folder: Path, trace: Trace, seed: int) -> None:
    """The CSV with the digits that its instruments have; a thousand units are many bytes."""
    row = ",".join(f"%.{DIGITS.get(unit(header), UNITS[unit(header)][1])}f" for header in trace.columns)
    rows = np.column_stack(list(trace.columns.values())) + 0.0  # no negative zeros
    body = "\n".join([row] * len(rows)) % tuple(rows.ravel())
    text = f"# SYNTHETIC: made by independent, seed {seed}\n{','.join(trace.columns)}\n{body}\n"
    (folder / trace.file).write_text(text, encoding="utf-8", newline="\n")


def common_toml(gear_ratio: float, bench: Bench) -> str:
    """What all units share, as tables of rig.toml."""
    sensors = [bench.sensors[name] for name in LOGGED]
    parts = [
        f"[rig]\nsynthetic = true\ngear_ratio = {gear_ratio}\nsupply_V = {bench.supply}\ntravel_deg = [0.0, 90.0]\n",
        f"[tps]\nclosed_V = {CLOSED_V}\nopen_V = {OPEN_V}\ntravel_deg = 90.0\n",
        "[noise]",
        *(f"{s.quantity}_{s.unit} = {s.declared:.6g}" for s in sensors),
        "",
    ]
    return "\n".join(parts)


def _fleet_toml(name: str, limits: Mapping[str, Limits], common: str) -> str:
    allowed = [f"{symbol} = {each.toml}" for symbol, each in limits.items()]
    table = "\n".join(["[limits]", *allowed, "", ""]) if allowed else ""
    return f'# SYNTHETIC: made by independent\n[fleet]\nname = "{name}"\n\n{table}{common}'


def _write_table(path: Path, truth: FleetTruth) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows(_rows(truth))


def _rows(truth: FleetTruth) -> Iterable[tuple[str, ...]]:
    for number, one in enumerate(truth.units):
        day = _workday(number // truth.line.a_day)
        yield (one.name, f"SYN-{one.part + 1:06d}", day.isoformat(), f"B{one.part // truth.line.batch + 1:02d}",
               f"rig {one.rig + 1}", "ABCDEFGHIJKLMNOPQRSTUVWXYZ"[one.operator], f"{one.temperature_C:.1f}",
               f"P{one.part + 1:06d}")  # fmt: skip


def _workday(number: int) -> date:
    """So many working days after the first, a Monday."""
    return FIRST_DAY + timedelta(days=number // 5 * 7 + number % 5)


def odd_ones(kinds: Iterable[str], units: int, seed: int) -> tuple[Odd, ...]:
    """One unit of each kind, spread over the fleet at random."""
    kinds = tuple(kinds)
    numbers = np.random.default_rng([seed, 6]).choice(units, len(kinds), replace=False)
    return tuple(Odd(int(number), kind) for number, kind in zip(numbers, kinds, strict=True))


def with_odd(line: Line, kinds: Iterable[str], units: int, seed: int) -> Line:
    """The line with one odd unit of each kind."""
    return replace(line, odd=odd_ones(kinds, units, seed))
