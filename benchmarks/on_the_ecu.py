"""Our optimum against every rule and a global search, where the ECU has noise, lag and delay, judged on the true plant.

    python -m benchmarks.on_the_ecu --rigs 20 --first-seed 21000 --out ecu.json

Rigs as in `pid_rules`: drawn from the independent generator, of which the rules see our model within 2 % in every
parameter. The controller is rusEFI's (500 Hz, no filter of the derivative) with 4 mV of noise on a sensor of 5 V, a
filter of 1 ms ahead of its converter and one tick of delay. Judged is the generator's own simulation under a computer
of its own, in every scenario, its figures computed here: requirements, duty at rest, tracking error of the trapezoid.

A plate that sticks slips or does not, as the noise has it, so one drawing of it is a throw of dice: `--drawings 12`
judges the gains of `optimal` and `global` in `--out` by more of them.

`global` is differential evolution (scipy) over the same model and requirements as our optimum: what a search without
knowledge of the plant finds at equal effort.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import differential_evolution

from etcfit.backend import use_compilation_cache
from etcfit.control.pid import RULES, Gains, Refusal, Task
from etcfit.control.pid.conditions import course
from etcfit.control.pid.linear_loop import COARSE, OpenLoop, margins
from etcfit.control.pid.optimal import scores
from etcfit.control.setpoint import Level
from etcfit.model.ecu import Ecu
from etcfit.model.ecus import RUSEFI
from independent.control import Computer, noisy
from independent.effects import PositionSensorLag
from independent.simulate import throttle as independent_throttle

from .pid_rules import TRAVEL, Drawn, draw, supposed
from .processes import resumed

GLOBAL = "global"
LAG, NOISE = 1e-3, 0.8e-3 * TRAVEL
ROUNDS, POPULATION = 40, 16  # of the global search; its population is that many times three gains
NEGLIGIBLE, OVERSHOT_OF, HELD_OF = 0.002, 0.01, 0.4  # shares of the travel, as commands/design.md has them


def ecu() -> Ecu:
    """RusEFI's controller where a car has it."""
    own = Ecu(**RUSEFI.completed({}))
    return own._replace(supply=12.0, lag=LAG, delay=own.period, noise=NOISE, resolution=TRAVEL / 4096)


def globally(task: Task) -> Gains:
    """By differential evolution over the same cost as our optimum's."""
    settings = task.settings.optimum
    loop = task.loop.first(settings.few)
    linear = OpenLoop.of_plants(loop.linear(), loop.ecu, COARSE)

    def cost(logs: np.ndarray) -> np.ndarray:
        return scores(task, Gains(*np.exp(logs)), loop, linear, settings.spares[0]).cost

    ends = list(zip(np.log(settings.lowest), np.log(settings.highest), strict=True))
    found = differential_evolution(cost, ends, popsize=POPULATION, maxiter=ROUNDS, tol=0.0, rng=1, polish=False,
                                   vectorized=True, updating="deferred")  # fmt: skip
    return Gains(*np.exp(found.x).tolist())


def on_the_plant(rig: Drawn, gains: Gains, task: Task, seed: int | Sequence[int]) -> dict[str, float]:
    """Figures of the generator's response, the worst of all levels."""
    own, setpoint = task.ecu, task.setpoint
    effects = rig.effects._replace(position_sensor_lag=PositionSensorLag(own.lag))
    habits = {"filter": own.filter, "delay": own.delay, "grain": own.resolution, "noise": own.noise}
    limits = {"supply": own.duty * own.supply, "hold": own.integral * own.supply}
    computer = Computer(*(float(g) for g in gains), period=own.period, **limits, **habits)
    wanted = setpoint.at(own.period * np.arange(round(setpoint.duration / own.period)))
    path = noisy(independent_throttle(rig.truth, effects), computer, TRAVEL * wanted, np.random.default_rng(seed))
    share, duty = path[:, 0] / TRAVEL, path[:, 1] / own.supply
    each = [_level(level, share, own.period) for level in setpoint.levels]
    tails = [duty[_tail(level, own.period)] for level in setpoint.levels]
    begin, end = (round(instant / own.period) for instant in setpoint.stretches[0][:2])
    return {
        "overshoot_pct": max(row[0] for row in each),
        "settling_s": max(row[1] for row in each),
        "steady_state_error_pct": max(row[2] for row in each),
        "duty_activity_pct": 100.0 * float(np.sqrt(np.mean([np.var(tail) for tail in tails]))),
        "rmse_pct": 100.0 * float(np.sqrt(np.mean((share[begin:end] - wanted[begin:end]) ** 2))),
    }


def _tail(level: Level, period: float) -> slice:
    begin, end = round(level.begins / period), round(level.ends / period)
    return slice(end - round(0.25 * (end - begin)), end)


def _level(level: Level, share: np.ndarray, period: float) -> tuple[float, float, float]:
    """Overshoot %, settling s, error %."""
    begin, end = round(level.begins / period), round(level.ends / period)
    size = abs(level.after - level.before)
    over = (share[begin:end] - level.after) * np.sign(level.after - level.before)
    far = np.flatnonzero(np.abs(over) > max(0.02 * size, NEGLIGIBLE))
    late = 0.0 if not far.size else np.inf if far[-1] == over.size - 1 else (far[-1] + 1) * period
    held = np.abs(share[_tail(level, period)] - level.after).max()
    overshoot = 100.0 * max(float(over.max()), 0.0) / max(size, OVERSHOT_OF)
    return overshoot, late, 100.0 * float(held) / max(size, HELD_OF)


