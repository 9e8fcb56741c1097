"""What the diagnosis found to be wrong with the rig rather than lacking in the model, and what to do about it.

A mistake that is likely enough comes with the line of rig.toml that mends it, a suspicion with the measurement that
would tell (`DiagnosisSettings.suspicion`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ..model.parameters import parameters_of
from ..model.rig_effects import AbstractRigEffect
from .composition import Effect
from .findings import RigMistake
from .settings import DEFAULT, DiagnosisSettings
from .suspicion import is_suspicion, what_would_tell


def rig_mistakes(
    added: Sequence[Effect],
    values: Mapping[str, float],
    probabilities: Mapping[str, float],
    settings: DiagnosisSettings = DEFAULT,
) -> tuple[RigMistake, ...]:
    """Of the effects added those that are the rig's.

    Args:
        added: effects at work, in the order found.
        values: of the fitted model, SI by symbol.
        probabilities: of the effects, given the data; one without any is taken as proven.
        settings: `suspicion`.
    """
    return tuple(
        _mistake(e, values, probabilities.get(e.name, 1.0), settings) for e in added if issubclass(e, AbstractRigEffect)
    )


def _mistake(
    effect: type[AbstractRigEffect], values: Mapping[str, float], probability: float, settings: DiagnosisSettings
) -> RigMistake:
    first = parameters_of(effect)[0]
    size, place = float(values[first.symbol]), effect.place
    mend = effect.mend(size)
    shown = f"{size:.3g} {first.unit}" if first.unit else f"{100.0 * size:+.3g} %"
    what = f"{effect.called(size)} in {place.words}: {shown}"
    suspected = is_suspicion(probability, settings.suspicion)
    doing = what_would_tell(probability, effect.told_by) if suspected else f"To be mended in rig.toml: {mend}"
    return RigMistake(
        effect=effect.name,
        kind=effect.called(size),
        test=place.test or None,
        channel=place.channel or None,
        size=size,
        unit=first.unit,
        mend=mend,
        sentence=f"{what}. {doing}",
        file=place.file or None,
        suspected=suspected,
    )
