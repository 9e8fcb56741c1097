"""Rows of a log, moved to the ticks of the ECU whose values they have.

A row is written up to one period after its tick, with a delay that depends on the logger's other work. For a noisy duty
that is held from tick to tick, an error of a share s of a period acts as a push of s times its change: even with the
right model, the free run of a plate with dry friction is then off by ten times the noise of its sensor. If the rows are
in step with the clock,

    t_k = phi + T (1 + eps) n_k + age_k,        0 <= age_k < T

n_k is determined and t_k becomes phi + T (1 + eps) n_k, for all columns of the row. eps, the error of the logger's
clock, and the phase are those at which the rows agree best, |mean exp(2 pi i t_k / (T (1 + eps)))|.

Source: Fisher 1993, Statistical Analysis of Circular Data, ch. 2 (mean resultant length). Differs from source: of many
periods the one with the largest length is taken.
"""

from __future__ import annotations

import numpy as np

_IN_STEP = 0.5  # mean resultant length: ages over 0.6 of a period; rows at random instants have about 1/sqrt(n)
_OFF = 5e-4  # largest relative error of the logger's clock: two crystals and a logger's rounding
_FEW = 50  # number of rows below which no verdict is given
_EARLIEST = 0.01  # share of the rows that may precede their tick, by jitter


def ticks(time: np.ndarray, fresh: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray] | None:
    """The rows to keep, one per tick, and the instants of their ticks; None if the rows are not in step.

    Args:
        time: time of the rows, s, shape (n,).
        fresh: rows that certainly show a new tick, such as a changed duty, shape (n,).
        period: period of the ECU's clock, s.
    Returns:
        Kept rows, shape (m,) of int, and their instants, s, shape (m,).
    """
    seen = time[fresh] - time[0]
    if seen.size < _FEW:
        return None
    turns = seen / period
    tried = np.arange(-1.0, 1.0, 0.25 / max(1.0, _OFF * turns[-1]))  # a quarter of a turn between neighbours
    waves = [np.mean(np.exp(2j * np.pi * turns * (1.0 - _OFF * each))) for each in tried]
    best = int(np.argmax(np.abs(waves)))
    if abs(waves[best]) < _IN_STEP:
        return None
    own = period / (1.0 - _OFF * tried[best])
    middle = own * float(np.angle(waves[best])) / (2.0 * np.pi)
    n = np.round((seen - middle) / own)
    own, middle = (float(each) for each in np.polyfit(n, seen, 1))
    begin = middle + own * float(np.quantile((seen - middle) / own - n, _EARLIEST))
    age = (time - time[0] - begin) / own
    n = np.where(fresh, np.round((time - time[0] - middle) / own), np.floor(age + 1e-6)).astype(int)
    n = np.maximum.accumulate(n)
    kept = np.flatnonzero(np.diff(n, prepend=n[0] - 1) > 0)
    return kept, time[0] + begin + own * n[kept]
