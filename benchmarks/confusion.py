"""What `etcfit diagnose` finds in folders whose missing physics is known, and what it takes for what.

    python -m benchmarks.confusion --first-seed 1000 --folders 200 --save confusion.jsonl
    python -m benchmarks.confusion --table confusion.jsonl

Each folder comes from tests/independent, which shares no code with the model and whose effects differ in detail from
those of the same name there. A seed is a case: of 200 in a row 30 have no effect, 105 one effect of the catalogue
(every one at every strength), 35 two of them, and 30 one that is outside the catalogue.

Seeds 9000 to 9199 are the TEST: run once, for the figures of the README. Any seed below 9000 is for tuning.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from independent import (
    CATALOGUE,
    CONSISTENT,
    NONE,
    OUTSIDE,
    STRENGTHS,
    Effects,
    Truth,
    combine,
    draw_truth,
    left_by_itself,
    make_folder,
)

from .processes import fresh

TEST = range(9000, 9200)
PARAMETERS = ("R_a", "L_a", "K_b", "J_m", "J_L", "B_m", "B_L", "K_s", "T_PL", "T_f")
LEVELS = ("low", "medium", "high")
_A_PROCESS = 8  # folders
NEAR = 1.2  # held-out error over noise within which a model predicts what it has not seen

# forty cases in a row, five times over; the levels of the five times
BLOCK = ("clean",) * 6 + ("single",) * 21 + ("pair",) * 7 + ("outside",) * 6
ORDER = tuple(BLOCK[k] for k in np.random.default_rng(0).permutation(len(BLOCK)))
TURNS = ("medium", "low", "high", "medium", "high")


@dataclass(frozen=True)
class Case:
    """One folder: kind "clean", "single", "pair" or "outside"; for each effect its name and level."""

    seed: int
    kind: str
    names: tuple[str, ...]
    strength: tuple[str, ...]
    effects: Effects
    truth: Truth


def case(seed: int) -> Case:
    """The seed's case; its kind, and what of its kind, by its place among 200."""
    turn, place = divmod(seed % (len(ORDER) * len(TURNS)), len(ORDER))
    kind = ORDER[place]
    names, strength = _drawn(kind, turn, ORDER[:place].count(kind), np.random.default_rng([seed, 1]))
    effects = NONE
    for name, level in zip(names, strength, strict=True):
        effects = combine(effects, STRENGTHS[name][LEVELS.index(level)])
    return Case(seed, kind, names, strength, effects, draw_truth(np.random.default_rng(seed), CONSISTENT))


