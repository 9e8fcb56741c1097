"""True terminal voltages: linear between knots, with jumps at any instant."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

KNOT = 2e-4  # s between the knots of a curved signal


@dataclass(frozen=True)
class Drive:
    """Knots in time (s, two at one time make a jump) and volts (V)."""

    time: np.ndarray
    volts: np.ndarray

    def after(self, quiet: float, until: float) -> Drive:
        """The same, begun after `quiet` s at 0 V and held at its last volts until `until` s."""
        time = np.concatenate(([0.0, quiet], quiet + self.time, [max(until, quiet + self.time[-1])]))
        return Drive(time, np.concatenate(([0.0, 0.0], self.volts, [self.volts[-1]])))

    def slewed(self, rise: float) -> Drive:
        """The same with each jump spread over `rise` s, as an amplifier of finite slew rate gives it."""
        jumped = np.concatenate(([False], np.diff(self.time) == 0.0))
        return Drive(self.time + rise * jumped, self.volts)

    def in_step(self, rate: float, phase: float) -> Drive:
        """The same with each jump moved on to `phase` sample periods before the next sample of a clock of `rate` Hz."""
        jumps = np.concatenate(([False], np.diff(self.time) == 0.0))
        jumps[:-1] |= jumps[1:]
        moved = (np.ceil(self.time * rate + phase) - phase) / rate
        return Drive(np.where(jumps, moved, self.time), self.volts)

    def delayed(self, delay: float, period: float) -> Drive:
        """The same at the next whole period (s) after a delay (s); what stood at the first knot stood before."""
        late = period * np.ceil((self.time + delay) / period)
        return Drive(np.concatenate((self.time[:1], late)), np.concatenate((self.volts[:1], self.volts)))

    def at(self, instants: np.ndarray) -> np.ndarray:
        """Volts at these instants (s)."""
        return np.interp(instants, self.time, self.volts)

    def limited(self, supply: float) -> Drive:
        """Clipped to what the supply can give, V; exact where knots are dense or constant between jumps."""
        return Drive(self.time, np.clip(self.volts, -supply, supply))


def steps(durations: np.ndarray, levels: np.ndarray) -> Drive:
    """Each level (V) for its duration (s), with jumps between."""
    edges = np.concatenate(([0.0], np.cumsum(durations)))
    return Drive(np.repeat(edges, 2)[1:-1], np.repeat(levels, 2))


def random_steps(rng: np.random.Generator, duration: float, middle: float, swing: float) -> Drive:
    """Levels 0.2 to 2.6 swings (V) above or below the middle, each for 60 to 400 ms, most to the other side in turn."""
    durations = rng.uniform(0.06, 0.4, int(duration / 0.06) + 1)
    count = int(np.searchsorted(np.cumsum(durations), duration)) + 1
    sides = np.cumprod(np.where(rng.uniform(size=count) < 0.75, -1.0, 1.0))
    return steps(durations[:count], middle + swing * sides * rng.uniform(0.2, 2.6, count))


def line(times: list[float], volts: list[float]) -> Drive:
    """Straight lines through these corners."""
    return Drive(np.array(times), np.array(volts))


def curve(duration: float, volts_at: np.ndarray) -> Drive:
    """A sampled curve, linear between its knots."""
    return Drive(np.linspace(0.0, duration, len(volts_at)), volts_at)


def multisine(rng: np.random.Generator, duration: float, offset: float, amplitude: float) -> Drive:
    """Eight sines of 0.3 to 9 Hz with random phases around an offset, falling as 1/sqrt f; peak `amplitude`, V."""
    t = _grid(duration)
    hertz = np.geomspace(0.3, 9.0, 8) * rng.uniform(0.9, 1.1, 8)
    waves = np.sin(2 * np.pi * np.outer(t, hertz) + rng.uniform(0, 2 * np.pi, 8)) @ hertz**-0.5
    return curve(duration, offset + amplitude * waves / np.abs(waves).max())


def chirp(duration: float, offset: float, amplitude: float, first: float = 0.4, last: float = 8.0) -> Drive:
    """offset + amplitude sin(phase), the frequency rising exponentially from first to last Hz."""
    t = _grid(duration)
    rate = np.log(last / first) / duration
    return curve(duration, offset + amplitude * np.sin(2 * np.pi * first * np.expm1(rate * t) / rate))


def trapezoids(duration: float, low: float, high: float, period: float = 1.0, edge: float = 0.1) -> Drive:
    """From low to high and back, V, once a period with edges of `edge` s: the paper's own setpoint shape."""
    one = np.array([0.0, edge, period / 2, period / 2 + edge])
    starts = np.arange(0.0, duration - period / 2, period)
    return Drive((starts[:, None] + one).ravel(), np.tile([low, high, high, low], len(starts)))


def _grid(duration: float) -> np.ndarray:
    return np.linspace(0.0, duration, int(duration / KNOT) + 1)
