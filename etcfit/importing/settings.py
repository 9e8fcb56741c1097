"""What decides a guess, and when it is sure."""

from __future__ import annotations

from dataclasses import dataclass

from ..ranges import check_ranges, real, whole


@dataclass(frozen=True)
class GuessSettings:
    """Thresholds of `etcfit import`.

    Args:
        follows: correlation, or share of the variance, from which one signal follows another.
        surely_follows: the same, for it to be sure.
        apart: by which the better of two must lead to be sure.
        least_sensor, most_sensor: what a position sensor can read, V.
        turns: strength of a vote, 0 to 1, from which a sign is believed.
        surely_turns: the same, for it to be sure.
        exchanged: part of a drive that must be negative for its leads to count as exchanged.
        pause, pause_s: times the usual step, and seconds, without a sample that part two traces.
        rest_s, rest_level: seconds at less than this part of the largest drive that part two traces.
        shortest_s: of a piece between two rests.
        anew: part of the time gone by that a clock must fall back to have begun anew.
        stands: part of its range within which a plate stands.
        open_end: part of the range below the top from which a plate is let go.
        release_s: that a plate let go takes at most for the middle of its way.
        fewest: samples of a trace.
        resolved: samples on the way of a rise from which its time constant can be read.
        bench_s: of a setpoint; a longer one is a drive's.
        one_level: part of a voltage within which it counts as one level.
        held: share of the current's variance that v/R explains where the plate is held.
        ramp_s: that a slow ramp takes each way, at least.
        beyond_deg: that a reading may lie beyond 0 to 90 degrees before the travel counts as another.
        end_quantile: of what was read that counts as an end stop.
    """

    follows: float = real(0.6, 0.0, 1.0)
    surely_follows: float = real(0.7, 0.0, 1.0)
    apart: float = real(0.2, 0.0, 1.0)
    least_sensor: float = real(-0.2)
    most_sensor: float = real(5.7, above=0.0)
    turns: float = real(0.3, 0.0, 1.0)
    surely_turns: float = real(0.6, 0.0, 1.0)
    exchanged: float = real(0.8, 0.0, 1.0)
    pause: float = real(50.0, above=1.0)
    pause_s: float = real(0.2, above=0.0)
    rest_s: float = real(1.0, above=0.0)
    rest_level: float = real(0.03, 0.0, 1.0)
    shortest_s: float = real(0.3, 0.0)
    anew: float = real(0.5, above=0.0, high=1.0)
    stands: float = real(0.02, above=0.0, below=1.0)
    open_end: float = real(0.1, above=0.0, below=1.0)
    release_s: float = real(0.7, above=0.0)
    fewest: int = whole(10, 2)
    resolved: int = whole(3, 1)
    bench_s: float = real(60.0, above=0.0)
    one_level: float = real(0.05, 0.0, 1.0)
    held: float = real(0.9, 0.0, 1.0)
    ramp_s: float = real(1.0, above=0.0)
    beyond_deg: float = real(4.0, 0.0)
    end_quantile: float = real(0.001, 0.0, below=0.5)

    __post_init__ = check_ranges
