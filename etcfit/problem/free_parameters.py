"""Free, fixed and tied parameters, and the vector of coordinates that the fit moves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..errors import MeasurementError
from ..model.effects import COMMANDING, EFFECT_BY_NAME, PAPER, AbstractEffect
from ..model.parameters import DOMAINS, AnyArray, NonNegative, Parameter, Positive, Real, Scalar, curves, slopes
from ..model.rig_effects import FAMILY_BY_KIND, Place, SeriesResistance, rig_effect
from ..model.throttle import catalogue
from ..rig.base import Fixed, Knowledge, Prior, RigConfig, Start, Tied
from ..rig.toml import closest

_FARTHEST = 1e9  # largest ratio of a given value to the usual size, and of the usual size to it
_FAR_FROM_BOUND = 0.1  # coordinate of a value of 0 or more from which on a logarithm says as much
SERIES = "series_ohm."  # prefix of a rig test's own circuit resistance


class Pick(NamedTuple):
    """The parameters of the coordinates, and the values of all others; an argument of compiled programs."""

    full: Float[AnyArray, " Q"]  # value of every parameter of the form, SI, shape (Q,)
    where: Int[AnyArray, " P"]  # index in `full` of each coordinate's parameter, shape (P,); Q for padding


@dataclass(frozen=True)
class Form:
    """The part of a model for which a program is compiled; hashable. The choice of free parameters is data (`Pick`), so
    another choice needs no compilation.
    """

    types: tuple[type[AbstractEffect], ...]  # effects of the model
    parameters: tuple[Parameter, ...]  # every parameter, including those of the tests' circuits; Q
    ties: tuple[tuple[str, str], ...]  # (symbol, the symbol it equals)

    def __hash__(self) -> int:
        return self._hash

    @cached_property
    def _hash(self) -> int:  # needed at every evaluation of a residual
        return hash((self.types, self.parameters, self.ties))

    def __getstate__(self) -> dict[str, object]:  # hashes differ in another process
        return {"types": self.types, "parameters": self.parameters, "ties": self.ties}

    @cached_property
    def index(self) -> dict[str, int]:
        """Index of each symbol among the parameters."""
        return {p.symbol: k for k, p in enumerate(self.parameters)}

    @cached_property
    def kinds(self) -> Int[np.ndarray, " _"]:
        """Domain of each parameter, as an index into `DOMAINS`, shape (Q + 1,); the last entry is for padding."""
        return np.array([*(DOMAINS.index(type(p.domain)) for p in self.parameters), DOMAINS.index(Real)])

    @cached_property
    def scales(self) -> Float[np.ndarray, " _"]:
        """Scale of each parameter, SI, shape (Q + 1,); the last entry is for padding."""
        return np.array([*(p.domain.scale for p in self.parameters), 1.0])

    def mapped(self, x: Float[AnyArray, " P"], pick: Pick) -> Float[Array, " P"]:
        """Values in SI of the free parameters, shape (P,)."""
        return jnp.asarray(self.scales)[pick.where] * curves(jnp.asarray(self.kinds)[pick.where], x)

    def live(self, pick: Pick) -> Bool[AnyArray, " P"]:
        """False for coordinates of the padding, shape (P,)."""
        return pick.where < len(self.parameters)

    def values(self, x: Float[AnyArray, " P"], pick: Pick) -> dict[str, Scalar]:
        """Values in SI by symbol, ties included.

        Args:
            x: coordinates, shape (P,), dimensionless.
            pick: the parameters of the coordinates, and the values of the others.
        """
        full = jnp.append(pick.full, 0.0).at[pick.where].set(self.mapped(x, pick))
        values = {symbol: full[k] for symbol, k in self.index.items()}
        return values | {s: values[other] for s, other in self.ties}

    def full(self, x: Float[np.ndarray, "*K P"], pick: Pick) -> Float[np.ndarray, "*K Q"]:
        """Values in SI of every parameter, shape (..., Q), by NumPy; a tied parameter has no value of its own.

        Args:
            x: coordinates, shape (..., P), dimensionless.
            pick: the parameters of the coordinates, and the values of the others.
        """
        where = np.asarray(pick.where)
        out = np.empty((*x.shape[:-1], len(self.parameters) + 1))
        out[..., :-1] = pick.full
        out[..., where] = self.scales[where] * curves(self.kinds[where], x, np)
        return out[..., :-1]

    def slopes(self, x: Float[np.ndarray, " P"], pick: Pick) -> Float[np.ndarray, " P"]:
        """Derivatives of the free parameters' values, SI, in their coordinates, shape (P,), by NumPy."""
        where = np.asarray(pick.where)
        return self.scales[where] * slopes(self.kinds[where], x)


