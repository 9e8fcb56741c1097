"""Places of effects of the rig that rig.toml names: each must be one that this folder has.

A slip of the pen would add a parameter that no data tell, or leave a trace of another rig in the fit.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from ..errors import MeasurementError
from ..model.rig_effects import FAMILY_BY_KIND, AbstractRigEffect, OtherRig, Place, rig_effect
from ..problem.trace import Trace, by_test
from ..rig.base import Rig
from ..rig.toml import closest

_SHOWN = 8  # places in a message, at most


def refuse_wrong_places(rig: Rig, traces: Iterable[Trace]) -> None:
    """Refuse an effect of the rig at a place that this folder does not have.

    Args:
        rig: whose rig.toml names effects.
        traces: those that the model can predict, held out and set aside ones included.
    Raises:
        MeasurementError: at the first, with the places that there are.
    """
    traces = tuple(traces)
    for name in rig.config.effects:
        effect = rig_effect(name)
        if effect is None:
            continue
        family = FAMILY_BY_KIND[effect.kind]
        places = _places(family, rig, traces)
        if effect.place not in places:
            raise _refusal(effect, [family.at(place).name for place in places], [str(place) for place in places])


def _refusal(effect: type[AbstractRigEffect], names: Sequence[str], places: Sequence[str]) -> MeasurementError:
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    required = (
        f"In this folder it can be {', '.join(names[:_SHOWN])}{more}."
        if names
        else ("It would change nothing in any trace of this folder.")
    )
    mend = closest(str(effect.place), places, "Correct the name, or delete it.")
    return MeasurementError("rig.toml: [model] effects", f"names {effect.name!r}.", required, mend)


def _places(family: type[AbstractRigEffect], rig: Rig, traces: Sequence[Trace]) -> tuple[Place, ...]:
    if family is OtherRig:  # that needs no model
        return tuple(dict.fromkeys(Place.named(each) for m in rig.measurements for each in (m.file, m.test)))
    return family.everywhere(by_test(traces), {trace.measurement.file: trace.logged for trace in traces})
