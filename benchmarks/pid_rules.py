"""Every tuning rule on rigs with dry friction and a limp-home spring, judged by the independent simulation.

    python -m benchmarks.pid_rules --fit --rigs 20 --first-seed 700 --out rules.json

Each rig is drawn from the independent generator: Eqs. 1-2 about the paper's rig +-40 %, a limp-home spring, Stribeck
friction. The rules see only our model of it, whose limp-home corner and Stribeck curve have another form; the response
is that of the generator, under a computer of its own. With --fit the model is fitted to a small bench folder that the
generator makes of the rig, both effects named in its rig.toml, and the draws are those of `etcfit design`. Without,
every parameter is the truth's within an error of 2 % (standard deviation), and so are the draws.

`unbound` is our optimum asked for no margins: where a rule without margins tracks better than our optimum and `unbound`
better still, the margins are what it costs, and not the search.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from etcfit.backend import use_compilation_cache
from etcfit.control.design import task_of as designed
from etcfit.control.judged import Tuned, judged
from etcfit.control.pid import RULES, Gains, Refusal, Requirements, Task
from etcfit.control.pid.loop import Body, Loop
from etcfit.estimation.joint_fit import fit
from etcfit.model.ecu import Ecu
from etcfit.model.effects import PAPER
from etcfit.model.effects.friction import StribeckFriction as OurStribeck
from etcfit.model.effects.springs import LimpHomeSpring as OurLimpHome
from etcfit.model.linear import TransferFunction
from etcfit.model.throttle import Throttle
from etcfit.rig.reader import read_folder
from independent import Truth, draw_truth, make_folder
from independent.control import Computer, Score, follow, score, trapezoids
from independent.effects import Effects, LimpHomeSpring, StribeckFriction
from independent.simulate import throttle as independent_throttle

from .processes import resumed

TRAVEL = math.pi / 2
DRAWS = 64
UNSURE = 0.02  # standard deviation of what we know of a parameter
TYPES = (*PAPER, OurLimpHome, OurStribeck)
UNBOUND = "unbound"
NO_MARGINS = {"gain_margin_db": 1e-3, "phase_margin_deg": 1e-3}
_A_PROCESS = 4  # rigs


@dataclass(frozen=True)
class Drawn:
    """A rig as it is."""

    truth: Truth
    limp: LimpHomeSpring
    stribeck: StribeckFriction

    @property
    def effects(self) -> Effects:
        """What it has beyond Eqs. 1-2."""
        return Effects(limp_home_spring=self.limp, stribeck_friction=self.stribeck)

    @property
    def plant(self) -> Any:
        """As the generator moves it."""
        return independent_throttle(self.truth, self.effects)

    @property
    def values(self) -> dict[str, float]:
        """As our model would have it, were it known exactly."""
        t, limp = self.truth, self.limp
        names = ("R_a", "L_a", "K_b", "K_m", "J_m", "J_L", "B_m", "B_L", "K_s", "T_PL", "T_f")
        return {name: getattr(t, name) for name in names} | {
            "T_lh": t.T_PL + t.K_s * limp.angle + limp.preload,
            "K_lh": max(limp.stiffness - t.K_s, 0.0),
            "theta_lh": limp.angle,
            "d_lh": 0.5 * limp.corner,
            "T_s": self.stribeck.excess,
            "omega_s": 1.2 * self.stribeck.speed,
            "delta_s": 1.0,
        }


def draw(seed: int) -> Drawn:
    """A rig: the paper's +-40 %, default position 6 to 13 degrees, 5 to 40 % more friction at rest than in motion."""
    rng = np.random.default_rng(seed)
    truth = draw_truth(rng)
    limp = LimpHomeSpring(math.radians(rng.uniform(6.0, 13.0)), rng.uniform(0.5, 1.5), rng.uniform(0.25, 0.45),
                          rng.uniform(0.005, 0.012))  # fmt: skip
    return Drawn(truth, limp, StribeckFriction(truth.T_f * rng.uniform(0.05, 0.4), rng.uniform(0.2, 0.8)))


@dataclass(frozen=True)
class Known:
    """What we know of a rig: what the rules are given, and where the model came from."""

    task: Task
    origin: dict[str, Any]


