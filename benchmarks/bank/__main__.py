"""The command line, see the package."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path

from independent import FURTHER as LATER
from independent.mistakes import IN_ONE_FILE as ONE_FILE

from ..page import Between
from . import __doc__ as usage
from .ablation import ablation, run_without
from .cases import CLASSES, wanted
from .mechanisms import MECHANISMS
from .picture import picture
from .table import table
from .work import latest, run, saved

TEST = 20_000  # seeds from here on are the test's
FURTHER = tuple(f"outside:{name}" for name in LATER)
# where the training seeds of a token begin
BEGINS: Mapping[str, int] = {**dict.fromkeys(("clean", "single", "pair", "outside"), 6500), "mistake": 7400,
                             "slow": 8200, "edges": 8300, "ecu": 17_500, **dict.fromkeys(FURTHER, 8000)}  # fmt: skip
IN_ONE_FILE = tuple(f"mistake:{change.__name__}" for change in ONE_FILE)
ECU = ("ecu:known", "ecu:scaled", "ecu:free")
MIXES: Mapping[str, Mapping[str, int]] = {
    "proof": dict.fromkeys((*CLASSES, FURTHER[0], FURTHER[3]), 2),
    "training": {"clean": 4, "single": 9, "pair": 4, "outside": 2, **dict.fromkeys(FURTHER, 1), "mistake": 11,
                 "mistake:warm_start": 1, "mistake:other_rig": 1, **dict.fromkeys(IN_ONE_FILE, 1), "slow": 2,
                 "edges": 5, **dict.fromkeys(ECU, 1)},
    "test": {"clean": 60, "single": 120, "pair": 80, "outside": 20, **dict.fromkeys(FURTHER, 5), "mistake": 77,
             "mistake:warm_start": 11, "mistake:other_rig": 12},
    "test_beside": {**dict.fromkeys(ECU, 40), "slow": 20, "edges": 20},
    "test_logs": {**dict.fromkeys(ECU, 15), "slow": 12},
    "test_short": {"clean": 10, "single": 20, "pair": 40, "outside": 8, **dict.fromkeys(FURTHER, 2), "mistake": 18,
                   "mistake:warm_start": 1, "mistake:other_rig": 1},
}  # fmt: skip
# from which seed a mix goes that is run once
FROZEN = {"test": 50_000, "test_beside": 30_000, "test_logs": 31_000, "test_short": 48_000}


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.bank", description=usage, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--mix", choices=MIXES, help="classes and how many folders of each")
    parser.add_argument("--classes", nargs="+", help="instead: these, as `single` or `single:backlash`")
    parser.add_argument("--folders", type=int, default=2, help="of each of --classes")
    parser.add_argument("--first-seed", type=int, help="of every class; else where its training seeds begin")
    parser.add_argument("--jobs", type=int, default=1, help="processes, of one core each")
    parser.add_argument("--save", type=Path, help="append each record as a line of JSON; resume from it")
    parser.add_argument("--list", action="store_true", help="run nothing: what each folder is")
    parser.add_argument("--table", type=Path, help="run nothing: the table of what was saved")
    parser.add_argument("--beside", type=Path, help="with --table or --without: older records of the same folders")
    parser.add_argument(
        "--without",
        nargs="+",
        metavar="MECHANISM",
        help="run the folders of --beside in which a mechanism acted once more without it; `each`: one after another",
    )
    parser.add_argument("--page", type=Path, help="put the table on this page, between its markers")
    parser.add_argument("--picture", type=Path, help="draw the rates beside their targets")
    choices = parser.parse_args()
    if choices.table is None and (choices.mix is None) == (choices.classes is None):
        parser.error("say --mix or --classes, or --table FILE")
    if choices.table is None and choices.save is None and not choices.list:
        parser.error("say --save FILE: each record is kept there as it is made")
    if choices.without == ["each"]:
        choices.without = [*MECHANISMS]
    if unknown := set(choices.without or ()) - {*MECHANISMS}:
        parser.error(f"no mechanism is called {', '.join(unknown)}; there are: {', '.join(MECHANISMS)}")
    if choices.without and choices.beside is None:
        parser.error("--without needs --beside FILE, the records with all mechanisms")
    if (choices.first_seed or 0) >= TEST and choices.mix not in FROZEN:
        parser.error(f"seeds from {TEST} on are the test's: --mix test runs them")
    return choices


def first_seed(token: str, choices: argparse.Namespace) -> int:
    """As asked for, that of a frozen mix, or where the token's training seeds begin."""
    return choices.first_seed or FROZEN.get(choices.mix) or begins(token)


def begins(token: str) -> int:
    """Where its training seeds do."""
    return BEGINS.get(token) or BEGINS.get(token.partition(":")[0], 0)


def main() -> None:
    choices = arguments()
    if choices.table is None:
        counts = MIXES[choices.mix] if choices.mix else {token: choices.folders for token in choices.classes}
        cases = wanted({token: (first_seed(token, choices), n) for token, n in counts.items()})
        if choices.list:
            for each in cases:
                print(each.kind, each.seed, " + ".join(each.names), " + ".join(each.strength), each.edges)
            return
        if choices.without:
            base = latest(saved(choices.beside))
            run_without(choices.without, cases, base, choices.jobs, choices.save, lambda line: print(line, flush=True))
            print(f"\n{ablation(choices.save, base)}")
            return
        new, old = run(cases, choices.jobs, choices.save, lambda line: print(line, flush=True)), None
    else:
        new, old = saved(choices.table), saved(choices.beside) if choices.beside else None
    records = latest(new)
    report = table(records, None if old is None else latest(old))
    print(f"\n{report}")
    if choices.page:
        Between.named("bank").put(choices.page, report)
    if choices.picture:
        picture([*records.values()], choices.picture)


if __name__ == "__main__":
    main()
