"""How often `etcfit drive` says the right thing of simulated logs whose truth is known.

    python -m benchmarks.good_enough [--count 40] [--first 1000]

Plates with stiction under a PID (`independent.hunting`) at 100 to 1000 Hz, noise 0.05 % and a resolution of 0.1 % of
the travel: what each shows at rest without noise is the truth. Pairs of sensors of six kinds. Thresholds were tuned on
seeds below 100; these begin at 1000.
"""

from __future__ import annotations

import argparse
import itertools
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from etcfit.car_log.limit_cycle import LimitCycle, limit_cycle
from etcfit.car_log.log import Series
from etcfit.car_log.sensors import Sensors, two_sensors
from etcfit.car_log.steps import steps
from independent import hunting, second_order

HELD = 8.0  # s
OSCILLATES = 0.2  # % of travel, half of peak to peak, and three periods in the last 5 s of the log


@dataclass(frozen=True)
class Case:
    """One log: what acts and what was said.

    Args:
        kind: of plate and gains.
        amplitude, period: at the end of the log, without noise, % and s.
        found: what `limit_cycle` says.
        after_dead_zone, after_dither: amplitude with what it proposes, %; None where it proposes nothing.
    """

    kind: str
    amplitude: float
    period: float
    found: LimitCycle | None
    after_dead_zone: float | None
    after_dither: float | None

    @property
    def oscillates(self) -> bool:
        """Whether there is an oscillation to be found."""
        return self.amplitude >= OSCILLATES and self.period < 5.0 / 3.0

    @property
    def is_what_it_should_be(self) -> bool:
        """Whether these gains do on this plate what their kind says; one that does not is left out."""
        return self.amplitude < 0.5 * OSCILLATES if self.kind == "calm" else self.oscillates


def case(kind: str, seed: int) -> Case:
    """Simulate, log and study one."""
    rng = np.random.default_rng([seed, hunting.KINDS.index(kind)])
    plate, pid = hunting.drawn(kind, rng)
    wanted = hunting.staircase(rng, 2.0 * HELD, HELD)
    true, duty = hunting.run(plate, pid, wanted, 0.02, rng)
    log = hunting.logged(rng, wanted, true, duty, float(rng.choice([100, 200, 500, 1000])), 0.05, 0.1)
    found = limit_cycle(*(Series(log["time"], log[name]) for name in ("position", "setpoint", "duty")))

    def after(**cure: float) -> float:
        path, _ = hunting.run(plate, replace(pid, **cure), wanted, 0.02, np.random.default_rng(1))
        return hunting.truth(path[-5000:])[0]

    zone, dither = (None, None) if found is None else (found.dead_zone, found.dither)
    return Case(kind, *hunting.truth(true[-5000:]), found, None if zone is None else after(dead_zone=zone),
                None if dither is None else after(dither=dither))  # fmt: skip


def answered(seed: int) -> list[tuple[float, float, float]]:
    """By how much overshoot (% of the step), settling and half-way time (ms) of a second-order loop are off, step by
    step; settling against the band that was used."""
    rng = np.random.default_rng(seed)
    zeta, wn = rng.uniform(0.3, 0.95), rng.uniform(15.0, 70.0)
    levels = [20.0, *rng.uniform(15.0, 85.0, 8).tolist()]
    made = second_order.log(levels, zeta, wn, float(rng.choice([100, 200, 500, 1000])), 0.05, seed, 1.5)
    position, wanted = (Series(made["time"], made[name]) for name in ("position", "setpoint"))
    fine = np.arange(0.0, 1.0, 1e-5)
    half = float(fine[np.argmax(second_order.answer(fine, zeta, wn) >= 0.5)])
    return [
        (each.overshoot - second_order.overshoot(zeta),
         1e3 * (each.settling - second_order.settled(zeta, wn, each.band / abs(each.size))), 1e3 * (each.lag - half))
        for each in steps(position, wanted) if abs(each.size) >= 5.0 and each.lag is not None
    ]  # fmt: skip


PAIRS = ("whole", "half", "falls", "falls half", "first turned", "exchanged")


