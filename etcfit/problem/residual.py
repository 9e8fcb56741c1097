"""THE residual: measured minus simulated, whitened. Nobody else subtracts y - y_hat for a fit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..model.delay import delayed, late_inputs
from ..model.parameters import AnyArray, Scalar
from ..model.stepper import Reset, StatePath, Step, simulate
from ..model.throttle import Throttle
from .batch import KINDS, BatchArrays, SampleSlots
from .free_parameters import SERIES, Form, Pick
from .innovations import InnovationsFilter, whiten


class WeightedData(NamedTuple):
    """What the residual needs besides the coordinates: data, whitening and prior, all arrays.

    Args:
        steps, resets, slots, circuit_of: the batch.
        whitening: frozen filter.
        pick: which parameters the coordinates stand for, and the values of the others.
        prior_mean, prior_sd: Gaussian priors on the coordinates, shape (P,); sd is inf where there is none.
    """

    steps: Step
    resets: Reset
    slots: SampleSlots
    circuit_of: Float[AnyArray, "T L"]
    whitening: InnovationsFilter
    pick: Pick
    prior_mean: Float[AnyArray, " P"]
    prior_sd: Float[AnyArray, " P"]

    @property
    def samples(self) -> float:
        """How many are fitted."""
        return float(np.sum(self.slots.weight))


def with_circuits(
    steps: Step, circuit_of: Scalar, batch_circuits: tuple[str, ...], values: Mapping[str, Scalar]
) -> Step:
    """Put each test's own series resistance in the batch."""
    series = jnp.zeros_like(steps.dt)
    for k, name in enumerate(batch_circuits):
        series = jnp.where(circuit_of == k + 1, values[SERIES + name], series)
    return steps._replace(series=series)


def equipped(steps: Step, circuit_of: Scalar, circuits: tuple[str, ...], values: Mapping[str, Scalar]) -> Step:
    """The batch, or one entry of it, with all that depends on parameters: its circuits and the guide's lever."""
    steps = with_circuits(steps, circuit_of, circuits, values)
    # a guide in volts knows no scale of torque: where the data know none, none can run away from it
    per_volt = steps.gear_ratio * values["K_m"] / (values["R_a"] + steps.series)
    return steps._replace(lever=jnp.where(steps.lever > 0.5, 1.0, per_volt))


def predict(
    throttle: Throttle, path: StatePath, steps: Step, resets: Reset, slots: SampleSlots
) -> Float[Array, "*batch M"]:
    """What each slot ought to show, SI, shape (T, L, M)."""
    seen = throttle.observe(*path, steps.inputs(1.0))
    delays = throttle.delays().channels if throttle.may_delay else {}
    y = jnp.zeros_like(slots.value)
    for k, name in enumerate(KINDS):
        channel = delayed(seen[name], steps, resets, delays[name]) if name in delays else seen[name]
        y = jnp.where(slots.kind == k, channel[..., None], y)
    return y


class SimulatedRun(NamedTuple):
    """A simulated batch.

    Args:
        throttle: the model.
        path: its states and memories at the end of each step, shape (T, L) each.
        steps: what it ran on: with its circuits, the guide's lever, and inputs as late as they act.
    """

    throttle: Throttle
    path: StatePath
    steps: Step


def run(
    form: Form, circuits: tuple[str, ...], x: Float[Array, " P"], pick: Pick, batch: BatchArrays | WeightedData
) -> SimulatedRun:
    """Simulate a batch.

    Args:
        form: the model.
        circuits: tests with a series resistance of their own, as in the batch.
        x: coordinates, shape (P,).
        pick: which parameters x stands for.
        batch: steps, resets and circuits.
    """
    values = form.values(x, pick)
    throttle = Throttle.build(form.types, values)
    steps = equipped(batch.steps, batch.circuit_of, circuits, values)
    if throttle.may_delay:
        steps = late_inputs(steps, batch.resets, throttle.delays().input)
    return SimulatedRun(throttle, simulate(throttle, steps, batch.resets), steps)


def prior_residual(x: Float[AnyArray, " P"], weighted: WeightedData) -> Float[AnyArray, " P"]:
    """That of the priors, (x - mean) / sd, shape (P,)."""
    return (x - weighted.prior_mean) / weighted.prior_sd


class Compared(NamedTuple):
    """A simulation beside the data, shape (T, L, M) each.

    Args:
        seen: what each slot ought to show, SI.
        r: whitened residual, 0 where there is no sample, standard normal where the model is right.
    """

    seen: Float[Array, "T L M"]
    r: Float[Array, "T L M"]


def compared(form: Form, circuits: tuple[str, ...], x: Float[Array, " P"], weighted: WeightedData) -> Compared:
    """All traces simulated, and their whitened residual.

        r = W (y - y_hat(x))

    Source: generalised least squares; see `innovations`.
    Args:
        form: the model.
        circuits: tests with a series resistance of their own, as in the batch.
        x: coordinates, shape (P,).
        weighted: data, and which parameters x stands for.
    """
    throttle, path, steps = run(form, circuits, x, weighted.pick, weighted)
    seen = predict(throttle, path, steps, weighted.resets, weighted.slots)
    error = weighted.slots.weight * (weighted.slots.value - seen)
    return Compared(seen, whiten(weighted.whitening, error))


def residual(
    form: Form, circuits: tuple[str, ...], x: Float[Array, " P"], weighted: WeightedData
) -> Float[Array, "T L M"]:
    """The whitened residual alone, see `compared`."""
    return compared(form, circuits, x, weighted).r
