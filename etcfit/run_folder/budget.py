"""The uncertainty budget as JSON: which part of an interval is statistical, which the instruments' stated accuracy."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..estimation.joint_fit import FitResult
from ..files import plain


def budget_json(result: FitResult) -> dict[str, Any]:
    """`intervals` says what they allow for; `budget` has the shares of each parameter's variance, by source."""
    budget = result.budget
    if budget is None:
        return {"intervals": "statistical only", "budget": {}}
    slope = np.abs(result.free_parameters.layout.numbers(result.x)[1])
    statistical = slope * np.sqrt(np.maximum(np.diag(budget.statistical), 0.0))
    shares = budget.shares()
    known = [s not in result.identifiability.lost for s in result.free_parameters.layout.free]
    return {
        "intervals": "statistical and stated accuracy",
        "budget": {
            symbol: plain({
                "stderr_statistical": float(statistical[k]),
                "shares": dict(zip((*budget.sources, "statistical"), shares[:, k].tolist(), strict=True)),
            })
            for k, symbol in enumerate(result.free_parameters.layout.free)
            if known[k]
        },
    }  # fmt: skip
