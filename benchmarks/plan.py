"""What planned tests do on the true plant against what they promise, over many folders.

    python -m benchmarks.plan --folders 2 --first-seed 7700

Each folder comes from independent, which shares no code with the model: the paper's rig with its parameters drawn
+-40 %. It is fitted, `etcfit plan RUN` is asked, what is to be played is played on the true plant, whose current, angle
and winding are looked at; the records join the folder and all is fitted again. Beside it the same folder with as many
seconds more of the paper's own tests (each once more, the rest driven responses) is fitted.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from independent import CONSISTENT, NONE, Bench, Truth, draw_truth
from independent.drives import Drive
from independent.folder import SIZES, write_folder, write_trace
from independent.planned import record
from independent.protocols import PROTOCOLS, Series, Session
from independent.simulate import resting_angle, simulate, throttle

COPPER = 0.0039  # 1/K


@dataclass(frozen=True)
class Outcome:
    """One folder.

    Args:
        seed: of it.
        seconds: logged more.
        tests: what was played, in words.
        outside: limits that the true plant passed.
        converged: all three fits.
        before, promised, found, papers: relative standard errors by symbol: of the folder alone, promised with the
            planned tests, found with them, found with as many seconds of the paper's. A fit may find a parameter of
            the rig, such as the phase of its edges, that another does not have.
    """

    seed: int
    seconds: float
    tests: tuple[str, ...]
    outside: tuple[str, ...]
    converged: bool
    before: dict[str, float]
    promised: dict[str, float]
    found: dict[str, float]
    papers: dict[str, float]

    @property
    def ratio(self) -> dict[str, float]:
        """Found over promised, by symbol."""
        return {s: self.found[s] / self.promised[s] for s in self.promised if s in self.found}

    @property
    def gain(self) -> float:
        """Geometric mean over all parameters of the standard error with the paper's tests over that with the plan's."""
        return float(np.exp(np.mean([np.log(self.papers[s] / self.found[s]) for s in self.ratio if s in self.papers])))

    def __str__(self) -> str:
        rows = [
            f"| {s} | {100 * self.before[s]:.3g} | {100 * self.promised[s]:.3g} | {100 * self.found[s]:.3g} | "
            f"{ratio:.3f} | {100 * self.papers[s]:.3g} |"
            for s, ratio in self.ratio.items()
            if s in self.papers
        ]
        head = (f"seed {self.seed}, {self.seconds:.1f} s more: {'; '.join(self.tests)}\n"
                f"outside its limits on the true plant: {'; '.join(self.outside) or 'nothing'}; converged "
                f"{self.converged}; the paper's tests leave standard errors {self.gain:.2f} times as wide\n\n"
                "| parameter | before, % | promised, % | found, % | found / promised | the paper's, % |\n"
                "|---|---|---|---|---|---|\n")  # fmt: skip
        return head + "\n".join(rows)


def one(seed: int, scratch: Path, size: str = "small") -> Outcome:
    """Draw, fit, plan, play, fit again; and the paper's tests beside it."""
    from etcfit.estimation.joint_fit import fit
    from etcfit.experiment.campaign import plan_campaign
    from etcfit.rig.reader import read_folder

    truth = draw_truth(np.random.default_rng(seed), CONSISTENT)
    write_folder(scratch / "before", f"seed {seed}", truth, seed, NONE, SIZES[size], Bench(), holdout=False, noise=True)
    first = fit(read_folder(scratch / "before"))
    campaign = plan_campaign(first.rig, first)
    outside = tuple(word for test in campaign.tests for word in on_the_true_plant(truth, test, campaign))

    shutil.copytree(scratch / "before", scratch / "after")
    session = Session(np.random.default_rng(1_000_000 + seed), truth, NONE, Bench())
    for test in campaign.tests:
        plan = test.candidate.plan
        trace = record(session, plan.test, plan.time, plan.volts, plan.release)
        (scratch / "after" / plan.test).mkdir(exist_ok=True)
        write_trace(scratch / "after", replace(trace, file=test.file), seed)
    second = fit(read_folder(scratch / "after"))

    shutil.copytree(scratch / "before", scratch / "papers")
    papers_again(scratch / "papers", Session(np.random.default_rng(2_000_000 + seed), truth, NONE, Bench()),
                 campaign.seconds, seed)  # fmt: skip
    third = fit(read_folder(scratch / "papers"))
    return Outcome(
        seed,
        campaign.seconds,
        tuple(test.candidate.plan.says for test in campaign.tests),
        outside,
        first.converged and second.converged and third.converged,
        stderr(first),
        dict(zip(campaign.symbols, campaign.expected.tolist(), strict=True)),
        stderr(second),
        stderr(third),
    )


