"""The uncertainty budget for a terminal: which source makes which share of each parameter's variance."""

from __future__ import annotations

from rich.console import RenderableType
from rich.text import Text

from ..estimation.joint_fit import FitResult
from ..run_folder.fit import budget_json
from .blocks import headed, plain_table, spaced
from .numbers import short

STATISTICAL_ONLY = "Intervals are statistical only: rig.toml states no [accuracy] of its instruments."
_SHOWN = 0.01  # least share of the variance that is named


def budget_table(result: FitResult) -> RenderableType:
    """One row a parameter, one column a source; or that intervals are statistical only."""
    if result.budget is None:
        return spaced(Text(STATISTICAL_ONLY, style="dim"))
    table = plain_table(
        "parameter", "statistical standard error", "unit", "statistical share, %", "shares of the instruments",
        words=("unit",), prose=("shares of the instruments",), spare=("statistical standard error",),
        file="RUN/fit.json",
    )  # fmt: skip
    units = {parameter.symbol: parameter.unit for parameter in result.free_parameters.layout.parameters}
    for symbol, row in budget_json(result)["budget"].items():
        shares = dict(row["shares"])
        own = shares.pop("statistical")
        largest = sorted(((share, source) for source, share in shares.items() if share > _SHOWN), reverse=True)
        words = ", ".join(f"{source} {100.0 * share:.0f} %" for share, source in largest)
        table.add_row(symbol, short(row["stderr_statistical"]), units[symbol], f"{100.0 * own:.0f}", words)
    return headed("Where the uncertainty comes from, as shares of the variance", table)
