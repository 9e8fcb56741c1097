"""Every pair of candidates scored together: what two effects explain at once that neither explains alone.

    gain_ab = max |r|^2 - |r + C_a' a + C_b' b|^2

One QR of all signatures side by side, [C', r] = Q R, replaces n samples by as many rows as there are columns, so that a
pair costs the solution of a few equations and thousands of pairs a second. Bounds of amplitudes are dropped first:
without them a pair gains no less, so that only pairs that may still be among the best are solved with them.

Source: Rao 1948 (score test), all subsets of size two (Miller 2002, Subset Selection in Regression, ch. 2). Differs
from source: amplitudes are bounded.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ..model.parameters import parameters_of
from .bounded import bounded, lowest
from .composition import Effect
from .screen import Signature

_NOTHING = 1e-5  # length of a column, once 1, below which another effect does all of it


@dataclass(frozen=True, eq=False)
class Pair:
    """Two effects, and what they would do to the residual together.

    Args:
        effects: the two.
        gain: by how much they would lower chi2, by the linearised model.
        values: of all their parameters, SI by symbol, at which they would.
    """

    effects: tuple[Effect, Effect]
    gain: float
    values: Mapping[str, float] = field(repr=False)


class _Block(NamedTuple):
    """A signature's columns among all of them, and its amplitudes' scales and lower bounds over these."""

    signature: Signature
    own: slice
    scale: np.ndarray
    low: np.ndarray
    fixed: np.ndarray | None


def pairs(signatures: Sequence[Signature], r: np.ndarray, most: int) -> tuple[Pair, ...]:
    """The pairs that would lower chi2 the most, each of two effects at their best shapes, the largest gain first.

    Args:
        signatures: of every variant of every candidate, their columns free of what the fitted parameters can do.
        r: the residual free of it, shape (n,).
        most: how many pairs.
    """
    blocks = _blocks([s for s in signatures if s.own > 0.0])
    if len(blocks) < 2:
        return ()
    columns = np.concatenate([b.signature.columns for b in blocks], axis=1)
    length = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    triangle = np.asarray(np.linalg.qr(np.column_stack((columns / length, r)), mode="r"))
    system = _System(triangle[:, :-1], -triangle[:, -1], length)
    bounds, best = _without_bounds(blocks, system), dict[frozenset[Effect], Pair]()
    for gain, a, b in bounds:
        if len(best) >= most and gain <= sorted((p.gain for p in best.values()), reverse=True)[most - 1]:
            break
        found = _solved(blocks[a], blocks[b], system)
        key = frozenset(found.effects)
        if key not in best or found.gain > best[key].gain:
            best[key] = found
    return tuple(sorted(best.values(), key=lambda p: -p.gain)[:most])


class _System(NamedTuple):
    """min |R a - t|^2 over amplitudes a whose columns were brought to length 1."""

    columns: np.ndarray
    target: np.ndarray
    length: np.ndarray


def _blocks(signatures: Sequence[Signature]) -> list[_Block]:
    found, start = [], 0
    for s in signatures:
        domains = {p.symbol: p.domain for p in parameters_of(s.variant.effect)}
        mine = [domains[symbol] for symbol in s.variant.amplitudes]
        own = slice(start, start := start + len(mine))
        scale = np.array([d.scale for d in mine])
        low = lowest(mine)
        scanned = any(symbol in s.variant.shape for symbol in s.variant.amplitudes)
        fixed = np.array([s.variant.shape[symbol] for symbol in s.variant.amplitudes]) / scale if scanned else None
        found.append(_Block(s, own, scale, low, fixed))
    return found


def _without_bounds(blocks: Sequence[_Block], system: _System) -> list[tuple[float, int, int]]:
    """Gain of each pair of different effects, amplitudes free, the largest first.

    The first of the two is taken out of all columns and of the target; what the second then does adds up.
    """
    out = []
    for a, first in enumerate(blocks):
        basis = np.linalg.qr(system.columns[:, first.own])[0]
        rest, target = (m - basis @ (basis.T @ m) for m in (system.columns, system.target))
        alone = float(system.target @ system.target - target @ target)
        for b in range(a + 1, len(blocks)):
            second = blocks[b]
            if second.signature.variant.effect is first.signature.variant.effect:
                continue
            mine = rest[:, second.own]
            kept = mine[:, np.linalg.norm(mine, axis=0) > _NOTHING]
            more = np.linalg.qr(kept)[0].T @ target if kept.size else np.zeros(0)
            out.append((alone + float(more @ more), a, b))
    return sorted(out, reverse=True)


def _solved(first: _Block, second: _Block, system: _System) -> Pair:
    """The pair with its amplitudes within their bounds; scanned ones stay at their scanned values."""
    target, free, at = system.target, [], {}
    for block in (first, second):
        columns, length = system.columns[:, block.own], system.length[block.own]
        if block.fixed is None:
            free.append(block)
        else:
            target = target - columns @ (block.fixed * length)
            at |= _values(block, block.fixed)
    left = float(target @ target)
    if free:
        columns = np.concatenate([system.columns[:, b.own] for b in free], axis=1)
        solution = bounded(columns, target, np.concatenate([b.low for b in free]))
        left = float(np.sum((columns @ solution - target) ** 2))
        for block in free:
            own, solution = np.split(solution, [len(block.scale)])
            at |= _values(block, own / system.length[block.own])
    gain = float(system.target @ system.target) - left
    both = (first.signature, second.signature)
    effects = (first.signature.variant.effect, second.signature.variant.effect)
    shapes = {k: v for s in both for k, v in s.variant.shape.items()}
    return Pair(effects, max(gain, 0.0), {**shapes, **at})


def _values(block: _Block, amplitudes: np.ndarray) -> dict[str, float]:
    """SI by symbol, of amplitudes over their scales."""
    symbols = block.signature.variant.amplitudes
    return {s: float(a * k) for s, a, k in zip(symbols, amplitudes, block.scale, strict=True)}
