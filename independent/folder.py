"""A measurement folder of synthetic data: CSVs and rig.toml (docs/reference/folder.md), marked synthetic everywhere."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Literal

import numpy as np

from .effects import NONE, Effects
from .instruments import CLOSED_V, OPEN_V, UNITS, Bench
from .protocols import PROTOCOLS, Series, Session, Trace, quantity, unit
from .truth import Truth

SIZES: dict[str, dict[str, Series]] = {
    "bench": {  # 30 traces, 67,000 samples
        "resistance": Series(7, 0.5, 1000),
        "inductance": Series(3, 0.03, 20_000),
        "back_emf": Series(3, 0.5, 2000),
        "static_load": Series(2, 20.0, 500, held=1),
        "viscous": Series(6, 1.0, 1000),
        "inertia": Series(3, 0.5, 2000),
        "response": Series(6, 5.0, 1000, held=1),
    },
    "twin": {  # 20 traces, 35,000 samples
        "resistance": Series(4, 0.4, 1000),
        "inductance": Series(2, 0.02, 20_000),
        "back_emf": Series(2, 0.4, 2000),
        "static_load": Series(2, 16.0, 250, held=1),
        "viscous": Series(3, 0.6, 1000),
        "inertia": Series(2, 0.4, 2000),
        "response": Series(5, 4.0, 1000, held=1),
    },
    "diagnose": {  # 19 traces, 13,000 samples: many folders in an hour
        "resistance": Series(3, 0.2, 1000),
        "inductance": Series(2, 0.01, 20_000),
        "back_emf": Series(1, 0.3, 2000),
        "static_load": Series(3, 8.0, 100, held=1),
        "viscous": Series(2, 0.4, 1000),
        "inertia": Series(1, 0.3, 2000),
        "response": Series(6, 1.5, 1000, held=2),
    },
    "small": {  # 14 traces, 8,500 samples: every test, for tests in a hurry
        "resistance": Series(3, 0.2, 1000),
        "inductance": Series(2, 0.01, 20_000),
        "back_emf": Series(1, 0.3, 1000),
        "static_load": Series(2, 8.0, 100, held=1),
        "viscous": Series(2, 0.4, 1000),
        "inertia": Series(1, 0.3, 1000),
        "response": Series(3, 1.5, 1000, held=1),
    },
}


def make_folder(
    path: Path | str,
    truth: Truth,
    seed: int,
    effects: Effects = NONE,
    size: Literal["bench", "twin", "diagnose", "small"] = "bench",
    *,
    holdout: bool = True,
    declare_noise: bool = True,
    bench: Bench | None = None,
) -> None:
    """A folder as `write_folder` makes it, and `truth.json` beside rig.toml: what a fit of it should find.

    Args:
        path: the folder; made if absent.
        truth: Eqs. 1-2's parameters.
        seed: of everything random in it.
        effects: what the body has beyond Eqs. 1-2.
        size: a key of SIZES.
        holdout: name the last response and the last static_load in [holdout], or the last two responses.
        declare_noise: give the sensors' noise in [noise]; else the reader must estimate it.
        bench: the instruments.
    """
    bench = bench or Bench()
    name = f"synthetic throttle body, seed {seed}"
    write_folder(Path(path), name, truth, seed, effects, SIZES[size], bench, holdout=holdout, noise=declare_noise)
    known = {
        "seed": seed,
        "parameters": asdict(truth) | {"J_eq": truth.J_eq, "B_eq": truth.B_eq},
        "series_ohm": bench.series_ohm,
        "effects": {name: getattr(effects, name)._asdict() for name in effects.on},
    }
    (Path(path) / "truth.json").write_text(json.dumps(known, indent=2) + "\n", encoding="utf-8")


def left_by_itself(
    truth: Truth, seed: int, effects: Effects, size: str, bench: Bench | None = None
) -> dict[tuple[str, str], float]:
    """Of each driven trace that `make_folder` holds out, by file and quantity: how far off the body itself would be.

    rms of what was logged less what the same body shows under the voltage and at the times that were logged, over the
    sensor's declared noise: 1 where nothing but that sensor is noisy. No model can be expected to leave less.
    """
    bench = bench or Bench()
    session = Session(np.random.default_rng(seed), truth, effects, bench, replays=[])
    assert session.replays is not None
    out = {}
    for test, series in SIZES[size].items():
        for n, trace in enumerate(PROTOCOLS[test](session, series)):
            shown = session.replays.pop() if session.replays else {}
            for header, true in shown.items() if n >= series.count - series.held else ():
                sensor = bench.sensors[quantity(header)]
                miss = trace.columns[header] / UNITS[unit(header)][0] - true
                out[trace.file, sensor.quantity] = float(np.sqrt(np.mean(miss**2))) / sensor.declared
    return out


def write_folder(
    path: Path,
    name: str,
    truth: Truth,
    seed: int,
    effects: Effects,
    sizes: dict[str, Series],
    bench: Bench,
    *,
    holdout: bool,
    noise: bool,
) -> None:
    """rig.toml and one CSV a trace; says nowhere what the truth is."""
    session = Session(np.random.default_rng(seed), truth, effects, bench)
    path.mkdir(parents=True, exist_ok=True)
    held = []
    for test, series in sizes.items():
        (path / test).mkdir(exist_ok=True)
        traces = list(PROTOCOLS[test](session, series))
        for trace in traces:
            write_trace(path, trace, seed)
        held = [trace.file for trace in traces[series.count - series.held :]] + held
    text = rig_toml(name, truth.N, bench, held if holdout else [], noise=noise)
    (path / "rig.toml").write_text(text, encoding="utf-8", newline="\n")


def write_trace(path: Path, trace: Trace, seed: int) -> None:
    """The CSV, each column with its unit's decimals."""
    row = ",".join(f"%.{UNITS[unit(header)][1]}f" for header in trace.columns)
    rows = np.column_stack(list(trace.columns.values())) + 0.0  # no negative zeros
    body = "\n".join([row] * len(rows)) % tuple(rows.ravel())
    text = f"# SYNTHETIC: made by independent, seed {seed}\n{','.join(trace.columns)}\n{body}\n"
    (path / trace.file).write_text(text, encoding="utf-8", newline="\n")


def rig_toml(name: str, gear_ratio: float, bench: Bench, holdout: list[str], *, noise: bool) -> str:
    """The nameplate; a declared noise is the sensor's own and its ADC's."""
    declared = [f"{s.quantity}_{s.unit} = {s.declared:.6g}" for s in bench.sensors.values()]
    parts = [
        "# SYNTHETIC: made by independent",
        f'[rig]\nname = "{name}"\nsynthetic = true\ngear_ratio = {gear_ratio}\nsupply_V = {bench.supply}',
        "travel_deg = [0.0, 90.0]\n",
        f"[tps]\nclosed_V = {CLOSED_V}\nopen_V = {OPEN_V}\ntravel_deg = 90.0\n",
        *(["[noise]", *declared, ""] if noise else []),
        '[tests.inductance]\nseries_ohm = "free"\n',
        *([f"[holdout]\nfiles = {json.dumps(holdout)}\n"] if holdout else []),
    ]
    return "\n".join(parts)
