"""The paper's six rig tests and driven responses, as an operator runs them on the truth at hand."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from .bridge import duty_of, fed
from .drives import Drive, chirp, line, multisine, random_steps, steps, trapezoids
from .effects import Effects
from .instruments import UNITS, Bench, CurrentChannel, clock, current_channel, true_values
from .kernel import Plant
from .simulate import NEVER, REHEARSAL, motor_alone, resting_angle, simulate, terminals_open, throttle
from .truth import OPEN, Truth

GRACE = 0.01  # s that a drive outlasts its log
CREEP = 1e-3  # rad/s; a plate on bristles that is slower has come to rest


@dataclass(frozen=True)
class Series:
    """How many traces of one rig test, how long (s, at least), at what sample rate (Hz); the last `held` held out."""

    count: int
    duration: float
    rate: float
    held: int = 0


@dataclass(frozen=True)
class Trace:
    """One CSV: file relative to the folder, columns by header (in the unit the header names)."""

    file: str
    columns: dict[str, np.ndarray]


@dataclass
class Stopwatch:
    """What has been logged so far, s."""

    seconds: float = 0.0


@dataclass(frozen=True)
class Session:
    """One throttle body on one bench."""

    rng: np.random.Generator  # of all that is random
    # truth, effects: the body
    truth: Truth
    effects: Effects
    bench: Bench  # the instruments
    stopwatch: Stopwatch = field(default_factory=Stopwatch)  # what has been logged so far
    # where a list, each trace adds what the same body shows, without noise, under the voltage and at the times that its
    # log has; by header, each in its sensor's unit
    replays: list[dict[str, np.ndarray]] | None = None

    def record(
        self,
        plant: Plant,
        drive: Drive,
        series: Series,
        headers: tuple[str, ...],
        *,
        angle: float = 0.0,
        held_until: float = 0.0,
    ) -> dict[str, np.ndarray]:
        """What the logger writes while the drive acts on the plant; headers as in `current [mA]`, time first."""
        place = self.bench.edge_place(series.rate)
        if place is not None:
            drive = drive.in_step(series.rate, place)
        drive = drive.slewed(self.bench.rise).limited(self.bench.supply)
        ticks = clock(self.rng, self.bench, series.rate, series.duration)
        plant, channel = self.aged(plant), current_channel(self.rng.spawn(1)[0], plant.effects)
        shown = partial(_shown, plant, channel, headers[1:], angle, held_until)
        columns = {headers[0]: ticks.logged * UNITS[unit(headers[0])][0]}
        for header, true in shown(drive, ticks.true).items():
            columns[header] = self.bench.sensors[quantity(header)].read(self.rng, true) * UNITS[unit(header)][0]
        if self.replays is not None and "voltage [V]" in columns:
            logged = Drive(ticks.logged, columns["voltage [V]"]).after(0.0, ticks.logged[-1] + GRACE)
            self.replays.append(shown(logged, ticks.logged))
        self.stopwatch.seconds += series.duration
        return columns

    def aged(self, plant: Plant) -> Plant:
        """The plant with the session's seconds behind it."""
        aging = ("friction_drift", "friction_tide", "supply_cycling")
        aged = {name: getattr(plant.effects, name)._replace(before=self.stopwatch.seconds) for name in aging}
        return plant._replace(effects=plant.effects._replace(**aged))


def resistance(session: Session, series: Series) -> Iterator[Trace]:
    """Plate held, the supply on since long: 0.3 to 3.4 V."""
    plant = throttle(session.truth, session.effects)
    headers = ("time [s]", "voltage [V]", "current [A]")
    for n, volts in enumerate(np.linspace(0.3, 3.4, series.count), 1):
        lead = 30 * plant.L / plant.R  # so long that nothing is left of the transient
        ticking = Drive(np.array([-lead, series.duration + GRACE]), np.full(2, volts))
        columns = session.record(plant, ticking, series, headers, held_until=NEVER)
        yield Trace(f"resistance/volts_{n}.csv", columns)


