"""The estimation problem: a rig's traces in a batch, its free parameters, and the model's computations with them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Float, Int

from ..kernels.machine import available
from ..model.parameters import AnyArray, Scalar
from ..rig.base import RigConfig
from . import filter_kernels, residual_kernels
from .batch import BatchArrays, SampleSlots, TraceBatch, batch_of, rounded
from .free_parameters import Form, FreeParameters, Layout, Pick
from .innovations import InnovationsFilter, Moved, kalman, plain, shifted_samples
from .instants import SHARES
from .integrators import fitted_integrals
from .lateness import moved_samples
from .normal_equations import linearised
from .one_pass_kernels import LinearisedTrace
from .prediction_error import columns
from .process_noise import free_run_variance, order_of
from .records import as_numpy
from .residual import Compared, WeightedData, compared, prior_residual_here, run
from .substeps import local_error, substeps_needed
from .trace import Trace, prepare

_PADDED = 1.25  # largest factor on the steps of a batch; above it two compilations are faster than longer simulations


@partial(jax.jit, static_argnums=0)
def _compared(form: Form, x: Float[Array, " P"], weighted: WeightedData) -> Compared:
    """The simulated value of each slot, and the whitened residual, shape (T, L, M) each."""
    return compared(form, x, weighted)


@partial(jax.jit, static_argnums=0)
def _local_error(form: Form, x: Float[Array, " P"], pick: Pick, arrays: BatchArrays) -> Float[Array, "T L"]:
    """The local integration error of every step, shape (T, L)."""
    throttle, path, steps, resets = run(form, x, pick, arrays)
    return local_error(throttle, path, arrays._replace(steps=steps, resets=resets))


@partial(jax.jit, static_argnums=0)
def _kalman(
    form: Form, x: Float[Array, " P"], pick: Pick, arrays: BatchArrays, jitter: Scalar
) -> tuple[InnovationsFilter, Float[Array, "T L M"]]:
    """The whitening filter, and the share of timing in each sample's variance, shape (T, L, M)."""
    throttle, path, steps, resets = run(form, x, pick, arrays)
    return kalman(throttle, path, arrays._replace(steps=steps, resets=resets), jitter)


@partial(jax.jit, static_argnums=0)
def _free_run_variance(
    form: Form, x: Float[Array, " P"], pick: Pick, arrays: BatchArrays, jitter: Scalar
) -> Float[Array, "T L M"]:
    """Variance of measured - free run, SI, shape (T, L, M)."""
    throttle, path, steps, resets = run(form, x, pick, arrays)
    return free_run_variance(throttle, path, arrays._replace(steps=steps, resets=resets), jitter)


class Linearisation(NamedTuple):
    """The residual near coordinates x: r(x + d) = r + J d."""

    r: Float[np.ndarray, "T L M"]  # whitened residual of the samples, shape (T, L, M), dimensionless
    prior: Float[np.ndarray, " P"]  # (x - mean) / sd of the priors, shape (P,), dimensionless; its own slope is 1 / sd
    jacobian: Float[np.ndarray, "T L M P"]  # J = dr/dx, shape (T, L, M, P), over coordinates