def pair(kind: str, seed: int) -> tuple[Sensors | None, float]:
    """A swept pair, and where its second one truly stops, %."""
    rng = np.random.default_rng([seed, PAIRS.index(kind)])
    time = np.arange(0.0, 13.0, 1.0 / rng.choice([50.0, 100.0, 500.0]))
    x = np.interp(time, [0, 1, 2, 3, 6, 7, 11, 13], [0.12, 0.12, 0, 0, 1, 1, 0.12, 0.12])
    stops = rng.uniform(0.4, 0.85) if "half" in kind or kind == "exchanged" else 1.0
    one = rng.uniform(0.3, 0.9) + rng.uniform(3.0, 3.9) * x
    two = rng.uniform(0.3, 0.9) + rng.uniform(1.5, 3.9) * np.minimum(x / stops, 1.0)
    two = 5.0 - two if "falls" in kind else two
    one = 5.0 - one if kind == "first turned" else one
    noisy = [each + rng.uniform(0.001, 0.008) * rng.standard_normal(time.size) for each in (one, two)]
    first, second = noisy[::-1] if kind == "exchanged" else noisy
    return two_sensors(Series(time, first), Series(time, second), "V", 0.0), 100.0 * stops


def said(found: Sensors | None) -> str:
    """What was said of a pair, in the words of `PAIRS`."""
    if found is None:
        return "nothing"
    if found.crossed:
        return "exchanged"
    if found.first.span < 0.0:
        return "first turned"
    falls, half = found.second.span < 0.0, found.stops < 100.0
    return "falls half" if falls and half else "falls" if falls else "half" if half else "whole"


def lines(count: int, first: int) -> Iterator[str]:
    """The report."""
    yield ("| log | logs | said right | said | amplitude off, median % | period off, median % | dead zone stops "
           "| dither stops |")  # fmt: skip
    yield "| --- | --- | --- | --- | --- | --- | --- | --- |"
    for kind in hunting.KINDS:
        clear = list(
            islice((each for k in itertools.count(first) if (each := case(kind, k)).is_what_it_should_be), count)
        )
        words = Counter(each.found.kind if each.found else "none" for each in clear)
        right = [each for each in clear
                 if (each.found.kind if each.found else "none") == (kind if each.oscillates else "none")]  # fmt: skip
        seen = [each for each in right if each.found]
        off = ["-", "-"] if not seen else [
            f"{100.0 * np.median([abs(e.found.amplitude / e.amplitude - 1.0) for e in seen if e.found]):.1f}",
            f"{100.0 * np.median([abs(e.found.period / e.period - 1.0) for e in seen if e.found]):.1f}"]  # fmt: skip
        cures = []
        for name in ("after_dead_zone", "after_dither"):
            tried = [value for each in clear if (value := getattr(each, name)) is not None]
            cures.append(f"{sum(value < OSCILLATES for value in tried)} of {len(tried)}" if tried else "-")
        told = ", ".join(f"{word} {n}" for word, n in words.most_common())
        yield f"| {kind} | {len(clear)} | {len(right)} | {told} | {off[0]} | {off[1]} | {cures[0]} | {cures[1]} |"
    yield ""
    off = np.abs(np.array([each for k in range(count) for each in answered(first + k)]))
    yield f"| {len(off)} steps of {count} second-order loops | median off | 95 % are off by less than |"
    yield "| --- | --- | --- |"
    for name, column in zip(("overshoot, % of the step", "settling, ms", "half way, ms"), off.T, strict=True):
        yield f"| {name} | {np.median(column):.2g} | {np.quantile(column, 0.95):.2g} |"
    yield ""
    yield "| pair of sensors | sweeps | said right | end of the second one off, largest % of travel |"
    yield "| --- | --- | --- | --- |"
    for kind in PAIRS:
        found = [pair(kind, first + k) for k in range(count)]
        right = sum(said(each) == kind for each, _ in found)
        off = max((abs(each.stops - stops) for each, stops in found if each and said(each) == kind), default=0.0)
        yield f"| {kind} | {count} | {right} | {off:.1f} |"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--first", type=int, default=1000)
    asked = parser.parse_args()
    for line in lines(asked.count, asked.first):
        print(line, flush=True)
