"""What the diagnosis found to be wrong with the rig rather than lacking in the model, and what to do about it.

A mistake that is likely enough comes with the line of rig.toml that mends it, a suspicion with the measurement that
would tell (`DiagnosisSettings.suspicion`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ..model.parameters import parameters_of
from ..model.rig_effects import AbstractRigEffect
from .composition import Effect
from .findings import RigMistake, Statement


def rig_mistakes(
    added: Sequence[Effect], values: Mapping[str, float], stated: Sequence[Statement]
) -> tuple[RigMistake, ...]:
    """Of the effects added those that are the rig's.

    Args:
        added: effects at work, in the order found.
        values: of the fitted model, SI by symbol.
        stated: on each of them.
    """
    return tuple(
        _mistake(e, values, each) for e, each in zip(added, stated, strict=True) if issubclass(e, AbstractRigEffect)
    )


def _mistake(effect: type[AbstractRigEffect], values: Mapping[str, float], stated: Statement) -> RigMistake:
    first, place = parameters_of(effect)[0], effect.place
    size = float(values[first.symbol])
    return RigMistake(
        effect=effect.name,
        kind=effect.called(size),
        test=place.test or None,
        channel=place.channel or None,
        size=size,
        unit=first.unit,
        mend=effect.mend(size),
        sentence=stated.sentence,
        file=place.file or None,
        suspected=not stated.acted_on,
    )
