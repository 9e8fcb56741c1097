"""What feed-forward and a table over the supply are worth on the bench twin, on our model and on the generator's.

    python -m benchmarks.feed_forward --rule damping_optimum

Our model has the true parameters; only the corner of the limp-home spring has another form. The voltages ahead are
ours in both programs, all else is each one's own: plant, integrator, PID. The sensor has no noise, which would be
another sequence in each. Without --again the gains are found once, without feed-forward; with it anew for each row.
"""

from __future__ import annotations

import argparse
from dataclasses import asdict, replace

import numpy as np

from etcfit.backend import use_compilation_cache
from etcfit.control.loop_figures import judge
from etcfit.control.pid import RULES, Gains, Refusal, Requirements, Task
from etcfit.control.pid.conditions import course
from etcfit.control.pid.feedforward import bias_of, sliding_of
from etcfit.control.pid.loop import Body, Loop
from etcfit.control.settings import DesignSettings
from etcfit.control.supply_table import supply_table
from etcfit.model.ecu import Ecu
from etcfit.model.effects import PAPER
from etcfit.model.effects.springs import LimpHomeSpring
from etcfit.model.feed_forward import Term, listed, terms_of
from etcfit.model.linear import TransferFunction
from etcfit.model.throttle import Throttle
from independent.bench_twin import TRUTH, UNDECLARED
from independent.control import Computer, helped
from independent.simulate import throttle
from independent.truth import OPEN

ECU = Ecu(period=1e-3, supply=12.0, filter=2e-3, resolution=OPEN / 2**12)
SETS = ((), (Term.SPRING,), (Term.FRICTION,), (Term.RATE,), (Term.FRICTION, Term.RATE), tuple(Term))


def twin() -> Loop:
    """The bench twin, by its true parameters."""
    spring = UNDECLARED.limp_home_spring
    limp = {
        "T_lh": TRUTH.T_PL + TRUTH.K_s * spring.angle + spring.preload,
        "K_lh": spring.stiffness - TRUTH.K_s,
        "theta_lh": spring.angle,
        "d_lh": 0.5 * spring.corner,
    }
    values = {symbol: value for symbol, value in asdict(TRUTH).items() if symbol != "N"} | limp
    throttles = Throttle.build((*PAPER, LimpHomeSpring), {s: np.array([v]) for s, v in values.items()})
    return Loop(throttles, Body(TRUTH.N, 0.0, OPEN), ECU)


def with_terms(loop: Loop, terms: tuple[Term, ...]) -> Loop:
    """The loop with some terms ahead."""
    bias = bias_of(loop.nominal, *loop.body) if Term.SPRING in terms else None
    return replace(loop, bias=bias, sliding=sliding_of(loop.nominal, *loop.body).only(terms))


def tuned(task: Task, rule: str) -> Gains:
    """Gains of a rule.

    Raises:
        SystemExit: it has none.
    """
    found = RULES[rule](task)
    if isinstance(found, Refusal):
        raise SystemExit(f"{rule}: {found.why}")
    return found


def row(task: Task, gains: Gains) -> str:
    """Figures of our simulation, and the generator's tracking error and overshoot."""
    loop, time = task.loop, task.setpoint.instants(ECU.period)
    ours = loop.tried(Gains.stacked(gains), task.setpoint).figures
    asked = np.asarray(loop.angle(task.setpoint.at(time)))
    computer = Computer(*(float(g) for g in gains), period=ECU.period, supply=ECU.limit, filter=ECU.filter,
                        grain=ECU.resolution)  # fmt: skip
    angle, _ = helped(throttle(TRUTH, UNDECLARED), computer, asked, loop.ahead(asked))
    theirs = judge(task.setpoint, time, angle / OPEN)
    figures = (ours.rmse_pct, theirs.rmse_pct, ours.overshoot_pct, theirs.overshoot_pct, ours.settling_s)
    return "".join(f"{float(np.squeeze(each)):12.3g}" for each in figures)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])  # type: ignore[union-attr]
    parser.add_argument("--rule", default="damping_optimum", choices=list(RULES))
    parser.add_argument("--again", action="store_true", help="seek the gains anew with each set of terms")
    parser.add_argument("--only", metavar="TERMS", help="one set of them, as friction,rate")
    asked = parser.parse_args()
    use_compilation_cache()
    loop, settings = twin(), DesignSettings()
    plant = loop.linear()
    flat = TransferFunction(*(float(np.asarray(v)[0, 0]) for v in (plant.b0, plant.a2, plant.a1, plant.a0)))
    task = Task(flat, ECU, Requirements(), loop, course(loop, settings.scenarios), settings=settings)
    gains = tuned(task, asked.rule)
    print("rule", asked.rule, "Kp, Ki, Kd", *(f"{float(g):.4g}" for g in gains))
    print(sliding_of(loop.nominal, *loop.body))
    print(f"{'ahead':24}{'RMSE %':>12}{'theirs':>12}{'overshoot %':>12}{'theirs':>12}{'settling s':>12}")
    for terms in SETS if asked.only is None else ((), terms_of(asked.only)):
        there = replace(task, loop=with_terms(loop, terms), terms=terms)
        mine = tuned(there, asked.rule) if asked.again and terms else gains
        print(f"{' '.join(listed(terms)) or 'nothing':24}{row(there, mine)}", flush=True)
    for end in supply_table(task, gains).ends:
        print(f"{end.supply:g} V: RMSE {end.fixed.rmse_pct:.3g} % fixed, {end.table.rmse_pct:.3g} % by the table; "
              f"overshoot {end.fixed.overshoot_pct:.3g} %, {end.table.overshoot_pct:.3g} %")  # fmt: skip


if __name__ == "__main__":
    main()
