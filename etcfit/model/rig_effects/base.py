"""The contract of a rig effect: what stands between throttle and log, in the traces of one place.

A throttle knows nothing of the resistor in a test's circuit, of a probe that reads 2 % high or of a clock that is slow.
A rig effect changes what goes into the model (`driven`, `begun`) and what is read off it (`read`); inside the model
nothing changes, so it costs next to nothing to simulate and to compile.
"""

from __future__ import annotations

import abc
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

# rig test, or file of one trace -> channels logged there; "voltage", "duty" or "torque" where one drove
Logged = Mapping[str, frozenset[str]]
STATIC = "resistance"  # rig test in which nothing depends on time
APART = "viscous"  # rig test in which the motor runs alone
DRIVING = ("voltage", "torque")  # those that drive it
OBSERVED = ("current", "position", "emf", "motor_speed")  # channels that a model predicts


class Place(NamedTuple):
    """Where a rig effect is at work.

    Args:
        test: name of the rig test; "" for all of them.
        channel: "current", "position", ...; "" where none is meant.
        file: of the one trace that is meant, as in `response/3.csv`; "" for every trace of the test.

    A channel of one trace is written `response/3.csv.current`.
    """

    test: str = ""
    channel: str = ""
    file: str = ""

    def __str__(self) -> str:
        where = self.file or self.test
        return f"{where}.{self.channel}" if self.channel else where

    @classmethod
    def named(cls, text: str) -> Place:
        """The one that is written so; what has a slash is a file, or a channel of it where its last part is one."""
        test, slash, _ = text.partition("/")
        if not slash:
            return cls(*text.split(".", 1))
        file, _, channel = text.rpartition(".")
        return cls(test, channel, file) if channel in (*OBSERVED, *DRIVING) else cls(test, "", text)

    @property
    def words(self) -> str:
        """As part of a sentence: "current of the response test"."""
        test = f"the {self.test} test" if self.test else "every test"
        where = f"the trace {self.file}" if self.file else test
        return f"{self.channel} of {where}" if self.channel else where


def number_of(name: str) -> float:
    """A number for a rig test or a file, CRC-32 of its name: by it arrays tell which test or trace an entry is of."""
    return float(zlib.crc32(name.encode()))


class AbstractRigEffect(AbstractEffect):
    """A mistake or a habit of the rig, at one place: an effect outside the throttle. At its off value it changes
    nothing.

    A class is a family of effects; `at` makes the one of a place, called `kind[place]`, whose parameters carry the
    place in their symbol (`series_ohm.inductance`). `places` says where a rig could show it, `in_traces` where one
    trace by itself could. One that `delays` says by `lateness` how late channels are logged: what they read needs the
    path before it.

    Attributes:
        kind: its name in rig.toml and diagnosis.json, without the place.
        place: where it is at work; of a family, everywhere.
        acts_on: channels of which a place must have logged one, or it changes nothing there; () where any will do.
        of_a_channel: its place is one of these channels, of a test or of one trace, no whole test.
        like: parameter of the throttle that, changed in one trace, does what this effect does there; needed of a family
            that is found `in_traces` and does not delay, for by that parameter's tangent all traces are screened. One
            `of_a_channel` needs none: it does in one trace what it does in the whole test.
    """

    kind: ClassVar[str]
    place: ClassVar[Place] = Place()
    acts_on: ClassVar[tuple[str, ...]] = ()
    of_a_channel: ClassVar[bool] = False
    like: ClassVar[str] = ""
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
    def in_traces(cls, logged: Logged) -> tuple[Place, ...]:
        """Traces that could show it one by one, by what each file logged."""
        return ()

    @classmethod
    def everywhere(cls, logged: Logged, traces: Logged) -> tuple[Place, ...]:
        """Every place where it changes something, whether or not these data tell it there: its size may be known.

        Args:
            logged: by test.
            traces: by file.
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
        """The line of rig.toml that takes it into account.

        Args:
            value: of its first parameter, SI.
        """
        return f"[model] effects = [{json.dumps(cls.name, ensure_ascii=False)}]"  # TOML quotes a text as JSON does

    @classmethod
    def cured(cls, config: Any, value: float) -> Any | None:
        """The rig (a `RigConfig`) whose rig.toml holds the right number in place of one that is off by `value`, its
        first parameter, SI; None where no number of rig.toml is wrong."""
        return None

    @classmethod
    def compounded(cls, cured: float, left: float) -> float:
        """Its first parameter, SI, in the rig as given, where it is `left` in the rig cured of `cured`."""
        return cured + left

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

    def begun(self, resets: Any, test_of: Scalar, trace: Scalar | None) -> Any:
        """The true states in which traces begin, from those read.

        Args:
            resets: a `Reset`.
            test_of, trace: `number_of` the rig test and of the file of each entry, of the resets' shape; see `here`.
        """
        return resets

    def read(self, seen: dict[str, Scalar], test_of: Scalar, trace: Scalar | None) -> dict[str, Scalar]:
        """What is logged, from what the sensors show.

        Args:
            seen: by channel, SI.
            test_of, trace: `number_of` the rig test and of the file of each entry; see `here`.
        """
        return seen

    def lateness(self, steps: Any, test_of: Scalar) -> dict[str, Scalar]:
        """How late channels are logged, s; negative where they are early. {}: none is."""
        return {}

    def here(self, test_of: Scalar, trace: Scalar | None) -> Scalar:
        """1 at entries of the test, or of the one trace, where it is at work, else 0.

        Args:
            test_of: `number_of` the rig test of each entry.
            trace: of its file; None where no batch was made of traces, for then none of them is meant.
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
        """The effect of this family at one place: one class for each, however often it is asked for."""
        return _placed(cls, place)


@cache
def _placed(family: Any, place: Place) -> Any:
    name = f"{family.kind}[{place}]" if str(place) else family.kind
    words = {"__module__": family.__module__, "__doc__": family.__doc__, "name": name, "place": place}
    if place.file:
        words["scope"] = "trace"
    if place.file and place.channel:
        words["told_by"] = "that trace taken once more"
    placed = type(family)(family.__name__, (family,), words)
    placed.off = {p.symbol: family.off[field] for field, p in declared(placed).items() if field in family.off}
    return placed


_SIGNALS = frozenset({*OBSERVED, *DRIVING})


def channels_of_traces(
    traces: Logged, channels: Iterable[str], places: Callable[[Logged], tuple[Place, ...]]
) -> tuple[Place, ...]:
    """Places of channels in single traces.

    A trace must have logged another signal beside the channel, and another trace, of whatever test, that channel too.
    A test of one trace has none where the test itself is a place: both would be the same, and the test is simpler.

    Args:
        traces: what each file logged.
        channels: those that are meant.
        places: of whole tests, by what each of them logged.
    """
    tests = places(_by_test(traces))
    logged = Counter(channel for seen in traces.values() for channel in seen)
    files = Counter(Place.named(file).test for file in traces)
    found = []
    for file, seen in traces.items():
        place = Place.named(file)
        told = [c for c in channels if c in seen and logged[c] > 1 and len(seen & _SIGNALS) > 1]
        found += [place._replace(channel=c) for c in told if files[place.test] > 1 or Place(place.test, c) not in tests]
    return tuple(found)


def _by_test(traces: Logged) -> dict[str, frozenset[str]]:
    found: dict[str, frozenset[str]] = {}
    for file, channels in traces.items():
        test = Place.named(file).test
        found[test] = found.get(test, frozenset()) | channels
    return found
