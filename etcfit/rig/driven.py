"""Rig tests of a driven plate: parameters from its motion, or from its ECU's gains where no voltage was logged.

The inverse model is fitted to torque, to current, or with a nominal scale to voltage. Under an ECU without a logged
drive:

    v = K_p e + K_i int e dt + K_d de/dt + v_0,    e = setpoint - position

Where other tests give the plate's parameters, v of the inverse model is regressed on the terms whose gains are not
given, and on a constant for each trace. Otherwise v is computed from the log and used like a logged voltage, with
nominal gains where they are unknown; the initial integral v_0 is taken as 0, so the preload cannot be read.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from ..model.ecu import Ecu
from ..model.paper import TABLE_2
from .base import (
    DRIVES,
    AbstractRigTest,
    Boundary,
    Channel,
    Fixed,
    Graph,
    Measurement,
    Prior,
    Reading,
    RigConfig,
    Start,
)
from .ecu import GAINS
from .inverse_model import LUMPED, Equations, equations, filter_for, held_values, solve
from .signals import drive_voltage, even_grid, on_times

MOTION = ("position", "motor_speed", "current", "emf")  # at least one of these channels is required
NOMINAL_SCALE = {symbol: TABLE_2[symbol] for symbol in ("R_a", "K_b", "N")}  # the scale where the data give none
LOWEST_SHARE = 0.02  # share of the whole that a part gets where it must be positive but reads negative
FEWEST_POSITIONS = 50
FEWEST_ROWS = 20  # least number of rows of a trace, for six unknowns at most
SYMBOLS = tuple(GAINS.values())
PLATE = ("R_a", "K_b", "K_m", "J_m", "J_L", "B_m", "B_L", "K_s", "T_PL", "T_f")
NOMINAL_GAINS = {"K_p": 6.0, "K_i": 30.0, "K_d": 0.1}  # of the order of the paper's: a scale where there is none


@dataclass(frozen=True)
class Scale:
    """Motor constants that convert voltage to torque at the plate; `nominal` names those unknown from the data."""

    R_a: float
    K_b: float
    N: float
    nominal: tuple[str, ...] = ()

    @property
    def torque_per_volt(self) -> float:
        """N K_m/R_a, N m/V."""
        return self.N * self.K_b / self.R_a


def read_motion(title: str, traces: Sequence[Measurement], config: RigConfig, known: Mapping[str, float]) -> Reading:
    """Inverse-model reading with the best logged right-hand side: torque, otherwise current, otherwise voltage."""
    placed = [t for t in traces if "position" in t.channels and len(t.channels["position"].time) > FEWEST_POSITIONS]
    held = held_values(config, known["N"])
    used, systems = _rows(placed, lambda t: t.channels.get("torque"), config)
    if used:
        return _reading(title, used, systems, solve(systems, held), config, {"J_m": 0.0, "B_m": 0.0, **known})
    used, systems = _rows(placed, lambda t: t.channels.get("current"), config)
    if used and "K_m" in known:
        systems = [s.scaled(known["N"] * known["K_m"]) for s in systems]
        return _reading(title, used, systems, solve(systems, held), config, known)
    used, systems = _rows(placed, lambda t: drive_voltage(t, config), config)
    if used:
        return _by_voltage(title, used, systems, config, known)
    return Reading({}, notes=("nothing can be read: no trace has a drive and a plate that moves off its stops",))


def _by_voltage(
    title: str, used: Sequence[Measurement], systems: Sequence[Equations], config: RigConfig, known: Mapping[str, float]
) -> Reading:
    """v = R_a/(N K_m) (J a + B w + K_s theta + T_PL + T_f sgn w + T_g sin theta) + N K_b w; inductance neglected."""
    nothing = {symbol: 0.0 for symbol, value in held_values(config, known["N"]).items() if value == 0}
    volts = solve(systems, nothing)
    notes = []
    if volts[1] < 0:
        notes.append("drive and position have opposite signs: read with the drive's sign inverted")
        systems, volts = [s.scaled(-1.0) for s in systems], -volts
    scale = _scale(config, known, dict(zip(LUMPED, volts.tolist(), strict=True)))
    back = scale.torque_per_volt * scale.N * scale.K_b  # N m s/rad: braking by the back-EMF
    held = held_values(config, scale.N)
    held |= {"B_eq": held["B_eq"] + back} if "B_eq" in held else {}
    systems = [s.scaled(scale.torque_per_volt) for s in systems]
    lumped = solve(systems, held)
    plain = lumped - back * (np.array(LUMPED) == "B_eq")
    reading = _reading(title, used, systems, plain, config, known, shown=lumped)
    if not scale.nominal:
        return replace(reading, notes=(*notes, *reading.notes))
    # the values include the nominal motor constants, marked as nominal
    constants = {s: getattr(scale, s) for s in scale.nominal}
    word = ", ".join(f"{s} = {value:.4g}" for s, value in constants.items())
    note = f"scale from nominal {word} (SI): without a current only ratios of torques can be read"
    values = {**reading.values, **constants}
    return replace(reading, values=values, notes=(*notes, note, *reading.notes), nominal=tuple(values))


def _rows(
    traces: Sequence[Measurement], right: Callable[[Measurement], Channel | None], config: RigConfig
) -> tuple[list[Measurement], list[Equations]]:
    """The traces with this right-hand side and enough motion, and their equations."""
    made = [(t, equations(t, channel, config)) for t in traces if (channel := right(t)) is not None]
    enough = [(t, s) for t, s in made if len(s.time) >= FEWEST_ROWS and np.any(s.right)]
    return [t for t, _ in enough], [s for _, s in enough]


def _scale(config: RigConfig, known: Mapping[str, float], volts: Mapping[str, float]) -> Scale:
    """Known motor constants, otherwise nominal ones.

    `volts` are the `LUMPED` coefficients of the voltage equation: its B_eq (V s/rad) is an upper bound of N K_b,
    because B is positive, and a gravity torque given in rig.toml determines N K_m/R_a.
    """
    N, drag, gravity = known["N"], volts["B_eq"], volts["T_g"]

    def is_nameplate(symbol: str) -> bool:
        given = config.parameters.get(symbol)
        return isinstance(given, Start) and given.value == known[symbol]

    assumed = tuple(s for s in ("R_a", "K_b") if s not in known or is_nameplate(s))
    R_a = known.get("R_a", NOMINAL_SCALE["R_a"])
    K_b = known.get("K_b", NOMINAL_SCALE["K_b"] * (1.0 if config.gear_ratio_given else NOMINAL_SCALE["N"] / N))
    if "K_b" in assumed and drag > 0:
        K_b = min(K_b, 0.8 * drag / N)
    if "R_a" in assumed and known.get("T_g", 0.0) * gravity > 0:
        R_a = N * K_b * gravity / known["T_g"]
    return Scale(R_a, K_b, N, assumed)


def _reading(
    title: str,
    traces: Sequence[Measurement],
    systems: Sequence[Equations],
    lumped: np.ndarray,
    config: RigConfig,
    known: Mapping[str, float],
    shown: np.ndarray | None = None,
) -> Reading:
    """Values, pictures and notes; `shown` are the coefficients of the plotted side where they differ from `lumped`."""
    held = held_values(config, known["N"])
    values = {symbol: float(v) for symbol, v in zip(LUMPED, lumped, strict=True) if symbol not in held}
    notes: list[str] = []
    if values.get("T_f", 1.0) <= 0:
        notes.append(f"T_f reads {values['T_f']:.3g} N m; it is set to 0.001")
        values["T_f"] = 1e-3
    assumed = _split("J", values, config, known, notes) + _split("B", values, config, known, notes)
    line = lumped if shown is None else shown
    graphs = tuple(
        Graph(f"{title}, {t.file}", "time [s]", "torque at the plate [N m]", s.time, s.right, s.time, s.rows @ line,
              f"inverse model, relative error {100 * s.error(line):.3g} %")
        for t, s in zip(traces[:6], systems, strict=False)
    )  # fmt: skip
    notes += [f"{t.file}: {filter_for(t.channels['position'])}; relative error {100 * s.error(line):.4g} %"
              for t, s in zip(traces, systems, strict=True)]  # fmt: skip
    return Reading(values, graphs, tuple(notes), nominal=assumed)


def _split(
    letter: str, values: dict[str, float], config: RigConfig, known: Mapping[str, float], notes: list[str]
) -> tuple[str, ...]:
    """whole = N^2 motor + load, J or B: the load from a known motor; half each where neither is known; and the assumed
    symbols."""
    whole_name, motor, load = f"{letter}_eq", f"{letter}_m", f"{letter}_L"
    if whole_name not in values:
        return ()
    whole, gear = values[whole_name], known["N"] ** 2
    if whole <= 0:
        notes.append(f"{whole_name} cannot be read: its value would be {whole:.3g}")
        del values[whole_name]
        return ()
    if motor in known:
        values[load] = _at_least(whole - gear * known[motor], LOWEST_SHARE * whole, load, notes)
        return ()
    if load in config.fixed:
        values[motor] = _at_least(whole - known[load], LOWEST_SHARE * whole, motor, notes) / gear
        return ()
    notes.append(f"only {whole_name} = N^2 {motor} + {load} is read; half of it is assigned to each")
    values[motor], values[load] = whole / 2 / gear, whole / 2
    return motor, load


def _at_least(value: float, floor: float, symbol: str, notes: list[str]) -> float:
    if value < floor:
        notes.append(f"{symbol} reads {value:.3g}; it is set to {floor:.3g}")
    return max(value, floor)


def read_driven(title: str, traces: Sequence[Measurement], config: RigConfig, known: Mapping[str, float]) -> Reading:
    """Read traces with a drive by the inverse model, and traces without one with the ECU's gains, or for these
    gains."""
    own = [t for t in traces if config.ecu is None or set(DRIVES) & set(t.channels)]
    waiting = [t for t in traces if t not in own and {"setpoint", "position"} <= set(t.channels)]
    waiting = [t for t in waiting if len(t.channels["position"].time) > FEWEST_POSITIONS]
    if not waiting or config.ecu is None:
        return read_motion(title, own, config, known)
    given = {s for s in SYMBOLS if isinstance(config.parameters.get(s), (Fixed, Prior))}
    if not {*SYMBOLS} <= given and {*PLATE} <= {*known}:
        return _gains(waiting, config.ecu, config, known, given)
    gains = {s: known.get(s, NOMINAL_GAINS[s]) for s in SYMBOLS}
    made = [replace(t, channels={**t.channels, "voltage": voltage(t, config.ecu, gains)}) for t in waiting]
    reading = read_motion(title, [*own, *made], config, known)
    values = {symbol: value for symbol, value in reading.values.items() if own or symbol != "T_PL"}
    assumed = [f"{s} = {gains[s]:g}" for s in SYMBOLS if s not in given]
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
    """The terms that K_p, K_i and K_d multiply, with the delay of their action: rad, rad s and rad/s, on an even
    grid."""
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
    """Output voltage of the ECU without the initial value of its integral, V."""
    parts = terms(trace, ecu)
    volts = sum(gains[s] * part.value for s, part in zip(SYMBOLS, parts, strict=True))
    limited = np.clip(volts, -ecu.limit, ecu.limit)
    return replace(parts[0], value=limited, sigma=0.0, header="voltage [V]", unit="V", scale=1.0)


def _gains(
    traces: Sequence[Measurement], ecu: Ecu, config: RigConfig, known: Mapping[str, float], given: set[str]
) -> Reading:
    """Least squares of the inverse model's voltage on the terms whose gains are not given, within the supply."""
    systems = [_regression(t, ecu, config, known) for t in traces]
    count = sum(len(s.right) for s in systems)
    if count < FEWEST_ROWS:
        return Reading({}, notes=("the plate hardly moves: the ECU's gains cannot be read",))
    rows = np.zeros((count, 3 + len(systems)))
    row = 0
    for k, system in enumerate(systems):
        part = slice(row, row + len(system.right))
        rows[part, :3], rows[part, 3 + k] = system.rows, 1.0
        row += len(system.right)
    right = np.concatenate([s.right for s in systems])
    held = [k for k, s in enumerate(SYMBOLS) if s in given]
    free = [k for k in range(rows.shape[1]) if k not in held]
    right = right - rows[:, held] @ np.array([known[SYMBOLS[k]] for k in held])
    size = np.linalg.norm(rows[:, free], axis=0) + 1e-300
    found = dict(zip(free, np.linalg.lstsq(rows[:, free] / size, right, rcond=1e-10)[0] / size, strict=True))
    values = {s: float(found[k]) for k, s in enumerate(SYMBOLS) if k in found}
    notes = tuple(f"{s} reads {value:.3g}: left out" for s, value in values.items() if value <= 0.0)
    return Reading({s: value for s, value in values.items() if value > 0.0}, notes=notes)


