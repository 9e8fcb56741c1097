"""The table: a column a tool, in Markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..page import Between

PLACE = Between.named("peers")


@dataclass(frozen=True)
class Column:
    """What is known of a tool; None or nothing where there is no such figure.

    Args:
        name: in the table's head.
        values: SI by symbol.
        cpu, wall: of its process, s.
        peak: largest resident set, MiB.
        own: chi2 per degree of freedom by its own model.
        accurate: the same of its values by the independent simulation.
        words: how it ended, or why it did not.
    """

    name: str
    values: Mapping[str, float]
    cpu: float | None = None
    wall: float | None = None
    peak: float | None = None
    own: float | None = None
    accurate: float | None = None
    words: str = ""


def error(values: Mapping[str, float], truth: Mapping[str, float], symbol: str) -> float | None:
    """(value / truth - 1), %; None without a value."""
    return 100.0 * (values[symbol] / truth[symbol] - 1.0) if symbol in values else None


def table(columns: Sequence[Column], truth: Mapping[str, float], stderr: Mapping[str, float]) -> str:
    """Figures by tool, and what is to be said of each below.

    Args:
        columns: the tools.
        truth: SI by symbol, of the parameters that are compared.
        stderr: one standard error of a fit, %, by symbol.
    """
    head = ["", *(column.name for column in columns), "one standard error"]
    rows = [
        ["processor time, s", *(number(c.cpu) for c in columns), ""],
        ["wall time, s", *(number(c.wall) for c in columns), ""],
        ["memory, MiB", *(number(c.peak) for c in columns), ""],
        ["chi2/dof, own model", *(number(c.own, 4) for c in columns), ""],
        ["chi2/dof, exact simulation", *(number(c.accurate, 4) for c in columns), ""],
        *(
            [f"error of `{s}`, %", *(signed(error(c.values, truth, s)) for c in columns), number(stderr.get(s), 2)]
            for s in truth
        ),
        ["errors over standard errors, rms", *(number(off(c.values, truth, stderr), 2) for c in columns), ""],
    ]
    lines = ["| " + " | ".join(cells) + " |" for cells in (head, ["---"] * len(head), *rows)]
    said = [f"- {column.name}: {column.words}" for column in columns if column.words]
    return "\n".join([*lines, "", *said] if said else lines)


def off(values: Mapping[str, float], truth: Mapping[str, float], stderr: Mapping[str, float]) -> float | None:
    """Root mean square of the errors, each over its standard error; None where a value or all errors lack."""
    if not stderr or not truth.keys() <= values.keys():
        return None
    each = [100.0 * (values[s] / truth[s] - 1.0) / stderr[s] for s in truth if s in stderr]
    return float(np.sqrt(np.mean(np.square(each))))


def number(value: float | None, digits: int = 3) -> str:
    """So many digits, never an exponent; nothing where there is no figure."""
    if value is None:
        return ""
    return f"{value:.0f}" if abs(value) >= 10.0 ** (digits - 1) else f"{value:.{digits}g}"


def signed(value: float | None) -> str:
    """Three decimals and a sign."""
    return "" if value is None else f"{value:+.3f}"
