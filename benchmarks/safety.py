"""Figures of safety against the independent simulation of the same rigs, each computed here in a way of its own.

    python -m benchmarks.safety --rigs 10 --first-seed 7650

Rigs as in `pid_rules`, our model with the truth's parameters, but for its own form of limp-home corner and Stribeck
curve; rusEFI's controller with gains of the rule `simc`, a filter of 1 ms ahead of its converter, a tick of delay and
no noise, which would be another sequence in each program. Printed is by how much our figures miss the generator's.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise, product
from typing import Any, NamedTuple

import numpy as np

from etcfit.backend import use_compilation_cache
from etcfit.control.pid import RULES, Gains, Requirements, Task
from etcfit.control.pid.conditions import course
from etcfit.control.pid.loop import Body, Loop
from etcfit.control.safety import Safety, safety
from etcfit.control.safety.faults import FAILS_AT, WATCHED
from etcfit.control.safety.unpowered import FALLS, RETURNED
from etcfit.control.settings import ConditionSettings, DesignSettings
from etcfit.model.linear import TransferFunction
from etcfit.model.throttle import Throttle
from independent.control import Computer, failing
from independent.drives import Drive
from independent.effects import PositionSensorLag
from independent.kernel import record, restoring_torque
from independent.simulate import simulate, terminals_open
from independent.simulate import throttle as independent_throttle

from .on_the_ecu import ecu
from .pid_rules import TRAVEL, TYPES, Drawn, draw

BENCH = ConditionSettings(supply=(12.0, 12.0), winding=(23.0, 23.0), friction=(1.0, 1.0))
_COPPER, _COLD = 0.00393, 23.0


class Off(NamedTuple):
    """By how much our figures miss the generator's at most.

    Args:
        envelope_s: longest time above each threshold from 2 % of the travel up.
        opens_pct: widest opening in any fault of the sensor, of the travel.
        tells_s: until a check tells, of faults that are there at once.
        creeps_s: likewise of a frozen sensor: until the integral has torn the plate loose and two sensors differ.
        sag_pct: how far a sag lets the plate fall and overshoot, of the travel.
        returns_s: time of the spring's return, open terminals.
        shorted_s: likewise on shorted ones, where a plate may creep at the end.
        rests_pct: where the plate then rests, of the travel.
        holding_pct: holding current 5 % of the travel and more above the limp-home position, of itself.
        disagreements: checks that tell in one program and not in the other.
    """

    envelope_s: float
    opens_pct: float
    tells_s: float
    creeps_s: float
    sag_pct: float
    returns_s: float
    shorted_s: float
    rests_pct: float
    holding_pct: float
    disagreements: int


def supposed(rig: Drawn, conditions: ConditionSettings) -> Task:
    """What our figures are made from: a single model, the true parameters."""
    own = ecu()._replace(noise=0.0)
    throttles = Throttle.build(TYPES, {s: np.array([v]) for s, v in rig.values.items()})
    loop = Loop(throttles, Body(rig.truth.N, 0.0, TRAVEL), own)
    rows = loop.linear()
    plant = TransferFunction(*(float(np.asarray(v)[0, 0]) for v in (rows.b0, rows.a2, rows.a1, rows.a0)))
    settings = DesignSettings(conditions=conditions)
    return Task(plant, own, Requirements(), loop, course(loop, settings.scenarios), settings=settings)


@dataclass(frozen=True)
class There:
    """The generator's plant under some condition, and its computer."""

    rig: Drawn
    task: Task
    gains: Gains
    winding: float = _COLD
    friction: float = 1.0

    @property
    def truth(self) -> Any:
        t = self.rig.truth
        return replace(t, R_a=t.R_a * (1.0 + _COPPER * (self.winding - _COLD)), T_f=t.T_f * self.friction)

    @property
    def effects(self) -> Any:
        stribeck = self.rig.stribeck._replace(excess=self.rig.stribeck.excess * self.friction)
        lag = PositionSensorLag(self.task.ecu.lag)
        return self.rig.effects._replace(stribeck_friction=stribeck, position_sensor_lag=lag)

    @property
    def computer(self) -> Computer:
        own = self.task.ecu
        return Computer(*(float(g) for g in self.gains), period=own.period, supply=own.duty * own.supply,
                        hold=own.integral * own.supply, filter=own.filter, delay=own.delay,
                        grain=own.resolution)  # fmt: skip

    def run(self, wanted: np.ndarray, shift: np.ndarray, shown: np.ndarray, feed: np.ndarray) -> np.ndarray:
        """Angle at each sample, rad."""
        plant = independent_throttle(self.truth, self.effects)
        return failing(plant, self.computer, wanted, shift, shown, feed)

    def read(self, angle: np.ndarray) -> np.ndarray:
        """What the computer reads of a sound sensor: a lag of first order, straight between ticks."""
        steps = self.task.ecu.period / self.task.ecu.lag
        out = [angle[0]]
        for before, now in pairwise(angle):
            behind = (now - before) / steps
            out.append(now - behind + (out[-1] - before + behind) * math.exp(-steps))
        return np.array(out)


