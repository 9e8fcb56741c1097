"""What a plate under an ECU tells where no voltage was logged: the voltage that known gains make, or the gains.

    v = K_p e + K_i int e dt + K_d de/dt + v_0,    e = setpoint - position

Plate read from other tests: v of the inverse model is regressed on those terms whose gains nobody told, and a constant
for each trace. Else v is computed from the log and read as a logged one would be, at nominal gains where none are
known; what the integral held at the begin, v_0, is taken as 0, so that no preload can be read.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..model.ecu import Ecu
from . import driven
from .base import DRIVES, Channel, Fixed, Measurement, Prior, Reading, RigConfig
from .ecu import GAINS
from .inverse_model import LUMPED, Equations, equations, filter_for
from .signals import even_grid, on_times

SYMBOLS = tuple(GAINS.values())
PLATE = ("R_a", "K_b", "K_m", "J_m", "J_L", "B_m", "B_L", "K_s", "T_PL", "T_f")
NOMINAL = {"K_p": 6.0, "K_i": 30.0, "K_d": 0.1}  # of the order of the paper's: a scale where there is none


def read(title: str, traces: Sequence[Measurement], config: RigConfig, known: Mapping[str, float]) -> Reading:
    """Traces with a drive by the inverse model; those without by the gains, or for the gains."""
    own = [t for t in traces if config.ecu is None or set(DRIVES) & set(t.channels)]
    waiting = [t for t in traces if t not in own and {"setpoint", "position"} <= set(t.channels)]
    waiting = [t for t in waiting if len(t.channels["position"].time) > driven.FEWEST_POSITIONS]
    if not waiting or config.ecu is None:
        return driven.read(title, own, config, known)
    told = {s for s in SYMBOLS if isinstance(config.parameters.get(s), (Fixed, Prior))}
    if not {*SYMBOLS} <= told and {*PLATE} <= {*known}:
        return _gains(waiting, config.ecu, config, known, told)
    gains = {s: known.get(s, NOMINAL[s]) for s in SYMBOLS}
    made = [replace(t, channels={**t.channels, "voltage": voltage(t, config.ecu, gains)}) for t in waiting]
    reading = driven.read(title, [*own, *made], config, known)
    values = {symbol: value for symbol, value in reading.values.items() if own or symbol != "T_PL"}
    assumed = [f"{s} = {gains[s]:g}" for s in SYMBOLS if s not in told]
    word = "voltage computed from setpoint, position and the ECU's gains" + (
        f", of which {', '.join(assumed)} (SI) only nominal" if assumed else ""
    )
    return replace(
        reading,
        values=values,
        notes=(word, *reading.notes),
        nominal=tuple(values) if assumed else tuple(s for s in reading.nominal if s in values),
    )


def terms(trace: Measurement, ecu: Ecu) -> tuple[Channel, Channel, Channel]:
    """What K_p, K_i and K_d multiply, as late as it acts: rad, rad s and rad/s, on an even grid."""
    position, setpoint = trace.channels["position"], trace.channels["setpoint"]
    time, step = even_grid(position.time)
    smooth = filter_for(position).position(on_times(position, time))
    error = on_times(setpoint, time) - smooth
    area = np.concatenate(([0.0], np.cumsum(0.5 * (error[1:] + error[:-1])) * step))
    slow = ecu.filter + 0.5 * ecu.period + ecu.late
    parts = ((error, ecu.late), (area, ecu.delay), (np.gradient(error, step), slow))
    p, i, d = (replace(position, time=time, value=np.interp(time - late, time, part)) for part, late in parts)
    return p, i, d


def voltage(trace: Measurement, ecu: Ecu, gains: Mapping[str, float]) -> Channel:
    """What the ECU put out, but for what its integral held at first, V."""
    parts = terms(trace, ecu)
    volts = sum(gains[s] * part.value for s, part in zip(SYMBOLS, parts, strict=True))
    limited = np.clip(volts, -ecu.supply, ecu.supply)
    return replace(parts[0], value=limited, sigma=0.0, header="voltage [V]", unit="V", scale=1.0)


def _gains(
    traces: Sequence[Measurement], ecu: Ecu, config: RigConfig, known: Mapping[str, float], told: set[str]
) -> Reading:
    """Least squares of the inverse model's voltage on the terms whose gains nobody told, within the supply."""
    systems = [_regression(t, ecu, config, known) for t in traces]
    count = sum(len(s.right) for s in systems)
    if count < driven.FEWEST_ROWS:
        return Reading({}, notes=("the plate hardly moves: the ECU's gains cannot be read",))
    rows = np.zeros((count, 3 + len(systems)))
    row = 0
    for k, system in enumerate(systems):
        part = slice(row, row + len(system.right))
        rows[part, :3], rows[part, 3 + k] = system.rows, 1.0
        row += len(system.right)
    right = np.concatenate([s.right for s in systems])
    held = [k for k, s in enumerate(SYMBOLS) if s in told]
    free = [k for k in range(rows.shape[1]) if k not in held]
    right = right - rows[:, held] @ np.array([known[SYMBOLS[k]] for k in held])
    size = np.linalg.norm(rows[:, free], axis=0) + 1e-300
    found = dict(zip(free, np.linalg.lstsq(rows[:, free] / size, right, rcond=1e-10)[0] / size, strict=True))
    values = {s: float(found[k]) for k, s in enumerate(SYMBOLS) if k in found}
    notes = tuple(f"{s} reads {value:.3g}: left out" for s, value in values.items() if value <= 0.0)
    return Reading({s: value for s, value in values.items() if value > 0.0}, notes=notes)


def _regression(trace: Measurement, ecu: Ecu, config: RigConfig, known: Mapping[str, float]) -> Equations:
    """The terms' rows, and the voltage that the plate's motion asks for, all through the inverse model's filters."""
    made = [equations(trace, term, config=config) for term in terms(trace, ecu)]
    gear, inner = known["N"], made[0]
    ohms = known["R_a"] / (gear * known["K_m"])
    lumps = {"J_eq": gear**2 * known["J_m"] + known["J_L"], "B_eq": gear**2 * known["B_m"] + known["B_L"]}
    lumped = np.array([{**known, **lumps}.get(symbol, 0.0) for symbol in LUMPED])
    back = gear * known["K_b"] * (np.array(LUMPED) == "B_eq")
    volts = inner.rows @ (ohms * lumped + back)
    within = np.abs(volts) < 0.9 * ecu.supply
    return Equations(inner.time[within], np.column_stack([m.right for m in made])[within], volts[within])
