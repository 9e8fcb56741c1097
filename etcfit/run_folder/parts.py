"""The parts of one design, from the run folder of a fleet."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..control.fleet import EVERY_UNIT, Parts
from ..errors import UsageError
from .fleet import model_in, read_fleet_files


def parts_of(run: Path) -> Parts:
    """The parts of one design that a fleet found, for the design of one of them.

    What the fleet's population leaves out, and what has no result or none that converged, is none of them: its values
    are not known, or it is something else.

    Raises:
        UsageError: see `read_fleet_files`; too few units to say how parts scatter.
    """
    files = read_fleet_files(run)
    model, left_out = model_in(files), _left_out(files.content)
    if model.law.units < EVERY_UNIT.fewest:
        raise UsageError(f"{run}: its population is known from {model.law.units} units, too few to say how parts "
                         f"scatter. Measure {EVERY_UNIT.fewest} at least, and run `etcfit fleet` again.")  # fmt: skip
    kept = np.flatnonzero([unit not in left_out for unit in model.units])
    if not kept.size:
        raise UsageError(f"{run} holds no unit whose fit can be trusted. The page fleet.html says why of each.")
    return Parts(str(run), str(files.content["name"]), model.taking(kept), left_out)


def _left_out(content: Mapping[str, Any]) -> dict[str, str]:
    """Units that are none of the parts, with why."""
    odd = {each["unit"]: f"odd: {each['why']}" for each in content["odd"]}
    apart = {unit: odd.get(unit, "too far from the others") for unit in content["left_out"]}
    failed = {each["unit"]: f"no result: {each['why']}" for each in content["failed"]}
    return apart | {each["unit"]: f"did not converge: {each['why']}" for each in content["not_converged"]} | failed
