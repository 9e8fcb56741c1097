"""Rows of a log at the ticks of the ECU that they show."""

from __future__ import annotations

import numpy as np
import pytest

from etcfit.importing.ecu_clock import ticks

PERIOD = 2e-3


def rows(step: float, late: float, off: float = 0.0, count: int = 4000) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times of rows that come up to a share `late` of a period after their instants, by a clock that is off; rows with
    a tick that no row before showed; and the tick of each."""
    rng = np.random.default_rng(4)
    instants = step * np.arange(count) + PERIOD * rng.uniform(0.05, late, count)
    n = np.floor(instants / PERIOD + 1e-9).astype(int)
    return instants * (1.0 + off), np.diff(n, prepend=-1) > 0, n


@pytest.mark.parametrize(("step", "late", "off"), [(PERIOD, 0.55, 0.0), (PERIOD, 0.4, 2.3e-4), (5 * PERIOD, 0.5, -1e-4),
                                                   (0.5 * PERIOD, 0.3, 5e-5)])  # fmt: skip
def test_rows_go_to_their_ticks_whatever_the_loggers_clock(step: float, late: float, off: float) -> None:
    time, fresh, n = rows(step, late, off)
    found = ticks(time, fresh, PERIOD)
    assert found is not None
    kept, instants = found
    assert np.array_equal(kept, np.flatnonzero(fresh))
    error = instants - PERIOD * (1.0 + off) * n[kept]
    assert np.ptp(error) < 0.02 * PERIOD
    assert np.ptp(time[kept] - PERIOD * (1.0 + off) * n[kept]) > 0.2 * PERIOD  # which they were off by before


def test_rows_at_any_instant_stay_where_they_are() -> None:
    time = np.cumsum(np.random.default_rng(1).uniform(0.5, 1.5, 4000)) * 1.37 * PERIOD
    assert ticks(time, np.ones(time.size, dtype=bool), PERIOD) is None