@dataclass(frozen=True, eq=False)
class EstimationProblem:
    """Data and free parameters of a rig, and computations with both. Frozen: methods return new problems."""

    config: RigConfig  # the rig
    free_parameters: FreeParameters  # its free parameters, and the given values of all
    batch: TraceBatch  # its traces as arrays
    # integration steps in each interval between instants, shape (n - 1,) for each trace
    substeps: tuple[Int[np.ndarray, " _"], ...]
    # noise of each sample, unit of the sample, increased for outliers; shape (T, L, M)
    sigma: Float[np.ndarray, "T L M"]
    jitter: float = 0.0  # standard deviation of the sampling instants, as a share of the time between samples
    # stiffness of the guide in the simulation of the residual, V/rad, or N m/rad if a torque is the input; 0 for a free
    # run
    guide_stiffness: float = 0.0

    @classmethod
    def of_traces(
        cls,
        config: RigConfig,
        free_parameters: FreeParameters,
        traces: tuple[Trace, ...],
        substeps: Sequence[Int[np.ndarray, " _"]] | None = None,
        least: tuple[int, ...] = (0, 0, 0),
    ) -> EstimationProblem:
        """The problem of some traces.

        Args:
            traces: prepared traces, see `trace.prepare`.
            substeps: integration steps in each interval, shape (n - 1,) for each trace; one each if None.
            least: least steps T, lanes L and slots M of the batch.
        """
        substeps = substeps or tuple(np.ones(t.instants.size - 1, dtype=int) for t in traces)
        batch = batch_of(traces, config, substeps, least)
        return cls(config, free_parameters, batch, tuple(substeps), batch.slots.sigma)

    @property
    def layout(self) -> Layout:
        """The parameters of x and their order."""
        return self.free_parameters.layout

    @property
    def slots(self) -> SampleSlots:
        """The samples with `sigma` as their noise."""
        return self.batch.slots._replace(sigma=self.sigma)

    @property
    def pick(self) -> Pick:
        """The parameters of x, and the values of the others."""
        return self.layout.pick(self.free_parameters.held)

    def at(self, x: Float[np.ndarray, " P"]) -> tuple[Form, Float[np.ndarray, " room"], Pick]:
        """The common arguments of compiled functions: model, padded coordinates, choice of free parameters."""
        return self.layout.form, self.layout.padded(x), self.pick

    def compile_ahead(self) -> None:
        """Start making, in the background, the kernels of a fit."""
        if available():
            weighted = self.weighted(plain(self.slots, order_of(self.layout.types)))
            residual_kernels.compile_ahead(self.layout.form, weighted)

    def free_run(self, x: Float[np.ndarray, " P"]) -> list[Float[np.ndarray, "_ _"]]:
        """Simulated samples y_hat of each trace, shape (n, M), SI, at coordinates x, shape (P,), from the logged input
        alone."""
        return columns(self.batch, self.simulated(x, 0.0))

    def free_run_variance(self, x: Float[np.ndarray, " P"]) -> list[Float[np.ndarray, "_ _"]]:
        """Variance of measured - free run of each trace, shape (n, M), SI^2: sensor noise, noisy input, unknown
        instants."""
        arrays, where = self._where_they_belong(x)
        if available():
            variance = filter_kernels.free_run_variance(*self.here(x, arrays), self.jitter)
        else:
            variance = _free_run_variance(*self.at(x), arrays, self.jitter)
        return columns(self.batch, variance if where is None else shifted_samples(np.asarray(variance), where.back))

    def simulated(self, x: Float[np.ndarray, " P"], guide_stiffness: float) -> Float[np.ndarray, "T L M"]:
        """Simulated samples of the whole batch, SI, shape (T, L, M).

        Args:
            x: coordinates, shape (P,).
            guide_stiffness: stiffness of the guide along the measured angle, V/rad, or N m/rad if a torque is the
                input; 0: a free run.
        """
        unwhitened = plain(self.slots, order_of(self.layout.types))
        weighted = self.guided(guide_stiffness).weighted(unwhitened)
        return np.asarray(self._compared(x, weighted).seen)

    def arrays(self, guide_stiffness: float = 0.0) -> BatchArrays:
        """The batch for compiled functions, with a guide of this stiffness, V/rad (N m/rad for a torque)."""
        batch = self.batch
        return BatchArrays(batch.guided(guide_stiffness), batch.resets, self.slots, batch.disturbance, batch.test_of)

    def kalman(self, x: Float[np.ndarray, " P"]) -> InnovationsFilter:
        """The whitening filter, linearised along the free run at coordinates x, shape (P,)."""
        return self.filter_and_timing(x)[0]

    def filter_and_timing(self, x: Float[np.ndarray, " P"]) -> tuple[InnovationsFilter, Float[AnyArray, "T L M"]]:
        """The whitening filter at coordinates x, shape (P,), and (dy/dt dt)^2 / S of each sample, shape (T, L, M): the
        variance that a jitter of 1 would add, over the present variance."""
        arrays, where = self._where_they_belong(x)
        if available():
            filter_, timing = filter_kernels.filter_and_timing(*self.here(x, arrays), self.jitter)
        else:
            filter_, timing = _kalman(*self.at(x), arrays, self.jitter)
        return (
            (filter_, timing)
            if where is None
            else (filter_._replace(moved=where), shifted_samples(np.asarray(timing), where.back))
        )

    def _where_they_belong(self, x: Float[np.ndarray, " P"]) -> tuple[BatchArrays, Moved | None]:
        """The batch with the noise of late samples at the instants that they show, to whole samples: there the
        uncertainty of an edge at an unknown instant acts."""
        arrays = self.arrays()
        where = moved_samples(self.batch, self.layout.types, self.layout.values(x, self.free_parameters.held))
        if where is None:
            return arrays, None
        present, sigma = (shifted_samples(each, where.forth) for each in (arrays.slots.weight, arrays.slots.sigma))
        sigma = np.where(present > 0.0, sigma, 1.0)
        return arrays._replace(slots=arrays.slots._replace(weight=present, sigma=sigma)), where

    def weighted(self, filter_: InnovationsFilter) -> WeightedData:
        """Samples, inputs, priors and this filter, for the residual."""
        batch, layout = self.batch, self.layout
        mean, sd = self.free_parameters.priors_on_coordinates
        priors = layout.padded(mean), layout.padded(sd, np.inf)
        steps = batch.guided(self.guide_stiffness)
        weighted = WeightedData(steps, batch.resets, self.slots, batch.test_of, filter_, self.pick, *priors)
        weighted = as_numpy(weighted)  # once, not at every call
        return weighted if available() else jax.device_put(jax.tree.map(np.asarray, weighted))

    def linearise(self, x: Float[np.ndarray, " P"], weighted: WeightedData) -> Linearisation:
        """Residual, residual of the priors, and the Jacobian of the former.

        Args:
            x: coordinates, shape (P,).
            weighted: data and frozen filter, see `weighted`.
        """
        padded = self.layout.padded(x)
        r, columns = linearised(self.layout.form, padded, weighted)
        prior = prior_residual_here(padded, weighted)[: x.size]
        return Linearisation(r, prior, columns[..., : x.size])

    def linearise_traces(self, x: Float[np.ndarray, " P"], weighted: WeightedData) -> list[LinearisedTrace]:
        """For each trace the residual at its instants, shape (n, M), and the Jacobian, shape (M, n, P): a fraction of
        the result of `linearise`, which also has the steps between. Arguments as of `linearise`."""
        places = [(lane, marks) for lane, _, marks in self.batch.places]
        if not available():
            r, _, jacobian = self.linearise(x, weighted)
            return [(r[rows, lane], np.moveaxis(jacobian[rows, lane], 1, 0)) for lane, rows in places]
        form, padded = self.layout.form, self.layout.padded(x)
        found = residual_kernels.linearised_at(form, form.full(padded, weighted.pick), weighted, places)
        slope = form.slopes(padded, weighted.pick)[: x.size]
        for _, slopes in found:
            slopes *= slope
        return found

    def residual(self, x: Float[np.ndarray, " P"], weighted: WeightedData) -> Float[np.ndarray, "T L M"]:
        """Whitened residual without Jacobian, shape (T, L, M), dimensionless, at coordinates x, shape (P,): takes a
        tenth of the time of the Jacobian."""
        return np.asarray(self._compared(x, weighted).r)

    def _compared(self, x: Float[np.ndarray, " P"], weighted: WeightedData) -> Compared:
        form, padded = self.layout.form, self.layout.padded(x)
        if available():
            return residual_kernels.compared(form, form.full(padded, weighted.pick), weighted)
        return _compared(form, padded, weighted)

    def chi2(self, x: Float[np.ndarray, " P"], weighted: WeightedData) -> float:
        """Sum of squares of the whitened residual at coordinates x, shape (P,), without the priors; `chi2.chi2_of`, for
        many points, includes them."""
        form = self.layout.form
        with np.errstate(over="ignore"):  # a simulation that diverges gives inf
            if available():
                return residual_kernels.chi2(form, form.full(self.layout.padded(x), weighted.pick), weighted)
            return float(np.sum(self.residual(x, weighted) ** 2))

    def refined(self, x: Float[np.ndarray, " P"]) -> EstimationProblem:
        """The problem with the integration steps in each interval that the free run at x, shape (P,), needs."""
        problem = self
        for _ in range(2):
            error = problem._local_error(x)
            steps = substeps_needed(problem.batch, error)
            problem = EstimationProblem.of_traces(
                self.config, self.free_parameters, self.batch.traces, steps, self.room
            )
        return problem

    def _local_error(self, x: Float[np.ndarray, " P"]) -> Float[np.ndarray, "T L"]:
        if available():
            return filter_kernels.local_error(*self.here(x, self.arrays()))
        return np.asarray(_local_error(*self.at(x), self.arrays()))

    def here(
        self, x: Float[np.ndarray, " P"], arrays: BatchArrays
    ) -> tuple[Form, Float[np.ndarray, " Q"], BatchArrays]:
        """Model, values of all parameters, and the batch as arrays of NumPy."""
        form = self.layout.form
        return form, form.full(self.layout.padded(x), self.pick), jax.tree.map(np.asarray, arrays)

    def reprepared(self, x: Float[np.ndarray, " P"]) -> EstimationProblem:
        """The problem of the measurements as logged: release instants come from the records again, and integration
        steps are chosen for x, shape (P,).

        It is for a model with a further effect: release instants placed by a poorer model would pull it back to that.
        """
        traces = tuple(t for t in (prepare(t.measurement, self.config) for t in self.batch.traces) if t is not None)
        problem = EstimationProblem.of_traces(self.config, self.free_parameters, traces, None, self.room)
        problem = problem.refined(x).with_integrator_states(x).with_setpoint_jumps(x)
        return replace(problem, jitter=self.jitter)

    @property
    def room(self) -> tuple[int, ...]:
        """Least steps T, lanes L and slots M of other batches of the rig: those of this one, so that JAX needs no new
        compilation. A kernel works for any T and L."""
        length, lanes, slots = self.batch.slots.value.shape
        return (0, 0, slots) if available() else (length, lanes, slots)

    def for_traces(self, traces: tuple[Trace, ...], x: Float[np.ndarray, " P"]) -> EstimationProblem:
        """The problem of other traces of the same rig, in a batch of the same shape if they fit, so that no new
        compilation is needed.

        Args:
            x: coordinates, shape (P,), for which integration steps are chosen.
        """
        other = (
            EstimationProblem.of_traces(self.config, self.free_parameters, traces, None, self.room)
            .refined(x)
            .with_instants(x)
        )
        return replace(other, jitter=self.jitter, guide_stiffness=self.guide_stiffness)

    def with_room_for(
        self, traces: tuple[Trace, ...], x: Float[np.ndarray, " P"], spare: float = 1.0
    ) -> EstimationProblem:
        """The problem in a batch long enough for other traces of the rig, so that both use one set of programs.

        Args:
            x: coordinates, shape (P,), for which their integration steps are chosen.
            spare: factor on their steps at x: elsewhere they may need a few more.
        Returns:
            The problem itself if they fit, if they would make it more than `_PADDED` times as long, or if kernels run.
        """
        if not traces or available():
            return self
        other = EstimationProblem.of_traces(self.config, self.free_parameters, traces, None, self.room).refined(x)
        longest = max(int(marks[-1]) for _, _, marks in other.batch.places) + 1
        room = (max(self.room[0], rounded(math.ceil(spare * longest))), *other.room[1:])
        if room == self.room or np.prod(room) > _PADDED * np.prod(self.room):
            return self
        least = tuple(map(max, self.room, room))
        longer = EstimationProblem.of_traces(self.config, self.free_parameters, self.batch.traces, self.substeps, least)
        return replace(longer, jitter=self.jitter, guide_stiffness=self.guide_stiffness)

    def guided(self, guide_stiffness: float) -> EstimationProblem:
        """The problem with a residual simulated with a guide of this stiffness, V/rad (N m/rad for a torque)."""
        return replace(self, guide_stiffness=guide_stiffness)

    def with_parameters(self, free_parameters: FreeParameters) -> EstimationProblem:
        """The same data with other free parameters."""
        return replace(self, free_parameters=free_parameters)

    def with_release_times(self, x: Float[np.ndarray, " P"]) -> EstimationProblem:
        """The problem with the release instants that best fit the model at x, shape (P,)."""
        if not any(trace.release for trace in self.batch.traces):
            return self
        predicted = self.free_run(x)
        traces = tuple(_better_release(t, y) for t, y in zip(self.batch.traces, predicted, strict=True))
        batch = self.batch.with_times_of(traces, self.config, self.substeps)
        return replace(self, batch=batch, sigma=batch.slots.sigma, guide_stiffness=0.0)

    def with_instants(self, x: Float[np.ndarray, " P"]) -> EstimationProblem:
        """The problem with all unlogged quantities estimated again at x, shape (P,): instants of releases and of
        jumps of a setpoint, integrals of an ECU."""
        return self.with_release_times(x).with_integrator_states(x).with_setpoint_jumps(x)

    @property
    def controlled(self) -> bool:
        """Whether an ECU in the model drives a trace."""
        return any(trace.controlled for trace in self.batch.traces)

    @property
    def sees_jumps(self) -> bool:
        """Whether an ECU in the model follows a setpoint that jumps."""
        return any(t.setpoint is not None and t.setpoint.jumps.size for t in self.batch.traces)

    def with_setpoint_jumps(self, x: Float[np.ndarray, " P"]) -> EstimationProblem:
        """The problem with the instants, at which an ECU in the model read its setpoint's jumps, that best fit the
        model at x, shape (P,)."""
        if not self.sees_jumps:
            return self
        seeing = [k for k, t in enumerate(self.batch.traces) if t.setpoint is not None and t.setpoint.jumps.size]
        tried = [self.batch.traces[k].with_jumps_at(share) for k in seeing for share in SHARES]
        steps = [self.substeps[k] for k in seeing for _ in SHARES]
        beside = EstimationProblem.of_traces(self.config, self.free_parameters, tuple(tried), steps, self.room)
        paths = iter(beside.free_run(x))
        placed = list(self.batch.traces)
        for k in seeing:
            placed[k] = placed[k].with_jumps_placed([next(paths) for _ in SHARES])
        batch = self.batch.with_times_of(placed, self.config, self.substeps)
        return replace(self, batch=batch, sigma=batch.slots.sigma, guide_stiffness=0.0)

    def with_integrator_states(self, x: Float[np.ndarray, " P"]) -> EstimationProblem:
        """The problem with the initial voltage in the integral of each ECU in the model that fits best at x, see
        `integrators`."""
        if not self.controlled:
            return self
        weighted = self.guided(0.0).weighted(plain(self.slots, order_of(self.layout.types)))
        volts = fitted_integrals(self.batch, weighted, lambda data: self._compared(x, data).seen)
        return replace(self, batch=self.batch.holding(volts))


def _better_release(trace: Trace, predicted: Float[np.ndarray, "n M"]) -> Trace:
    """One Gauss-Newton step in the release instant: y(t - d) = y - d dy/dt, while the plate falls freely."""
    if trace.release is None:
        return trace
    instant, sd = trace.release
    falling = trace.instants > instant
    lead = trace.channels.index("emf") if "emf" in trace.channels else 0
    top = int(np.argmax(np.abs(predicted[:, lead] - predicted[0, lead])))
    falling &= np.arange(falling.size) < 0.8 * top
    slope = -np.gradient(predicted, trace.instants, axis=0)[falling] / trace.sigma
    error = (trace.data - predicted)[falling] / trace.sigma
    seen = np.isfinite(error)
    if seen.sum() < 3:
        return trace
    power = float(np.sum(slope[seen] ** 2))
    shift = float(np.sum(slope[seen] * error[seen])) / power if power > 0.0 else 0.0
    return trace.released_at(float(instant + np.clip(shift, -3.0 * sd, 3.0 * sd)), sd)