def inductance(session: Session, series: Series) -> Iterator[Trace]:
    """Plate held, a jump to about 1 V through harness and shunt."""
    plant = throttle(session.truth, session.effects, session.bench.series_ohm)
    headers = ("time [ms]", "voltage [V]", "current [mA]")
    for n in range(1, series.count + 1):
        jump = steps(np.array([series.duration]), np.array([session.rng.uniform(0.95, 1.05)]))
        drive = jump.after(session.rng.uniform(0.05, 0.15) * series.duration, 2 * series.duration)
        yield Trace(f"inductance/step_{n}.csv", session.record(plant, drive, series, headers, held_until=NEVER))


def back_emf(session: Session, series: Series) -> Iterator[Trace]:
    """Terminals open, the plate let go from open."""
    return _releases(session, series, "back_emf", ("time [s]", "emf [V]", "tps [V]"))


def inertia(session: Session, series: Series) -> Iterator[Trace]:
    """As back_emf, logged by another instrument."""
    return _releases(session, series, "inertia", ("time [ms]", "emf [mV]", "tps [V]"))


def static_load(session: Session, series: Series) -> Iterator[Trace]:
    """A slow ramp up until the plate is open, a breath, down again, and a wait for the plate to close."""
    plant, rest = throttle(session.truth, session.effects), resting_angle(session.truth, session.effects)
    peak = _opening_voltage(session, plant, rest)
    longer = Series(series.count, series.duration + _fall_time(plant), series.rate)
    headers = ("time [s]", "voltage [V]", "current [A]", "tps [V]")
    for n in range(1, series.count + 1):
        quiet = session.rng.uniform(0.1, 0.3)
        span = series.duration - quiet - 0.2
        ramp = line([0.0, 0.48 * span, 0.52 * span, span], [0.0, peak, peak, 0.0])
        drive = ramp.after(quiet, longer.duration + GRACE)
        yield Trace(f"static_load/ramp_{n}.csv", session.record(plant, drive, longer, headers, angle=rest))


def viscous(session: Session, series: Series) -> Iterator[Trace]:
    """Gear apart, the motor run up by a jump of 2 to 12 V and left to reach its speed."""
    plant = motor_alone(session.truth, session.effects)
    run_up = plant.J / (plant.B + plant.k * plant.k_t / plant.R)
    longer = Series(series.count, max(series.duration, 5 * run_up), series.rate)
    headers = ("time [s]", "voltage [V]", "current [A]", "motor_speed [rpm]")
    for n, volts in enumerate(np.linspace(2.0, 12.0, series.count), 1):
        drive = steps(np.array([longer.duration]), np.array([volts]))
        drive = drive.after(session.rng.uniform(0.02, 0.1), longer.duration + GRACE)
        yield Trace(f"viscous/volts_{n}.csv", session.record(plant, drive, longer, headers))


def response(session: Session, series: Series) -> Iterator[Trace]:
    """Random steps, multisine, chirp, trapezoids in turn, about the voltage that balances the spring."""
    plant, rest = throttle(session.truth, session.effects), resting_angle(session.truth, session.effects)
    headers = ("time [s]", "voltage [V]", "current [mA]", "tps [V]")
    for n in range(series.count):
        quiet = session.rng.uniform(0.02, 0.1)
        drive = _driven(session, n, series.duration - quiet).after(quiet, series.duration + GRACE)
        if session.bench.supply_ohm is None:
            columns = session.record(plant, drive, series, headers, angle=rest)
        else:
            columns = _by_duty(session, plant, drive, series, rest)
        yield Trace(f"response/drive_{n + 1}.csv", columns)


def _by_duty(session: Session, plant: Plant, drive: Drive, series: Series, rest: float) -> dict[str, np.ndarray]:
    """The response to a bridge whose duty is logged, and neither its supply nor the voltage at the motor."""
    bench, count = session.bench, math.ceil((series.duration + GRACE) * series.rate)
    duty = duty_of(drive, series.rate, count, bench.supply)
    applied = fed(plant, duty, series.rate, bench.supply, bench.supply_ohm or 0.0, rest)
    shown = session.record(plant, applied, series, ("time [s]", "current [mA]", "tps [V]"), angle=rest)
    time = shown.pop("time [s]")
    return {"time [s]": time, "duty [%]": 100.0 * duty[: time.size], **shown}


