"""What was found in a folder, one record a seed: made, and read from files."""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from independent import left_by_itself, make_folder

from ..processes import fresh
from .cases import PARAMETERS, Case, case, known

_A_PROCESS = 8  # folders


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
    from etcfit.diagnosis import diagnose
    from etcfit.estimation.joint_fit import fit
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
        "rounds": [_round(turn) for turn in diagnosis.rounds],
        "probabilities": dict(diagnosis.probabilities),
        "unexplained": None
        if left is None
        else {"enters": left.enters, "depends_on": left.depends_on, "bic_change": left.bic_change},
        "before": _standing(result, known(chosen)),
        "after": _standing(diagnosis.after, known(chosen)),
    }


def _round(turn: Any) -> dict[str, Any]:
    """What was added, and what every effect that was refitted would have made of BIC and of the held-out error."""
    tried = [[c.effect, c.bic_change, c.holdout_rms_ratio] for c in turn.candidates if c.refitted]
    return {"added": turn.added, "ties": list(turn.ties), "tried": tried}


def _standing(result: Any, truth: dict[str, float]) -> dict[str, Any]:
    """How well a model predicts what it has not seen, and what it says of each parameter."""
    from etcfit.estimation.intervals import intervals
    from etcfit.problem.prediction_error import pooled

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


def saved(file: Path | None) -> list[dict[str, Any]]:
    """What was saved, one record a seed, the last one counting."""
    if file is None or not file.exists():
        return []
    records = (json.loads(line) for line in file.read_text(encoding="utf-8").splitlines())
    latest = {record["seed"]: record for record in records}
    # those of an older program lack what the body itself leaves
    return [r if "by_itself" in r else r | {"by_itself": by_itself(case(seed))} for seed, r in latest.items()]
