"""Units whose own model does not explain their own traces as well as the other units' models explain theirs.

    z = (log m_u - median log m) / (1.4826 MAD),   m: chi2 per degree of freedom, or the misfit of one trace

A ground of its own: it needs no covariance, and a defect that no parameter can imitate moves no estimate but the
misfit. Traces are compared with those of the same file name, or of the same rig test where names are a unit's own. Only
the high side counts: better explained than others is not odd.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy import stats

from ..unit import UnitResult
from .multiplicity import MANY
from .settings import OddSettings

COMMON = 0.5  # share of the units that must have a file for its name to be the line's


@dataclass(frozen=True)
class TraceScore:
    """A trace against those like it.

    Args:
        file: below the unit's folder.
        misfit: root mean square of its whitened residual.
        z: of log misfit, robust standard deviations above the median.
    """

    file: str
    misfit: float
    z: float


@dataclass(frozen=True, eq=False)
class Misfits:
    """N units.

    Args:
        whole: z of chi2 per degree of freedom, shape (N,).
        traces: of each unit, worst first.
        p: that an ordinary unit is as badly explained, shape (N,).
    """

    whole: Float[np.ndarray, " N"]
    traces: tuple[tuple[TraceScore, ...], ...]
    p: Float[np.ndarray, " N"]


def misfits(results: Sequence[UnitResult], settings: OddSettings) -> Misfits:
    """Of all units, two p values each (the whole, the worst trace) made one by Bonferroni."""
    whole = robust_scores(np.array([each.chi2_per_dof for each in results]), settings)
    traces = _traces(results, settings)
    worst = np.array([t[0].z if t else 0.0 for t in traces])
    many = np.array([max(len(t), 1) for t in traces])
    of_worst = -np.expm1(many * np.log1p(-np.minimum(stats.norm.sf(worst), 1.0 - 1e-16)))
    return Misfits(whole, traces, np.minimum(1.0, 2.0 * np.minimum(stats.norm.sf(whole), of_worst)))


def robust_scores(value: np.ndarray, settings: OddSettings) -> np.ndarray:
    """(log value - median) / scale; the scale is the widest of MAD, upper tail, and the least that means anything."""
    log = np.log(np.maximum(value, 1e-300))
    middle = float(np.median(log))
    scale = max(1.4826 * float(np.median(np.abs(log - middle))), settings.least_scatter)
    if len(log) >= MANY:
        reach = float(np.quantile(log, 0.5 + 0.5 * settings.tail)) - middle
        scale = max(scale, reach / float(stats.norm.ppf(0.5 + 0.5 * settings.tail)))
    return (log - middle) / scale


def _traces(results: Sequence[UnitResult], settings: OddSettings) -> tuple[tuple[TraceScore, ...], ...]:
    having: dict[str, int] = defaultdict(int)
    for each in results:
        for trace in each.traces:
            having[trace.file] += 1
    groups: dict[str, list[tuple[int, str, float]]] = defaultdict(list)
    for u, each in enumerate(results):
        for trace in each.traces:
            alike = trace.file if having[trace.file] >= COMMON * len(results) else f"any {trace.test}"
            groups[alike].append((u, trace.file, trace.misfit))
    out: list[list[TraceScore]] = [[] for _ in results]
    for group in groups.values():
        for (u, file, misfit), z in zip(group, robust_scores(np.array([m for *_, m in group]), settings), strict=True):
            out[u].append(TraceScore(file, misfit, float(z)))
    return tuple(tuple(sorted(t, key=lambda s: -s.z)) for t in out)
