"""Do the posterior's intervals cover as often as they say? Ranks of the truth over many folders of independent data.

    python -m benchmarks.calibration --folders 40 --save calibration.jsonl --picture calibration.png

Each folder comes from independent, which shares no code with the model, with true parameters drawn +-40 % around
the centre. The rank of the truth is the probability that the posterior gives to values below it: uniform on [0, 1]
where uncertainty is stated right. An interval of probability q covers where |rank - 1/2| <= q/2. What was done is kept,
one line of JSON a folder, and not done again. The fit's own intervals are judged by `benchmarks.bank`.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from .recovery import CENTRES, PAPER, SERIES

SYMBOLS = (*PAPER, SERIES)
LEVELS = (0.5, 0.8, 0.95)
_BINS = 10


def one(seed: int, centre: str, size: Any, folder: Path) -> dict[str, Any]:
    """Draw, simulate, fit and sample: ranks by symbol, None where a parameter is not identifiable."""
    from etcfit.estimation.joint_fit import fit
    from etcfit.posterior.sampling import sample
    from etcfit.rig.reader import read_folder
    from independent import Bench, draw_truth, make_folder

    truth = draw_truth(np.random.default_rng(seed), CENTRES[centre])
    make_folder(folder / "rig", truth, seed, size=size)
    result = fit(read_folder(folder / "rig"))
    true = {s: getattr(truth, s) for s in PAPER} | {SERIES: Bench().series_ohm}
    posterior = sample(result, folder)
    ranks = {s: float(np.mean(posterior.draws[s] < true[s])) if posterior.marginals[s].status == "estimated" else None
             for s in result.free_parameters.layout.free}  # fmt: skip
    return {"seed": seed, "converged": result.converged, "ranks": ranks, "chain": posterior.convergence.converged}


def ranks(outcomes: Iterable[Mapping[str, Any]], symbol: str) -> np.ndarray:
    """Of one parameter over all folders where there is one; a chain that did not converge is no posterior."""
    return np.array([o["ranks"][symbol] for o in outcomes if o["chain"] and o["ranks"][symbol] is not None])


def table(outcomes: Sequence[Mapping[str, Any]]) -> str:
    """Coverage in per cent of each parameter's intervals, and a test of its ranks for uniformity."""
    lines = ["| parameter | folders | " + " | ".join(f"{100 * q:.0f} %" for q in LEVELS) + " | p (uniform) |",
             "| --- |" + " --- |" * (len(LEVELS) + 2)]  # fmt: skip
    every = {s: ranks(outcomes, s) for s in SYMBOLS}
    for s, u in {**every, "all": np.concatenate(list(every.values()))}.items():
        if not u.size:
            continue
        cover = " | ".join(f"{100 * np.mean(np.abs(u - 0.5) <= q / 2):.1f}" for q in LEVELS)
        p = (
            "" if s == "all" else f"{stats.kstest(u, 'uniform').pvalue:.3f}"
        )  # parameters of a folder are not independent
        lines.append(f"| {s} | {u.size} | {cover} | {p} |")
    sd = [math.sqrt(q * (1 - q) / max(1, len(every[SYMBOLS[0]]))) for q in LEVELS]
    lines += ["", "Sampling error of one row, 1 sd: " + ", ".join(f"{100 * e:.1f}" for e in sd) + " points."]
    return "\n".join(lines)


def picture(outcomes: Sequence[Mapping[str, Any]], path: Path) -> None:
    """Rank histograms, a panel a parameter."""
    from etcfit.reporting import style

    across = 4
    down = -(-len(SYMBOLS) // across)
    with style.drawing():
        fig = style.figure(12.0, 0.9 + 2.2 * down, synthetic=True)
        panels = fig.subplots(down, across, squeeze=False).flat
        for panel, symbol in zip(panels, SYMBOLS, strict=False):
            _histogram(panel, symbol, outcomes)
        empty = list(fig.axes)[len(SYMBOLS) :]
        for panel in empty:
            panel.set_axis_off()
        fig.suptitle(f"Rank of the truth, {len(outcomes)} folders", x=0.015, ha="left", fontsize=13)
        empty[0].legend(*fig.axes[0].get_legend_handles_labels(), loc="center left", frameon=False)
        fig.tight_layout(rect=(0.0, 0.0, 1.0, 0.95))
        style.save(fig, path)


def _histogram(panel: Any, symbol: str, outcomes: Sequence[Mapping[str, Any]]) -> None:
    from etcfit.reporting import style

    edges = np.linspace(0.0, 1.0, _BINS + 1)
    u = ranks(outcomes, symbol)
    if u.size:
        density = np.histogram(u, edges)[0] * _BINS / u.size
        panel.stairs(density, edges, baseline=None, color=style.READING, lw=1.6, zorder=3, label=f"{u.size} folders")
    low, high = (stats.binom.ppf(p, max(1, u.size), 1 / _BINS) * _BINS / max(1, u.size) for p in (0.025, 0.975))
    panel.axhspan(low, high, color=style.BAND, lw=0, zorder=0, label="95 % of uniform ranks")
    panel.set_title(symbol, loc="left")
    panel.set_xlabel("rank of the truth [1]")
    panel.set_ylabel("density [1]")
    panel.set_ylim(0.0, None)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folders", type=int, default=40)
    parser.add_argument("--first-seed", type=int, default=20_000)
    parser.add_argument("--centre", choices=CENTRES, default="consistent")
    parser.add_argument("--size", choices=("bench", "small"), default="bench")
    parser.add_argument("--save", type=Path, required=True, help="JSON lines; what is in it is not done again")
    parser.add_argument("--picture", type=Path)
    choices = parser.parse_args()
    done = [json.loads(line) for line in choices.save.read_text().splitlines()] if choices.save.exists() else []
    wanted = range(choices.first_seed, choices.first_seed + choices.folders)
    for seed in wanted:
        if any(o["seed"] == seed for o in done):
            continue
        with tempfile.TemporaryDirectory() as scratch:
            done.append(one(seed, choices.centre, choices.size, Path(scratch)))
        with choices.save.open("a", encoding="utf-8") as file:
            file.write(json.dumps(done[-1]) + "\n")
        print(f"seed {seed}: converged {done[-1]['converged']}, chain {done[-1]['chain']}", flush=True)
    some = [o for o in done if o["seed"] in wanted]
    print(table(some), end="\n\n")
    if choices.picture:
        picture(some, choices.picture)


if __name__ == "__main__":
    main()
