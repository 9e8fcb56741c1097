"""What every detector is, and what it sees: the traces, and the circuit that each of them and each rig test shows."""

from __future__ import annotations

import abc
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, NamedTuple

from ...ranges import check_ranges
from ..base import Channel, Measurement, RigConfig
from ..finding import Finding
from ..units import NUMBER
from .circuit import Circuit, read_circuit
from .line import Spectrum, spectrum
from .other_current import OtherCurrent, other_current

MAINS = 50.0  # Hz, the lower of the two
_ALIKE = 2.0  # factor within which a reading of one trace is that of its test turned round


@dataclass(frozen=True, eq=False)
class Records:
    """All traces of a rig, held out ones too, and what several detectors read off them.

    Args:
        config: rig.toml.
        traces: as read.
        blamed: tests whose circuit is known to be read wrong, because of a mistake found before.
    """

    config: RigConfig
    traces: tuple[Measurement, ...]
    blamed: frozenset[str] = frozenset()

    def without(self, tests: Iterable[str | None]) -> Records:
        """As one that does not trust the circuit of these tests."""
        return replace(self, blamed=self.blamed | {test for test in tests if test is not None})

    @cached_property
    def tests(self) -> Mapping[str, tuple[Measurement, ...]]:
        """Traces by rig test."""
        names = dict.fromkeys(trace.test for trace in self.traces)
        return {name: tuple(trace for trace in self.traces if trace.test == name) for name in names}

    @cached_property
    def circuits(self) -> Mapping[str, Circuit]:
        """The circuit by rig test, where it shows."""
        sound = {name: traces for name, traces in self.tests.items() if name not in self.blamed}
        read = {name: read_circuit(traces, self.config) for name, traces in sound.items()}
        return {name: circuit for name, circuit in read.items() if circuit is not None}

    @cached_property
    def currents(self) -> Mapping[str, OtherCurrent]:
        """The current of each rig test in each of its readings, where windows tell them apart."""
        read = {name: other_current(traces, self.config) for name, traces in self.tests.items()}
        return {name: found for name, found in read.items() if found is not None and name not in self.blamed}

    @cached_property
    def circuit_of(self) -> Mapping[str, Circuit]:
        """The circuit by file, where it shows."""
        read = {t.file: read_circuit((t,), self.config) for t in self.traces if t.test not in self.blamed}
        return {file: circuit for file, circuit in read.items() if circuit is not None}

    @cached_property
    def _spectra(self) -> dict[tuple[str, str], Spectrum | None]:
        return {}

    def spectrum(self, trace: Measurement, channel: str) -> Spectrum | None:
        """Of one channel about the frequencies of the mains, worked out once."""
        key = trace.file, channel
        if key not in self._spectra:
            self._spectra[key] = spectrum(trace.channels[channel], MAINS)
        return self._spectra[key]

    def signs(self, trace: Measurement, errors: float) -> Signs | None:
        """Signs of R, L and k in a trace; where it cannot tell one, that of all traces of its test.

        One trace tells little apart: a sign of its own is believed against its test's only for a value about as large.
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
    """-1, 1, or 0 where it cannot be told."""

    R: int
    L: int
    k: int


class AbstractDetector(abc.ABC):
    """Finds one kind of mistake or habit of the rig before any fit.

    A detector is a frozen dataclass: its thresholds are its fields, with defaults and ranges (`ranges.py`), and so a
    part of the policy that can be read, changed and written down.

    Raises:
        ValueError: a threshold lies outside its range.
    """

    kind: ClassVar[str]
    explains: ClassVar[bool] = False  # what is found makes the circuit of its test wrong: no later detector reads it

    def __post_init__(self) -> None:
        check_ranges(self)

    @abc.abstractmethod
    def find(self, records: Records) -> Iterator[Finding]:
        """Every find, the surest first.

        Args:
            records: all traces.
        """


def column(channel: Channel, factor: float = 1.0) -> str:
    """The header under which a channel's numbers, times this factor, are what they should be."""
    name = channel.header.partition("[")[0].strip() or channel.header
    return f"{name} [{scaled_unit(channel.unit, factor)}]"


def scaled_unit(unit: str, factor: float) -> str:
    """The unit of which `unit` times the factor is one, as a header may name it: a number may stand before it."""
    head, _, rest = unit.partition(" ")
    if rest and NUMBER.fullmatch(head):
        factor, unit = factor * float(head), rest
    return unit if abs(factor - 1.0) < 1e-9 else f"{factor:.6g} {unit}"


def everywhere(files: list[str], traces: tuple[Measurement, ...]) -> str | None:
    """The one file that shows it, or None where more than one does."""
    return files[0] if len(files) == 1 and len(traces) > 1 else None


def in_files(test: str, files: list[str], traces: tuple[Measurement, ...]) -> str:
    """Words for where: every trace of a test, or these."""
    if len(files) == len(traces):
        return f"in every trace of {test}" if len(traces) > 1 else f"in {files[0]}"
    return f"in {', '.join(files[:3])}" + (f" and {len(files) - 3} more" if len(files) > 3 else "")
