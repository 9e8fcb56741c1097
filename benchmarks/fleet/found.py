"""What a fleet's run folder says, against the truth that the generator kept."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from independent.fleet import FleetTruth


@dataclass(frozen=True)
class Found:
    """Odd units.

    Args:
        right: kinds of the truly odd ones that are listed as odd or have no result, by unit.
        missed: kinds of those that are not, by unit.
        false: units listed as odd that are as all others.
        failed, not_converged: units, whatever they are.
        units: with a result.
    """

    right: dict[str, str]
    missed: dict[str, str]
    false: list[str]
    failed: list[str]
    not_converged: list[str]
    units: int


def fleet_json(run: Path) -> dict[str, Any]:
    """RUN/fleet.json."""
    return json.loads((run / "fleet.json").read_text(encoding="utf-8"))


def judged(run: Path, truth: FleetTruth) -> Found:
    """The run's list of odd units against the truth. A unit that failed is named too, and so is not overlooked."""
    said = fleet_json(run)
    odd, failed = ({each["unit"] for each in said[key]} for key in ("odd", "failed"))
    true = truth.odd
    right = {unit: kind for unit, kind in true.items() if unit in odd | failed}
    missed = {unit: kind for unit, kind in true.items() if unit not in right}
    return Found(right, missed, sorted(odd - true.keys()), sorted(failed),
                 [each["unit"] for each in said["not_converged"]], len(said["units"]))  # fmt: skip
