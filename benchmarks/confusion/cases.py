"""Which physics the folder of a seed lacks nothing of, or one effect, or two, or something outside the catalogue."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from independent import CATALOGUE, CONSISTENT, NONE, OUTSIDE, STRENGTHS, Effects, Truth, combine, draw_truth

PARAMETERS = ("R_a", "L_a", "K_b", "J_m", "J_L", "B_m", "B_L", "K_s", "T_PL", "T_f")
LEVELS = ("low", "medium", "high")

# forty cases in a row, five times over; the levels of the five times
BLOCK = ("clean",) * 6 + ("single",) * 21 + ("pair",) * 7 + ("outside",) * 6
ORDER = tuple(BLOCK[k] for k in np.random.default_rng(0).permutation(len(BLOCK)))
IN_SINCE = ("stiffening_spring",)  # once outside, now in etcfit's catalogue: one effect like any other ...
SINCE = 10_000  # ... from this seed on: the first test set was of the program without it
TURNS = ("medium", "low", "high", "medium", "high")


@dataclass(frozen=True)
class Case:
    """One folder: kind "clean", "single", "pair" or "outside"; for each effect its name and level."""

    seed: int
    kind: str
    names: tuple[str, ...]
    strength: tuple[str, ...]
    effects: Effects
    truth: Truth


def case(seed: int) -> Case:
    """The seed's case; its kind, and what of its kind, by its place among 200."""
    turn, place = divmod(seed % (len(ORDER) * len(TURNS)), len(ORDER))
    kind = ORDER[place]
    names, strength = _drawn(kind, turn, ORDER[:place].count(kind), np.random.default_rng([seed, 1]))
    effects = NONE
    for name, level in zip(names, strength, strict=True):
        effects = combine(effects, STRENGTHS[name][LEVELS.index(level)])
    if kind == "outside" and names[0] in IN_SINCE and seed >= SINCE:
        kind = "single"
    return Case(seed, kind, names, strength, effects, draw_truth(np.random.default_rng(seed), CONSISTENT))


def _drawn(kind: str, turn: int, count: int, rng: np.random.Generator) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names and levels of the `count`-th of its kind in this turn."""
    match kind:
        case "single":
            return (CATALOGUE[count],), (TURNS[turn],)
        case "pair":
            names = rng.choice(CATALOGUE, 2, replace=False)
            return tuple(map(str, names)), tuple(map(str, rng.choice(LEVELS[1:], 2)))
        case "outside":
            nth = turn * BLOCK.count("outside") + count
            return (OUTSIDE[nth % len(OUTSIDE)],), (LEVELS[nth // len(OUTSIDE) % len(LEVELS)],)
    return (), ()


def known(chosen: Case) -> dict[str, float]:
    """The truth of PARAMETERS; dry friction told apart by direction is a preload, and is counted as that."""
    truth = {s: float(getattr(chosen.truth, s)) for s in PARAMETERS}
    dry = chosen.effects.asymmetric_friction
    truth["T_f"] += 0.5 * (dry.opening + dry.closing)
    truth["T_PL"] += 0.5 * (dry.opening - dry.closing)
    return truth
