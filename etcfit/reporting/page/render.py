"""The page's parts in its template, with the files and versions from which it was made."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import chain
from typing import Any

from ..control.gains import design_parts
from ..control.plant import plant_tables, sine_parts
from ..control.sentence import cautions, why_withheld, withheld
from ..diagnosis import diagnosis_parts, how_sure
from ..html import environment, polynomial
from ..table import Column, Part, Table, there
from ..tables import LOST, entries, errors_table, knowledge_parts, parameters_table
from ..tune import tables_of_steps
from . import Contents, logs_of, rows_of, tuned_of
from .pictures import BUDGET, groups
from .verdict import model, verdict


def files_table(contents: Contents) -> Table:
    """SHA-256 of every measurement file at the time of the fit, and of the run's present files."""
    fit = contents.files["fit"]
    role = {row["file"]: "held out" for row in fit["score"]["holdout"]}
    role |= {row["file"]: "fitted" for row in fit["score"]["fit"]}
    rows = [
        (file, role.get(file, "read"), digest or "no longer there") for file, digest in (fit.get("files") or {}).items()
    ]
    rows += [(name, "result", digest) for name, digest in contents.hashes.items()]
    return Table("Files", (Column("file", 0, "word"), Column("", 1, "word"), Column("SHA-256", 2, "hash")), rows)


def versions_table(contents: Contents) -> Table:
    """Versions of each step; steps with the same versions share a line."""
    steps: dict[tuple[str, str], list[str]] = {}
    for kind, content in contents.files.items():
        for name, version in (content.get("versions") or {}).items():
            steps.setdefault((name, version), []).append(kind.replace("_", " "))
    rows = [(name, version, ", ".join(kinds)) for (name, version), kinds in steps.items()]
    return Table("Versions", (Column("", 0, "word"), Column("version", 1, "word"), Column("used by", 2, "word")), rows)


def _of_posterior(posterior: Mapping[str, Any]) -> list[Part]:
    if not posterior:
        return []
    from ..posterior import posterior_parts  # with it comes emcee, which takes a second

    return posterior_parts(posterior)


def _errors(contents: Contents) -> Table:
    """Errors before and after a diagnosis, else those of the fit."""
    fitted, held_out = (rows_of(contents.score[part]) for part in ("fit", "holdout"))
    found, before = contents.get("diagnosis"), None
    if found:
        before = rows_of(found["before"]["fit"]), rows_of(found["before"]["holdout"])
    return errors_table(entries(fitted, held_out, before), bool(found))


def stale(contents: Contents) -> list[str]:
    """Results that were made from other files than the fit."""
    files = contents.files["fit"].get("files") or {}
    out = []
    for kind, content in contents.files.items():
        theirs = content.get("files")
        if isinstance(theirs, dict) and theirs and files and theirs != files:
            changed = sorted(f for f in {*files, *theirs} if files.get(f) != theirs.get(f))
            out.append(f"{kind}.json was made of other data than fit.json ({', '.join(changed[:4])}): run it again.")
    return out


def to_record(logs: Mapping[str, Any]) -> list[str]:
    """A line for each log to record next; none for an older drive.json."""
    return [f"Record next: {each['record']}. It determines {each['why']}." for each in logs.get("record_next") or ()]


def render(contents: Contents, budget: int = BUDGET) -> str:
    """The whole page, HTML; its pictures may take so many bytes."""
    made = environment(("etcfit.reporting.page", "template"))
    return made.get_template("page.html").render(**_parts(contents, budget))


def _parts(contents: Contents, budget: int) -> dict[str, Any]:
    fit, diagnosis, plant, pid = (contents.get(k) for k in ("fit", "diagnosis", "transfer_function", "pid"))
    response, tuned = contents.get("frequency_response"), tuned_of(contents.run)
    return {
        "tuned": tuned,
        "tables_of_steps": tables_of_steps(tuned) if tuned else (),
        "rig": fit["rig"],
        "synthetic": fit["synthetic"],
        "folder": fit.get("folder"),
        "model": model(contents),
        "verdict": verdict(contents),
        "converged": contents.final.get("converged", True),
        "reason": contents.final.get("reason"),
        "parameters": [
            parameters_table(
                contents.final["parameters"],
                {} if contents.added else fit.get("lumped") or {},
                "Parameters of the final model",
            ),
            *_of_posterior(contents.get("posterior")),
            # the fit's own sentences do not apply if a diagnosis has replaced its model
            *knowledge_parts(contents.final if contents.added else {**fit, **contents.final}),
        ],
        "lost": [s for s, p in contents.final["parameters"].items() if p["status"] == LOST],
        "ledger": _errors(contents),
        "diagnosis": diagnosis,
        "found": there(how_sure(diagnosis), *diagnosis_parts(diagnosis)),
        "plant": plant,
        "formula": {key: polynomial(plant[key]) for key in ("num", "den")} if plant else None,
        "plant_tables": plant_tables(plant),
        "plant_cautions": cautions(plant),
        "sines": sine_parts(response) if response.get("points") else [],
        "gains": design_parts(pid) if pid else [],
        "gains_cautions": (why_withheld(pid),) if withheld(pid) else cautions(pid),
        "warnings": [*stale(contents), *_warnings(contents)],
        "to_record": to_record(logs_of(contents.run)),
        "groups": groups(contents.run, budget),
        "files": files_table(contents),
        "versions": versions_table(contents),
    }


def _warnings(contents: Contents) -> Iterator[str]:
    """Warnings of the final model, then of results made from it; each once."""
    of_model = contents.final.get("warnings", contents.get("fit").get("warnings"))
    later = (
        contents.get(kind).get("warnings") for kind in ("posterior", "transfer_function", "frequency_response", "pid")
    )
    yield from dict.fromkeys(chain.from_iterable(said or () for said in (of_model, *later)))
