"""What a candidate costs in a diagnosis, beside a plain fit with it from scratch, in one run.

    python -m benchmarks.bench_diagnose [FOLDER]

The same effect on the same folder: `etcfit fit` with the effect named in rig.toml (a model of its own: reading, starts,
compilation), against its refit from where the fit without it ended.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from etcfit.diagnosis import DiagnosisSettings
from etcfit.diagnosis.loop import screened
from etcfit.diagnosis.refit import start
from etcfit.estimation.joint_fit import fit
from etcfit.rig.reader import read_folder

EFFECTS = ("quadratic_drag", "stribeck_friction")


def timed(work: Callable[[], Any]) -> tuple[Any, float]:
    begin = time.perf_counter()
    return work(), time.perf_counter() - begin


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", type=Path, default=Path("measurements/bench_twin"))
    rig = read_folder(parser.parse_args().folder)
    result, base = timed(lambda: fit(rig))
    standing = start(result, DiagnosisSettings())
    candidates = standing.composition.candidates
    signatures, cold = timed(lambda: screened(standing, candidates))
    _, warm = timed(lambda: screened(standing, candidates))
    print(f"fit of Eqs. 1-2 {base:.1f} s")
    print(f"screening {len(candidates)} effects: {cold:.1f} s with compilation, {warm:.1f} s without")
    chosen = [g for g in signatures if g.variant.effect.name in EFFECTS]
    first = standing.with_effects((chosen[0].variant.effect,), chosen[0].values)
    print(f"first refit, with compilation: {timed(first.optimised)[1]:.1f} s")
    for g in chosen:
        trial = standing.with_effects((g.variant.effect,), g.values)
        mine = timed(trial.optimised)[1]
        named = replace(rig, config=replace(rig.config, effects=(*rig.config.effects, g.variant.effect.name)))
        plain = timed(lambda named=named: fit(named))[1]
        print(f"{g.variant.effect.name}: {mine:.2f} s a candidate, {plain:.1f} s from scratch: {plain / mine:.0f} x")


if __name__ == "__main__":
    main()
