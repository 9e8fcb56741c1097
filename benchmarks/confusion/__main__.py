"""The command line, see the package."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from independent import CATALOGUE, OUTSIDE

from . import __doc__ as usage
from .cases import LEVELS, case
from .picture import picture
from .records import run, saved
from .tables import asked, tables
from .verdicts import said


def chosen_seeds(choices: argparse.Namespace) -> list[int]:
    """Of the range, those asked for and not yet saved."""
    done = {record["seed"] for record in saved(choices.save)}
    wanted = []
    for seed in range(choices.first_seed, choices.first_seed + choices.folders):
        each = case(seed)
        of_this = choices.only in (None, each.kind) and (not choices.names or set(each.names) & set(choices.names))
        if of_this and choices.strength in (None, *each.strength) and seed not in done:
            wanted.append(seed)
    return wanted


def line(record: dict[str, Any]) -> str:
    """Progress."""
    there = " + ".join(f"{n} ({s})" for n, s in zip(record["names"], record["strength"], strict=True)) or "clean"
    if "error" in record:
        return f"seed {record['seed']}: {there}: {record['error']}"
    ratio = f"held-out {record['before']['holdout']:.2f} -> {record['after']['holdout']:.2f}"
    return f"seed {record['seed']}: {there}: {said(record)}; {ratio}; {record['seconds']:.0f} s"


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=usage, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folders", type=int, default=200)
    parser.add_argument("--first-seed", type=int, default=1000)
    parser.add_argument("--only", choices=("clean", "single", "pair", "outside"))
    parser.add_argument("--names", nargs="+", choices=(*CATALOGUE, *OUTSIDE), help="only cases with one of these")
    parser.add_argument("--strength", choices=LEVELS, help="only cases with an effect of this strength")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--save", type=Path, help="append each record to this file as a line of JSON; skip those in it")
    parser.add_argument("--table", type=Path, nargs="+", help="diagnose nothing: the tables of what was saved in files")
    parser.add_argument("--picture", type=Path, help="draw what --table says")
    parser.add_argument("--list", action="store_true", help="diagnose nothing: what each seed is")
    return parser.parse_args()


def main() -> None:
    choices = arguments()
    if choices.table:
        parts = {file.stem.replace("_", " "): saved(file) for file in choices.table}
        every = [record for part in parts.values() for record in part]
        print(asked(parts if len(parts) == 1 else parts | {"all": every}) + "\n\n" + tables(every))
        if choices.picture:
            picture(every, choices.picture)
        return
    seeds = chosen_seeds(choices)
    if choices.list:
        print("\n".join(f"{c.seed} {c.kind} {' + '.join(c.names)} {' + '.join(c.strength)}" for c in map(case, seeds)))
        return
    records = []
    for record in run(seeds, choices.processes):
        records.append(json.loads(json.dumps(record)))
        print(line(records[-1]), flush=True)
        if choices.save:
            with choices.save.open("a", encoding="utf-8") as file:
                file.write(json.dumps(record) + "\n")
    if every := saved(choices.save) or records:
        print("\n" + tables(every))


if __name__ == "__main__":
    main()
