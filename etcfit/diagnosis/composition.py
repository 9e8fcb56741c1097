"""One composed model of every effect that a rig could show: which of them are at work is data, so it compiles once.

An effect is taken out of the model by holding its parameters at their off values, at which it contributes exactly zero.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..model.effects import EFFECTS, PAPER, AbstractEffect
from ..model.parameters import parameters_of
from ..problem.free_parameters import FreeParameters, Layout, free_parameters
from ..problem.jacobian import AT_ONCE
from ..problem.trace import Trace
from ..rig.base import Rig

Effect = type[AbstractEffect]

_MORE = 12  # room for further free parameters, so that few models are compiled twice


@dataclass(frozen=True, eq=False)
class Composition:
    """Every effect that may be at work in a rig, all but the known ones at their off values.

    Args:
        whole: unknowns of the model with all effects at work.
        known: effects that are at work from the start: Eqs. 1-2 and those that rig.toml names.
        candidates: the others.
    """

    whole: FreeParameters
    known: tuple[Effect, ...]
    candidates: tuple[Effect, ...]

    def free_parameters(self, added: tuple[Effect, ...]) -> FreeParameters:
        """Free parameters of the model with these candidates at work; the others are held at their off values."""
        whole = self.whole.layout
        asleep = {s: v for effect in self.candidates if effect not in added for s, v in resting(effect).items()}
        free = tuple(s for s in whole.free if s not in asleep)
        fixed = dict(zip(whole.held, self.whole.held.tolist(), strict=True))
        held = fixed | {s: v for s, v in asleep.items() if s in whole.free}
        least = sum(1 for s in whole.free if not any(s in resting(e) for e in self.candidates)) + _MORE
        layout = Layout(whole.types, whole.parameters, free, tuple(held), whole.ties, room(max(least, len(free))))
        priors = {s: v for s, v in self.whole.priors.items() if s in free}
        return FreeParameters(layout, np.array(list(held.values())), priors, self.whole.start)

    def lean(self, added: tuple[Effect, ...]) -> FreeParameters:
        """As `free_parameters`, with equal coordinates, of a model that has no effects but those at work."""
        full, types = self.free_parameters(added), (*self.known, *added)
        types = tuple(t for t in self.whole.layout.types if t in types)
        gone = {s for effect in self.candidates if effect not in added for s in resting(effect)}
        parameters = tuple(p for p in full.layout.parameters if p.symbol not in gone)
        held = {s: v for s, v in zip(full.layout.held, full.held.tolist(), strict=True) if s not in gone}
        layout = Layout(types, parameters, full.layout.free, tuple(held), full.layout.ties)
        return FreeParameters(layout, np.array(list(held.values())), full.priors, full.start)


def compose(
    rig: Rig, traces: tuple[Trace, ...], further: tuple[Effect, ...] = (), only: tuple[Effect, ...] = EFFECTS
) -> Composition:
    """The model of every effect that these traces could show.

    Args:
        rig: whose rig.toml says what is fixed and which effects are known.
        traces: what was logged decides which effects could show (`needs` of an effect).
        further: effects beside the catalogue.
        only: effects of the catalogue that are considered besides those that rig.toml names.
    """
    seen = logged(rig, traces)
    fitting = [e for e in EFFECTS if e.name in rig.config.effects or (e in only and set(e.needs) <= seen)]
    names = tuple(e.name for e in fitting if e not in PAPER)
    whole = free_parameters(replace(rig.config, effects=names), tuple(e for e in further if set(e.needs) <= seen))
    known = tuple(e for e in whole.layout.types if e in PAPER or e.commands or e.name in rig.config.effects)
    return Composition(whole, known, tuple(e for e in whole.layout.types if e not in known))


def logged(rig: Rig, traces: tuple[Trace, ...]) -> frozenset[str]:
    """What effects may need to be seen: a driven winding, a current, a position, a known gear ratio."""
    words = {
        "circuit": any(t.circuit for t in traces),
        "current": any("current" in t.channels for t in traces),
        "position": any("position" in t.channels for t in traces),
        "gear": rig.config.gear_ratio_given,
    }
    return frozenset(word for word, true in words.items() if true)


def resting(effect: Effect) -> dict[str, float]:
    """Amplitudes at their off values and shapes at their nominal ones, SI by symbol."""
    off = effect.off or {}
    return {p.symbol: off.get(p.symbol, p.nominal) for p in parameters_of(effect)}


def room(count: int) -> int:
    """Length to which a vector of so many parameters is padded."""
    return AT_ONCE * math.ceil(count / AT_ONCE)


def carried(x: np.ndarray, old: Layout, new: FreeParameters, values: Mapping[str, Any]) -> np.ndarray:
    """Coordinates of another choice of free parameters, shape (P_new,).

    Args:
        x: coordinates, shape (P_old,); parameters free in both choices keep theirs.
        old: layout of those.
        new: the other choice.
        values: SI by symbol, for the parameters that become free.
    Raises:
        KeyError: a parameter that becomes free has no value.
    """
    at = dict(zip(old.free, x.tolist(), strict=True))
    layout = new.layout
    out = [at[s] if s in at else layout.parameter(s).domain.coordinate(float(values[s])) for s in layout.free]
    return np.array(out)
