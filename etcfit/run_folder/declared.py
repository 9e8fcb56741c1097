"""Parts of the JSON schemas that follow from declared figures.

`python -m etcfit.run_folder.declared` writes them anew.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ..control.pid.figures import MARGINS, REQUIRED, LoopFigures
from ..files import whole
from ..model.figure import schema_of

FOLDER = Path(__file__).parent / "schemas"
_LOOP = "How well a loop follows its setpoint, and what that costs; null is infinite, absent, or not computed there."
_LIMITS = "What each figure must stay below; null for no limit."
_MARGINS = "At least; asked of the rule optimal only."
PARTS: dict[str, dict[tuple[str, ...], dict[str, Any]]] = {
    "pid": {
        ("$defs", "metrics"): schema_of(LoopFigures, _LOOP),
        ("properties", "requirements"): schema_of(LoopFigures, _LIMITS, REQUIRED),
        ("properties", "margins_asked"): schema_of(LoopFigures, _MARGINS, MARGINS),
    },
}
"""By kind of file and path within its schema."""


def with_declared(kind: str, schema: dict[str, Any]) -> dict[str, Any]:
    """A schema with what is declared put in its place."""
    for (*above, last), part in PARTS.get(kind, {}).items():
        place = schema
        for key in above:
            place = place[key]
        place[last] = part
    return schema


def main() -> None:
    """Write every schema anew that has such parts."""
    for kind in PARTS:
        path = FOLDER / f"{kind}.schema.json"
        schema = with_declared(kind, json.loads(path.read_text(encoding="utf-8")))
        with whole(path) as draft:
            draft.write_text(json.dumps(schema, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