def _drawn(kind: str, turn: int, count: int, rng: np.random.Generator) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names and levels of the `count`-th of its kind in this turn."""
    match kind:
        case "single":
            return (CATALOGUE[count],), (TURNS[turn],)
        case "pair":
            names = rng.choice(CATALOGUE, 2, replace=False)
            return tuple(map(str, names)), tuple(map(str, rng.choice(LEVELS[1:], 2)))
        case "outside":
            nth = turn * BLOCK.count("outside") + count
            return (OUTSIDE[nth % len(OUTSIDE)],), (LEVELS[nth // len(OUTSIDE) % len(LEVELS)],)
    return (), ()


def known(chosen: Case) -> dict[str, float]:
    """The truth of PARAMETERS; dry friction told apart by direction is a preload, and is counted as that."""
    truth = {s: float(getattr(chosen.truth, s)) for s in PARAMETERS}
    dry = chosen.effects.asymmetric_friction
    truth["T_f"] += 0.5 * (dry.opening + dry.closing)
    truth["T_PL"] += 0.5 * (dry.opening - dry.closing)
    return truth


# ---- one folder


def one(seed: int) -> dict[str, Any]:
    """Make, read, fit, diagnose; a record for the file, with `error` where that failed."""
    chosen = case(seed)
    record: dict[str, Any] = {k: getattr(chosen, k) for k in ("seed", "kind", "names", "strength")}
    record |= {"by_itself": by_itself(chosen)}
    with tempfile.TemporaryDirectory() as scratch:
        make_folder(Path(scratch), chosen.truth, seed, chosen.effects, "small")
        begin = time.perf_counter()
        try:
            found = _found(Path(scratch), chosen)
        except Exception as error:
            found = {"error": f"{type(error).__name__}: {error}"}
    return record | {"seconds": time.perf_counter() - begin} | found


def by_itself(chosen: Case) -> list[tuple[str, str, float]]:
    """File, channel, error over noise of what the body itself, under the logged voltage, leaves of held-out traces."""
    left = left_by_itself(chosen.truth, chosen.seed, chosen.effects, "small")
    channels = {"current": "current", "tps": "position"}
    return [(file, channels[of], ratio) for (file, of), ratio in left.items() if of in channels]


def _found(folder: Path, chosen: Case) -> dict[str, Any]:
    from etcfit.backend import use_compilation_cache
    from etcfit.diagnose import diagnose
    from etcfit.fit import fit
    from etcfit.rig.reader import read_folder

    use_compilation_cache()
    rig = read_folder(folder)
    begin = time.perf_counter()
    result = fit(rig)
    fitted = time.perf_counter() - begin
    diagnosis = diagnose(result)
    left = diagnosis.unexplained
    return {
        "fit_seconds": fitted,
        "added": list(diagnosis.added),
        "ties": [list(tie.effects) for tie in diagnosis.ties],
        "unexplained": None if left is None else {"enters": left.enters, "depends_on": left.depends_on},
        "before": _standing(result, known(chosen)),
        "after": _standing(diagnosis.after, known(chosen)),
    }


def _standing(result: Any, truth: dict[str, float]) -> dict[str, Any]:
    """How well a model predicts what it has not seen, and what it says of each parameter."""
    from etcfit.intervals import intervals
    from etcfit.score import pooled

    stated = intervals(result)
    keys = ("value", "stderr", "low", "high", "status")
    return {
        "converged": bool(result.converged),
        "chi2_per_dof": float(result.chi2_per_dof),
        "holdout": pooled(result.score_holdout),
        "holdout_position": pooled([row for row in result.score_holdout if row.channel == "position"]),
        "holdout_rows": [[row.file, row.channel, row.n, row.rms / row.sigma] for row in result.score_holdout],
        "parameters": {s: {"truth": truth[s]} | {k: getattr(stated[s], k) for k in keys} for s in PARAMETERS},
    }


def run(seeds: Sequence[int], processes: int) -> Iterator[dict[str, Any]]:
    """Records as they are ready."""
    if processes == 1:
        yield from map(one, seeds)
        return
    for _, record in fresh(one, seeds, processes, _A_PROCESS):
        yield record


# ---- tables


def tied(record: dict[str, Any], name: str) -> set[str]:
    """A name found, and what these data cannot tell from it."""
    return {name}.union(*(tie for tie in record["ties"] if name in tie))


def first(record: dict[str, Any]) -> str:
    return record["added"][0] if record["added"] else "-"


def is_first(record: dict[str, Any]) -> bool:
    return bool(record["added"]) and record["names"][0] in tied(record, record["added"][0])


def is_found(record: dict[str, Any], name: str) -> bool:
    """By its name, or in a tie."""
    return any(name in tied(record, added) for added in record["added"])


def markdown(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    return "\n".join("| " + " | ".join(cells) + " |" for cells in (head, ["---"] * len(head), *rows))


def share(flags: Sequence[bool]) -> str:
    return f"{sum(flags)} of {len(flags)} ({100 * sum(flags) / len(flags):.0f} %)" if flags else "-"


def of_kind(records: Sequence[dict[str, Any]], *kinds: str) -> list[dict[str, Any]]:
    return [r for r in records if r["kind"] in kinds]


KINDS = ("clean", "single", "outside")


def confusion(records: Sequence[dict[str, Any]]) -> str:
    """Rows: what was in the folder; columns, by number of a row: what was named first."""
    rows = ("clean", *CATALOGUE, *OUTSIDE)
    columns = ("-", *(name for name in CATALOGUE if any(first(r) == name for r in of_kind(records, *KINDS))))
    counts = Counter((r["names"][0] if r["names"] else "clean", first(r)) for r in of_kind(records, *KINDS))
    body = [
        [f"{n} {name}" if n else name, *(str(counts[name, column] or "") for column in columns)]
        for n, name in enumerate(rows)
        if any(counts[name, column] for column in columns)
    ]
    numbers = ["nothing" if column == "-" else str(rows.index(column)) for column in columns]
    return markdown(["in the folder", *numbers], body)


def found(records: Sequence[dict[str, Any]]) -> str:
    """Rates by strength: named first by its own name, first or tied with the first, found at all."""
    body = []
    for label, levels in (*((level, (level,)) for level in LEVELS), ("medium and high", LEVELS[1:])):
        chosen = [r for r in of_kind(records, "single") if r["strength"][0] in levels]
        exact = [first(r) == r["names"][0] for r in chosen]
        alone = [r["added"] == r["names"] for r in chosen]
        anywhere = [is_found(r, r["names"][0]) for r in chosen]
        body.append([label, share(exact), share([is_first(r) for r in chosen]), share(anywhere), share(alone)])
    return markdown(["strength", "named first", "first, or tied with it", "found at all", "and nothing else"], body)


def by_effect(records: Sequence[dict[str, Any]]) -> str:
    """For each effect alone, a strength a column: what was named."""
    body = []
    for name in (*CATALOGUE, *OUTSIDE):
        chosen = [r for r in of_kind(records, "single", "outside") if r["names"] == [name]]
        if chosen:
            body.append([name, *("; ".join(_said(r) for r in chosen if r["strength"] == [level]) for level in LEVELS)])
    return markdown(["in the folder", *LEVELS], body)


def _said(record: dict[str, Any]) -> str:
    named = " + ".join("=".join((name, *sorted(tied(record, name) - {name}))) for name in record["added"]) or "nothing"
    left = record["unexplained"]
    return named if left is None else f"{named}, and {left['enters']} over {left['depends_on']}"


def others(records: Sequence[dict[str, Any]]) -> str:
    """Clean folders, pairs, and what is outside the catalogue."""
    clean, pairs, outside = (of_kind(records, kind) for kind in ("clean", "pair", "outside"))
    both = [[is_found(r, name) for name in r["names"]] for r in pairs]
    lines = [
        ["clean: nothing added", share([r["added"] == [] for r in clean])],
        ["clean: nothing added, nothing unexplained", share([_silent(r) for r in clean])],
        ["pair: both found", share([all(flags) for flags in both])],
        ["pair: at least one found", share([any(flags) for flags in both])],
        ["pair: nothing found that is not there", share([_nothing_else(r) for r in pairs])],
        ["outside: no name given", share([r["added"] == [] for r in outside])],
        ["outside: no name given, called unexplained", share([_open(r) for r in outside])],
        ["outside, medium and high: no name, unexplained", share([_open(r) for r in outside if _clear(r)])],
    ]
    return markdown(["folders", "share"], lines)


def _silent(record: dict[str, Any]) -> bool:
    return record["added"] == [] and record["unexplained"] is None


def _open(record: dict[str, Any]) -> bool:
    return record["added"] == [] and record["unexplained"] is not None


def _clear(record: dict[str, Any]) -> bool:
    return "low" not in record["strength"]


def _nothing_else(record: dict[str, Any]) -> bool:
    return all(tied(record, name) & set(record["names"]) for name in record["added"])


def coverage(records: Sequence[dict[str, Any]]) -> str:
    """How many 95 % intervals hold the truth, before and after, by kind of folder."""
    groups = [
        ("clean", of_kind(records, "clean")),
        ("one effect, low", [r for r in of_kind(records, "single") if not _clear(r)]),
        ("one effect, medium and high", [r for r in of_kind(records, "single") if _clear(r)]),
        ("... found alone", [r for r in of_kind(records, "single") if _clear(r) and r["added"] == r["names"]]),
        ("two effects", of_kind(records, "pair")),
        ("... both found", [r for r in of_kind(records, "pair") if all(is_found(r, name) for name in r["names"])]),
        ("outside the catalogue", of_kind(records, "outside")),
        ("all", list(records)),
    ]
    body = []
    for label, chosen in groups:
        if chosen:
            body.append([label, *_intervals(chosen, "before"), *_intervals(chosen, "after")])
    head = ["folders", "before: inside %", "worst z", "no interval", "after: inside %", "worst z", "no interval"]
    return markdown(head, body)


def _intervals(records: Sequence[dict[str, Any]], when: str) -> list[str]:
    stated = [p for r in records for p in r[when]["parameters"].values()]
    sure = [p for p in stated if p["low"] is not None and p["stderr"]]
    inside = [p["low"] <= p["truth"] <= p["high"] for p in sure]
    z = max((abs(p["value"] - p["truth"]) / p["stderr"] for p in sure), default=float("nan"))
    return [f"{100 * np.mean(inside):.1f}" if inside else "-", f"{z:.1f}", str(len(stated) - len(sure))]


def by_parameter(records: Sequence[dict[str, Any]]) -> str:
    """Of every parameter over all folders: median relative error and coverage, before and after."""
    body = []
    for s in PARAMETERS:
        cells = [s]
        for when in ("before", "after"):
            each = [r[when]["parameters"][s] for r in records]
            sure = [p for p in each if p["low"] is not None]
            error = [100 * abs(p["value"] / p["truth"] - 1) for p in sure]
            inside = [p["low"] <= p["truth"] <= p["high"] for p in sure]
            cells += [f"{np.median(error):.3f}", f"{100 * np.mean(inside):.1f}"] if sure else ["-", "-"]
        body.append(cells)
    return markdown(["parameter", "before: median error %", "inside %", "after: median error %", "inside %"], body)


def held_out(records: Sequence[dict[str, Any]]) -> str:
    """Free-running error on traces never fitted, over the sensors' noise, and over what the body itself leaves.

    The body itself: the generator's own plant under the voltage and at the times that were logged. The noise of that
    voltage and the clock's jitter are in what it leaves as they are in what any model leaves.
    """
    body = []
    for kind in ("clean", "single", "pair", "outside"):
        chosen = of_kind(records, kind)
        for key, channels in (("holdout", ("current", "position")), ("holdout_position", ("position",))):
            if chosen:
                cells = [cell for when in ("before", "after") for cell in _near([r[when][key] for r in chosen])]
                least = [_least(r, channels) for r in chosen]
                over = _near([r["after"][key] / each for r, each in zip(chosen, least, strict=True)])
                body.append([kind, " and ".join(channels), *cells, f"{np.median(least):.2f}", *over])
    head = ["folders", "of", "before: median error / noise", f"within {NEAR}", "after: median", f"within {NEAR}",
            "the body itself: median", "after / the body itself: median", f"within {NEAR}"]  # fmt: skip
    return markdown(head, body)


def _least(record: dict[str, Any], channels: Sequence[str]) -> float:
    """Error over noise that the body itself leaves of these channels of the held-out traces, pooled as a model's is."""
    samples = {(file, channel): n for file, channel, n, _ in record["after"]["holdout_rows"]}
    left = [(samples[file, channel], ratio) for file, channel, ratio in record["by_itself"] if channel in channels]
    count, ratio = np.array(left).T
    return float(np.sqrt(np.sum(count * ratio**2) / count.sum()))


