"""What made-up data were made from, where their maker left a note of it."""

from __future__ import annotations

import json
from pathlib import Path

from ..problem.free_parameters import SERIES
from ..rig.base import Rig

_NOTE, _CIRCUIT = "truth.json", "inductance"


def truths(rig: Rig) -> dict[str, float]:
    """SI by symbol, from truth.json beside rig.toml; empty for measured data and where nobody wrote it."""
    note = Path(rig.folder) / _NOTE
    if not (rig.config.synthetic and note.is_file()):
        return {}
    known = json.loads(note.read_text(encoding="utf-8"))
    series = {SERIES + _CIRCUIT: known["series_ohm"]} if "series_ohm" in known else {}
    return {s: float(v) for s, v in (known["parameters"] | series).items()}