@dataclass(frozen=True)
class Layout:
    """The order of the parameters in the vectors of coordinates x and of held values."""

    types: tuple[type[AbstractEffect], ...]  # effects of the model
    parameters: tuple[Parameter, ...]  # every parameter, including those of the tests' circuits
    free: tuple[str, ...]  # symbols that are fitted, in the order of x; P of them
    held: tuple[str, ...]  # symbols with a fixed value, in the order of the vector of held values; H of them
    ties: tuple[tuple[str, str], ...]  # (symbol, the free or held symbol it equals)
    # length to which x is padded for compiled programs, so that models with a few more parameters use the same programs
    room: int = 0

    @cached_property
    def form(self) -> Form:
        """The part on which compiled programs depend."""
        return Form(self.types, self.parameters, self.ties)

    @property
    def spare(self) -> int:
        """Number of coordinates of the padding: room - P."""
        return max(0, self.room - len(self.free))

    def pick(self, held: Float[np.ndarray, " H"]) -> Pick:
        """The choice of free parameters for compiled programs, the others at held values, SI, shape (H,)."""
        full, index = np.zeros(len(self.parameters)), self.form.index
        full[[index[s] for s in self.held]] = held
        return Pick(full, np.array([*(index[s] for s in self.free), *(len(index) for _ in range(self.spare))]))

    def padded(self, x: Float[np.ndarray, "*K P"], filler: float = 0.0) -> Float[np.ndarray, "*K room"]:
        """Coordinates filled up to `room` for a compiled program.

        Args:
            x: shape (..., P).
            filler: value of the padding.
        Returns:
            Shape (..., room).
        """
        return np.concatenate((x, np.full((*x.shape[:-1], self.spare), filler)), axis=-1)

    def parameter(self, symbol: str) -> Parameter:
        """Unit, domain and meaning of a symbol. KeyError if the model has no such symbol."""
        return self.parameters[self.form.index[symbol]]

    def values(self, x: Float[np.ndarray, " P"], held: Float[np.ndarray, " H"]) -> dict[str, Scalar]:
        """Values in SI by symbol, ties included.

        Args:
            x: coordinates, shape (P,), dimensionless.
            held: values of the held parameters, SI, shape (H,).
        """
        values = {s: held[k] for k, s in enumerate(self.held)} | dict(zip(self.free, self.numbers(x)[0], strict=True))
        return values | {s: values[other] for s, other in self.ties}

    def numbers(self, x: Float[np.ndarray, " P"]) -> tuple[Float[np.ndarray, " P"], Float[np.ndarray, " P"]]:
        """Values of the free parameters, SI, and their derivatives dvalue/dx, SI, at coordinates x; shape (P,) each."""
        where = np.array([self.form.index[s] for s in self.free], dtype=int)
        kinds, scales, x = self.form.kinds[where], self.form.scales[where], np.asarray(x, dtype=float)
        return scales * curves(kinds, x, np), scales * slopes(kinds, x)

    def coordinates(self, values: Mapping[str, float]) -> Float[np.ndarray, " P"]:
        """The coordinates x, shape (P,), of values in SI by symbol; a value on a bound is moved just inside it."""
        return np.array([self.parameter(s).domain.coordinate(float(values[s])) for s in self.free])

    def log_distance(self, x: Float[np.ndarray, " P"], other: Float[np.ndarray, " P"]) -> Float[np.ndarray, " P"]:
        """Changes of coordinates that stand for the changes of the logarithms of values, with the slopes at x; where a
        value may be negative, or is near its bound at 0 at either end, the changes of coordinates themselves.

        Args:
            x, other: coordinates, shape (P,).
        Returns:
            (dx/dlog value at x) log(value at the other / value at x), shape (P,), dimensionless.
        """
        (value, slope), (there, _) = self.numbers(x), self.numbers(other)
        straight = np.array(self._straight) & (np.minimum(x, other) < _FAR_FROM_BOUND)
        signed = np.array([isinstance(self.parameter(s).domain, Real) for s in self.free])
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(straight | signed, other - x, value / slope * np.log(there / value))

    def reach(self, x: Float[np.ndarray, " P"]) -> Float[np.ndarray, " P"]:
        """The change of a coordinate for a change of its value by about 100 %: 1 for a logarithm, else max(|x|, 1).

        Args:
            x: coordinates, shape (P,).
        Returns:
            Shape (P,), dimensionless.
        """
        return np.where(self._straight, np.maximum(1.0, np.abs(x)), 1.0)

    def relative_size(self, x: Float[np.ndarray, " P"]) -> Float[np.ndarray, " P"]:
        """Values over the changes of `reach`, at most 1: |x| / reach, and 1 for a logarithm; arguments as of
        `reach`."""
        return np.where(self._straight, np.abs(x) / self.reach(x), 1.0)

    @property
    def _straight(self) -> list[bool]:
        """Whether each free parameter has a coordinate in proportion to its value."""
        return [not isinstance(self.parameter(s).domain, Positive) for s in self.free]

    def off_bounds(self, x: Float[np.ndarray, " P"]) -> Float[np.ndarray, " P"]:
        """Coordinates, shape (P,), with those on a bound moved to a place where the value depends on them again."""
        out = np.array(x, dtype=float)
        for k, (symbol, value) in enumerate(zip(self.free, self.numbers(out)[0].tolist(), strict=True)):
            domain = self.parameter(symbol).domain
            if domain.at_bound(value):
                out[k] = domain.coordinate(domain.inside(value))
        return out

    def status(self, symbol: str) -> str:
        """ "estimated", "fixed" or "tied"."""
        if symbol in dict(self.ties):
            return "tied"
        return "fixed" if symbol in self.held else "estimated"