def stderr(result: Any) -> dict[str, float]:
    """Relative standard errors of a fit, by symbol."""
    layout = result.free_parameters.layout
    sd = np.sqrt(np.diag(result.taken_as_exact().covariance)) / layout.reach(result.x)
    return dict(zip(layout.free, sd.tolist(), strict=True))


def papers_again(folder: Path, session: Session, seconds: float, seed: int) -> None:
    """Each of the paper's tests once more, and driven responses until all have so many seconds, `again_*.csv`."""
    once = {
        "resistance": Series(1, 0.2, 1000),
        "inductance": Series(1, 0.01, 20_000),
        "back_emf": Series(1, 0.3, 1000),
        "static_load": Series(1, 8.0, 100),
        "viscous": Series(1, 0.4, 1000),
        "inertia": Series(1, 0.3, 1000),
    }
    for test, series in once.items():
        _write(folder, test, session, series, seed)
    left = seconds - session.stopwatch.seconds
    _write(folder, "response", session, Series(3, left / 3.0, 1000), seed)


def _write(folder: Path, test: str, session: Session, series: Series, seed: int) -> None:
    for n, trace in enumerate(PROTOCOLS[test](session, series), 1):
        write_trace(folder, replace(trace, file=f"{test}/again_{n}.csv"), seed)


def on_the_true_plant(truth: Truth, test: Any, campaign: Any) -> list[str]:
    """Limits that the true plant passes while a planned test is played, in words."""
    played, window, settings = test.candidate.played, test.candidate.window, campaign.settings
    if played is None or window is None:
        return []
    at = np.repeat(played.time, 2)
    drive = Drive(at[1:], np.repeat(played.volts, 2)[:-1])  # sample and hold
    motion = simulate(throttle(truth, NONE), drive, played.time[1:], angle=resting_angle(truth, NONE))
    out = []
    if (volts := float(np.abs(played.volts).max())) > campaign.setting.supply:
        out.append(f"{test.file}: {volts:.2f} V")
    if (amps := float(np.abs(motion.current).max())) > settings.current:
        out.append(f"{test.file}: {amps:.2f} A")
    warmth, dt = 0.0, float(played.time[1] - played.time[0])
    for current in motion.current:
        heat = truth.R_a * (1.0 + COPPER * warmth) * current**2
        warmth += dt * (heat / campaign.winding.capacity - warmth / campaign.winding.cooling)
        if settings.ambient + warmth > settings.temperature:
            out.append(f"{test.file}: winding {settings.ambient + warmth:.0f} degC")
            break
    inside = motion.angle[(motion.time >= window[0]) & (motion.time <= window[1])]
    margin = settings.margin * (campaign.setting.open - campaign.setting.rest)
    low, high = campaign.setting.rest + margin, campaign.setting.open - margin
    if inside.min() < low or inside.max() > high or motion.angle.max() > high:
        ends = np.degrees([inside.min(), motion.angle.max()])
        out.append(f"{test.file}: plate {ends[0]:.1f} to {ends[1]:.1f} deg")
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folders", type=int, default=2)
    parser.add_argument("--first-seed", type=int, default=7700)
    parser.add_argument("--size", choices=list(SIZES), default="small")
    choices = parser.parse_args()
    from etcfit.backend import use_compilation_cache

    use_compilation_cache()
    began, ratios, gains = time.process_time(), [], []
    with tempfile.TemporaryDirectory() as scratch:
        for seed in range(choices.first_seed, choices.first_seed + choices.folders):
            outcome = one(seed, Path(scratch) / str(seed), choices.size)
            ratios += list(outcome.ratio.values())
            gains.append(outcome.gain)
            print(f"{outcome}\n\n({time.process_time() - began:.0f} s cpu so far)\n", flush=True)
    near = np.mean(np.abs(np.log(ratios)) < np.log(1.3))
    print(f"{len(ratios)} standard errors, {100 * near:.1f} % within 30 % of what was promised; "
          f"the paper's tests leave them {np.exp(np.mean(np.log(gains))):.2f} times as wide")  # fmt: skip


if __name__ == "__main__":
    main()
