"""What the diagnosis found to be wrong with the rig rather than lacking in the model, and the line that mends it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ..model.parameters import parameters_of
from ..model.rig_effects import AbstractRigEffect
from .composition import Effect
from .findings import RigMistake


def rig_mistakes(added: Sequence[Effect], values: Mapping[str, float]) -> tuple[RigMistake, ...]:
    """Of the effects added those that are the rig's.

    Args:
        added: effects at work, in the order found.
        values: of the fitted model, SI by symbol.
    """
    return tuple(_mistake(e, values) for e in added if issubclass(e, AbstractRigEffect))


def _mistake(effect: type[AbstractRigEffect], values: Mapping[str, float]) -> RigMistake:
    first = parameters_of(effect)[0]
    size, place = float(values[first.symbol]), effect.place
    mend = effect.mend(size)
    shown = f"{size:.3g} {first.unit}" if first.unit else f"{100.0 * size:+.3g} %"
    sentence = f"{effect.called(size)} in {place.words}: {shown}. To be mended in rig.toml: {mend}"
    return RigMistake(
        effect=effect.name,
        kind=effect.called(size),
        test=place.test or None,
        channel=place.channel or None,
        size=size,
        unit=first.unit,
        mend=mend,
        sentence=sentence,
        file=place.file or None,
    )
