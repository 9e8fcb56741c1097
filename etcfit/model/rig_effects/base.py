"""The contract of a rig effect: what stands between throttle and log, in the traces of one place.

A throttle knows nothing of the resistor in a test's circuit, of a probe that reads 2 % high or of a clock that is slow.
A rig effect changes what goes into the model (`driven`, `begun`) and what is read off it (`read`); inside the model
nothing changes, so it costs next to nothing to simulate and to compile.
"""

from __future__ import annotations

import abc
import zlib
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import Any, ClassVar, NamedTuple

import jax.numpy as jnp

from ..effects.base import AbstractEffect, Contribution, Inputs, State
from ..parameters import Parameter, Scalar, declared

Logged = Mapping[str, frozenset[str]]  # rig test -> channels its traces logged, "voltage" or "torque" where one drove


class Place(NamedTuple):
    """Where a rig effect is at work.

    Args:
        test: name of the rig test; "" for all of them.
        channel: "current", "position", ...; "" where none is meant.
    """

    test: str = ""
    channel: str = ""

    def __str__(self) -> str:
        return f"{self.test}.{self.channel}" if self.channel else self.test

    @property
    def words(self) -> str:
        """As part of a sentence: "current of the response test"."""
        test = f"the {self.test} test" if self.test else "every test"
        return f"{self.channel} of {test}" if self.channel else test


def number_of(test: str) -> float:
    """A number for a rig test, CRC-32 of its name: by it arrays tell which test an entry is of."""
    return float(zlib.crc32(test.encode()))


class AbstractRigEffect(AbstractEffect):
    """A mistake or a habit of the rig, at one place: an effect outside the throttle. At its off value it changes
    nothing.

    A class is a family of effects; `at` makes the one of a place, called `kind[place]`, whose parameters carry the
    place in their symbol (`series_ohm.inductance`).

    Attributes:
        kind: its name in rig.toml and diagnosis.json, without the place.
        place: where it is at work; of a family, everywhere.
    """

    kind: ClassVar[str]
    place: ClassVar[Place] = Place()
    scope = "test"
    inexact = 0.0  # gains and resistances are what they are

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        """Nothing: the throttle itself is as it was."""
        return Contribution()

    @classmethod
    @abc.abstractmethod
    def places(cls, logged: Logged) -> tuple[Place, ...]:
        """Where it could be told from the throttle, by what each test logged."""

    @classmethod
    def mend(cls, value: float) -> str:
        """The line of rig.toml that takes it into account.

        Args:
            value: of its first parameter, SI.
        """
        return f'[model] effects = ["{cls.name}"]'

    @classmethod
    def called(cls, value: float) -> str:
        """Kind of mistake that a value of its first parameter (SI) is: a gain of -1 is a wrong sign, say."""
        return cls.kind

    def driven(self, steps: Any, test_of: Scalar) -> Any:
        """The steps as they act on the throttle, from those logged.

        Args:
            steps: a `Step`.
            test_of: `number_of` the rig test of each entry, of the steps' shape.
        """
        return steps

    def begun(self, resets: Any, test_of: Scalar) -> Any:
        """The true states in which traces begin, from those read.

        Args:
            resets: a `Reset`.
            test_of: `number_of` the rig test of each entry, of the resets' shape.
        """
        return resets

    def read(self, seen: dict[str, Scalar], test_of: Scalar) -> dict[str, Scalar]:
        """What is logged, from what the sensors show.

        Args:
            seen: by channel, SI.
            test_of: `number_of` the rig test of each entry.
        """
        return seen

    def here(self, test_of: Scalar) -> Scalar:
        """1 at entries of the test where it is at work, else 0."""
        return jnp.where(test_of == number_of(self.place.test), 1.0, 0.0) if self.place.test else 1.0

    @classmethod
    def named(cls, p: Parameter) -> Parameter:
        if not str(cls.place):
            return p
        return replace(p, symbol=f"{p.symbol}.{cls.place}", meaning=f"{p.meaning}, {cls.place.words}")

    @classmethod
    def at(cls, place: Place) -> type[AbstractRigEffect]:
        """The effect of this family at one place: one class for each, however often it is asked for."""
        return _placed(cls, place)


@cache
def _placed(family: Any, place: Place) -> Any:
    name = f"{family.kind}[{place}]" if str(place) else family.kind
    words = {"__module__": family.__module__, "__doc__": family.__doc__, "name": name, "place": place}
    placed = type(family)(family.__name__, (family,), words)
    placed.off = {p.symbol: family.off[field] for field, p in declared(placed).items() if field in family.off}
    return placed