PROTOCOLS: dict[str, Callable[[Session, Series], Iterator[Trace]]] = {
    protocol.__name__: protocol
    for protocol in (resistance, inductance, back_emf, static_load, viscous, inertia, response)
}


def _shown(
    plant: Plant,
    channel: CurrentChannel,
    headers: tuple[str, ...],
    angle: float,
    held_until: float,
    drive: Drive,
    instants: np.ndarray,
) -> dict[str, np.ndarray]:
    """What noiseless sensors read at the instants, by header, each in its sensor's unit."""
    motion = simulate(plant, drive, instants, angle=angle, held_until=held_until)
    if channel.late > 0.0:
        earlier = channel.instants(instants, drive.time[0])
        late = simulate(plant, drive, earlier, angle=angle, held_until=held_until)
        motion = replace(motion, current=late.current)
    motion = replace(motion, current=motion.current + channel.offset)
    return {header: true_values(quantity(header), motion, plant.k, plant.N, plant.effects) for header in headers}


def quantity(header: str) -> str:
    return header.partition(" ")[0]


def unit(header: str) -> str:
    return header[header.index("[") + 1 : -1]


def _releases(session: Session, series: Series, test: str, headers: tuple[str, ...]) -> Iterator[Trace]:
    plant = terminals_open(session.truth, session.effects)
    fall = _fall_time(plant)
    for n in range(1, series.count + 1):
        let_go = session.rng.uniform(0.02, 0.1)
        longer = Series(series.count, max(series.duration, let_go + fall + 0.1), series.rate)
        still = Drive(np.array([0.0, longer.duration + GRACE]), np.zeros(2))
        columns = session.record(plant, still, longer, headers, angle=OPEN, held_until=let_go)
        yield Trace(f"{test}/release_{n}.csv", columns)


def _fall_time(plant: Plant, longest: float = 10.0) -> float:
    """How long the plate moves once it is let go from open, at 0 V or with its terminals open; s."""
    time = np.arange(0.0, longest, 1e-3)
    motion = simulate(plant, Drive(np.array([0.0, longest]), np.zeros(2)), time, angle=OPEN, h_max=REHEARSAL)
    creep = CREEP if plant.effects.presliding_friction.angle > 0.0 else 0.0
    return float(time[np.flatnonzero(np.abs(motion.speed) > creep)[-1]])


def _opening_voltage(session: Session, plant: Plant, rest: float, over: float = 1.08) -> float:
    """The voltage at which the operator stops turning up: the plate is open, and a little more; V."""
    truth = session.truth
    volts = truth.volts_for(truth.T_PL + truth.T_f + truth.K_s * OPEN)
    while volts < session.bench.supply:
        ramp = line([0.0, 6.0, 7.0], [0.0, volts, volts])
        end = simulate(plant, ramp, np.array([0.0, 7.0]), angle=rest, h_max=REHEARSAL)
        if end.angle[-1] >= OPEN:
            break
        volts *= 1.05
    return min(over * volts, session.bench.supply)


def _driven(session: Session, n: int, duration: float) -> Drive:
    """About the balance at half travel, by so many times the voltage that overcomes dry friction; V."""
    truth, rng = session.truth, session.rng
    balance = truth.volts_for(truth.T_PL + truth.K_s * OPEN / 2)
    swing = truth.volts_for(truth.T_f) * rng.uniform(0.9, 1.1)
    match n % 4:
        case 0:
            return random_steps(rng, duration, balance, swing)
        case 1:
            return multisine(rng, duration, balance, 3.2 * swing)
        case 2:
            return chirp(duration, balance, 2.4 * swing)
        case _:
            return trapezoids(duration, balance - 1.8 * swing, balance + 1.7 * swing)
