"""The log-probability that is sampled: the fit's own residual and priors, in the fit's own coordinates.

    log p(x) = -1/2 sum_s |r_s(x)|^2 / f_s  -  1/2 |(x - m) / w|^2  +  sum_j log |dq_j/dx_j|

r_s is the whitened residual of one channel of one trace (the filter frozen at the optimum), m and w the user's prior.
The last term is the Jacobian of the coordinates: the prior is flat in q, which is the logarithm of a parameter that is
positive and the value itself of one that may be zero (dry and viscous friction, series resistance, amplitudes) or have
either sign. A parameter without a prior of the user's is believed to lie within about a factor of 20 of the optimum
(sd of 3 in its coordinate), as in the fit's covariance: a belief that weighs nothing beside data, and keeps what the
data do not determine from wandering.

f_s >= 1 tempers. Residuals that are larger than their noise, or not independent, carry less than their number says; f_s
is the variance of their sum over that of independent standard normal ones, the factor by which the fit widens its own
intervals (`autocorrelation.inflation`). For a fit `far` from the data each channel was already weighed by the error
left in it, so that chi2 per degree of freedom is about 1, and f_s is the autocorrelation time of its residual in
samples. All f_s are 1 where the model is right.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..estimation.goodness import inflation
from ..estimation.identifiability import WIDE
from ..estimation.joint_fit import FitResult
from ..estimation.levenberg_marquardt import linearise_at, minimise
from ..model.parameters import NonNegative, log_flats
from ..problem.chi2 import chi2_of
from ..problem.free_parameters import SERIES
from ..problem.prediction_error import columns
from ..problem.problem import EstimationProblem
from ..problem.residual import WeightedData
from ..rig.base import Rig

TOLERANCE = 3e-6  # relative change of chi2 that ends the descent to the mode


@dataclass(frozen=True, eq=False)
class Target:
    """A posterior density over the coordinates of a fit."""

    problem: EstimationProblem  # the data
    weighted: WeightedData  # of the residual, tempered, with the beliefs among its priors
    mode: np.ndarray  # where the tempered residual and the priors are least, coordinates, shape (P,)
    covariance: np.ndarray  # of the coordinates, from the curvature there, shape (P, P)
    factors: Mapping[tuple[str, str], float]  # f_s by file and channel

    @classmethod
    def from_fit(cls, result: FitResult) -> Target:
        """The posterior that belongs to a fit."""
        problem, x = result.problem, result.x
        factors = inflations(problem, x, result.weighted)
        weighted = believed(tempered(problem, result.weighted, factors), x, problem.layout.reach(x))
        there, _ = minimise(problem, x, weighted, TOLERANCE, result.settings.steps)
        before, after = chi2_of(problem, np.stack((x, there)), weighted)
        mode = there if after < before else x
        return cls(problem, weighted, mode, linearise_at(problem, mode, weighted).covariance, factors)

    @property
    def symbols(self) -> tuple[str, ...]:
        """Symbols of the coordinates, P."""
        return self.problem.layout.free

    def start(self) -> tuple[np.ndarray, np.ndarray]:
        """A point from which the density's own mean and covariance are sought, and the covariance of the curvature
        there, shapes (P,) and (P, P).

        It is the mode, with quantities that may be zero and are moved off it: on the bound dq/dx is 0, and the
        curvature tells nothing of the width, while the prior is flat in q.
        """
        layout = self.problem.layout
        may_be_zero = [isinstance(layout.parameter(s).domain, NonNegative) for s in self.symbols]
        point = np.where(may_be_zero, layout.off_bounds(self.mode), self.mode)
        if np.array_equal(point, self.mode):
            return self.mode, self.covariance
        return point, linearise_at(self.problem, point, self.weighted).covariance

    def log_probability(self, points: np.ndarray) -> np.ndarray:
        """log p to a constant at K points, shape (K, P) -> (K,); -inf where the model cannot be computed."""
        form, where = self.problem.layout.form, self.problem.layout.pick(self.problem.free_parameters.held).where
        with np.errstate(over="ignore", divide="ignore", invalid="ignore"):  # of points that are none
            jacobian = np.sum(log_flats(form.kinds[where[: points.shape[1]]], points, np), axis=1)
        log_p = -0.5 * chi2_of(self.problem, points, self.weighted) + jacobian
        return np.where(np.isfinite(log_p), log_p, -np.inf)


def inflations(problem: EstimationProblem, x: np.ndarray, weighted: WeightedData) -> dict[tuple[str, str], float]:
    """f_s of each channel of each trace at coordinates x, shape (P,), by file and channel."""
    r = problem.residual(x, weighted)
    out = {}
    for trace, part in zip(problem.batch.traces, columns(problem.batch, r), strict=True):
        for m, channel in enumerate(trace.channels):
            seen = np.isfinite(trace.data[:, m])
            out[trace.measurement.file, channel] = inflation(part[seen, m])
    return out


def tempering(factors: Mapping[tuple[str, str], float]) -> str:
    """What of the data counts for less than its number says, and by how much; "" where nothing does."""
    many = [f for f in factors.values() if f > 1.0]
    if not many:
        return ""
    return (
        f"{len(many)} of {len(factors)} residuals are larger than their noise or not independent; their likelihood was "
        f"tempered for that (their chi2 divided by up to {max(many):.3g}). The fit weighs all alike and widens its "
        "intervals instead: the posterior may be narrower."
    )


def tempered(
    problem: EstimationProblem, weighted: WeightedData, factors: Mapping[tuple[str, str], float]
) -> WeightedData:
    """Data in which each channel's squared residuals are divided by its factor, given by file and channel."""
    weight = np.array(weighted.whitening.weight)
    for trace, (lane, _, marks) in zip(problem.batch.traces, problem.batch.places, strict=True):
        for m, channel in enumerate(trace.channels):
            weight[marks, lane, m] /= np.sqrt(factors[trace.measurement.file, channel])
    return weighted._replace(whitening=weighted.whitening._replace(weight=weight))


def believed(weighted: WeightedData, x: np.ndarray, reach: np.ndarray) -> WeightedData:
    """Data with a normal prior of `WIDE` reaches about x on each coordinate that has no prior; shapes (P,)."""
    mean, sd = np.array(weighted.prior_mean), np.array(weighted.prior_sd)
    bare = np.flatnonzero(~np.isfinite(sd[: x.size]))
    mean[bare], sd[bare] = x[bare], WIDE * reach[bare]
    return weighted._replace(prior_mean=mean, prior_sd=sd)


def truths(rig: Rig) -> dict[str, float]:
    """What made-up data were made from, SI by symbol, where their maker left truth.json beside rig.toml; else empty."""
    note = Path(rig.folder) / "truth.json"
    if not (rig.config.synthetic and note.is_file()):
        return {}
    known = json.loads(note.read_text(encoding="utf-8"))
    series = {SERIES + "inductance": known["series_ohm"]} if "series_ohm" in known else {}
    return {s: float(v) for s, v in (known["parameters"] | series).items()}
