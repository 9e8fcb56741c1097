"""The part of a sine trace that counts: where the setpoint moves, whole cycles, and no transient."""

from __future__ import annotations

import numpy as np
import pytest

from etcfit.control.frequency.wave import Signal
from etcfit.control.frequency.window import common, frequency_of, moving, settled
from etcfit.control.settings import FrequencySettings

RATE, HERTZ = 500.0, 2.0


def sine(cycles: float, lead: float = 0.0, fading: float = 0.0) -> Signal:
    """At rest for `lead` s, then so many cycles; `fading` is the size of a transient of 0.3 s time constant."""
    time = np.arange(round((lead + cycles / HERTZ) * RATE)) / RATE
    since = np.maximum(time - lead, 0.0)
    return Signal(time, 0.5 + np.sin(2.0 * np.pi * HERTZ * since) + fading * (since > 0.0) * np.exp(-since / 0.3))


def test_a_setpoint_at_rest_before_and_after_is_cut_off() -> None:
    still = sine(3.0, lead=0.4)
    found = moving(Signal(np.append(still.time, still.time[-1] + 1.0), np.append(still.value, still.value[-1])))
    assert found.time[0] == pytest.approx(0.4, abs=2.0 / RATE)
    assert found.time[-1] == pytest.approx(still.time[-1])
    assert moving(Signal(still.time, np.ones(still.time.size))).time.size == 0


@pytest.mark.parametrize("cycles", [3.0, 7.3, 40.0])
def test_the_frequency_is_found_between_the_bins(cycles: float) -> None:
    assert frequency_of(sine(cycles)) == pytest.approx(HERTZ, rel=1e-6)


def test_both_must_have_been_logged() -> None:
    begin, end = common(
        Signal(np.arange(0.0, 2.0, 0.1), np.zeros(20)), Signal(np.arange(0.5, 3.0, 0.01), np.zeros(250))
    )
    assert (begin, end) == (0.5, pytest.approx(2.0))


def test_a_window_is_whole_cycles_up_to_the_end_without_the_transient() -> None:
    for fading, fewest in ((0.0, 1.0), (0.5, 2.0)):
        found = settled(sine(8.4), sine(8.4, fading=fading), HERTZ, 1)
        assert found.end - found.begin == pytest.approx(found.cycles / HERTZ)
        assert found.skipped >= fewest
        assert found.cycles + found.skipped == pytest.approx(8.4)


def test_what_is_alike_enough_is_a_matter_of_settings() -> None:
    fading = sine(8.4, fading=0.5)
    strict, lax = (settled(sine(8.4), fading, HERTZ, 1, FrequencySettings(same=same)).cycles for same in (1e-6, 1.0))
    assert strict < lax == 7  # the very first one is always left out
