"""Tests whether the residual is noise, and computes torque and voltage that the model lacks along the motion."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.special import ndtr

from ..estimation.free_run import guide_stiffness_of
from ..estimation.goodness import ljung_box
from ..kernels.machine import available
from ..model.stepper import StatePath, Step
from ..model.throttle import Throttle
from ..problem import filter_kernels
from ..problem.filter_kernels import along_path
from ..problem.free_parameters import SERIES, Form, Pick
from ..problem.prediction_error import columns
from ..problem.problem import EstimationProblem
from ..problem.residual import run
from ..problem.trace import Trace
from .candidate_model import CandidateModel
from .composition import is_of_the_rig
from .findings import Evidence, Motion, Share, Whiteness
from .formula_errors import FormulaErrors

# ---- What the model lacks along the measured motion
#
# A guide at the terminals draws the plate of the simulation along the measured angle; the torque and the voltage that
# the guide needs are those that the model lacks,
#
#     T_missing = N K_m / R_a stiffness (theta_measured - theta),        V_missing = (R_a + R_series) (i_measured - i)
#
# so that sticking friction, stops, effects with memory and the electrical side need no inverse formula: the same
# stepper simulates them as in the fit. The second equation holds for signals that change slower than L_a/R_a.
#
# Source: synchronisation by a coupling (Abarbanel 2009); the guide as inverse dynamics with a finite bandwidth.


WHITE_P = 1e-5  # p-value of a test for autocorrelation or correlation below which a residual is not white
EVENT = 0.1  # longest part of a trace that counts as one event
LARGE_RMS = 0.03  # excess of a residual's RMS over 1 sigma that a wrong estimate of the noise may explain
# standard deviations of the RMS of white noise, 1/sqrt(2 n), that are allowed in addition to that excess
LARGE_RMS_DEVIATIONS = 5.0
SHARE_BINS = 24  # of equal count along an axis, whose means are the curve that takes a share of the variance away
SHARE_SAMPLES = 200  # fewest samples from which such a share is read
SHARE_NAMED = 0.05  # share of the variance from which on a sentence names it


def _shown(throttle: Throttle, path: StatePath, steps: Step) -> dict[str, Any]:
    """Signals of a batch or of one entry, and what every effect contributes, (effects, T, L)."""
    state, z = path
    u = steps.inputs(1.0)
    parts = throttle.parts(state, z, u)
    zero = jnp.zeros_like(state.omega)
    direction = jnp.sign(state.omega)
    torque = [zero + part.torque + part.drive - part.friction * direction for part in parts]
    drive, external = sum(part.drive for part in parts), sum(part.torque for part in parts)
    resting = (state.omega == 0.0) | (steps.mobile < 0.5) | (steps.guide_stiffness == 0.0)
    return {
        "time": steps.time,
        # a motor that runs alone turns no plate
        "angle": jnp.where(steps.plate > 0.5, state.theta, steps.lower),
        "speed": state.omega,
        "current": state.i,
        "load": zero + u._replace(motor=drive + u.torque, external=external).gear_load,
        "input": jnp.where(steps.circuit > 0.5, u.voltage, u.torque),
        "torque": jnp.where(resting, jnp.nan, steps.lever * steps.guide(1.0, state.theta)),
        "effect_torque": jnp.stack(torque),
        "effect_voltage": jnp.stack([zero + part.voltage for part in parts]),
    }


@partial(jax.jit, static_argnums=0)
def _by_jax(form: Form, x: Any, pick: Pick, arrays: Any) -> dict[str, Any]:
    throttle, path, steps, _ = run(form, x, pick, arrays)
    return _shown(throttle, path, steps)


def _shown_after(given: filter_kernels.Given) -> dict[str, Any]:
    return _shown(given.throttle, given.after, given.batch.steps)


_BY_KERNEL = along_path(_shown_after)


def _along(problem: EstimationProblem, x: np.ndarray, guide_stiffness: float) -> dict[str, np.ndarray]:
    """Signals along a guided run, (T, L) each, and what every effect contributes, (effects, T, L)."""
    arrays = problem.arrays(guide_stiffness)
    if not available():
        return {k: np.asarray(v) for k, v in _by_jax(*problem.at(x), arrays).items()}
    found = jax.tree.map(np.asarray, filter_kernels.along(_BY_KERNEL, *problem.here(x, arrays)))
    return {k: np.moveaxis(v, 2, 0) if v.ndim > 2 else v for k, v in found.items()}


def signals(problem: EstimationProblem, x: np.ndarray, guide_stiffness: float) -> list[dict[str, np.ndarray]]:
    """Signals of each trace along a run drawn along its measured angle.

    Args:
        guide_stiffness: V/rad, or N m/rad where torque drives.
    Returns:
        for each trace, by name, shape (n,): "time" (s), "angle" (rad), "speed" (rad/s), "current" (A), "load" (N m
        through the gear), "input" (V or N m), "torque" (missing, N m; NaN where the plate rests); and of each effect,
        shape (effects, n): "effect_torque" (N m) and "effect_voltage" (V).
    """
    along = _along(problem, x, guide_stiffness)
    out = []
    for lane, _, marks in problem.batch.places:
        out.append({name: column[..., marks, lane] for name, column in along.items()})
    return out


def motions(before: CandidateModel, after: CandidateModel, held_out: bool) -> list[Motion]:
    """Missing torque and voltage of both models along the measured motion.

    Args:
        held_out: of the traces held out rather than those fitted.
    """
    first, last = (s.holdout[0] if held_out and s.holdout is not None else s.problem for s in (before, after))
    stiffness = guide_stiffness_of(last, after.x)
    lacked, left = signals(first, before.x, stiffness), signals(last, after.x, stiffness)
    volts, volts_left = missing_voltage(first, before.x, stiffness), missing_voltage(last, after.x, stiffness)
    out = []
    for k, trace in enumerate(last.batch.traces):
        end = left[k]
        effects = {
            effect.name: {"torque": end["effect_torque"][n], "voltage": end["effect_voltage"][n]}
            for n, effect in enumerate(e for e in last.layout.types if not is_of_the_rig(e))
            if effect in after.added
        }
        axes = {name: end[name] for name in ("time", "angle", "speed", "current", "load")}
        rest = {"torque": end["torque"], "voltage": volts_left[k]}
        file, test = trace.measurement.file, trace.measurement.test
        out.append(Motion(file, test, held_out, axes, lacked[k]["torque"], volts[k], rest, effects))
    return out


def missing_voltage(problem: EstimationProblem, x: np.ndarray, guide_stiffness: float) -> list[np.ndarray]:
    """(R_a + R_series) (i_measured - i) of each trace, V, shape (n,); NaN where no current was logged.

    Args: as of `signals`.
    """
    values: Mapping[str, Any] = problem.layout.values(x, problem.free_parameters.held)
    out = []
    for trace, model in zip(
        problem.batch.traces, columns(problem.batch, problem.simulated(x, guide_stiffness)), strict=True
    ):
        if "current" not in trace.channels:
            out.append(np.full(trace.instants.size, np.nan))
            continue
        m = trace.channels.index("current")
        ohm = float(values["R_a"]) + float(values.get(SERIES + trace.test.name, 0.0))
        out.append(ohm * (trace.data[:, m] - model[:, m]))
    return out


# ---- Is the residual noise, and if not, with which signal does it correlate?
#
# Per channel and trace: Ljung and Box's test, the size of the whitened residual, and its correlation with the motion
# of the plate and its input. Over all traces: how much of the missing torque and voltage is a function of one quantity
# alone.
#
# A single event of a single trace is no evidence: where the instant of an edge was not logged and the plate turns back
# meanwhile, the residual is wrong from there until the plate rests again. So a residual that is no larger than noise,
# and is white but for one event, counts as noise.

_AXES = {"torque": ("angle", "speed", "current", "load", "time"), "voltage": ("current", "speed", "angle", "time")}

Signals = Mapping[str, np.ndarray]


class Place(NamedTuple):
    """The place of a residual: file, rig test and channel."""

    file: str
    test: str
    channel: str


def evidence(s: CandidateModel, errors: FormulaErrors) -> Evidence:
    """Test the residual of the fitted traces, the formula errors of the model whitened too."""
    stiffness = guide_stiffness_of(s.problem, s.x)
    along = signals(s.problem, s.x, stiffness)
    judged = list(_residuals(s, along, errors))
    rows = _rows(judged)
    volts = missing_voltage(s.problem, s.x, stiffness)
    found = (*shares("torque", along, [a["torque"] for a in along]),
             *shares("voltage", along, volts))  # fmt: skip
    found = tuple(sorted(found, key=lambda share: -share.share))
    noise = _is_noise(judged, rows)
    return Evidence(tuple(rows), noise, found, tuple(sentences(rows, found, noise)))


def is_white(s: CandidateModel) -> bool:
    """`Evidence.white` alone: it is cheaper, because the signals that the residual correlates with are not sought."""
    along = signals(s.problem, s.x, guide_stiffness_of(s.problem, s.x))
    judged = list(_residuals(s, along, FormulaErrors.of_model(s)))
    return _is_noise(judged, _rows(judged))


Judged = tuple[Trace, np.ndarray, Signals]  # a trace, its whitened residual, shape (n, M), and the signals along it


def _rows(judged: Sequence[Judged]) -> list[Whiteness]:
    """Each channel of each trace."""
    return [row for each in judged for row in rows_of(*each)]


def _residuals(s: CandidateModel, along: Sequence[Signals], errors: FormulaErrors) -> Iterator[Judged]:
    """Each trace with its whitened residual, shape (n, M), the errors of inexact formulas whitened too. Far from the
    data, where the samples were weighed down, it is in units of the noise alone."""
    r = s.problem.residual(s.x, s.weighted)
    if s.far:
        r = r * (s.problem.sigma / s.problem.batch.slots.sigma)
    else:
        seen = np.asarray(s.weighted.slots.weight) > 0.0
        r[seen] = errors.whitened(r[seen])
    return zip(s.problem.batch.traces, columns(s.problem.batch, r), along, strict=True)


def _is_noise(judged: Sequence[Judged], rows: Sequence[Whiteness]) -> bool:
    """Whether every residual is white, or is no larger than noise and would be white without one event of one trace."""
    odd = {row.file for row in rows if not row.white}
    if len(odd) != 1 or any(is_larger_than_noise(row.rms, row.n) for row in rows):
        return not odd
    return any(white_but_for_one_event(*each) for each in judged if each[0].measurement.file in odd)


def is_larger_than_noise(rms: float, count: int) -> bool:
    """Whether a whitened residual of so many samples is larger than a wrong estimate of its noise explains."""
    return not rms < 1.0 + LARGE_RMS + LARGE_RMS_DEVIATIONS / math.sqrt(2.0 * count)


def white_but_for_one_event(trace: Trace, r: np.ndarray, along: Signals) -> bool:
    """Whether a trace is white outside one part of it, `EVENT` of its length.

    Args:
        trace: whose residual it is.
        r: whitened residual, shape (n, M).
        along: see `whiteness`.
    """
    step = max(1, round(0.5 * EVENT * len(r)))
    for begin in range(0, len(r) - step, step):
        beside = np.ones(len(r), dtype=bool)
        beside[begin : begin + 2 * step] = False
        if all(row.white for row in rows_of(trace, np.where(beside[:, None], r, np.nan), along)):
            return True
    return False


def rows_of(trace: Trace, r: np.ndarray, along: Signals) -> Iterator[Whiteness]:
    """Each channel of one trace, by the samples that it has and whose residual, shape (n, M), is finite."""
    for m, channel in enumerate(trace.channels):
        place = Place(trace.measurement.file, trace.measurement.test, channel)
        yield whiteness(place, r[:, m], np.isfinite(trace.data[:, m]) & np.isfinite(r[:, m]), along)


def whiteness(place: Place, r: np.ndarray, logged: np.ndarray, along: Signals) -> Whiteness:
    """Whether one channel's residual is noise: no larger than its noise, not autocorrelated, correlated with nothing.

        rms < 1 + LARGE_RMS + LARGE_RMS_DEVIATIONS / sqrt(2 n),    p-values > WHITE_P, that of the correlation times the
        number of signals tried

    Args:
        place: whose residual it is.
        r: whitened residual, shape (n,).
        logged: where the channel has a sample, shape (n,).
        along: "input", "speed", "angle", "current" and "time" at the instants, shape (n,) each.
    """
    regressors = {
        "input": along["input"],
        "speed": along["speed"],
        "sign of speed": np.sign(along["speed"]),
        "angle": along["angle"],
        "current": along["current"],
        "time": along["time"],
    }
    own = r[logged]
    name, rho = strongest(own, {k: v[logged] for k, v in regressors.items()})
    p = min(1.0, len(regressors) * 2.0 * float(ndtr(-abs(rho) * math.sqrt(own.size))))
    size, box = float(np.sqrt(np.mean(own**2))), ljung_box(own)
    white = not is_larger_than_noise(size, own.size) and box > WHITE_P and p > WHITE_P
    return Whiteness(*place, own.size, size, box, name, rho, p, white)


def strongest(r: np.ndarray, regressors: Signals) -> tuple[str, float]:
    """The signal with which a residual correlates most, whatever the sign, and the coefficient; all of shape (n,)."""
    every = {name: correlation(r, signal) for name, signal in regressors.items()}
    return max(every.items(), key=lambda item: abs(item[1]))


def correlation(a: np.ndarray, b: np.ndarray) -> float:
    """Pearson's coefficient; 0 where either does not vary."""
    a, b = a - a.mean(), b - b.mean()
    power = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / power if power > 0.0 else 0.0


