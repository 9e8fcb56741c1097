"""One folder made, read, fitted, diagnosed and judged: a line of JSON."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from . import under_ecu
from .cases import Case, known, made
from .judging import Z_95, is_right, is_true, wanted
from .judging import found as named_rightly
from .mechanisms import WITHOUT, watched
from .tellable import missed_effects

_SAID = 0.05  # statements that are less likely say hardly anything


def one(chosen: Case) -> dict[str, Any]:
    """The record of a folder; `error` where something broke.

    Keys: `class`, `seed`, `commit`; `truth` (`names`, `strength`, `edges`, and of a mistake its kind, place and size);
    `check` (`refused`, the message, and what was `found`); `named`, in order, each with its probability, its ties and
    whether it is right; `unexplained`, its probability, and `curve`; `chi2` before and after, fitted (over degrees of
    freedom) and held out (free run, over samples); `converged`, `compromise`; `intervals` before and after, of each
    true parameter `z`, whether it `holds`, its `status`; `statements`: what, probability, right or not; `acted`: the
    mechanisms of the diagnosis that changed something (`mechanisms`); `missed`: whether the data could have told the
    effects that were not named (`tellable`); `seconds` of processor time.
    """
    began = time.process_time()
    with tempfile.TemporaryDirectory() as scratch:
        mistake = made(chosen, Path(scratch))
        record = blank(chosen, mistake)
        acted = watched(os.environ.get(WITHOUT, ""))
        try:
            _worked(record, Path(scratch), chosen)
        except Exception as error:
            record["error"] = f"{type(error).__name__}: {error}"[:500]
        record["acted"] = sorted(acted)
    return record | {"seconds": time.process_time() - began}


def blank(chosen: Case, mistake: Mapping[str, Any]) -> dict[str, Any]:
    """What is known of a folder before anything is made of it."""
    truth = {"names": list(chosen.names), "strength": list(chosen.strength), "edges": chosen.edges, "mistake": mistake}
    return {"class": chosen.kind, "seed": chosen.seed, "truth": truth, "check": {"refused": None, "found": []},
            "named": [], "unexplained": None, "curve": None, "chi2": {}, "converged": [], "compromise": False,
            "scale_told": [], "intervals": {}, "statements": [], "acted": [], "missed": {}, "seconds": 0.0}  # fmt: skip


def _worked(record: dict[str, Any], folder: Path, chosen: Case) -> None:
    from etcfit.backend import use_compilation_cache
    from etcfit.errors import MeasurementError
    from etcfit.estimation.joint_fit import fit
    from etcfit.rig.reader import read_folder

    use_compilation_cache()
    try:
        rig = read_folder(folder)
        keys = ("kind", "test", "file", "channel", "size", "chance")
        record["check"]["found"] = [{key: getattr(found, key) for key in keys} for found in rig.findings]
        before = fit(rig)
    except MeasurementError as refused:
        _refused(record, folder, str(refused))
        return
    record["chi2"]["before"] = _chi2(before)
    record["compromise"] = before.compromise is not None
    if chosen.kind == "ecu":
        z, record["scale_told"] = under_ecu.errors(before, chosen.truth, chosen.names[0])
        record["converged"] = [bool(before.converged)]
        holds = {s: {"z": v, "holds": None if v is None else abs(v) < Z_95, "status": ""} for s, v in z.items()}
        record["intervals"] = {"after": holds}
        return
    record["intervals"]["before"] = _intervals(before, known(chosen))
    _diagnosed(record, before, known(chosen))


def _refused(record: dict[str, Any], folder: Path, message: str) -> None:
    """Physics rules the data out, or they cannot be read: the kinds that the message names stand for names."""
    from etcfit.model.rig_effects import RIG_EFFECTS
    from etcfit.rig.checks import DETECTORS

    every = dict.fromkeys(each.kind for each in (*DETECTORS, *RIG_EFFECTS))
    kinds = [kind for kind in every if f"{kind}:" in message]
    record["check"]["refused"] = message.replace(f"{folder}{os.sep}", "")[:500]
    record["named"] = [_named(record, {"name": kind, "kind": kind, "before_any_fit": True}, 1.0, []) for kind in kinds]


def _diagnosed(record: dict[str, Any], before: Any, truth: dict[str, float]) -> None:
    from etcfit.diagnosis import diagnose

    found = diagnose(before)
    chance = found.probabilities
    sizes = {mistake.effect: mistake.size for mistake in found.rig}
    for name in found.added:
        ties = [each for tie in found.ties if name in tie.effects for each in tie.effects if each != name]
        shown = [_described(tied, sizes.get(tied)) for tied in ties]
        record["named"].append(_named(record, _described(name, sizes.get(name)), float(chance.get(name, 1.0)), shown))
    left = found.unexplained
    record["unexplained"] = float(chance["unexplained"]) if "unexplained" in chance else None
    record["curve"] = None if left is None else f"{left.enters} over {left.depends_on}"
    record["statements"] = _statements(record, chance)
    record["chi2"]["after"] = _chi2(found.after)
    record["converged"] = [bool(before.converged), bool(found.after.converged)]
    record["compromise"] = found.after.compromise is not None
    # bristles share dry friction with T_f, as the generator has it by themselves: it has no truth beside them
    judged = {s: v for s, v in truth.items() if s != "T_f" or "presliding_friction" not in found.final}
    record["intervals"]["after"] = _intervals(found.after, judged)
    record["missed"] = _missed(record, before, found.after)


def _missed(record: dict[str, Any], before: Any, after: Any) -> dict[str, Any]:
    """Of effects of the catalogue that are there and have no name: could these data have told them?"""
    names = record["truth"]["names"]
    missing = [name for name in wanted(record) if name not in named_rightly(record)]
    of_catalogue = record["class"] in ("single", "pair") and missing
    return missed_effects(before, after, names, missing) if of_catalogue else {}


def _described(name: str, size: float | None) -> dict[str, Any]:
    """A name, and of a mistake of the rig its kind, what its size makes of it, and where it is."""
    from etcfit.model.rig_effects import rig_effect

    effect = rig_effect(name)
    if effect is None:
        return {"name": name, "kind": name}
    place = effect.place
    return {"name": name, "kind": effect.kind, "called": effect.called(size or 0.0), "size": size,
            "test": place.test, "channel": place.channel, "file": place.file}  # fmt: skip


def _named(record: dict[str, Any], name: dict[str, Any], probability: float, ties: list[dict[str, Any]]):
    named = {**name, "probability": probability, "ties": ties}
    return named | {"right": is_right(record["truth"], named)}


def _statements(record: dict[str, Any], chance: Mapping[str, float]) -> list[list[Any]]:
    """What was stated with some probability, and whether it is so."""
    out = []
    for what, p in chance.items():
        if p < _SAID:
            continue
        named = next((n for n in record["named"] if n["name"] == what), None) or _described(what, None)
        right = is_true(record, what) if what in ("nothing", "unexplained") else is_right(record["truth"], named)
        out.append([what, float(p), right])
    return out


def _chi2(result: Any) -> dict[str, float | None]:
    """Of the fitted traces whitened, over degrees of freedom; of those held out free-running, over samples."""
    from etcfit.problem.prediction_error import pooled

    held = pooled(result.score_holdout) ** 2 if result.score_holdout else None
    return {"fitted": float(result.chi2_per_dof), "held_out": held}


def _intervals(result: Any, truth: Mapping[str, float]) -> dict[str, dict[str, Any]]:
    """Of each true parameter: z where a standard error is stated, whether the 95 % interval holds it, the status."""
    from etcfit.estimation.intervals import intervals, lumped

    stated, out = {**lumped(result), **intervals(result)}, {}
    for symbol, true in truth.items():
        each = stated[symbol]
        z = (each.value - true) / each.stderr if each.stderr else None
        holds = None if each.low is None or each.high is None else bool(each.low <= true <= each.high)
        out[symbol] = {"z": z, "holds": holds, "status": each.status}
    return out
