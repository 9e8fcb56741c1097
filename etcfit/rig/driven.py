"""What a driven plate tells: the inverse model on torque, on current, or at a nominal scale on voltage."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..model.paper import TABLE_2
from .base import Channel, Fixed, Graph, Measurement, Reading, RigConfig, Start
from .inverse_model import LUMPED, Equations, equations, filter_for, held_values, solve
from .signals import drive_voltage

NOMINAL = {symbol: TABLE_2[symbol] for symbol in ("R_a", "K_b", "N")}  # the scale where the data have none
LOWEST_SHARE = 0.02  # of the whole: where a part that must be positive is put when it reads negative
FEWEST_POSITIONS = 50
FEWEST_ROWS = 20  # of a trace, for six unknowns at most


@dataclass(frozen=True)
class Scale:
    """Motor constants that turn volts into torque at the plate; `nominal` names those not known from the data."""

    R_a: float
    K_b: float
    N: float
    nominal: tuple[str, ...] = ()

    @property
    def torque_per_volt(self) -> float:
        """N K_m/R_a, N m/V."""
        return self.N * self.K_b / self.R_a


def read(title: str, traces: Sequence[Measurement], config: RigConfig, known: Mapping[str, float]) -> Reading:
    """Inverse-model reading with the best right-hand side that was logged: torque, else current, else voltage."""
    placed = [t for t in traces if "position" in t.channels and len(t.channels["position"].time) > FEWEST_POSITIONS]
    for kind in (_by_torque, _by_current, _by_voltage):
        reading = kind(title, placed, config, known)
        if reading is not None:
            return reading
    return Reading({}, notes=("nothing can be read: no trace has a drive and a plate that moves off its stops",))


def _by_torque(
    title: str, traces: Sequence[Measurement], config: RigConfig, known: Mapping[str, float]
) -> Reading | None:
    used, systems = _rows(traces, lambda t: t.channels.get("torque"), config)
    if not used:
        return None
    lumped = solve(systems, held_values(config, known["N"]))
    return _reading(title, used, systems, lumped, config, {"J_m": 0.0, "B_m": 0.0, **known})


def _by_current(
    title: str, traces: Sequence[Measurement], config: RigConfig, known: Mapping[str, float]
) -> Reading | None:
    used, systems = _rows(traces, lambda t: t.channels.get("current"), config)
    if not used or "K_m" not in known:
        return None
    systems = [_scaled(s, known["N"] * known["K_m"]) for s in systems]
    return _reading(title, used, systems, solve(systems, held_values(config, known["N"])), config, known)


def _by_voltage(
    title: str, traces: Sequence[Measurement], config: RigConfig, known: Mapping[str, float]
) -> Reading | None:
    """v = R_a/(N K_m) (J a + B w + K_s theta + T_PL + T_f sgn w + T_g sin theta) + N K_b w; inductance neglected."""
    used, systems = _rows(traces, lambda t: drive_voltage(t, config), config)
    if not used:
        return None
    nothing = {symbol: 0.0 for symbol, value in held_values(config, known["N"]).items() if value == 0}
    volts = solve(systems, nothing)
    notes = []
    if volts[1] < 0:
        notes.append("drive and position run against each other: read with the drive's sign turned")
        systems, volts = [_scaled(s, -1.0) for s in systems], -volts
    scale = _scale(config, known, dict(zip(LUMPED, volts.tolist(), strict=True)))
    back = scale.torque_per_volt * scale.N * scale.K_b  # N m s/rad: what the back-EMF brakes
    held = held_values(config, scale.N)
    held |= {"B_eq": held["B_eq"] + back} if "B_eq" in held else {}
    systems = [_scaled(s, scale.torque_per_volt) for s in systems]
    lumped = solve(systems, held)
    plain = lumped - back * (np.array(LUMPED) == "B_eq")
    reading = _reading(title, used, systems, plain, config, known, shown=lumped)
    return _at_scale(reading, scale, notes)


def _rows(
    traces: Sequence[Measurement], right: Callable[[Measurement], Channel | None], config: RigConfig
) -> tuple[list[Measurement], list[Equations]]:
    """Traces that have this right-hand side and enough motion, and their equations."""
    made = [(t, equations(t, channel, config=config)) for t in traces if (channel := right(t)) is not None]
    enough = [(t, s) for t, s in made if len(s.time) >= FEWEST_ROWS and np.any(s.right)]
    return [t for t, _ in enough], [s for _, s in enough]


def _scaled(system: Equations, factor: float) -> Equations:
    return Equations(system.time, system.rows, factor * system.right)


def _scale(config: RigConfig, known: Mapping[str, float], volts: Mapping[str, float]) -> Scale:
    """Known motor constants, else nominal ones.

    `volts` are `LUMPED` seen by the voltage: its B_eq (V s/rad) bounds N K_b from above, so that B stays positive, and
    a gravity torque given in rig.toml fixes N K_m/R_a.
    """
    N, drag, gravity = known["N"], volts["B_eq"], volts["T_g"]
    assumed = tuple(s for s in ("R_a", "K_b") if s not in known or _nameplate(s, config, known))
    R_a = known.get("R_a", NOMINAL["R_a"])
    K_b = known.get("K_b", NOMINAL["K_b"] * (1.0 if config.gear_ratio_given else NOMINAL["N"] / N))
    if "K_b" in assumed and drag > 0:
        K_b = min(K_b, 0.8 * drag / N)
    if "R_a" in assumed and known.get("T_g", 0.0) * gravity > 0:
        R_a = N * K_b * gravity / known["T_g"]
    return Scale(R_a, K_b, N, assumed)


def _nameplate(symbol: str, config: RigConfig, known: Mapping[str, float]) -> bool:
    given = config.parameters.get(symbol)
    return isinstance(given, Start) and given.value == known[symbol]


def _at_scale(reading: Reading, scale: Scale, notes: Sequence[str]) -> Reading:
    """The reading with its nominal motor constants among the values, named as such."""
    if not scale.nominal:
        return replace(reading, notes=(*notes, *reading.notes))
    constants = {"R_a": scale.R_a, "K_b": scale.K_b}
    values = {**reading.values, **{s: constants[s] for s in scale.nominal}}
    word = ", ".join(f"{s} = {constants[s]:.4g}" for s in scale.nominal)
    note = f"scale from nominal {word} (SI): without a current only ratios of torques can be read"
    return replace(reading, values=values, notes=(*notes, note, *reading.notes), nominal=tuple(values))


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
        notes.append(f"T_f read as {values['T_f']:.3g} N m, put at 0.001")
        values["T_f"] = 1e-3
    assumed = _split("J", values, config, known, notes) + _split("B", values, config, known, notes)
    line = lumped if shown is None else shown
    graphs = tuple(_graph(title, t, s, line) for t, s in zip(traces[:6], systems, strict=False))
    notes += [f"{t.file}: {filter_for(t.channels['position'])}; relative error {100 * s.error(line):.4g} %"
              for t, s in zip(traces, systems, strict=True)]  # fmt: skip
    return Reading(values, graphs, tuple(notes), nominal=assumed)


def _split(
    letter: str, values: dict[str, float], config: RigConfig, known: Mapping[str, float], notes: list[str]
) -> tuple[str, ...]:
    """whole = N^2 motor + load, J or B: the load from a known motor; half and half where neither is; those assumed."""
    whole_name, motor, load = f"{letter}_eq", f"{letter}_m", f"{letter}_L"
    if whole_name not in values:
        return ()
    whole, gear = values[whole_name], known["N"] ** 2
    if whole <= 0:
        notes.append(f"{whole_name} cannot be read: it comes out as {whole:.3g}")
        del values[whole_name]
        return ()
    if motor in known:
        values[load] = _at_least(whole - gear * known[motor], LOWEST_SHARE * whole, load, notes)
        return ()
    if isinstance(config.parameters.get(load), Fixed):
        values[motor] = _at_least(whole - known[load], LOWEST_SHARE * whole, motor, notes) / gear
        return ()
    notes.append(f"{whole_name} = N^2 {motor} + {load} only is read; half of it is given to each")
    values[motor], values[load] = whole / 2 / gear, whole / 2
    return motor, load


def _at_least(value: float, floor: float, symbol: str, notes: list[str]) -> float:
    if value < floor:
        notes.append(f"{symbol} read as {value:.3g}, put at {floor:.3g}")
    return max(value, floor)


def _graph(title: str, trace: Measurement, system: Equations, lumped: np.ndarray) -> Graph:
    says = f"inverse model, relative error {100 * system.error(lumped):.3g} %"
    return Graph(f"{title}, {trace.file}", "time [s]", "torque at the plate [N m]", system.time, system.right,
                 system.time, system.rows @ lumped, says)  # fmt: skip