@dataclass(frozen=True, eq=False)
class FreeParameters:
    """The free parameters of a rig, and the values in rig.toml of all parameters."""

    layout: Layout  # the free parameters
    held: Float[np.ndarray, " H"]  # values of the held parameters, SI, shape (H,)
    priors: Mapping[str, tuple[float, float]]  # symbol -> (mean, standard deviation) of a Gaussian prior, SI
    start: Mapping[str, float]  # symbol -> value from which the fit starts, SI

    def values(self, x: np.ndarray) -> dict[str, float]:
        """All parameters at coordinates x, shape (P,): SI by symbol."""
        return {symbol: float(value) for symbol, value in self.layout.values(x, self.held).items()}

    @cached_property
    def priors_on_coordinates(self) -> tuple[Float[np.ndarray, " P"], Float[np.ndarray, " P"]]:
        """Gaussian priors on the coordinates, to first order in their standard deviation:

            mean_x = x(mean),    sd_x = sd / (dvalue/dx)

        Returns:
            Mean and standard deviation, shape (P,) each, dimensionless; the latter inf if rig.toml gives no prior.
        """
        free = self.layout.free
        mean, sd = np.zeros(len(free)), np.full(len(free), np.inf)
        for k, symbol in enumerate(free):
            if symbol in self.priors:
                domain = self.layout.parameter(symbol).domain
                value, width = self.priors[symbol]
                mean[k] = domain.coordinate(value)
                sd[k] = width / float(jax.grad(domain.value)(mean[k]))
        return mean, sd


