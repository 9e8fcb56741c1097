"""How `etcfit tune` ends."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ...errors import command
from ..numbers import short
from .base import Closing


def of_tune(found: Any, run: Path, files: Sequence[Path]) -> Closing:
    """The half-way gains where the present ones are known, else the proposed ones; or why there are none."""
    look = (run / "pictures" / "tune.png",)
    if found.why_not:
        return Closing(f"Not from this log. {found.why_not}", _mended(found, run, files), look)
    step = found.steps[min(1, len(found.steps) - 1)]
    words = ", ".join(f"{name} {short(gain, 4)}" for name, gain in
                      zip(found.profile.gains, found.written(step.gains), strict=True))  # fmt: skip
    which = "Half-way gains to try first" if len(found.steps) > 1 else "Proposed gains"
    doubt = " In spite of this: " + " ".join(found.doubts) if found.doubts else ""
    again = f"etcfit tune NEXT_LOG --ecu {found.profile.name} --present P,I,D --out {shlex.quote(str(run))}"
    return Closing(
        f"{which}: {words}.{doubt}", f"type them in, engine off, log the same moves again, then {again}", look
    )


def _mended(found: Any, run: Path, files: Sequence[Path]) -> str:
    stopped = found.input.stopped_by
    if stopped:
        return stopped[0].cure
    listed = " ".join(shlex.quote(str(file)) for file in files)
    return (f"look at {command('report', run)}; the gains all the same: etcfit tune {listed} --ecu "
            f"{found.profile.name} --anyway --out {shlex.quote(str(run))}")  # fmt: skip
