"""The class of detectors, and the records that they evaluate: the traces, and the circuit of each trace and rig
test."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from math import erfc
from typing import NamedTuple, TypeVar

from ...errors import first_names
from ..base import Channel, Finding, Measurement, RigConfig
from ..rows import NUMBER
from .circuit import Circuit, OtherCurrent, other_current, read_circuit
from .line import Spectrum, spectrum

LOWER_MAINS = 50.0  # Hz
COMMANDS = ("setpoint", "duty")  # channels without a sensor: they may rest at any value, and have no noise
_ALIKE = 2.0  # factor within which a reading of one trace counts as that of its test with the opposite sign
Key = TypeVar("Key")
Value = TypeVar("Value")


@dataclass(frozen=True, eq=False)
class Records:
    """All traces of a rig, including held-out ones, and evaluations that several detectors share."""

    config: RigConfig
    traces: tuple[Measurement, ...]
    # tests whose circuit is wrong because of a mistake found before
    blamed: frozenset[str] = frozenset()

    def without(self, tests: Iterable[str]) -> Records:
        """The records with these tests marked as having an untrusted circuit."""
        blamed = self.blamed | {*tests}
        return self if blamed == self.blamed else replace(self, blamed=blamed)

    @cached_property
    def tests(self) -> Mapping[str, tuple[Measurement, ...]]:
        """Traces by rig test."""
        names = dict.fromkeys(trace.test for trace in self.traces)
        return {name: tuple(trace for trace in self.traces if trace.test == name) for name in names}

    @property
    def _trusted(self) -> Mapping[str, tuple[Measurement, ...]]:
        """Traces of the tests whose circuit is trusted."""
        return {name: traces for name, traces in self.tests.items() if name not in self.blamed}

    @cached_property
    def circuits(self) -> Mapping[str, Circuit]:
        """The circuit by rig test, where the traces show it."""
        return _present({name: read_circuit(traces, self.config) for name, traces in self._trusted.items()})

    @cached_property
    def currents(self) -> Mapping[str, OtherCurrent]:
        """The current of each rig test in each of its interpretations, where enough windows compare them."""
        return _present({name: other_current(traces, self.config) for name, traces in self._trusted.items()})

    @cached_property
    def circuit_of(self) -> Mapping[str, Circuit]:
        """The circuit by file, where the trace shows it."""
        return _present({t.file: read_circuit((t,), self.config) for t in self.traces if t.test not in self.blamed})

    @cached_property
    def spectra(self) -> Mapping[tuple[str, str], Spectrum]:
        """Spectra about the mains' frequencies, by file and measured channel, where the record allows one."""
        logged = [(t.file, name, c) for t in self.traces for name, c in t.channels.items() if name not in COMMANDS]
        return _present({(file, name): spectrum(channel, LOWER_MAINS) for file, name, channel in logged})

    def where(
        self, read: Callable[[Measurement, RigConfig], Value | None]
    ) -> Iterator[tuple[tuple[Measurement, ...], dict[str, Value]]]:
        """The traces of each rig test in which a function gives a result, and the results by file."""
        for traces in self.tests.values():
            if found := _present({t.file: read(t, self.config) for t in traces}):
                yield traces, found

    def signs(self, trace: Measurement, errors: float) -> Signs | None:
        """Signs of R, L and k in a trace; where it shows none, those of all traces of its test.

        One trace separates the values poorly: its own sign is accepted against that of its test only where its value is
        about as large.
        """
        both = [c for c in (self.circuit_of.get(trace.file), self.circuits.get(trace.test)) if c is not None]
        if not both:
            return None

        def first(name: str) -> int:
            own, whole = (getattr(c, name) for c in (both[0], both[-1]))
            signs = [value.sign(errors) if value is not None else 0 for value in (own, whole)]
            if signs[0] * signs[1] < 0 and not 1.0 / _ALIKE < -own.value / whole.value < _ALIKE:
                return signs[1]
            return signs[0] or signs[1]

        return Signs(first("R"), first("L"), first("k"))


class Signs(NamedTuple):
    """Signs: -1, 1, or 0 where the sign is not significant."""

    R: int
    L: int
    k: int


@dataclass(frozen=True)
class Detector:
    """Finds one kind of mistake or habit of the rig before any fit."""

    find: Callable[[Records], Iterator[Finding]]  # gives every finding, the surest first; its name is the kind
    explains: bool = False  # whether a finding makes the circuit of its test wrong, so that later detectors skip it

    @property
    def kind(self) -> str:
        """Name of the mistake."""
        return self.find.__name__


def found_in(files: Iterable[str], traces: tuple[Measurement, ...], finding: Finding) -> Finding:
    """The finding with its place in front of its sentence: every trace of a rig test, or these files of it."""
    test, shown = traces[0].test, list(files)
    if len(shown) < len(traces):
        where = first_names(shown, 3)
    else:
        where = f"every trace of {test}" if len(traces) > 1 else shown[0]
    alone = shown[0] if len(shown) == 1 and len(traces) > 1 else None
    return replace(finding, found=f"In {where} {finding.found}", test=test, file=alone)


def by_chance(errors: float) -> float:
    """Probability that noise moves a reading by so many standard errors, in either direction."""
    return erfc(errors / 2**0.5)


def column(channel: Channel, factor: float = 1.0) -> str:
    """The header with which a channel's numbers times this factor are right."""
    return f"{channel.name} [{scaled_unit(channel.unit, factor)}]"


def scaled_unit(unit: str, factor: float) -> str:
    """The unit that is `unit` times the factor, as a header may name it: with a number before the unit if needed."""
    head, _, rest = unit.partition(" ")
    if rest and NUMBER.fullmatch(head):
        factor, unit = factor * float(head), rest
    return unit if abs(factor - 1.0) < 1e-9 else f"{factor:.6g} {unit}"


def _present(values: Mapping[Key, Value | None]) -> dict[Key, Value]:
    return {name: value for name, value in values.items() if value is not None}
