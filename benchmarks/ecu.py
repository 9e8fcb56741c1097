"""Do the intervals of logs under an ECU hold? Folders that log setpoint and position alone, against their truth.

    python -m benchmarks.ecu --first-seed 17500 --folders 40 --save ecu.jsonl

Each folder holds two logs of independent, which shares no code with the model: one with steps as its setpoint and one
with slow ramps, 1.5 s each at 500 Hz, sampled at ticks of an ECU of 1 ms; parameters drawn +-40 % around the centre. It
is fitted three times: gains known, known up to a scale, and free. With known gains what the plate feels in volts is
judged; without, the ratios of it, and whether all that has no scale is called not identifiable. A fit that ends as a
compromise states no standard error and is counted apart. What was done is kept, one line of JSON a fit, and not done
again.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from etcfit.estimation.settings import FitSettings

GAINS = {"K_p": 6.0, "K_i": 40.0, "K_d": 0.12}  # of the ECU, SI
LOGS, DURATION = ("steps", "ramps"), 1.5  # s each
CASES: dict[str, Mapping[str, str]] = {
    "known": {"P": "6.0", "I": "40.0", "D": "0.12"},
    "scaled": {key: f'{{ value = {value}, scale = "free" }}' for key, value in (("P", 5.0), ("I", 45.0), ("D", 0.1))},
    "free": dict.fromkeys("PID", '"free"'),
}
VOLTS = ("V_f", "V_s", "V_w", "V_PL")
RATIOS = (("V_s", "V_f"), ("V_w", "V_f"), ("K_p", "V_f"), ("K_i", "K_p"), ("K_d", "K_p"))
Z_95 = 1.959963984540054


def write(path: Path, seed: int, case: str) -> dict[str, float]:
    """The folder of a seed with the gains told as the case says; what a fit of it should find."""
    from independent import Bench, draw_truth
    from independent.control import Computer
    from independent.folder import rig_toml
    from independent.under_ecu import Log, add_logs

    truth = draw_truth(np.random.default_rng(seed))
    plain = rig_toml("synthetic, under its ECU", truth.N, Bench(), [], noise=True)
    ecu = "".join(f"{key} = {value}\n" for key, value in CASES[case].items())
    text = plain.replace('[tests.inductance]\nseries_ohm = "free"\n', "")
    path.mkdir(parents=True)
    (path / "rig.toml").write_text(f'{text}\n[ecu]\n{ecu}unit = "V/rad"\nperiod_ms = 1.0\n', encoding="utf-8")
    add_logs(path, truth, Computer(*GAINS.values()), seed, kinds=LOGS, how=Log(duration=DURATION))
    volts = {"V_f": truth.T_f, "V_s": truth.K_s, "V_PL": truth.T_PL}
    speed = truth.B_eq * truth.volts_for(1.0) + truth.N * truth.K_b
    return {**{s: truth.volts_for(torque) for s, torque in volts.items()}, "V_w": speed, **GAINS}


def one(seed: int, case: str, folder: Path, settings: FitSettings) -> dict[str, Any]:
    """Simulate and fit: z = (found - true)/standard error of each volt or ratio; None where there is no interval."""
    from etcfit.estimation.intervals import intervals, lumped
    from etcfit.estimation.joint_fit import fit
    from etcfit.rig.reader import read_folder

    true = write(folder / "rig", seed, case)
    result = fit(read_folder(folder / "rig"), settings=settings)
    stated = {**lumped(result), **intervals(result)}
    if case == "known":
        z = {s: _z(stated[s].value - true[s], stated[s].stderr) for s in VOLTS}
    else:
        z = {f"{a}/{b}": _ratio(result, stated, a, b, true[a] / true[b]) for a, b in RATIOS}
    told = [s for s in (*VOLTS, *GAINS, "T_f", "K_s", "T_PL") if stated[s].stderr] if case != "known" else []
    return {"seed": seed, "case": case, "converged": result.converged, "far": result.far, "z": z, "scale_told": told,
            "chi2_per_dof": result.chi2_per_dof, "compromise": result.compromise is not None}  # fmt: skip


def _z(miss: float, stderr: float | None) -> float | None:
    return miss / stderr if stderr else None


def _ratio(result: Any, stated: Mapping[str, Any], a: str, b: str, true: float) -> float | None:
    """z of the logarithm of a ratio, by central differences through the fit's own covariance."""
    from etcfit.estimation.intervals import LUMPS

    layout, held = result.free_parameters.layout, result.free_parameters.held
    if result.compromise is not None:
        return None

    def log(x: np.ndarray) -> float:
        values, n = layout.values(x, held), result.rig.config.gear_ratio
        top, bottom = (float(LUMPS[s].of(values, n) if s in LUMPS else values[s]) for s in (a, b))
        return float(np.log(top / bottom))

    steps = 1e-4 * np.eye(result.x.size)
    gradient = np.array([(log(result.x + h) - log(result.x - h)) / 2e-4 for h in steps])
    sd = float(np.sqrt(gradient @ result.covariance @ gradient))
    return None if sd > 0.5 else (log(result.x) - float(np.log(true))) / sd


def table(outcomes: Sequence[Mapping[str, Any]]) -> str:
    """How many intervals of each quantity hold, by case."""
    lines = ["| gains | quantity | intervals | 95 % hold | rms z | none stated |", "| --- |" + " --- |" * 5]
    for case in CASES:
        rows = [o for o in outcomes if o["case"] == case]
        names = list(dict.fromkeys(name for o in rows for name in o["z"]))
        for name in (*names, "all") if names else ():
            every = [v for o in rows for s, v in o["z"].items() if name in (s, "all")]
            z = np.array([v for v in every if v is not None])
            holds = f"{100 * np.mean(np.abs(z) < Z_95):.0f} %" if z.size else "-"
            rms = f"{np.sqrt(np.mean(z**2)):.2f}" if z.size else "-"
            lines.append(f"| {case} | {name} | {z.size} | {holds} | {rms} | {len(every) - z.size} |")
    far = sum(o["compromise"] for o in outcomes)
    told = sum(bool(o["scale_told"]) for o in outcomes)
    lines += ["", f"{len(outcomes)} fits, {far} of them a compromise; {told} told a scale that no gain gives."]
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folders", type=int, default=40)
    parser.add_argument("--first-seed", type=int, default=17_500)
    parser.add_argument("--save", type=Path, required=True, help="JSON lines; what is in it is not done again")
    neighbours = FitSettings().neighbours
    parser.add_argument(
        "--neighbours", type=int, default=neighbours, help="see FitSettings; 0: no optimum but the first"
    )
    choices = parser.parse_args()
    from etcfit.backend import use_compilation_cache

    use_compilation_cache()
    done = [json.loads(line) for line in choices.save.read_text().splitlines()] if choices.save.exists() else []
    wanted = range(choices.first_seed, choices.first_seed + choices.folders)
    for seed, case in ((seed, case) for seed in wanted for case in CASES):
        if any((o["seed"], o["case"]) == (seed, case) for o in done):
            continue
        with tempfile.TemporaryDirectory() as scratch:
            done.append(one(seed, case, Path(scratch), FitSettings(neighbours=choices.neighbours)))
        with choices.save.open("a", encoding="utf-8") as file:
            file.write(json.dumps(done[-1]) + "\n")
        print(f"seed {seed}, {case}: chi2/dof {done[-1]['chi2_per_dof']:.2f}, {done[-1]['z']}", flush=True)
    print(table([o for o in done if o["seed"] in wanted]))


if __name__ == "__main__":
    main()
