"""Are the rig's own mistakes found before any fit, and is nothing found where there is none?

    python -m benchmarks.rig_checks --folders 40 --mistaken 20 --first-seed 7100

Every folder comes from independent, which shares no code with the model: the paper's rig with its parameters drawn
+-40 %, in three sizes in turn. Clean ones, ones of a body that has an effect beyond Eqs. 1-2, the committed bench twin
and, where ETCFIT_DATA names copies, the public data sets must give no alarm; ones with one mistake each must give its
name, and where it lies. A name counts as found if kind and test are right, with whatever size; any other find in the
same folder counts as a wrong name.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from etcfit.datasets import DATASETS, fetch
from etcfit.errors import MeasurementError
from etcfit.rig.base import Finding
from etcfit.rig.checks import DETECTORS
from etcfit.rig.reader import read_folder
from independent import CONSISTENT, MEDIUM, draw_truth, make_folder
from independent.mistakes import MISTAKES, ONLY_BY_A_FIT, Mistake, make_mistaken

from .bank.judging import HABITS

SIZES = ("small", "diagnose", "twin")


def found_in(folder: Path) -> tuple[Finding, ...]:
    """What reading the folder finds; a record that lies there twice is a find too."""
    try:
        return read_folder(folder).findings
    except MeasurementError as error:
        kind = "duplicate" if "hold the same numbers" in str(error) or "holds the same" in str(error) else "refused"
        return (Finding(kind, 1.0, "", 0.0, error.found, error.mend),)


def clean(seeds: range, scratch: Path) -> Iterator[tuple[str, tuple[Finding, ...]]]:
    """Folders without any mistake: generated, the committed one, the public ones."""
    for seed in seeds:
        folder = scratch / f"clean_{seed}"
        make_folder(folder, truth(seed), seed, size=SIZES[seed % 3])  # pyright: ignore[reportArgumentType]
        yield "generated", found_in(folder)
    yield "bench_twin", found_in(Path("measurements/bench_twin"))
    for name in DATASETS:
        try:
            yield name, found_in(Path(fetch(name, scratch / name)))
        except MeasurementError as error:
            print(f"{name} is left out: {error}", flush=True)


def with_effects(seeds: range, scratch: Path) -> Iterator[tuple[str, tuple[Finding, ...]]]:
    """Bodies with one effect each, in turn; finds that are rightly named are left out."""
    names = list(MEDIUM)
    for k, seed in enumerate(seeds):
        name, folder = names[k % len(names)], scratch / f"effect_{seed}"
        make_folder(folder, truth(seed), seed, MEDIUM[name], "diagnose")
        yield name, tuple(f for f in found_in(folder) if f.kind != HABITS.get(name))


def truth(seed: int):
    return draw_truth(np.random.default_rng(seed), CONSISTENT)


def mistaken(mistake: str, seeds: range, scratch: Path) -> list[tuple[Mistake, tuple[Finding, ...]]]:
    out = []
    for seed in seeds:
        folder = scratch / f"{mistake}_{seed}"
        done = make_mistaken(folder, truth(seed), seed, mistake, SIZES[seed % 3])
        out.append((done, found_in(folder)))
    return out


def names(done: Mistake, found: Finding) -> bool:
    """Kind and place are right."""
    return found.kind == done.kind and (found.kind == "duplicate" or done.test in (None, found.test))


def alarms(title: str, folders: list[tuple[str, tuple[Finding, ...]]]) -> str:
    """A row a detector: in how many folders it gave an alarm."""
    kinds = dict.fromkeys((*(d.kind for d in DETECTORS), "duplicate", "refused"))
    counts = Counter(kind for _, every in folders for kind in {f.kind for f in every})
    pairs = len(folders) * len(kinds)
    lines = [f"| {title}: detector | folders | alarms |", "|---|---|---|",
             *(f"| {kind} | {len(folders)} | {counts[kind]} |" for kind in kinds)]  # fmt: skip
    share = 100.0 * sum(counts.values()) / pairs
    return "\n".join(
        [*lines, "", f"{sum(counts.values())} alarms in {pairs} pairs of folder and detector, {share:.2f} %."]
    )


def row(mistake: str, outcomes: list[tuple[Mistake, tuple[Finding, ...]]]) -> str:
    named = sum(any(names(done, f) for f in every) for done, every in outcomes)
    wrong = sum(any(not names(done, f) for f in every) for done, every in outcomes)
    share = 100.0 * named / len(outcomes)
    return f"| {mistake} | {len(outcomes)} | {named} ({share:.0f} %) | {wrong} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folders", type=int, default=40)
    parser.add_argument("--mistaken", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=7100)
    choices = parser.parse_args()
    seeds = range(choices.first_seed, choices.first_seed + choices.folders)
    began = time.process_time()
    with tempfile.TemporaryDirectory() as scratch:
        for title, every in (("clean", list(clean(seeds, Path(scratch)))),
                             ("one effect", list(with_effects(seeds, Path(scratch))))):  # fmt: skip
            print(f"{alarms(title, every)}\n", flush=True)
            for name, finds in every:
                print(*(f"{name}: {f}\n" for f in finds), sep="", end="", flush=True)
        print("| mistake | folders | named, and where | other names |\n|---|---|---|---|", flush=True)
        for mistake in (m for m in MISTAKES if m not in ONLY_BY_A_FIT):
            print(row(mistake, mistaken(mistake, seeds[: choices.mistaken], Path(scratch))), flush=True)
    print(f"\n{time.process_time() - began:.0f} s of processor time")


if __name__ == "__main__":
    main()