def fitted(rig: Drawn, ecu: Ecu, seed: int) -> Known:
    """A model fitted to bench measurements of the rig, and draws as `etcfit design` takes them."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        make_folder(folder, rig.truth, seed, rig.effects, "small")
        toml = folder / "rig.toml"
        toml.write_text(toml.read_text() + f"\n[model]\neffects = {json.dumps(rig.effects.on)}\n")
        begun = time.perf_counter()
        result = fit(read_folder(folder))
    origin = {"converged": result.converged, "reason": result.reason, "chi2_per_dof": result.chi2_per_dof,
              "seconds": time.perf_counter() - begun}  # fmt: skip
    return Known(designed(result.fitted(), ecu), origin)


def supposed(rig: Drawn, ecu: Ecu, seed: int) -> Known:
    """A model 2 % off, and draws as far about it."""
    rng = np.random.default_rng(seed + 10**6)
    known = {s: v * math.exp(UNSURE * rng.standard_normal()) for s, v in rig.values.items()}
    known["K_m"] = known["K_b"]
    factors = {s: np.append(1.0, np.exp(UNSURE * rng.standard_normal(DRAWS - 1))) for s in known}
    factors["K_m"] = factors["K_b"]
    throttles = Throttle.build(TYPES, {s: v * factors[s] for s, v in known.items()})
    loop = Loop(throttles, Body(rig.truth.N, 0.0, TRAVEL), ecu)
    plants = loop.linear()
    numbers = (plants.b0, plants.a2, plants.a1, plants.a0)
    plant = TransferFunction(*(float(np.asarray(v)[0, 0]) for v in numbers))
    return Known(Task(plant, ecu, Requirements(), loop), {})


def measured(rig: Drawn, gains: Gains, ecu: Ecu) -> Score:
    """The response of the rig as it is."""
    computer = Computer(*(float(g) for g in gains), period=ecu.period, supply=ecu.supply, filter=ecu.filter,
                        grain=ecu.resolution)  # fmt: skip
    wanted = trapezoids(0.05 * TRAVEL, 0.45 * TRAVEL, ecu.period)
    angle, _ = follow(rig.plant, computer, wanted)
    return score(angle, wanted, ecu.period, TRAVEL)


def run(seed: int, known: Callable[[Drawn, Ecu, int], Known]) -> dict[str, Any]:
    """Every rule on one rig."""
    use_compilation_cache()
    begun = time.perf_counter()
    rig, ecu = draw(seed), Ecu(resolution=TRAVEL / 4096)
    told = known(rig, ecu, seed)
    task = told.task
    found: dict[str, Gains | Refusal] = {name: rule(task) for name, rule in RULES.items()}
    free = replace(task, requirements=replace(task.requirements, **NO_MARGINS))
    found[UNBOUND] = RULES["optimal"](free)
    ours = judged(task, found)
    rules = {name: _outcome(rig, gains, ours[name], task) for name, gains in found.items()}
    return {"model": told.origin, "rules": rules, "seconds": time.perf_counter() - begun}


def _outcome(rig: Drawn, gains: Gains | Refusal, tuned: Tuned, task: Task) -> dict[str, Any]:
    """What a rule's gains come to on the rig as it is, and what our model foretells."""
    if isinstance(gains, Refusal):
        return {"why": gains.why}
    real, asked = measured(rig, gains, task.ecu), task.requirements
    assert tuned.linear is not None
    assert tuned.nonlinear is not None
    gain, phase = tuned.linear.gain_margin_db, tuned.linear.phase_margin_deg
    return {
        "gains": [float(g) for g in gains],
        "rmse": real.rmse,
        "overshoot": real.overshoot,
        "settling": real.settling,
        "error": real.error,
        "meets": real.meets_the_papers_requirements,
        "gain_margin_db": gain,
        "phase_margin_deg": phase,
        "margins": bool(gain >= asked.gain_margin_db and phase >= asked.phase_margin_deg),
        "linear_meets": all(tuned.met_linear.values()),
        "model_rmse": tuned.nonlinear.rmse_pct,
        "probability_met": tuned.probability_met,
        "probability_margins": tuned.probability_stable,
    }


Rules = Mapping[str, Mapping[str, Any]]


