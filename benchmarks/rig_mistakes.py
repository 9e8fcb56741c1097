"""Which mistakes of the rig `etcfit diagnose` names, and what they leave of the parameters.

    python -m benchmarks.rig_mistakes --first-seed 7400 --folders 20 --save rig_mistakes.jsonl
    python -m benchmarks.rig_mistakes --table rig_mistakes.jsonl

Each folder comes from `independent`, which shares no code with the model; one mistake was then made in its CSVs or its
rig.toml, and the kinds take turns. NAMED: the kind and its place are among what was found, or among the ties of what
was (a voltage that reads too much and a current that reads too little are one thing where the plate is held).

Seeds 7400 to 7999 are for tuning; 20000 to 20199 are the TEST's and were not touched.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np

from etcfit.diagnosis import Diagnosis, diagnose
from etcfit.errors import MeasurementError
from etcfit.estimation.intervals import intervals
from etcfit.estimation.joint_fit import FitResult, fit
from etcfit.model.rig_effects import rig_effect
from etcfit.rig.reader import read_folder
from independent import CONSISTENT, draw_truth
from independent.mistakes import Mistake, make_mistaken

KINDS = ("series_resistance", "channel_gain", "channel_offset", "sensor_end_points", "channel_sign", "time_scale",
         "gear_ratio", "unit_scale", "channel_late", "trace_late", "supply_sag")  # fmt: skip
SINCE = (
    "warm_start",
    "other_rig",
    "one_channel_late",
    "one_channel_gain",
    "one_channel_offset",
    "one_channel_sign",
)  # kinds of later: seeds go on to name the mistakes that they named before
ALSO = {"voltage": "current", "current": "voltage"}  # what reads one too large reads the other too small
PARAMETERS = ("R_a", "L_a", "K_b", "J_m", "J_L", "B_m", "B_L", "K_s", "T_PL", "T_f")


def record(seed: int, kinds: tuple[str, ...] = KINDS) -> dict[str, Any]:
    """One folder: made, fitted, diagnosed, judged."""
    kind = kinds[seed % len(kinds)]
    truth = draw_truth(np.random.default_rng(seed), CONSISTENT)
    with tempfile.TemporaryDirectory() as folder:
        made = make_mistaken(Path(folder), truth, seed, kind)
        began = time.perf_counter()
        try:
            before = fit(read_folder(folder))
        except MeasurementError as refused:  # physics rules it out: named before any fit
            return _refused(seed, kind, made, str(refused))
        found = diagnose(before)
        seconds = time.perf_counter() - began
    true = {s: float(getattr(truth, s)) for s in PARAMETERS}
    return {
        "seed": seed, "kind": kind, "test": made.file or made.test, "channel": made.channel, "size": made.size,
        "sizes": [mistake.size for mistake in found.rig],
        "found": list(found.added), "ties": [list(tie.effects) for tie in found.ties],
        "named": named(made, found), "chi2": [before.chi2_per_dof, found.after.chi2_per_dof],
        "before": _held(before, true), "after": _held(found.after, true), "seconds": seconds,
    }  # fmt: skip


def _refused(seed: int, kind: str, made: Mistake, message: str) -> dict[str, Any]:
    """The record of a folder that no fit takes."""
    nothing = {"stated": 0, "holding": 0, "worst": 0.0, "compromise": 0}
    return {
        "seed": seed, "kind": kind, "test": made.test, "channel": made.channel, "size": made.size,
        "sizes": [], "found": ["refused"], "ties": [], "named": f"{made.kind}:" in message, "chi2": [0.0, 0.0],
        "before": nothing, "after": nothing, "seconds": 0.0,
    }  # fmt: skip


def named(made: Mistake, found: Diagnosis) -> bool:
    """Whether the mistake is among what was found, at its place."""
    alike = {name for tie in found.ties for name in tie.effects if set(tie.effects) & set(found.added)}
    return any(_is(made, name, found) for name in (*found.added, *alike))


def _is(made: Mistake, name: str, found: Diagnosis) -> bool:
    effect = rig_effect(name)
    if effect is None:
        return False
    size = next((mistake.size for mistake in found.rig if mistake.effect == name), 0.0)
    kinds = {effect.kind, effect.called(size)}
    place = effect.place.test in ("", made.test or "") and effect.place.file == made.file
    also = "" if made.kind == "channel_late" else ALSO.get(made.channel or "")
    channel = made.channel in (None, "time") or effect.place.channel in ("", made.channel, also)
    return made.kind in kinds and place and channel


def _held(result: FitResult, true: dict[str, float]) -> dict[str, Any]:
    """Intervals that hold the truth, of those stated; parameters called a compromise; the largest error over s.e."""
    stated = {s: i for s, i in intervals(result).items() if s in true and i.low is not None and i.high is not None}
    holding = [s for s, i in stated.items() if (i.low or 0.0) <= true[s] <= (i.high or 0.0)]
    scores = [abs(i.value - true[s]) / i.stderr for s, i in stated.items() if i.stderr]
    return {
        "stated": len(stated), "holding": len(holding), "worst": max(scores, default=0.0),
        "compromise": sum(i.status == "compromise" for i in stated.values()),
    }  # fmt: skip


def line(r: dict[str, Any]) -> str:
    where = ".".join(word for word in (r["test"], r["channel"]) if word) or "rig"
    held = ", ".join(
        f"{w} {r[w]['holding']}/{r[w]['stated']} hold, worst {r[w]['worst']:.1f}" for w in ("before", "after")
    )
    return (
        f"seed {r['seed']}: {r['kind']} in {where} ({r['size']:.4g}): {'NAMED' if r['named'] else 'missed'}, "
        f"found {', '.join(r['found']) or 'nothing'}; chi2/dof {r['chi2'][0]:.3g} -> {r['chi2'][1]:.3g}; {held}; "
        f"{r['seconds']:.0f} s"
    )


def table(records: list[dict[str, Any]]) -> str:
    """By kind: how many were named, how many intervals hold before and after."""
    by_kind: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for each in records:
        by_kind[each["kind"]].append(each)
        by_kind["all"].append(each)
    rows = ["| mistake | folders | named | hold before | hold after | worst z after |", "|---|---|---|---|---|---|"]
    for kind in (*KINDS, *SINCE, "all"):
        if some := by_kind.get(kind):
            cells = [str(len(some)), f"{100 * np.mean([r['named'] for r in some]):.0f} %"]
            cells += [f"{sum(r[w]['holding'] for r in some)} of {sum(r[w]['stated'] for r in some)}"
                      for w in ("before", "after")]  # fmt: skip
            rows.append(f"| {kind} | {' | '.join(cells)} | {max(r['after']['worst'] for r in some):.1f} |")
    return "\n".join(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folders", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=7400)
    parser.add_argument("--only", nargs="+", choices=(*KINDS, *SINCE), default=KINDS, help="these mistakes, in turn")
    parser.add_argument("--save", type=Path, help="append each record to this file as a line of JSON")
    parser.add_argument("--table", type=Path, help="diagnose nothing: the table of what was saved")
    asked = parser.parse_args()
    if asked.table:
        print(table([json.loads(text) for text in asked.table.read_text(encoding="utf-8").splitlines()]))
        return
    records = []
    for seed in range(asked.first_seed, asked.first_seed + asked.folders):
        records.append(record(seed, tuple(asked.only)))
        print(line(records[-1]), flush=True)
        if asked.save:
            with asked.save.open("a", encoding="utf-8") as file:
                file.write(json.dumps(records[-1]) + "\n")
    print(table(records))


if __name__ == "__main__":
    main()
