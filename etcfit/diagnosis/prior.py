"""What is known of a mistake of the rig before its likelihood is asked: how large such a mistake usually is, and
whether the rig's checks found it.

    -2 ln prior = 2 sum over amplitudes of ln(1 + (a / usual size)^2)    - 2 ln 10 where the checks found it
                                                                        + 2 ln 25 in one channel of one trace

A Cauchy density of the size, over its peak: a mistake of a usual size pays next to nothing, and one of any size may be
there. So a resistor of 1.2 ohm, which many rigs have, goes before a probe that reads 74 % too much, which none has,
where both explain the data alike; and what a whole test shows is not put down to its one fitted trace. The usual size
is the scale of the parameter.

Source: Berger 1985, Statistical Decision Theory, 4.7 (robust priors with flat tails). Differs from source: only the
ratio to the density at zero is kept.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from ..model.parameters import parameters_of
from .composition import Effect, is_of_one_channel, is_of_the_rig

_FOUND_BY_CHECKS = 10.0  # times as probable, before any fit, as a mistake of which no check says anything

_IN_ONE_PLACE = 25.0  # times less probable: one of hundreds of such places


def surprise(effect: Effect, values: Mapping[str, float], stated: Iterable[Effect]) -> float:
    """-2 ln prior of an effect of the rig at its size; 0 of an effect of the throttle.

    Args:
        effect: at work.
        values: of the model, SI by symbol.
        stated: effects that the rig's checks state.
    """
    if not is_of_the_rig(effect):
        return 0.0
    sizes = [values[p.symbol] / p.domain.scale for p in parameters_of(effect) if p.symbol in (effect.off or {})]
    unusual = 2.0 * float(np.sum(np.log1p(np.square(sizes))))
    place = 2.0 * float(np.log(_IN_ONE_PLACE)) if is_of_one_channel(effect) else 0.0
    return unusual + place - (2.0 * float(np.log(_FOUND_BY_CHECKS)) if effect in stated else 0.0)
