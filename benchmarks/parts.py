"""Gains sought over a fleet's parts against gains sought for one unit: on fresh units of the line, by the generator.

    python -m benchmarks.parts [--units 20] [--fresh 200] [--runs 3] [--spread 1.0] [--seed 9100]

A line's units are made, fitted one by one and as a fleet; of the first few each is the run of a design. Its gains are
sought by `optimal` twice: over draws of its own fit, and over units drawn from the fleet's population. Both are tried
on the true plants of units that nobody measured, in the independent simulation, under the same computer. Beside it
stand what our own model says of those units by their true parameters, and what the population promises: the share of
drawn units, others than the search saw, that meet everything.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import asdict, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

import etcfit
from etcfit.backend import use_compilation_cache
from etcfit.control.design import ecu_of, task_of
from etcfit.control.fleet import Parts, best_for_parts, sought_over
from etcfit.control.judged import over_models
from etcfit.control.loop_figures import OF_THE_PAPER, Ran, judge_all
from etcfit.control.on_units import Share
from etcfit.control.pid import RULES, Gains, Refusal, Task
from etcfit.estimation.fitted_model import Fitted
from etcfit.model.throttle import Throttle
from etcfit.run_folder.fleet import parts_of
from independent.control import Computer, noisy
from independent.effects import NONE
from independent.fleet import UnitTruth, draw_fleet, make_fleet
from independent.line import SPREAD, Line, Population
from independent.simulate import throttle
from independent.truth import Truth


class Fared(NamedTuple):
    """Gains on fresh units.

    Args:
        gains: themselves.
        share: of fresh units that meet everything, in the independent simulation.
        rmse: mean tracking error on them, %.
        ours: that share by our own model with their true parameters.
        promised: share of units drawn from the population that the fleet found.
    """

    gains: Gains
    share: Share
    rmse: float
    ours: float
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
    figures = judge_all(setpoint, time, Ran(share[None], volts[None] / ecu.supply, np.zeros((1, time.size))))
    meets = all(asked.met(figures, (*OF_THE_PAPER, "duty_activity_pct")).values())
    return OnPlant(bool(meets), float(figures.rmse_pct[0]))


def designed(fitted: Fitted, parts: Parts, fresh: tuple[UnitTruth, ...]) -> dict[str, Fared]:
    """Gains sought over either source of plants, and what they are worth."""
    settings = etcfit.DesignSettings()
    lower, upper = fitted.config.travel
    rest = fitted.laplace(settings.draws - 1, np.random.default_rng(settings.seed))
    task = task_of(fitted, ecu_of(fitted, resolution=(upper - lower) / 2**12), drawn=rest)
    over = parts.drawn(fitted, rest, settings.seed)
    judging = sought_over(task, parts.drawn(fitted, rest, settings.seed + 1))  # units that neither search has seen
    true = sought_over(task, of_truth(fitted, fresh))
    out = {}
    for source, gains in (("its own fit", RULES["optimal"](task)), ("the parts", best_for_parts(task, over))):
        assert not isinstance(gains, Refusal)
        found = [on_plant(task, gains, one.truth, k) for k, one in enumerate(fresh)]
        ours, promised = (float(met_on(each, gains).mean()) for each in (true, judging))
        out[source] = Fared(gains, Share.counted(np.array([each.meets for each in found])),
                            float(np.mean([each.rmse for each in found])), ours, promised)  # fmt: skip
    return out


def of_truth(fitted: Fitted, units: tuple[UnitTruth, ...]) -> Throttle:
    """Our model of units by their true parameters."""
    values = {symbol: np.array([getattr(one.truth, symbol) for one in units]) for symbol in asdict(units[0].truth)}
    rest = fitted.values_at(np.tile(fitted.x, (len(units), 1)))
    return Throttle.build(fitted.free_parameters.layout.types, rest | {s: v for s, v in values.items() if s in rest})


def met_on(task: Task, gains: Gains) -> np.ndarray:
    """Whether the models of a task, but for the nominal one, meet everything."""
    return task.requirements.all_met(over_models(task, task.loop, Gains.stacked(gains)).of_gains(0))[1:]


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
              f"{'ours %':>8}{'promised %':>12}{'RMSE %':>8}")  # fmt: skip
        for unit in made.units[: asked.runs]:
            fitted = etcfit.fit(Path(place) / "line" / unit.name, quiet=True).result.fitted()
            for source, each in designed(fitted, parts, fresh).items():
                share = each.share
                print(f"{unit.name:9}{source:13}" + "".join(f"{float(g):8.4g}" for g in each.gains)
                      + f"{100.0 * share.value:16.1f}{100.0 * share.low:9.1f} to {100.0 * share.high:4.1f}"
                      f"{100.0 * each.ours:8.1f}{100.0 * each.promised:12.1f}{each.rmse:8.3f}", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
