"""Which units have an effect that the model of the line declares, and how strong it is in each.

    w_u = (s_u - off)^T V_u^-1 (s_u - off) ~ chi2 with as many degrees of freedom as amplitudes, if the effect is absent

V_u is the block of the unit's own covariance: no other unit makes an effect present. Over the units Benjamini and
Hochberg. A unit whose data do not tell the amplitudes is not counted among those asked.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from ...model.effects import EFFECT_BY_NAME
from .multiplicity import found
from .scaled import scaled
from .settings import DEFAULT, FleetSettings
from .stack import Stack


@dataclass(frozen=True)
class EffectInFleet:
    """One effect.

    Args:
        effect: its name.
        symbol: the amplitude that stands for its strength.
        units: that have it.
        of: units whose data tell.
        median: of the strength over these, SI.
        strength: by unit, SI: as estimated, below nought too.
        p: by unit, of its being absent.
    """

    effect: str
    symbol: str
    units: tuple[str, ...]
    of: int
    median: float
    strength: Mapping[str, float]
    p: Mapping[str, float]


def effects_in(stack: Stack, names: Sequence[str], settings: FleetSettings = DEFAULT) -> tuple[EffectInFleet, ...]:
    """Those of the named effects that have an off value and an amplitude that some unit's data tell.

    Args:
        stack: units.
        names: of effects, as in rig.toml.
        settings: rate of units falsely said to have it, what counts as no information.
    Raises:
        ValueError: no effect has such a name.
    """
    if unknown := [name for name in names if name not in EFFECT_BY_NAME]:
        raise ValueError(f"no effect is called {', '.join(unknown)}. There are: {', '.join(EFFECT_BY_NAME)}.")
    out = []
    for name in names:
        off = {s: v for s, v in (EFFECT_BY_NAME[name].off or {}).items() if s in stack.symbols}
        if off and (one := _effect(stack, name, off, settings)):
            out.append(one)
    return tuple(out)


def _effect(stack: Stack, name: str, off: Mapping[str, float], settings: FleetSettings) -> EffectInFleet | None:
    data = scaled(stack.marginal(tuple(off)), settings.population.null)
    asked = np.all(data.tells, axis=1)
    if not np.any(asked):
        return None
    error = data.x[asked] - (np.array(list(off.values())) - data.centre) / data.scale
    wald = np.sum(np.einsum("ujk,uk->uj", data.root[asked], error) ** 2, axis=1)
    p = stats.chi2.sf(wald, len(off))
    units = [unit for unit, each in zip(stack.units, asked, strict=True) if each]
    has = found(p, settings.effect_rate)
    strength = data.stack.estimate[asked, 0]
    return EffectInFleet(
        name, next(iter(off)), tuple(unit for unit, each in zip(units, has, strict=True) if each), len(units),
        float(np.median(strength)), dict(zip(units, map(float, strength), strict=True)),
        dict(zip(units, map(float, p), strict=True)),
    )  # fmt: skip
