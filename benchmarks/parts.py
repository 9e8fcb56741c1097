"""Gains sought over a fleet's parts against gains sought for one unit: on fresh units of the line, by the generator.

    python -m benchmarks.parts [--units 20] [--fresh 200] [--runs 3] [--spread 1.0] [--seed 9100]

A line's units are made, fitted one by one and as a fleet; of the first few each is the run of a design. Its gains are
sought by `optimal` twice: over draws of its own fit, and over units drawn from the fleet's population. Both are tried
on the true plants of units that nobody measured, in the independent simulation, under the same computer. Beside it
stands what the population promises: the share of drawn units, others than the search saw, that meet everything.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

import etcfit
from etcfit.backend import use_compilation_cache
from etcfit.control.design import ecu_of, task_of
from etcfit.control.fleet_verdict import Share
from etcfit.control.judged import over_models
from etcfit.control.parts import Parts, sought_over
from etcfit.control.pid import RULES, Gains, Refusal, Task
from etcfit.control.pid.response import effort, judge
from etcfit.estimation.fitted_model import Fitted
from etcfit.run_folder.parts import parts_of
from independent.control import Computer, noisy
from independent.effects import NONE
from independent.fleet import UnitTruth, draw_fleet, make_fleet
from independent.line import SPREAD, Line, Population
from independent.simulate import throttle
from independent.truth import Truth


class Fared(NamedTuple):
    """Gains on fresh units: share that meets everything, mean tracking error (%), share promised of drawn ones."""

    gains: Gains
    share: Share
    rmse: float
    promised: float


class OnPlant(NamedTuple):
    """Whether everything that is asked is met, and the tracking error, %."""

    meets: bool
    rmse: float


def on_plant(task: Task, gains: Gains, truth: Truth, seed: int) -> OnPlant:
    """An independent plate under an independent computer; no feed-forward.

    Args:
        task: its ECU, its scenarios and what is asked.
        gains: of the computer.
        truth: of the plate.
        seed: of the sensor's noise.
    """
    ecu, asked, setpoint, body = task.ecu, task.requirements, task.setpoint, task.loop.body
    computer = Computer(*(float(g) for g in gains), period=ecu.period, supply=float(ecu.limit), filter=ecu.filter,
                        delay=ecu.delay, grain=ecu.resolution, noise=ecu.noise)  # fmt: skip
    time = setpoint.instants(ecu.period)
    wanted = body.lower + setpoint.at(time) * (body.upper - body.lower)
    angle, volts = noisy(throttle(truth, NONE), computer, wanted, np.random.default_rng(seed)).T
    share = (angle - body.lower) / (body.upper - body.lower)
    figures = judge(setpoint, time, share[None])
    duty = effort(setpoint, time, volts[None] / ecu.supply, np.zeros((1, time.size))).duty_activity_pct
    limits = (asked.overshoot_pct, asked.settling_s, asked.steady_state_error_pct, asked.duty_activity_pct)
    meets = all(float(f[0]) < limit for f, limit in zip((*figures[:3], duty), limits, strict=True))
    return OnPlant(meets, float(figures.rmse_pct[0]))


def designed(fitted: Fitted, parts: Parts, fresh: tuple[UnitTruth, ...]) -> dict[str, Fared]:
    """Gains sought over either source of plants, and what they are worth."""
    settings = etcfit.DesignSettings()
    lower, upper = fitted.config.travel
    rest = fitted.laplace(settings.draws - 1, np.random.default_rng(settings.seed))
    alone = task_of(fitted, ecu_of(fitted, resolution=(upper - lower) / 2**12), drawn=rest)
    over = sought_over(alone, parts.drawn(fitted, rest, settings.seed))
    judge_on = sought_over(alone, parts.drawn(fitted, rest, settings.seed + 1))  # that neither search has seen
    out = {}
    for source, task in (("its own fit", alone), ("the parts", over)):
        gains = RULES["optimal"](task)
        assert not isinstance(gains, Refusal)
        found = [on_plant(alone, gains, one.truth, k) for k, one in enumerate(fresh)]
        one = Gains(*(np.array([g]) for g in gains))
        promised = over_models(judge_on, judge_on.loop, one).of(0).met(task.requirements)[1:].mean()
        out[source] = Fared(gains, Share.counted(np.array([each.meets for each in found])),
                            float(np.mean([each.rmse for each in found])), float(promised))  # fmt: skip
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])  # type: ignore[union-attr]
    parser.add_argument("--units", type=int, default=20, help="measured")
    parser.add_argument("--fresh", type=int, default=200, help="never measured, on which gains are tried")
    parser.add_argument("--runs", type=int, default=3, help="units for each of which gains are sought")
    parser.add_argument("--spread", type=float, default=1.0, help="times that of the line as it is")
    parser.add_argument("--seed", type=int, default=9100)
    asked = parser.parse_args()
    use_compilation_cache()
    wide = {symbol: asked.spread * share for symbol, share in SPREAD.items()}
    line = Line(population=replace(Population(), spread=wide))
    fresh = draw_fleet(line, asked.units + asked.fresh, asked.seed).units[asked.units :]
    with tempfile.TemporaryDirectory() as place:
        made = make_fleet(Path(place) / "line", line, asked.units, asked.seed, own_rig_toml=True)
        etcfit.fleet(Path(place) / "line", Path(place) / "run", workers=1, quiet=True)
        parts = parts_of(Path(place) / "run")
        print(f"{len(parts.model.units)} of {asked.units} units make the population; spread {asked.spread:g}")
        print(f"{'unit':9}{'sought over':13}{'Kp':>8}{'Ki':>8}{'Kd':>8}{'met of fresh %':>16}{'95 %':>15}"
              f"{'promised %':>12}{'RMSE %':>8}")  # fmt: skip
        for unit in made.units[: asked.runs]:
            fitted = etcfit.fit(Path(place) / "line" / unit.name, quiet=True).result.fitted()
            for source, each in designed(fitted, parts, fresh).items():
                share = each.share
                print(f"{unit.name:9}{source:13}" + "".join(f"{float(g):8.4g}" for g in each.gains)
                      + f"{100.0 * share.value:16.1f}{100.0 * share.low:9.1f} to {100.0 * share.high:4.1f}"
                      f"{100.0 * each.promised:12.1f}{each.rmse:8.3f}", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
