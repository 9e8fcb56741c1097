"""The contract of a rig effect: an effect between throttle and log, in the traces of one place.

The model of the throttle does not include the resistor in a test's circuit, a probe that reads 2 % high or a slow
clock. A rig effect changes the inputs of the model (`driven`, `begun`) and its readings (`read`). The model itself does
not change, so simulation and compilation take hardly longer.
"""

from __future__ import annotations

import json
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import cache
from typing import Any, ClassVar, NamedTuple

import jax.numpy as jnp

from ..effects.base import AbstractEffect, Contribution, Inputs, State
from ..parameters import Parameter, Scalar, declared

# rig test, or file of one trace -> channels logged there; "voltage", "duty" or "torque" if it was the input
Logged = Mapping[str, frozenset[str]]
STATIC = "resistance"  # rig test in which nothing depends on time
APART = "viscous"  # rig test in which the motor runs alone
DRIVING = ("voltage", "torque")  # channels that are inputs
OBSERVED = ("current", "position", "emf", "motor_speed")  # channels that a model predicts


class Place(NamedTuple):
    """The place of a rig effect.


    A channel of one trace is written `response/3.csv.current`.
    """

    test: str = ""  # name of the rig test; "" for all of them
    channel: str = ""  # "current", "position", ...; "" for no particular channel
    file: str = ""  # file of one trace, as in `response/3.csv`; "" for every trace of the test

    def __str__(self) -> str:
        where = self.file or self.test
        return f"{where}.{self.channel}" if self.channel else where

    @classmethod
    def named(cls, text: str) -> Place:
        """The place with this text; a text with a slash is a file, or a channel of it if its last part is a channel."""
        test, slash, _ = text.partition("/")
        if not slash:
            return cls(*text.split(".", 1))
        file, _, channel = text.rpartition(".")
        return cls(test, channel, file) if channel in (*OBSERVED, *DRIVING) else cls(test, "", text)

    @property
    def words(self) -> str:
        """The place as part of a sentence: "current of the response test"."""
        test = f"the {self.test} test" if self.test else "every test"
        where = f"the trace {self.file}" if self.file else test
        return f"{self.channel} of {where}" if self.channel else where


def number_of(name: str) -> float:
    """A number for a rig test or a file, CRC-32 of its name: arrays of it give the test or trace of each entry."""
    return float(zlib.crc32(name.encode()))