def shares(enters: str, along: Sequence[Signals], missing: Sequence[np.ndarray]) -> list[Share]:
    """How much of a missing torque or voltage each quantity explains; none where too few samples know it.

    Args:
        enters: "torque" or "voltage".
        along: signals of each trace by name, shape (n,) each.
        missing: of each trace, N m or V, shape (n,); NaN where it is not known.
    """
    y = np.concatenate(missing)
    seen = np.isfinite(y)
    if seen.sum() < SHARE_SAMPLES:
        return []
    axes = {axis: np.concatenate([a[axis] for a in along])[seen] for axis in _AXES[enters]}
    return [Share(enters, axis, explained(values, y[seen], SHARE_BINS)) for axis, values in axes.items()]


def explained(axis: np.ndarray, y: np.ndarray, bins: int) -> float:
    """Share of the variance of y that its mean in bins of equal count along the axis takes away, chance subtracted.

        1 - sum (y - mean of its bin)^2 / sum (y - mean)^2 (n - 1) / (n - bins),    from 0 to 1

    Args:
        axis, y: shape (n,).
        bins: fewer where many samples share one value of the axis.
    """
    edges = np.unique(np.quantile(axis, np.linspace(0.0, 1.0, bins + 1)[1:-1]))
    place = np.digitize(axis, edges)
    count = np.bincount(place, minlength=edges.size + 1)
    mean = np.bincount(place, y, minlength=edges.size + 1) / np.maximum(count, 1)
    total = float(np.sum((y - y.mean()) ** 2))
    if total <= 0.0:
        return 0.0
    within = float(np.sum((y - mean[place]) ** 2))
    fair = (y.size - 1) / max(y.size - edges.size - 1, 1)
    return float(np.clip(1.0 - within / total * fair, 0.0, 1.0))


def sentences(rows: Sequence[Whiteness], found: Sequence[Share], noise: bool) -> list[str]:
    """The evidence in words: the largest residual that is not white, and the shares of at least `SHARE_NAMED`.

    Args:
        noise: whether all rows are white, or would be without one event.
    """
    odd = [row for row in rows if not row.white]
    if not odd:
        return [f"All {len(rows)} residuals are white: noise, as far as these tests see."]
    worst = max(odd, key=lambda row: row.rms)
    if noise:
        return [
            f"All {len(rows)} residuals are noise but for one moment in {worst.file}. One moment of one trace is no "
            "evidence: most often it is the instant of an edge that was not logged."
        ]
    out = [
        f"{len(odd)} of {len(rows)} residuals are not white; the largest, {worst.channel} in {worst.file}, is "
        f"{worst.rms:.3g} times its noise and correlates with {worst.strongest} (correlation {worst.correlation:+.2f})."
    ]
    for enters in ("torque", "voltage"):
        mine = [share for share in found if share.enters == enters and share.share > SHARE_NAMED]
        if mine:
            words = ", ".join(f"{share.axis} {100 * share.share:.0f} %" for share in mine)
            out.append(f"Of the missing {enters}, a curve over one quantity explains: {words}.")
    return out