def free_parameters(config: RigConfig, further: tuple[type[AbstractEffect], ...] = ()) -> FreeParameters:
    """The free parameters according to rig.toml.

    Args:
        config: rig.toml.
        further: effects in addition to those of Eqs. 1-2 and those in rig.toml.
    Raises:
        MeasurementError: an unknown effect or symbol, an effect named twice, a tie to an unknown symbol, a value out of
            range, or nothing left to fit.
    """
    _each_once(config.effects)
    named = (effect_named(name) for name in config.effects if EFFECT_BY_NAME.get(name) not in PAPER)
    series = (SeriesResistance.at(Place(test)) for test in config.series_ohm)
    every = (*PAPER, *series, *named, *(COMMANDING if config.ecu is not None else ()), *further)
    types = tuple(dict.fromkeys(every))
    parameters = dict(catalogue(types))
    fixed: dict[str, float] = {}
    fixed |= {SERIES + test: ohm for test, ohm in config.series_ohm.items() if ohm is not None}
    known: dict[str, Knowledge] = {"K_m": Tied("K_b")}
    if "V_0" in parameters and config.supply_V:
        known["V_0"] = Fixed(config.supply_V)
    known |= config.parameters
    known.pop("N", None)
    for symbol in known:
        _must_exist(symbol, parameters)
    fixed |= {s: k.value for s, k in known.items() if isinstance(k, Fixed)}
    ties = {s: k.to for s, k in known.items() if isinstance(k, Tied)}
    for symbol, other in ties.items():
        _must_tie(symbol, other, ties, parameters)
    for symbol, knowledge in known.items():
        if not isinstance(knowledge, Tied):
            _must_lie(parameters[symbol], knowledge.value)
    free = tuple(s for s in parameters if s not in fixed and s not in ties)
    if not free:
        raise MeasurementError("rig.toml: [parameters]", "nothing is left to fit: every parameter is fixed or tied.",
                               "At least one must be free.",
                               "Remove the line of one, or write it as { value = 1.0, sd = 0.1 }.")  # fmt: skip
    priors = {s: (k.value, k.sd) for s, k in known.items() if isinstance(k, Prior)}
    start = {s: k.value for s, k in known.items() if isinstance(k, (Prior, Start, Fixed))}
    layout = Layout(types, tuple(parameters.values()), free, tuple(fixed), tuple(ties.items()))
    return FreeParameters(layout, np.array(list(fixed.values()), dtype=float), priors, start)


def _each_once(names: Sequence[str]) -> None:
    for name in names:
        if names.count(name) > 1:
            found = f"names {name!r} {names.count(name)} times."
            raise MeasurementError("rig.toml: [model] effects", found, "An effect acts once.", "Delete the others.")


def effect_named(name: str) -> type[AbstractEffect]:
    """The effect with this name in rig.toml and diagnosis.json, rig effects included.

    Raises:
        MeasurementError: there is no such effect.
    """
    found = EFFECT_BY_NAME.get(name) or rig_effect(name)
    if found is None:
        known = [n for n, effect in EFFECT_BY_NAME.items() if effect not in PAPER]
        required = f"Known effects: {', '.join(known)}; of the rig, with their place: {', '.join(FAMILY_BY_KIND)}."
        raise MeasurementError("rig.toml: [model] effects", f"names {name!r}.", required,
                               closest(name, (*known, *FAMILY_BY_KIND), "Correct the name, or delete it."))  # fmt: skip
    return found


def _must_exist(symbol: str, parameters: Mapping[str, Parameter]) -> None:
    if symbol not in parameters:
        known = ", ".join(parameters)
        where = "rig.toml: [parameters]"
        raise MeasurementError(where, f"names {symbol!r}.", f"This model has: {known}.", "Correct the symbol.")


def _must_lie(parameter: Parameter, value: float) -> None:
    """Refuse a value of the wrong sign, or of a size that only a mistake in the unit explains."""
    domain, most = parameter.domain, _FARTHEST * parameter.domain.scale
    least = most / _FARTHEST**2 if isinstance(domain, Positive) else 0.0 if isinstance(domain, NonNegative) else -most
    if not least <= value <= most:
        found = f"{parameter.symbol} is {value:g} {parameter.unit}."
        required = f"It must lie between {least:.3g} and {most:.3g}; a usual size is {domain.scale:g}."
        raise MeasurementError("rig.toml: [parameters]", found, required, "Correct the number; it is in SI.")


def _must_tie(symbol: str, other: str, ties: Mapping[str, str], parameters: Mapping[str, Parameter]) -> None:
    if other not in parameters or other in ties:
        found = f"ties {symbol} to {other!r}."
        required = "A tie must name a parameter that is not itself tied."
        raise MeasurementError("rig.toml: [parameters]", found, required, "Name another, or give a number.")
