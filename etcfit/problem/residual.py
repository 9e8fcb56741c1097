"""THE residual: measured minus simulated, whitened. No other module subtracts y - y_hat for a fit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..model.delay import delayed, late_inputs, logged_late
from ..model.parameters import AnyArray, Scalar
from ..model.stepper import Reset, StatePath, Step, simulate
from ..model.throttle import Throttle
from .batch import KINDS, BatchArrays, SampleSlots
from .free_parameters import Form, Pick
from .innovations import InnovationsFilter, whiten

_LIMIT = 12.0  # V


class WeightedData(NamedTuple):
    """All data of the residual except the coordinates, as arrays."""

    # steps, resets, slots, test_of: the batch, see `TraceBatch`
    steps: Step
    resets: Reset
    slots: SampleSlots
    test_of: Float[AnyArray, "T L"]
    whitening: InnovationsFilter  # the frozen filter
    pick: Pick  # the parameters of the coordinates, and the values of the others
    # prior_mean, prior_sd: Gaussian priors on the coordinates, shape (P,), dimensionless; sd is inf without one
    prior_mean: Float[AnyArray, " P"]
    prior_sd: Float[AnyArray, " P"]

    @property
    def samples(self) -> float:
        """Number of fitted samples."""
        return float(np.sum(np.asarray(self.slots.weight)))


def equipped(
    throttle: Throttle, steps: Step, resets: Reset, test_of: Scalar, values: Mapping[str, Scalar]
) -> tuple[Step, Reset]:
    """Steps and resets, of a batch or of one entry, with everything that depends on parameters: effects of the rig on
    input and initial state, and the torque of a guide if there is no circuit.

    Args:
        steps, resets, test_of: the logged ones, see `TraceBatch`.
        values: values of the model's parameters, SI by symbol.
    """
    steps = _held(throttle.driven(steps, test_of), values)
    # a guide in volts does not depend on the scale of torque, so an undetermined scale cannot drift because of it
    per_volt = steps.gear_ratio * values["K_m"] / (values["R_a"] + steps.series)
    if steps.acting is not None:
        steps = steps._replace(**steps.acting._asdict(), acting=None)
    resets = throttle.begun(resets, test_of, steps.trace)
    within = jnp.clip(resets.theta, steps.lower, steps.upper)  # a sensor may show a plate beyond its stop
    return steps._replace(lever=jnp.where(steps.lever > 0.5, 1.0, per_volt), edge=None), resets._replace(theta=within)


def _held(steps: Step, values: Mapping[str, Scalar]) -> Step:
    """If an ECU in the model drives the plate, its integral begins with the voltage that holds the spring there,

        v_0 = (T_PL + K_s theta_0) R_a/(N K_m) + the estimated rest, in volts of a limit of 12 V

    so that a preload, which the integral always balances, does not change the path, and neither does an undetermined
    scale of all voltages: exactly, not only along the path about which the whitening was linearised.
    """
    if steps.command is None:
        return steps
    torque = steps.command.active * (values["T_PL"] + values["K_s"] * steps.command.origin)
    volts = torque * values["R_a"] / (steps.gear_ratio * values["K_m"])
    besides = 1.0 + steps.command.active * (values["V_e"] / _LIMIT - 1.0)
    return steps._replace(voltage0=besides * steps.voltage0 + volts, voltage1=besides * steps.voltage1 + volts)


def predict(
    throttle: Throttle, path: StatePath, steps: Step, resets: Reset, slots: SampleSlots, test_of: Scalar
) -> Float[Array, "*batch M"]:
    """y_hat: the simulated value of each slot.

    Args:
        path: its states and memories at the end of each step, shape (T, L) each.
        steps, resets, slots, test_of: the batch, see `TraceBatch`; of one entry without the axis T.
    Returns:
        Shape (T, L, M), SI unit of each channel.
    """
    seen = throttle.read(throttle.observe(*path, steps.inputs(1.0)), test_of, steps.trace)
    delays = throttle.delays().channels if throttle.may_delay else {}
    by_the_rig = throttle.lateness(steps, test_of)
    for name in KINDS:
        channel = delayed(seen[name], steps, resets, delays[name]) if name in delays else seen[name]
        seen[name] = logged_late(channel, steps, resets, by_the_rig[name]) if name in by_the_rig else channel
    return shown(seen, slots.kind)


def shown(
    seen: Mapping[str, Float[AnyArray, "*batch"]], kind: Float[AnyArray, "*batch M"]
) -> Float[AnyArray, "*batch M"]:
    """The value of each slot from the channels, by its kind, an index into `KINDS`; 0 if it is of none of them."""
    y = jnp.zeros(kind.shape)
    for k, name in enumerate(KINDS):
        if name in seen:
            y = jnp.where(kind == k, seen[name][..., None], y)
    return y


class SimulatedRun(NamedTuple):
    """A simulated batch."""

    throttle: Throttle  # the model
    path: StatePath  # its states and memories at the end of each step, shape (T, L) each
    steps: Step  # the simulated steps: with the rig's effects, late inputs, and the guide's lever
    resets: Reset  # true initial states of its traces, which may differ from the logged ones by a rig effect


def run(form: Form, x: Float[Array, " P"], pick: Pick, batch: BatchArrays | WeightedData) -> SimulatedRun:
    """Simulate a batch.

    Args:
        x: coordinates, shape (P,).
        pick: the parameters of x.
        batch: its logged steps and resets, and the test of each entry.
    """
    values = form.values(x, pick)
    throttle = Throttle.build(form.types, values)
    steps, resets = equipped(throttle, batch.steps, batch.resets, batch.test_of, values)
    if throttle.may_delay:
        steps = late_inputs(steps, resets, throttle.delays().input)
    return SimulatedRun(throttle, simulate(throttle, steps, resets), steps, resets)


def prior_residual(x: Float[AnyArray, "*K P"], weighted: WeightedData) -> Float[AnyArray, "*K P"]:
    """(x - mean) / sd of the Gaussian priors, shape (..., P), dimensionless; 0 without a prior."""
    return (x - weighted.prior_mean) / weighted.prior_sd


def prior_residual_here(x: Float[np.ndarray, "*K P"], weighted: WeightedData) -> Float[np.ndarray, "*K P"]:
    """`prior_residual` by NumPy, without compilation."""
    mean, sd = np.asarray(weighted.prior_mean), np.asarray(weighted.prior_sd)
    return prior_residual(x, weighted._replace(prior_mean=mean, prior_sd=sd))


class Compared(NamedTuple):
    """A simulation and its residual, shape (T, L, M) each."""

    seen: Float[AnyArray, "*batch M"]  # y_hat, the simulated value of each slot, SI
    # whitened residual, dimensionless, 0 without a sample; standard normal if the model is right
    r: Float[AnyArray, "*batch M"]


def compared(form: Form, x: Float[Array, " P"], weighted: WeightedData) -> Compared:
    """Simulate all traces, and compute their whitened residual.

        r = W (y - y_hat(x))

    Source: generalised least squares; see `innovations`.
    Args:
        x: coordinates, shape (P,).
        weighted: data, and the parameters of x.
    """
    throttle, path, steps, resets = run(form, x, weighted.pick, weighted)
    seen = predict(throttle, path, steps, resets, weighted.slots, weighted.test_of)
    error = weighted.slots.weight * (weighted.slots.value - seen)
    return Compared(seen, whiten(weighted.whitening, error))


def residual(form: Form, x: Float[Array, " P"], weighted: WeightedData) -> Float[Array, "T L M"]:
    """r = W (y - y_hat(x)) of all samples, shape (T, L, M), dimensionless; arguments as of `compared`."""
    return compared(form, x, weighted).r
