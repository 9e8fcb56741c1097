"""Which folder a class has at a seed. A seed is the same folder for ever: a later kind is asked for by its name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import count, islice
from pathlib import Path
from typing import Any

import numpy as np

from independent import (
    CATALOGUE,
    CONSISTENT,
    FURTHER,
    NONE,
    OUTSIDE,
    STRENGTHS,
    Bench,
    Effects,
    Truth,
    combine,
    draw_truth,
    make_folder,
)
from independent.control import Computer
from independent.folder import rig_toml
from independent.mistakes import MISTAKES, make_mistaken
from independent.under_ecu import add_coarse_logs

from . import under_ecu

PARAMETERS = ("R_a", "L_a", "K_b", "J_m", "J_L", "B_m", "B_L", "K_s", "T_PL", "T_f")
LEVELS = ("low", "medium", "high")
CLASSES = ("clean", "single", "pair", "outside", "mistake", "slow", "edges", "ecu")

# forty cases in a row, five times over; the levels of the five times
BLOCK = ("clean",) * 6 + ("single",) * 21 + ("pair",) * 7 + ("outside",) * 6
ORDER = tuple(BLOCK[k] for k in np.random.default_rng(0).permutation(len(BLOCK)))
IN_SINCE = ("stiffening_spring",)  # drawn where OUTSIDE is, and since in etcfit's catalogue: one effect like any other
TURNS = ("medium", "low", "high", "medium", "high")

# mistakes of the rig that take turns; of the others each is a token of its own, `mistake:warm_start`
IN_TURN = ("series_resistance", "channel_gain", "channel_offset", "sensor_end_points", "channel_sign", "time_scale",
           "gear_ratio", "unit_scale", "channel_late", "trace_late", "supply_sag")  # fmt: skip

# sample periods before the sample that shows it at which an edge of the input lies: on it, a hair before, a hair after
EDGES: Mapping[str, float] = {"on": 0.0, "just before": 5e-4, "just after": -5e-4}
EDGE_TURNS = (0, 1, 0, 1, 2)  # effects beside edges, by the seed
LOOP = Computer(6.0, 40.0, 0.12, period=2e-3)  # of slow logs: it acts at 500 Hz and is logged at 100 Hz


@dataclass(frozen=True)
class Case:
    """One folder.

    Args:
        seed: of everything random in it.
        kind: one of CLASSES.
        names: effects or the mistake in it; of "ecu" how its gains are told.
        strength: level of each effect.
        effects, truth: of the body.
        edges: a key of EDGES, "" where edges lie anywhere.
    """

    seed: int
    kind: str
    names: tuple[str, ...]
    strength: tuple[str, ...]
    effects: Effects
    truth: Truth
    edges: str = ""

    @property
    def key(self) -> tuple[str, int, str]:
        """By which a record of it is found again."""
        return self.kind, self.seed, "+".join(self.names)


def case(seed: int) -> Case:
    """Clean, one effect, a pair or one from outside, by the seed's place among 200."""
    turn, place = divmod(seed % (len(ORDER) * len(TURNS)), len(ORDER))
    kind = ORDER[place]
    names, strength = _drawn(kind, turn, ORDER[:place].count(kind), np.random.default_rng([seed, 1]))
    return _of(seed, "single" if names[:1] == IN_SINCE else kind, names, strength)


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


def _of(seed: int, kind: str, names: tuple[str, ...] = (), strength: tuple[str, ...] = (), edges: str = "") -> Case:
    effects = NONE
    for name, level in zip(names, strength, strict=False):  # a mistake has no level
        effects = combine(effects, STRENGTHS[name][LEVELS.index(level)])
    return Case(seed, kind, names, strength, effects, draw_truth(np.random.default_rng(seed), CONSISTENT), edges)


