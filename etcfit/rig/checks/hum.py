"""Mains hum: a line at 50 or 60 Hz in a channel, the same in every trace of a test.

    chance = P(chi2_(2n) > -2 sum log p_j),   p_j from `line.py`, over the n traces of the test

It must be far clearer than the clearest line in the bands beside it, which motion that repeats itself makes as well.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from ...ranges import real
from ..finding import Finding
from .base import AbstractDetector, Records
from .line import Line, Spectrum, line_near

MAINS = (50.0, 60.0)  # Hz
SILENT = ("setpoint", "duty")  # no sensor's channels


class Mains(NamedTuple):
    """The mains as one channel of one rig test shows it.

    Args:
        nominal: Hz.
        lines: of each trace in which a line could be sought.
        chance: of all of them together.
        beside: that of the clearest lines in the bands beside it.
        amplitude: median, SI.
        frequency: weighted mean by the log's clock, Hz; error: its standard error.
    """

    nominal: float
    lines: tuple[Line, ...]
    chance: float
    beside: float
    amplitude: float
    frequency: float
    error: float

    def clear(self, chance: float) -> bool:
        """Rarer than this, and than the square of what is seen beside it."""
        return self.chance < chance and self.chance < max(self.beside, 1e-150) ** 2


def mains_in(records: Records, test: str, name: str, band: float) -> Mains | None:
    """The clearer of the two mains frequencies in a channel of a test's traces; None where none can be sought."""
    spectra = [s for t in records.tests[test] if name in t.channels if (s := records.spectrum(t, name)) is not None]
    found = [_at(spectra, nominal, band) for nominal in MAINS] if spectra else []
    return min(found, key=lambda m: m.chance, default=None)


def _at(spectra: Sequence[Spectrum], nominal: float, band: float) -> Mains:
    lines = tuple(line_near(s, nominal, band) for s in spectra)
    weight = np.array([1.0 / line.error**2 for line in lines])
    frequency = float(np.sum(weight * [line.frequency for line in lines]) / max(float(np.sum(weight)), 1e-300))
    return Mains(nominal, lines, _together([line.chance for line in lines]), _together([x.beside for x in lines]),
                 float(np.median([line.amplitude for line in lines])), frequency,
                 float(1.0 / np.sqrt(max(float(np.sum(weight)), 1e-300))))  # fmt: skip


def _together(chances: Sequence[float]) -> float:
    """Chance of n chances as small as these, by chi2 of 2n degrees of freedom (Fisher 1932).

    exp(-h) sum_(k < n) h^k / k!,    h = -sum log chance
    """
    h = -float(np.sum(np.log(np.maximum(chances, 1e-300))))
    if h == 0.0:
        return 1.0
    return math.fsum(math.exp(k * math.log(h) - h - math.lgamma(k + 1)) for k in range(len(chances)))


@dataclass(frozen=True)
class Hum(AbstractDetector):
    """See the module.

    Args:
        chance: the greatest of a find.
        band: relative deviation of the mains frequency that is searched.
        noises: of one sample, the least amplitude.
    """

    chance: float = real(1e-6, 0.0, 1.0)
    band: float = real(0.01, 0.0, 1.0)
    noises: float = real(0.15, 0.0)
    kind: ClassVar[str] = "hum"

    def find(self, records: Records) -> Iterator[Finding]:
        for test, traces in records.tests.items():
            for name in dict.fromkeys(n for t in traces for n in t.channels if n not in SILENT):
                mains = mains_in(records, test, name, self.band)
                channel = next(t.channels[name] for t in traces if name in t.channels)
                if mains and mains.clear(self.chance) and mains.amplitude > self.noises * channel.sigma:
                    size = mains.amplitude / abs(channel.scale)
                    yield Finding(self.kind, size, channel.unit, mains.chance,
                                  f"In {test} '{channel.header}' carries a line of {mains.nominal:g} Hz, amplitude "
                                  f"{size:.3g} {channel.unit}.",
                                  "Ground or twist the sensor's leads and log again; until then "
                                  f"[noise] in rig.toml must count it, {_noise(channel.header, channel.unit)} = "
                                  f"{np.hypot(channel.sigma / abs(channel.scale), size / np.sqrt(2)):.3g}.",
                                  test, channel=name)  # fmt: skip


def _noise(header: str, unit: str) -> str:
    return f"{header.partition('[')[0].strip().replace(' ', '_')}_{unit.replace('/', '_').replace(' ', '')}"
