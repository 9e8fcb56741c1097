"""Who pulls what and who contradicts whom, as fit.json and diagnosis.json have it."""

from __future__ import annotations

from typing import Any

from ..estimation.result import FitResult
from ..files import plain

_LEAST, _MOST = 0.5, 50  # standard errors a pull must have to be written, and how many are


def influence_json(result: FitResult) -> dict[str, Any]:
    """The keys `influence`, `only_told_by`, `contradictions` and `compromise`."""
    layout = result.free_parameters.layout
    unit = {p.symbol: p.unit for p in layout.parameters}
    return {
        "influence": [plain({"test": p.test, "file": p.file, "parameter": p.parameter, "pull": p.pull})
                      for p in result.influence.largest(_LEAST, _MOST)],
        "only_told_by": dict(result.influence.alone),
        "contradictions": [
            plain({"test": c.test, "parameter": c.parameter, "pull": c.pull, "value": c.value, "without": c.without,
                   "unit": unit[c.parameter], "p": c.p, "share": c.share})
            for c in result.contradictions
        ],
        "compromise": None if result.compromise is None else result.compromise.why,
    }  # fmt: skip