def _near(ratios: Sequence[float]) -> tuple[str, str]:
    return f"{np.median(ratios):.2f}", share([ratio <= NEAR for ratio in ratios])


def tables(records: Sequence[dict[str, Any]]) -> str:
    """All of the README's."""
    failed = [r for r in records if "error" in r]
    good = [r for r in records if "error" not in r]
    seconds = [r["seconds"] for r in good]
    converged = sum(r["after"]["converged"] for r in good)
    summary = (
        f"{len(records)} folders, seeds {min(r['seed'] for r in records)} to {max(r['seed'] for r in records)}; "
        f"{converged} converged, {len(failed)} failed; {np.median(seconds):.0f} s a folder (median), "
        f"{max(seconds):.0f} s at most"
    )
    parts = [confusion, found, others, coverage, by_parameter, held_out, by_effect]
    failures = [f"seed {r['seed']} ({' + '.join(r['names'])}): {r['error']}" for r in failed]
    return "\n\n".join([summary, *(part(good) for part in parts), *failures])


# ---- command line


def saved(file: Path | None) -> list[dict[str, Any]]:
    """What was saved, one record a seed, the last one counting."""
    if file is None or not file.exists():
        return []
    records = (json.loads(line) for line in file.read_text(encoding="utf-8").splitlines())
    latest = {record["seed"]: record for record in records}
    # those of an older program lack what the body itself leaves
    return [r if "by_itself" in r else r | {"by_itself": by_itself(case(seed))} for seed, r in latest.items()]


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
    return f"seed {record['seed']}: {there}: {_said(record)}; {ratio}; {record['seconds']:.0f} s"


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folders", type=int, default=200)
    parser.add_argument("--first-seed", type=int, default=1000)
    parser.add_argument("--only", choices=("clean", "single", "pair", "outside"))
    parser.add_argument("--names", nargs="+", choices=(*CATALOGUE, *OUTSIDE), help="only cases with one of these")
    parser.add_argument("--strength", choices=LEVELS, help="only cases with an effect of this strength")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--save", type=Path, help="append each record to this file as a line of JSON; skip those in it")
    parser.add_argument("--table", type=Path, help="diagnose nothing: the tables of what was saved in this file")
    parser.add_argument("--list", action="store_true", help="diagnose nothing: what each seed is")
    return parser.parse_args()


def main() -> None:
    choices = arguments()
    if choices.table:
        print(tables(saved(choices.table)))
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