def _regression(trace: Measurement, ecu: Ecu, config: RigConfig, known: Mapping[str, float]) -> Equations:
    """The rows of the terms, and the voltage that the plate's motion needs, all filtered as in the inverse model."""
    made = [equations(trace, term, config) for term in terms(trace, ecu)]
    gear, inner = known["N"], made[0]
    ohms = known["R_a"] / (gear * known["K_m"])
    lumps = {"J_eq": gear**2 * known["J_m"] + known["J_L"], "B_eq": gear**2 * known["B_m"] + known["B_L"]}
    lumped = np.array([{**known, **lumps}.get(symbol, 0.0) for symbol in LUMPED])
    back = gear * known["K_b"] * (np.array(LUMPED) == "B_eq")
    volts = inner.rows @ (ohms * lumped + back)
    within = np.abs(volts) < 0.9 * ecu.limit
    return Equations(inner.time[within], np.column_stack([m.right for m in made])[within], volts[within])


class AbstractDriven(AbstractRigTest):
    """The complete throttle, driven by any logged voltage, duty or torque, or by its ECU.

    A trace without a logged drive is simulated with the ECU of [ecu]; without [ecu] it is not fitted.
    """

    boundary = Boundary()
    observes = ("current", "position", "motor_speed", "emf")

    def reading(self, traces: Sequence[Measurement], config: RigConfig, known: Mapping[str, float]) -> Reading:
        """The inverse model on every trace whose voltage is known, or the gains of the ECU that drives it."""
        return read_driven(self.title, traces, config, known)


@final
class Response(AbstractDriven):
    """Eqs. 1-2 under a logged drive."""

    name = "response"
    title = "Driven response"
    needs = (DRIVES, MOTION)


@final
class ClosedLoop(AbstractDriven):
    """An ECU follows a setpoint on the bench."""

    name = "closed_loop"
    title = "Closed loop on the bench"
    needs = (MOTION,)


@final
class Sine(AbstractDriven):
    """An ECU follows a sine setpoint, one file a frequency."""

    name = "sine"
    title = "Sine setpoints"
    needs = (MOTION,)


@final
class Drive(AbstractDriven):
    """A log from the car."""

    name = "drive"
    title = "Log from the car"
    needs = (MOTION,)