def compare(seed: int) -> Off:
    """One rig."""
    rig = draw(seed)
    task = supposed(rig, ConditionSettings())
    gains = RULES["simc"](task)
    assert isinstance(gains, Gains)
    ours = safety(task, gains)
    sound = safety(supposed(rig, BENCH), gains)
    places = [There(rig, task, gains)]
    places += [There(rig, task, gains, *each) for each in product((-20.0, 130.0), (0.5, 1.5))]
    opens, tells, apart = zip(*_sensors(ours, places), strict=True)
    frozen = len(task.settings.safety.frozen)
    return Off(
        _envelope(sound, places[0]),
        max(opens),
        max(tells[frozen:]),
        max(tells[:frozen]),
        max(_sags(ours, places)),
        *_returns(ours, places),
        _holding(ours, places[0]),
        sum(apart),
    )


def _longest(off: np.ndarray, period: float) -> float:
    best = run = 0
    for beyond in off:
        run = run + 1 if beyond else 0
        best = max(best, run)
    return best * period


def _envelope(ours: Safety, place: There) -> float:
    setpoint, period = place.task.setpoint, place.task.ecu.period
    time = setpoint.instants(period)
    wanted = setpoint.at(time)
    nothing = np.zeros(time.size)
    angle = place.run(TRAVEL * wanted, nothing, nothing * np.nan, nothing + 1.0)
    error = np.abs(wanted - place.read(angle) / TRAVEL)[time >= setpoint.judged_from - 1e-9]
    seen = ours.envelope
    return max(abs(longest - _longest(error > level, period))
               for level, longest in zip(seen.errors, seen.longest, strict=True) if level >= 0.02)  # fmt: skip


def _sensors(ours: Safety, places: list[There]) -> Iterator[tuple[float, float, int]]:
    """By how much an opening and the time of a check are missed, and whether one tells in one program alone."""
    settings, period, jam = places[0].task.settings.safety, places[0].task.ecu.period, ours.jam
    ticks = round((FAILS_AT + 0.55 + WATCHED) / period)
    begin = round(FAILS_AT / period)
    failed = np.arange(ticks) >= begin
    asked = [0.25 + step for step in settings.frozen] + [0.25] * 3
    shown = [np.inf, np.inf, 0.0, TRAVEL, np.nan]
    for mine, goal, value in zip(ours.sensors, asked, shown, strict=True):
        wanted = TRAVEL * np.where(failed, goal, 0.25)
        shift = np.where(failed & np.isnan(value), -settings.offset * TRAVEL, 0.0)
        instead = np.where(failed, value, np.nan)
        openings, times = np.zeros(3), np.zeros(3)
        for place in places:
            feed = np.full(ticks, settings.supply / place.task.ecu.supply)
            angle = place.run(wanted, shift, instead, feed)
            read = place.read(angle)
            seen = np.where(failed, read[begin - 1] if np.isinf(value) else read + shift, read)
            seen = np.where(failed & np.isfinite(value), value, seen)
            far = np.abs(wanted - seen) / TRAVEL > (np.inf if jam is None else jam.error)
            differ = np.abs(read - seen) / TRAVEL > settings.apart
            trips = [math.inf, _trip(far, np.inf if jam is None else jam.timeout, period)]
            trips.append(min(trips[1], _trip(differ, settings.apart_for, period)))
            for k, trip in enumerate(trips):
                cut = np.arange(ticks) * period >= trip + place.task.ecu.delay - 1e-9
                stopped = place.run(wanted, shift, instead, np.where(cut, 0.0, feed))
                openings[k] = max(openings[k], stopped[begin:].max() / TRAVEL)
                times[k] = max(times[k], trip - FAILS_AT)
        theirs = (mine.opens, mine.jam_opens, mine.apart_opens)
        told = [math.inf if t is None else t for t in (mine.jam_after, mine.apart_after)]
        known = np.isfinite(times[1:]) & np.isfinite(told)
        late = max((abs(a - b) for a, b, k in zip(times[1:], told, known, strict=True) if k), default=0.0)
        yield (
            100.0 * float(np.max(np.abs(openings - theirs))),
            late,
            int(np.sum(np.isfinite(times[1:]) != np.isfinite(told))),
        )


