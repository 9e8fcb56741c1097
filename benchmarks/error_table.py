"""Would a table of gains over the error track better? Near and far gains beside one set, on the same models.

    python -m benchmarks.error_table --rigs 3 --first-seed 7605

Rigs and ECU as in `on_the_ecu`. One set of gains is our optimum's. The table holds other ones at an error of zero and
goes straight to that set at an error of `--bands`, shares of the travel; the near gains are sought by the same search,
over the same draws, requirements and scenarios, from the one set, which is itself such a table. Margins are those of
the near gains. What the table is worth is the tracking error that it saves over all draws: of the models that it was
sought on, and so at its best. *Missed by*: mean log(1 + excess) of the requirement missed worst, without and with the
table; 0 where 95 % of the draws meet all.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from typing import Any

import jax.numpy as jnp
import numpy as np

from etcfit.backend import use_compilation_cache
from etcfit.control.pid import RULES, Gains, Task
from etcfit.control.pid.linear_loop import COARSE, OpenLoop
from etcfit.control.pid.loop import Loop, Path
from etcfit.control.pid.optimal import Scores, best_over_draws, scores
from etcfit.control.setpoint import Setpoint
from etcfit.model.ecu import Ecu
from etcfit.model.parameters import Scalar
from etcfit.model.pid import Memory, tick

from .on_the_ecu import known

SEED = 1


def over_the_error(settings: Any, ecu: Ecu, memory: Memory, setpoint: Scalar, position: Scalar, bias: Scalar) -> Any:
    """One tick of a PID whose gains lie between near and far ones, by |error| over the band."""
    near, far, band = settings
    share = jnp.clip(jnp.abs(setpoint - position) / band, 0.0, 1.0)
    gains = Gains(*(a + (b - a) * share for a, b in zip(near, far, strict=True)))
    return tick(gains, ecu, memory, setpoint, position, bias)


@dataclass(frozen=True, eq=False)
class LoopWithTable(Loop):
    """A loop whose gains, those that a search tries, hold at an error of zero.

    Args:
        far: gains beyond the band.
        band: rad.
    """

    far: tuple[float, ...] = (0.0, 0.0, 0.0)
    band: float = 1.0

    def respond(self, gains: Gains, setpoint: Setpoint) -> Path:
        near = Gains(*(jnp.asarray(gain, dtype=float) for gain in gains))
        far = Gains(*(jnp.full_like(near.Kp, gain) for gain in self.far))
        first = Memory.at_rest(near, self.ecu, self.angle(setpoint.shares[0]))
        return self.run(over_the_error, (near, far, jnp.full_like(near.Kp, self.band)), first, setpoint)


def with_table(task: Task, far: Gains, share: float) -> Task:
    """The same task under gains that are the given ones beyond an error of a share of the travel."""
    loop = task.loop
    band = share * (loop.body.upper - loop.body.lower)
    common = (loop.throttles, loop.body, loop.ecu, loop.bias, loop.settings, loop.drive, loop.sliding)
    return replace(task, loop=LoopWithTable(*common, far=tuple(far), band=band))


def fares(task: Task, gains: Gains) -> Scores:
    """Over all draws, nothing kept in hand."""
    linear = OpenLoop.of_plants(task.loop.linear(), task.loop.ecu, COARSE)
    return scores(task, Gains.stacked(gains), task.loop, linear, 0.0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rigs", type=int, default=3)
    parser.add_argument("--first-seed", type=int, default=7605)
    parser.add_argument("--bands", type=float, nargs="+", default=(0.01, 0.03, 0.08), help="shares of the travel")
    given = parser.parse_args()
    use_compilation_cache()
    print("| rig | band, % of travel | near gains over far ones, P I D | RMSE % | with table % | saves % | missed by |")
    print("|---|---|---|---|---|---|---|")
    for seed in range(given.first_seed, given.first_seed + given.rigs):
        _, task = known(seed)
        far = RULES["optimal"](task)
        assert isinstance(far, Gains)
        alone = fares(task, far)
        for share in given.bands:
            tabled = with_table(task, far, share)
            near = best_over_draws(tabled, np.log(np.array(far))[None], np.random.default_rng(SEED))
            found = fares(tabled, near)
            ratio = " ".join(f"{a / b:.2f}" for a, b in zip(near, far, strict=True))
            saved = f"{100.0 * (1.0 - found.rmse[0] / alone.rmse[0]):+.1f}"
            missed = f"{alone.missed[0]:.4f}, {found.missed[0]:.4f}"
            print(f"| {seed} | {100.0 * share:.0f} | {ratio} | {alone.rmse[0]:.3f} | {found.rmse[0]:.3f} | "
                  f"{saved} | {missed} |", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
