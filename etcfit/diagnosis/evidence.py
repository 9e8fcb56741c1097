"""Is the residual noise, and if not, what does it go along with?

Per channel and trace: Ljung and Box's test, the size of the whitened residual, and its correlation with what the plate
and its input did. Over all traces: how much of the missing torque and voltage is a function of one quantity alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy import stats

from ..estimation.autocorrelation import ljung_box
from ..problem.prediction_error import columns
from ..problem.trace import Trace
from .findings import Evidence, Share, Whiteness
from .missing_torque import missing_voltage, pull_of, signals
from .trial import CandidateModel

_LEVEL = 1e-4  # p-value below which a channel is not white
_LARGE = 0.03  # relative excess of a residual's rms that no estimate of the noise explains
_BINS = 24
_AXES = {"torque": ("angle", "speed", "current", "load", "time"), "voltage": ("current", "speed", "angle", "time")}
_FEWEST = 200  # samples from which a share is read
_WORTH = 0.05  # share worth a sentence


def evidence(s: CandidateModel) -> Evidence:
    """Test the residual of the fitted traces."""
    guide_stiffness = pull_of(s.problem, s.x)
    r = columns(s.problem.batch, s.problem.residual(s.x, s.weighted) * (_weighed(s) if s.far else 1.0))
    along = signals(s.problem, s.x, guide_stiffness)
    rows = [w for t, part, sig in zip(s.problem.batch.traces, r, along, strict=True) for w in _channels(t, part, sig)]
    volts = missing_voltage(s.problem, s.x, guide_stiffness)
    shares = sorted((*_shares("torque", along, [a["torque"] for a in along]), *_shares("voltage", along, volts)),
                    key=lambda share: -share.share)  # fmt: skip
    white = all(row.white for row in rows)
    return Evidence(tuple(rows), white, tuple(shares), tuple(_sentences(rows, shares)))


def _weighed(s: CandidateModel) -> np.ndarray:
    """By how much each sample was weighed down, shape (T, L, M): a residual is judged by its noise."""
    return s.problem.sigma / s.problem.batch.slots.sigma


def _channels(trace: Trace, r: np.ndarray, along: dict[str, np.ndarray]) -> list[Whiteness]:
    regressors = {
        "input": along["input"],
        "speed": along["speed"],
        "sign of speed": np.sign(along["speed"]),
        "angle": along["angle"],
        "current": along["current"],
        "time": along["time"],
    }
    out = []
    for m, channel in enumerate(trace.channels):
        seen = np.isfinite(trace.data[:, m])
        own = r[seen, m]
        name, rho = _strongest(own, {k: v[seen] for k, v in regressors.items()})
        p = min(1.0, len(regressors) * 2.0 * float(stats.norm.sf(abs(rho) * math.sqrt(own.size))))
        size, box = float(np.sqrt(np.mean(own**2))), ljung_box(own)
        fair = size < 1.0 + _LARGE + 5.0 / math.sqrt(2.0 * own.size)
        white = fair and box > _LEVEL and p > _LEVEL
        file, test = trace.measurement.file, trace.measurement.test
        out.append(Whiteness(file, test, channel, own.size, size, box, name, rho, p, white))
    return out


def _strongest(r: np.ndarray, regressors: dict[str, np.ndarray]) -> tuple[str, float]:
    every = {name: _correlation(r, signal) for name, signal in regressors.items()}
    name = max(every, key=lambda key: abs(every[key]))
    return name, every[name]


def _correlation(a: np.ndarray, b: np.ndarray) -> float:
    a, b = a - a.mean(), b - b.mean()
    power = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / power if power > 0.0 else 0.0


def _shares(enters: str, along: Sequence[dict[str, np.ndarray]], missing: Sequence[np.ndarray]) -> list[Share]:
    y = np.concatenate(missing)
    seen = np.isfinite(y)
    if seen.sum() < _FEWEST:
        return []
    return [Share(enters, axis, explained(np.concatenate([a[axis] for a in along])[seen], y[seen]))
            for axis in _AXES[enters]]  # fmt: skip


def explained(axis: np.ndarray, y: np.ndarray) -> float:
    """Share of the variance of y that its mean in bins of equal count along the axis takes away, chance subtracted."""
    edges = np.unique(np.quantile(axis, np.linspace(0.0, 1.0, _BINS + 1)[1:-1]))
    place = np.digitize(axis, edges)
    count = np.bincount(place, minlength=edges.size + 1)
    mean = np.bincount(place, y, minlength=edges.size + 1) / np.maximum(count, 1)
    total = float(np.sum((y - y.mean()) ** 2))
    if total <= 0.0:
        return 0.0
    within = float(np.sum((y - mean[place]) ** 2))
    fair = (y.size - 1) / max(y.size - edges.size - 1, 1)
    return float(np.clip(1.0 - within / total * fair, 0.0, 1.0))


def _sentences(rows: Sequence[Whiteness], shares: Sequence[Share]) -> list[str]:
    odd = [row for row in rows if not row.white]
    if not odd:
        return [f"All {len(rows)} residuals are white: noise, as far as these tests see."]
    worst = max(odd, key=lambda row: row.rms)
    out = [
        f"{len(odd)} of {len(rows)} residuals are not white; the largest, {worst.channel} in {worst.file}, is "
        f"{worst.rms:.3g} times its noise and goes along with {worst.strongest} (correlation {worst.correlation:+.2f})."
    ]
    for enters in ("torque", "voltage"):
        mine = [share for share in shares if share.enters == enters and share.share > _WORTH]
        if mine:
            words = ", ".join(f"{share.axis} {100 * share.share:.0f} %" for share in mine)
            out.append(f"Of the missing {enters}, a curve over one quantity takes away: {words}.")
    return out
