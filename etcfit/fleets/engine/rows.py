"""What a unit leaves behind as a row of a table, and back, bit for bit.

A failed unit has a `why` and no data. Matrices lie in a row as the list of their numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np

from ..unit import FailedUnit, TraceMisfit, UnitEstimate, UnitParameter, UnitResult


@cache
def schema() -> Any:
    """The columns, for pyarrow."""
    import pyarrow as pa

    text, number = pa.string(), pa.float64()
    parameter = [("symbol", text), ("value", number), ("unit", text), ("stderr", number), ("low", number),
                 ("high", number), ("status", text)]  # fmt: skip
    trace = [("file", text), ("test", text), ("misfit", number)]
    return pa.schema(
        [
            ("unit", text),
            ("digest", text),
            ("why", text),
            ("symbols", pa.list_(text)),
            ("estimate", pa.list_(number)),
            ("information", pa.list_(number)),
            ("parameters", pa.list_(pa.struct(parameter))),
            ("traces", pa.list_(pa.struct(trace))),
            ("chi2_per_dof", number),
            ("converged", pa.bool_()),
            ("reason", text),
            ("synthetic", pa.bool_()),
            ("seconds", number),
            ("warnings", pa.list_(text)),
            ("widening", pa.list_(number)),
        ]
    )


def row_of(end: UnitResult | FailedUnit) -> dict[str, Any]:
    """One unit's row."""
    if isinstance(end, FailedUnit):
        return {"unit": end.unit, "digest": end.digest, "why": end.why}
    return {
        "unit": end.unit,
        "digest": end.digest,
        "why": None,
        "symbols": end.own.symbols,
        "estimate": end.own.estimate,
        "information": end.own.information.ravel(),
        "parameters": [{"symbol": symbol, **vars(each)} for symbol, each in end.parameters.items()],
        "traces": [vars(each) for each in end.traces],
        **{name: getattr(end, name) for name in _ALIKE},
        "warnings": end.warnings,
        "widening": [end.widening[symbol] for symbol in end.own.symbols] if end.widening else None,
    }


def end_of(row: Mapping[str, Any]) -> UnitResult | FailedUnit:
    """What `row_of` made a row of."""
    if row["why"] is not None:
        return FailedUnit(row["unit"], row["why"], row["digest"])
    estimate = np.array(row["estimate"], dtype=float)
    information = np.array(row["information"], dtype=float).reshape(estimate.size, estimate.size)
    return UnitResult(
        own=UnitEstimate(row["unit"], tuple(row["symbols"]), estimate, information),
        parameters={each["symbol"]: _parameter(each) for each in row["parameters"]},
        traces=tuple(TraceMisfit(**each) for each in row["traces"]),
        digest=row["digest"],
        warnings=tuple(row["warnings"]),
        widening=dict(zip(row["symbols"], row["widening"], strict=True)) if row["widening"] else {},
        **{name: row[name] for name in _ALIKE},
    )


_ALIKE = ("chi2_per_dof", "converged", "reason", "synthetic", "seconds")


def _parameter(held: Mapping[str, Any]) -> UnitParameter:
    return UnitParameter(**{name: value for name, value in held.items() if name != "symbol"})