def at(kind: str, name: str, seed: int) -> tuple[Case, ...]:
    """The folders of a class at a seed, of this name where one is given; none where the seed is of something else.

    Raises:
        ValueError: no such class, or no such name in it.
    """
    match kind:
        case "outside" if name in FURTHER:
            return (_of(seed, kind, (name,), (LEVELS[seed % len(LEVELS)],)),)
        case "clean" | "single" | "pair" | "outside" if name in ("", *CATALOGUE, *OUTSIDE):
            found = case(seed)
            return (found,) if found.kind == kind and (not name or name in found.names) else ()
        case "mistake" if name in ("", *MISTAKES):
            return (_of(seed, kind, (name or IN_TURN[seed % len(IN_TURN)],)),)
        case "slow" if not name:
            return (_of(seed, kind),)
        case "edges" if name in ("", *EDGES):
            return (_beside_edges(seed, name or (*EDGES,)[seed % len(EDGES)]),)
        case "ecu" if name in ("", *under_ecu.CASES):
            return tuple(_of(seed, kind, (told,)) for told in ([name] if name else under_ecu.CASES))
    raise ValueError(f"no class {kind!r} with {name!r}. Classes: {', '.join(CLASSES)}.")


def _beside_edges(seed: int, where: str) -> Case:
    """Nothing, one effect or two, clear to see, and every edge of the input at a sample."""
    rng, many = np.random.default_rng([seed, 7]), EDGE_TURNS[seed % len(EDGE_TURNS)]
    names = tuple(map(str, rng.choice(CATALOGUE, many, replace=False)))
    return _of(seed, "edges", names, tuple(map(str, rng.choice(LEVELS[1:], many))), where)


def chosen(token: str, first: int, folders: int) -> list[Case]:
    """So many folders of `class` or `class:name`, from a seed on."""
    kind, _, name = token.partition(":")
    every = (each for seed in count(first) for each in at(kind, name, seed))
    return list(islice(every, folders))


def interleaved(some: Mapping[str, list[Case]]) -> list[Case]:
    """All of them, each token spread evenly: a run that is broken off has some of everything."""
    places = [((k + 0.5) / len(cases), each) for cases in some.values() for k, each in enumerate(cases)]
    return [each for _, each in sorted(places, key=lambda item: item[0])]


def made(chosen: Case, folder: Path) -> dict[str, Any]:
    """Write the folder; of a mistake what was done and where."""
    match chosen.kind:
        case "mistake":
            return vars(make_mistaken(folder, chosen.truth, chosen.seed, chosen.names[0]))
        case "slow":
            files = add_coarse_logs(folder, chosen.truth, LOOP, chosen.seed)
            text = rig_toml("synthetic, logged too slowly", chosen.truth.N, Bench(), files[-1:], noise=True)
            (folder / "rig.toml").write_text(under_ecu.without_inductance(text), encoding="utf-8")
        case "ecu":
            under_ecu.write(folder, chosen.truth, chosen.seed, chosen.names[0])
        case "edges":
            bench = replace(Bench(), edge_phase=EDGES[chosen.edges], jitter=0.0)
            make_folder(folder, chosen.truth, chosen.seed, chosen.effects, "small", bench=bench)
        case _:
            make_folder(folder, chosen.truth, chosen.seed, chosen.effects, "small")
    return {}


def known(chosen: Case) -> dict[str, float]:
    """What the fit should find of PARAMETERS, and where no current was logged of what the plate feels in volts.

    Dry friction told apart by direction is a preload, and is counted as that.
    """
    truth = {s: float(getattr(chosen.truth, s)) for s in PARAMETERS}
    dry = chosen.effects.asymmetric_friction
    truth["T_f"] += 0.5 * (dry.opening + dry.closing)
    truth["T_PL"] += 0.5 * (dry.opening - dry.closing)
    return truth | under_ecu.in_volts(chosen.truth) if chosen.kind == "slow" else truth


def wanted(counts: Mapping[str, tuple[int, int]]) -> list[Case]:
    """The folders of a mix, interleaved.

    Args:
        counts: token -> the seed from which on, and how many.
    """
    return interleaved({token: chosen(token, *each) for token, each in counts.items()})