def table(rigs: Sequence[Rules]) -> str:
    """How often each rule that has gains meets what is asked, its RMSE, and how often our optimum beats it."""
    lines = ["| rule | gains | meets | margins too | meets on linear model | gain margin dB | phase margin deg | "
             "median RMSE % | our optimum is better |", "|---|---|---|---|---|---|---|---|---|"]  # fmt: skip
    for name in (*RULES, UNBOUND):
        rows = [rig[name] for rig in rigs if "rmse" in rig[name]]
        if not rows:
            continue
        better = "-" if name in ("optimal", UNBOUND) else str(sum(_beats(rig["optimal"], rig[name]) for rig in rigs))
        gain, phase, rmse = (
            np.median([r[key] for r in rows]) for key in ("gain_margin_db", "phase_margin_deg", "rmse")
        )
        lines.append(
            f"| {name} | {len(rows)} of {len(rigs)} | {sum(r['meets'] for r in rows)} | "
            f"{sum(r['meets'] and r['margins'] for r in rows)} | {sum(r['linear_meets'] for r in rows)} | "
            f"{gain:.1f} | {phase:.0f} | {rmse:.3f} | {better} |"
        )
    return "\n".join(lines)


def summary(rigs: Mapping[int, dict[str, Any]]) -> str:
    """How often our optimum is the best, and what those rules gave up that track better."""
    rules: list[Rules] = [rig["rules"] for rig in rigs.values()]
    others = [name for name in RULES if name != "optimal"]
    best = sum(all(_beats(each["optimal"], each[name]) for name in others) for each in rules)
    ahead = {seed: [name for name in others if _ahead(rig["rules"], name)] for seed, rig in rigs.items()}
    foretold = max(abs(each["optimal"]["model_rmse"] / each["optimal"]["rmse"] - 1.0) for each in rules)
    lines = [
        f"{len(rules)} rigs. Our optimum meets requirements and margins, and no other rule that does both tracks "
        f"better: {best} of {len(rules)}. A rule that meets the requirements, whatever its margins, tracks better in "
        f"{sum(map(bool, ahead.values()))}:",
        *(_why(seed, rigs[seed]["rules"], names) for seed, names in ahead.items() if names),
        f"Our model foretells the generator's RMSE of its optimum within {100.0 * foretold:.1f} %.",
    ]
    models = [rig["model"] for rig in rigs.values() if rig["model"]]
    return "\n".join([*lines, *([_fits(models)] if models else [])])


def _fits(models: Sequence[Mapping[str, Any]]) -> str:
    size = [model["chi2_per_dof"] for model in models]
    return (f"{sum(model['converged'] for model in models)} of {len(models)} fits converged; the others count as well. "
            f"chi2 per degree of freedom {min(size):.2f} to {max(size):.2f}.")  # fmt: skip


def _why(seed: int, rules: Rules, names: Sequence[str]) -> str:
    """A rig on which rules without our margins track better: their RMSE, gain and phase margin, and ours."""
    shown = "; ".join(
        f"{name} {rules[name]['rmse']:.3f} % ({rules[name]['gain_margin_db']:.1f} dB, "
        f"{rules[name]['phase_margin_deg']:.0f} deg)"
        for name in ("optimal", *names, UNBOUND)
    )
    return f"  rig {seed}: {shown}"


def _beats(ours: Mapping[str, Any], theirs: Mapping[str, Any]) -> bool:
    """Ours meets requirements and margins, and theirs refuses, misses some, or tracks worse."""
    if not (ours.get("meets") and ours.get("margins")):
        return False
    return not (theirs.get("meets") and theirs.get("margins")) or ours["rmse"] < theirs["rmse"]


def _ahead(rules: Rules, name: str) -> bool:
    """A rule meets the requirements and tracks better than our optimum, or that one misses them."""
    ours, theirs = rules["optimal"], rules[name]
    return bool(theirs.get("meets")) and not (ours["meets"] and ours["rmse"] < theirs["rmse"])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rigs", type=int, default=24)
    parser.add_argument("--first-seed", type=int, default=7000)
    parser.add_argument("--fit", action="store_true", help="the model is fitted, not the truth's within 2 %%")
    parser.add_argument("--out", type=Path, help="every figure, JSON; rigs already there are not run again")
    given = parser.parse_args()
    seeds = range(given.first_seed, given.first_seed + given.rigs)
    rigs = resumed(partial(run, known=fitted if given.fit else supposed), seeds, 1, _A_PROCESS, given.out)
    print(table([rig["rules"] for rig in rigs.values()]), summary(rigs), sep="\n\n")


if __name__ == "__main__":
    main()
