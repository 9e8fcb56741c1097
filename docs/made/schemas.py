"""The schema of a JSON file that is declared, and the table of a file's keys, made from its schema."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from etcfit.run_folder.declared import schema_of_file
from etcfit.run_folder.diagnosis import DIAGNOSIS
from etcfit.run_folder.drive import DRIVE
from etcfit.run_folder.fit import FIT
from etcfit.run_folder.fleet import STUDY
from etcfit.run_folder.manifest import RUN
from etcfit.run_folder.pid import PID
from etcfit.run_folder.plan import ADVICE, PLAN
from etcfit.run_folder.plant import FREQUENCY_RESPONSE, TRANSFER_FUNCTION
from etcfit.run_folder.posterior import POSTERIOR
from etcfit.run_folder.tune import TUNE

FOLDER = Path(__file__).resolve().parents[2] / "etcfit" / "run_folder" / "schemas"
DECLARED = {  # kinds of files whose schema follows from a declaration
    "advice": ADVICE,
    "diagnosis": DIAGNOSIS,
    "drive": DRIVE,
    "fit": FIT,
    "fleet": STUDY,
    "frequency_response": FREQUENCY_RESPONSE,
    "pid": PID,
    "plan": PLAN,
    "posterior": POSTERIOR,
    "run": RUN,
    "transfer_function": TRANSFER_FUNCTION,
    "tune": TUNE,
}


def text_of(kind: str) -> str:
    """The schema of a declared file as it is committed."""
    return json.dumps(schema_of_file(kind, DECLARED[kind]), indent=2, ensure_ascii=False) + "\n"


def table(kind: str) -> str:
    """One row a key, keys of keys behind a dot; keys that may be absent are marked."""
    schema = json.loads((FOLDER / f"{kind}.schema.json").read_text(encoding="utf-8"))
    rows = ["| key | type | meaning |", "| --- | --- | --- |"]
    for path, part, always in keys(schema, schema, ""):
        absent = "" if always else " *(optional)*"
        rows.append(f"| `{path}` | {type_of(part)} | {part.get('description', '')}{absent} |")
    return "\n".join(rows)


def keys(schema: dict[str, Any], root: dict[str, Any], above: str) -> Iterator[tuple[str, dict[str, Any], bool]]:
    """Path, sub-schema and whether it is always there, depth first."""
    required = set(schema.get("required", ()))
    for name, raw in schema.get("properties", {}).items():
        path, part = f"{above}{name}", resolved(raw, root)
        yield path, part, name in required
        yield from below(part, root, path)


def below(part: dict[str, Any], root: dict[str, Any], path: str) -> Iterator[tuple[str, dict[str, Any], bool]]:
    """What lies inside an object, an array of objects, or a mapping of objects."""
    for choice in part.get("anyOf", ()):
        yield from below(resolved(choice, root), root, path)
    yield from keys(part, root, f"{path}.")
    if isinstance(part.get("items"), dict):
        yield from below(resolved(part["items"], root), root, f"{path}[]")
    if isinstance(part.get("additionalProperties"), dict):
        yield from below(resolved(part["additionalProperties"], root), root, f"{path}.NAME")


def resolved(part: dict[str, Any], root: dict[str, Any]) -> dict[str, Any]:
    """A `$ref` replaced by what it names; a description beside it wins."""
    if "$ref" not in part:
        return part
    named = root["$defs"][part["$ref"].rsplit("/", 1)[-1]]
    return {**named, **{key: value for key, value in part.items() if key != "$ref"}}


def type_of(part: dict[str, Any]) -> str:
    """In words: "number or null"."""
    if "const" in part:
        return f"`{json.dumps(part['const'])}`"
    kinds = part.get("type")
    if kinds is None:
        kinds = [kind for choice in part.get("anyOf", ()) for kind in [choice.get("type", "object")]]
    return " or ".join(dict.fromkeys([kinds] if isinstance(kinds, str) else kinds))