class AbstractRigEffect(AbstractEffect):
    """A mistake or a habit of the rig, at one place: an effect outside the throttle. At its off value it changes
    nothing.

    A class is a family of effects; `at` makes the effect of a place, called `kind[place]`, whose parameters have the
    place in their symbol (`series_ohm.inductance`). `places` gives the places where a rig could show it, `in_traces`
    those of single traces. An effect that `delays` gives the lateness of channels by `lateness`: their readings need
    the path before.

    Attributes:
        kind: its name in rig.toml and diagnosis.json, without the place.
        place: the place of the effect; for a family, everywhere.
        acts_on: channels of which a place must have logged one for the effect to change anything; () for any channel.
        of_a_channel: its place is one of these channels, of a test or of one trace, not a whole test.
        like: parameter of the throttle whose change in one trace has the same action as this effect there; required of
            a family that is found `in_traces` and does not delay, because the tangent of this parameter screens all
            traces. A family `of_a_channel` needs none: its action in one trace is that in the whole test.
    """

    kind: ClassVar[str]
    place: ClassVar[Place] = Place()
    acts_on: ClassVar[tuple[str, ...]] = ()
    of_a_channel: ClassVar[bool] = False
    like: ClassVar[str] = ""
    scope = "test"
    inexact = 0.0  # gains and resistances have exact formulas

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        """No contribution: the throttle itself does not change."""
        return Contribution()

    @classmethod
    def places(cls, logged: Logged) -> tuple[Place, ...]:
        """Places where it could be distinguished from the throttle, by the channels of each test."""
        return ()

    @classmethod
    def in_traces(cls, logged: Logged) -> tuple[Place, ...]:
        """Single traces that could show it, by the channels of each file."""
        return ()

    @classmethod
    def everywhere(cls, logged: Logged, traces: Logged) -> tuple[Place, ...]:
        """Every place where it changes something, even if these data do not determine it there: its size may be known.

        Args:
            logged: channels by test.
            traces: channels by file.
        """
        if cls.of_a_channel:
            named = {Place.named(name): seen for name, seen in {**logged, **traces}.items()}
            return tuple(place._replace(channel=c) for place, seen in named.items() for c in cls.acts_on if c in seen)
        found = {name for name, seen in {**logged, **traces}.items() if not cls.acts_on or seen & {*cls.acts_on}}
        if cls.scope == "rig":
            return (Place(),) if found else ()
        return tuple(Place.named(name) for name in (traces if cls.scope == "trace" else logged) if name in found)

    @classmethod
    def mend(cls, value: float) -> str:
        """The line of rig.toml that corrects it.

        Args:
            value: value of its first parameter, SI.
        """
        return f"[model] effects = [{json.dumps(cls.name, ensure_ascii=False)}]"  # TOML quotes a text as JSON does

    @classmethod
    def cured(cls, config: Any, value: float) -> Any | None:
        """The rig (a `RigConfig`) with the right number in rig.toml instead of one that is off by `value`, the first
        parameter, SI; None if no number of rig.toml is wrong."""
        return None

    @classmethod
    def compounded(cls, cured: float, left: float) -> float:
        """Its first parameter, SI, in the rig as given, if it is `left` in the rig cured of `cured`."""
        return cured + left

    @classmethod
    def called(cls, value: float) -> str:
        """Kind of mistake for a value of its first parameter (SI): for example, a gain of -1 is a wrong sign."""
        return cls.kind

    def driven(self, steps: Any, test_of: Scalar) -> Any:
        """The steps as they act on the throttle, from those logged.

        Args:
            test_of: `number_of` the rig test of each entry, of the steps' shape.
        """
        return steps

    def begun(self, resets: Any, test_of: Scalar, trace: Scalar | None) -> Any:
        """The true states in which traces begin, from those read.

        Args:
            test_of, trace: `number_of` the rig test and of the file of each entry, of the resets' shape; see `here`.
        """
        return resets

    def read(self, seen: dict[str, Scalar], test_of: Scalar, trace: Scalar | None) -> dict[str, Scalar]:
        """The logged values, from the sensors' readings.

        Args:
            seen: readings by channel, SI.
            test_of, trace: `number_of` the rig test and of the file of each entry; see `here`.
        """
        return seen

    def lateness(self, steps: Any, test_of: Scalar) -> dict[str, Scalar]:
        """Lateness of channels, s; negative if they are early. {}: none is late."""
        return {}

    def here(self, test_of: Scalar, trace: Scalar | None) -> Scalar:
        """1 at entries of its test, or of its trace, else 0.

        Args:
            test_of: `number_of` the rig test of each entry.
            trace: `number_of` its file; None if the batch was not made of traces, so that no trace is meant.
        """
        if self.place.file:
            return 0.0 if trace is None else jnp.where(trace == number_of(self.place.file), 1.0, 0.0)
        return jnp.where(test_of == number_of(self.place.test), 1.0, 0.0) if self.place.test else 1.0

    @classmethod
    def named(cls, p: Parameter) -> Parameter:
        if not str(cls.place):
            return p
        return replace(p, symbol=f"{p.symbol}.{cls.place}", meaning=f"{p.meaning}, {cls.place.words}")

    @classmethod
    def at(cls, place: Place) -> type[AbstractRigEffect]:
        """The effect of this family at one place; one class per place."""
        return _placed(cls, place)


@cache
def _placed(family: Any, place: Place) -> Any:
    name = f"{family.kind}[{place}]" if str(place) else family.kind
    words = {"__module__": family.__module__, "__doc__": family.__doc__, "name": name, "place": place}
    if place.file:
        words["scope"] = "trace"
    if place.file and place.channel:
        words["told_by"] = "that trace measured again"
    placed = type(family)(family.__name__, (family,), words)
    placed.off = {p.symbol: family.off[field] for field, p in declared(placed).items() if field in family.off}
    return placed


_SIGNALS = frozenset({*OBSERVED, *DRIVING})


def channels_of_traces(
    traces: Logged, channels: Iterable[str], places: Callable[[Logged], tuple[Place, ...]]
) -> tuple[Place, ...]:
    """Places of channels in single traces.

    The trace must have logged another signal too, and another trace, of any test, must have logged the channel. A test
    with one trace has no such place if the test itself is a place: both would be the same, and the test is simpler.

    Args:
        traces: channels that each file logged.
        channels: the channels to consider.
        places: gives the places of whole tests, by the channels of each.
    """
    tests = places(_by_test(traces))
    logged = Counter(channel for seen in traces.values() for channel in seen)
    files = Counter(Place.named(file).test for file in traces)
    found = []
    for file, seen in traces.items():
        place = Place.named(file)
        usable = [c for c in channels if c in seen and logged[c] > 1 and len(seen & _SIGNALS) > 1]
        found += [
            place._replace(channel=c) for c in usable if files[place.test] > 1 or Place(place.test, c) not in tests
        ]
    return tuple(found)


def _by_test(traces: Logged) -> dict[str, frozenset[str]]:
    found: dict[str, frozenset[str]] = {}
    for file, channels in traces.items():
        test = Place.named(file).test
        found[test] = found.get(test, frozenset()) | channels
    return found