def known(seed: int) -> tuple[Drawn, Task]:
    """A rig, and what the rules are given of it."""
    rig = draw(seed)
    told = supposed(rig, ecu(), seed).task
    return rig, replace(told, setpoint=course(told.loop.first(1), told.settings.scenarios))


def run(seed: int) -> dict[str, Any]:
    """Every rule on one rig."""
    use_compilation_cache()
    begun = time.perf_counter()
    rig, task = known(seed)
    found: dict[str, Gains | Refusal] = {name: rule(task) for name, rule in RULES.items()}
    found[GLOBAL] = globally(task)
    rules = {name: _outcome(rig, gains, task, seed) for name, gains in found.items() if isinstance(gains, Gains)}
    return {"rules": rules, "seconds": time.perf_counter() - begun}


def _outcome(rig: Drawn, gains: Gains, task: Task, seed: int) -> dict[str, Any]:
    figures, asked = on_the_plant(rig, gains, task, seed), task.requirements
    gain, phase = (float(each) for each in margins(gains, task.plant, task.ecu))
    met = _meets(figures, task)
    safe = gain >= asked.gain_margin_db and phase >= asked.phase_margin_deg
    return {"gains": [float(g) for g in gains], **figures, "gain_margin_db": gain, "phase_margin_deg": phase,
            "meets": met, "margins": safe}  # fmt: skip


def _meets(figures: Mapping[str, float], task: Task) -> bool:
    return all(figures[symbol] < getattr(task.requirements, symbol) for symbol in figures if symbol != "rmse_pct")


def table(rigs: Mapping[int, Mapping[str, Any]]) -> str:
    """How often each meets what is asked on the true plant, and its medians."""
    rows = [each["rules"] for each in rigs.values()]
    lines = ["| rule | meets | margins too | gain margin dB | phase margin deg | RMSE % | duty % |",
             "|---|---|---|---|---|---|---|"]  # fmt: skip
    for name in (*RULES, GLOBAL):
        mine = [row[name] for row in rows if name in row]
        if not mine:
            continue
        keys = ("gain_margin_db", "phase_margin_deg", "rmse_pct", "duty_activity_pct")
        gain, phase, rmse, duty = (float(np.median([m[key] for m in mine])) for key in keys)
        lines.append(f"| {name} | {sum(m['meets'] for m in mine)} of {len(rows)} | "
                     f"{sum(m['meets'] and m['margins'] for m in mine)} | {gain:.1f} | {phase:.0f} | {rmse:.2f} | "
                     f"{duty:.1f} |")  # fmt: skip
    possible = [row for row in rows if any(m["meets"] and m["margins"] for m in row.values())]
    ours = sum(row["optimal"]["meets"] and row["optimal"]["margins"] for row in possible)
    over = [row["optimal"]["rmse_pct"] / row[GLOBAL]["rmse_pct"] - 1.0 for row in rows]
    lines += ["", f"{len(rows)} rigs. Where any of them meets requirements and margins on the true plant, our optimum "
              f"does: {ours} of {len(possible)}. Its tracking error over the global search's: median "
              f"{100.0 * float(np.median(over)):+.1f} %, worst {100.0 * max(over):+.1f} %."]  # fmt: skip
    return "\n".join(lines)


def shares(seed: int, rules: Mapping[str, Mapping[str, Any]], drawings: int) -> dict[str, float]:
    """Share of drawings of the noise in which the plant meets every requirement, by the rules compared."""
    rig, task = known(seed)
    found = {}
    for name in ("optimal", GLOBAL):
        gains = Gains(*rules[name]["gains"])
        met = [_meets(on_the_plant(rig, gains, task, [seed, k]), task) for k in range(drawings)]
        found[name] = float(np.mean(met)) if rules[name]["margins"] else 0.0
    return found


def table_of_shares(found: Mapping[int, Mapping[str, float]]) -> str:
    """In how many drawings each meets what is asked, rig by rig, and on how many rigs in 95 % of them."""
    lines = ["| rig | optimal, % of the drawings | global |", "|---|---|---|"]
    lines += [f"| {seed} | {100.0 * row['optimal']:.0f} | {100.0 * row[GLOBAL]:.0f} |" for seed, row in found.items()]
    mean = {name: 100.0 * float(np.mean([row[name] for row in found.values()])) for name in ("optimal", GLOBAL)}
    often = {name: sum(row[name] >= 0.95 for row in found.values()) for name in mean}
    words = [f"{name} {mean[name]:.0f} % of the drawings, at least 95 % of them on {often[name]} rigs" for name in mean]
    return "\n".join([*lines, "", f"{len(found)} rigs: {', '.join(words)}."])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rigs", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=7600)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--out", type=Path, help="every figure, JSON; rigs already there are not run again")
    parser.add_argument("--drawings", type=int, default=0, help="of the noise, by which both searches are judged again")
    given = parser.parse_args()
    seeds = range(given.first_seed, given.first_seed + given.rigs)
    rigs = resumed(run, seeds, given.processes, 4, given.out)
    print(table(rigs))
    if given.drawings:
        print()
        print(table_of_shares({seed: shares(seed, each["rules"], given.drawings) for seed, each in rigs.items()}))


if __name__ == "__main__":
    main()
