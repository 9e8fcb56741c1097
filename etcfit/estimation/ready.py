"""The beginning of a fit: the traces that it takes, and its start values."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from ..errors import MeasurementError, first_names
from ..model.rig_effects import FAMILY_BY_KIND, AbstractRigEffect, OtherRig, Place, rig_effect
from ..problem.free_parameters import FreeParameters
from ..problem.trace import Trace, by_test, follows_setpoint, prepare
from ..rig.base import Measurement, Rig
from ..rig.checks import refuse
from ..rig.paper_readings import Readings
from ..rig.toml import closest


def start_values(free_parameters: FreeParameters, readings: Readings) -> dict[str, float]:
    """Start values of the fit: the reading; without one the value in rig.toml; without that a nominal value."""
    values = {p.symbol: p.nominal for p in free_parameters.layout.parameters}
    values |= free_parameters.start
    read = {s: v for s, v in readings.values.items() if s in values and np.isfinite(v)}
    if "T_PL" not in read and {"K_s", "K_m", "R_a"} <= read.keys():
        # nominal in volts: the scale of torque comes from the reading
        read["T_PL"] = values["T_PL"] * (read["K_m"] / read["R_a"]) / (values["K_m"] / values["R_a"])
    return values | read


def _left_out(measurement: Measurement) -> str:
    """Why a trace is not fitted, and how it could be."""
    why = f"{measurement.file}: no voltage, duty or torque was logged with it; it is not fitted"
    if not follows_setpoint(measurement):
        return why
    return f'{why}. A table [ecu] in rig.toml, with the ECU\'s gains or P, I, D = "free", puts the ECU into the model'


class Prepared(NamedTuple):
    """The traces of a rig, ready for the model."""

    fitted: tuple[Trace, ...]  # traces to fit; at least one
    held_out: tuple[Trace, ...]  # traces that are only predicted
    notes: tuple[str, ...]  # one sentence on each trace that the model cannot predict, with the reason


def ready(rig: Rig) -> Prepared:
    """Sort the traces of a rig into those to fit and those held out.

    Raises:
        MeasurementError: nothing is left to fit, or the data are physically impossible.
    """
    refuse(rig.folder, rig.findings)
    fitted, held_out, notes = [], [], []
    traces = [prepare(measurement, rig.config) for measurement in rig.measurements]
    refuse_wrong_places(rig, [trace for trace in traces if trace is not None])
    for measurement, trace in zip(rig.measurements, traces, strict=True):
        if rig.config.sets_aside(measurement):
            notes.append(f"{measurement.file}: set aside as a trace of another rig; it is neither fitted nor predicted")
        elif trace is None:
            notes.append(_left_out(measurement))
        else:
            (held_out if measurement.held_out else fitted).append(trace)
    if rig.config.ecu is not None and not any(trace.controlled for trace in (*fitted, *held_out)):
        notes.append("rig.toml: no trace needs [ecu], because each logs its input, or no setpoint")
    if not fitted:
        found = "has no trace that can be fitted."
        required = "At least one trace must log its input and its response, and not be held out."
        raise MeasurementError(rig.folder, found, required, "Add one, or remove one from [holdout].")
    return Prepared(tuple(fitted), tuple(held_out), tuple(notes))


# ---- Places of the rig effects that rig.toml names: each must exist in this folder
#
# A misspelt place would add a parameter that no data determine, or leave a trace of another rig in the fit.

_SHOWN = 8  # largest number of places in a message


def refuse_wrong_places(rig: Rig, traces: Iterable[Trace]) -> None:
    """Refuse an effect of the rig at a place that this folder does not have.

    Args:
        traces: traces that the model can predict, including those held out or set aside.
    Raises:
        MeasurementError: for the first such place, with the places that exist.
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
    required = (
        f"In this folder it can be {first_names(names, _SHOWN)}."
        if names
        else ("It would change nothing in any trace of this folder.")
    )
    mend = closest(str(effect.place), places, "Correct the name, or delete it.")
    return MeasurementError("rig.toml: [model] effects", f"names {effect.name!r}.", required, mend)


def _places(family: type[AbstractRigEffect], rig: Rig, traces: Sequence[Trace]) -> tuple[Place, ...]:
    if family is OtherRig:  # such traces need no model
        return tuple(dict.fromkeys(Place.named(each) for m in rig.measurements for each in (m.file, m.test)))
    return family.everywhere(by_test(traces), {trace.measurement.file: trace.logged for trace in traces})