def _trip(bad: np.ndarray, timeout: float, period: float) -> float:
    """Instant at which something has been bad for longer than the timeout, s."""
    run = 0
    for k, each in enumerate(bad):
        run = run + 1 if each else 0
        if run * period > timeout + 1e-9:
            return k * period
    return math.inf


def _sags(ours: Safety, places: list[There]) -> Iterator[float]:
    settings, own = places[0].task.settings.safety, places[0].task.ecu
    ticks = round((FAILS_AT + sum(settings.crank_for) + WATCHED) / own.period)
    time = own.period * np.arange(ticks) - FAILS_AT + 1e-9
    dip = np.where((time >= 0.0) & (time < settings.dip_for), settings.dip, own.supply)
    crank = np.where((time >= 0.0) & (time < sum(settings.crank_for)), settings.crank[1], own.supply)
    crank = np.where((time >= 0.0) & (time < settings.crank_for[0]), settings.crank[0], crank)
    nothing = np.zeros(ticks)
    for mine in ours.sags:
        feed = {"dip": dip, "crank": crank}[mine.name] / own.supply
        wanted = TRAVEL * np.where(np.arange(ticks) == 0, 0.25, mine.opening)
        falls = rises = 0.0
        for place in places:
            angle = place.run(wanted, nothing, nothing * np.nan, feed) / TRAVEL
            off = angle[time >= 0.0] - angle[time >= 0.0][0]
            falls, rises = max(falls, -off.min()), max(rises, off.max())
        yield 100.0 * max(abs(falls - mine.closes), abs(rises - mine.opens))


def _returns(ours: Safety, places: list[There]) -> tuple[float, float, float]:
    instants = np.arange(0.0, FALLS, 1e-3)
    still = Drive(np.array([0.0, FALLS]), np.zeros(2))
    late, apart = ([], []), []
    for mine in ours.returns:
        worst, rests = np.zeros(2), []
        for place in places:
            for k, plant in enumerate((terminals_open, independent_throttle)):
                angle = simulate(plant(place.truth, place.effects), still, instants, angle=TRAVEL * mine.opening).angle
                far = np.flatnonzero(np.abs(angle - place.rig.limp.angle) / TRAVEL > RETURNED)
                worst[k] = max(
                    worst[k], 0.0 if not far.size else math.inf if far[-1] == angle.size - 1 else instants[far[-1] + 1]
                )
                if k == 0:
                    rests.append(angle[-1] / TRAVEL)
        for off, own, true in zip(late, (mine.cut_s, mine.shorted_s), worst, strict=True):
            off.append(0.0 if own is None and true == math.inf else abs((math.inf if own is None else own) - true))
        apart += [abs(min(rests) - mine.rests[0]), abs(max(rests) - mine.rests[1])]
    return max(late[0]), max(late[1]), 100.0 * max(apart)


def _holding(ours: Safety, place: There) -> float:
    held, plant = ours.holding, independent_throttle(place.truth, place.effects)
    far = held.shares * TRAVEL > place.rig.limp.angle + 0.05 * TRAVEL
    exact = np.array([restoring_torque(record(plant), TRAVEL * share) / plant.k_t for share in held.shares[far]])
    return 100.0 * float(np.max(np.abs(held.current[far] / exact - 1.0)))


def table(found: Mapping[int, Off]) -> str:
    """A row a rig, and the worst of each column."""
    lines = ["| seed | " + " | ".join(Off._fields) + " |", "|---" * (1 + len(Off._fields)) + "|"]
    rows = {str(seed): off for seed, off in found.items()}
    rows["worst"] = Off(*(max(column) for column in zip(*found.values(), strict=True)))
    lines += [f"| {name} | " + " | ".join(f"{each:.3g}" for each in off) + " |" for name, off in rows.items()]
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rigs", type=int, default=10)
    parser.add_argument("--first-seed", type=int, default=7650)
    given = parser.parse_args()
    use_compilation_cache()
    print(table({seed: compare(seed) for seed in range(given.first_seed, given.first_seed + given.rigs)}))


if __name__ == "__main__":
    main()
