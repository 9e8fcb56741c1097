"""Rows of a log, brought to the ticks of the ECU whose values they have.

A row is written up to a period after the tick that it shows, sooner or later by what else the logger does. Of a noisy
duty that is held from tick to tick, a share s of a period too late is as good as a kick of s times its change: the free
run of a plate with dry friction strays by ten times the noise of its sensor, with the right model. Where the rows come
in step with the clock,

    t_k = phi + T (1 + eps) n_k + age_k,        0 <= age_k < T

n_k is found and t_k becomes phi + T (1 + eps) n_k: what all columns of the row have in common. eps, by which the
logger's clock is off, and the phase are those at which the rows agree best, |mean exp(2 pi i t_k / (T (1 + eps)))|.

Source: Fisher 1993, Statistical Analysis of Circular Data, ch. 2 (mean resultant length). Differs from source: of many
periods the one with the largest is taken.
"""

from __future__ import annotations

import numpy as np

_IN_STEP = 0.5  # mean resultant length: ages spread over 0.6 of a period; rows at any instant have about 1/sqrt(n)
_OFF = 5e-4  # by which the logger's clock may be off, a share: two crystals and a logger's rounding
_FEW = 50  # rows, below which nothing is said
_EARLIEST = 0.01  # share of the rows that may come before the tick that they show, by jitter


def ticks(time: np.ndarray, fresh: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray] | None:
    """Which rows to keep, one a tick, and the instants of their ticks; None where the rows are not in step.

    Args:
        time: of the rows, s, shape (n,).
        fresh: rows that surely show a new tick, as a duty that changed does, shape (n,).
        period: of the ECU's clock, s.
    Returns:
        kept rows, shape (m,) of int, and their instants, s, shape (m,).
    """
    seen = time[fresh] - time[0]
    if seen.size < _FEW:
        return None
    turns = seen / period
    tried = np.arange(-1.0, 1.0, 0.25 / max(1.0, _OFF * turns[-1]))  # a quarter of a turn from one to the next
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
