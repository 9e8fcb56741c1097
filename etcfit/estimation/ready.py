"""What a fit begins with: the traces that it takes, and where it starts."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..errors import MeasurementError
from ..problem.free_parameters import FreeParameters
from ..problem.trace import Trace, follows_setpoint, prepare
from ..rig.base import Measurement, Rig
from ..rig.checks import refuse
from ..rig.paper_readings import Readings
from .rig_places import refuse_wrong_places


def start_values(free_parameters: FreeParameters, readings: Readings) -> dict[str, float]:
    """Where the fit starts: the reading; where it is silent rig.toml; where that is silent a nominal value."""
    values = {p.symbol: p.nominal for p in free_parameters.layout.parameters}
    values |= free_parameters.start
    read = {s: v for s, v in readings.values.items() if s in values and np.isfinite(v)}
    if "T_PL" not in read and {"K_s", "K_m", "R_a"} <= read.keys():
        # nominal in volts: the scale of torque is the reading's
        read["T_PL"] = values["T_PL"] * (read["K_m"] / read["R_a"]) / (values["K_m"] / values["R_a"])
    return values | read


def _left_out(measurement: Measurement) -> str:
    """Why a trace is not fitted, and what would make it count."""
    why = f"{measurement.file}: no voltage, duty or torque was logged with it; it is not fitted"
    if not follows_setpoint(measurement):
        return why
    return f'{why}. A table [ecu] in rig.toml, with the ECU\'s gains or P, I, D = "free", puts the ECU into the model'


class Prepared(NamedTuple):
    """The traces of a rig, ready for the model.

    Args:
        fitted: to be fitted; at least one.
        held_out: to be predicted only.
        notes: a sentence on each trace that the model cannot predict, and why.
    """

    fitted: tuple[Trace, ...]
    held_out: tuple[Trace, ...]
    notes: tuple[str, ...]


def ready(rig: Rig) -> Prepared:
    """Sort the traces of a rig into those to fit and those held out.

    Raises:
        MeasurementError: nothing is left to fit, or physics rules the data out.
    """
    refuse(rig.folder, rig.findings)
    fitted, held_out, notes = [], [], []
    traces = [prepare(measurement, rig.config) for measurement in rig.measurements]
    refuse_wrong_places(rig, [trace for trace in traces if trace is not None])
    for measurement, trace in zip(rig.measurements, traces, strict=True):
        if rig.config.sets_aside(measurement):
            notes.append(f"{measurement.file}: set aside as of another rig; it is neither fitted nor predicted")
        elif trace is None:
            notes.append(_left_out(measurement))
        else:
            (held_out if measurement.held_out else fitted).append(trace)
    if rig.config.ecu is not None and not any(trace.controlled for trace in (*fitted, *held_out)):
        notes.append("rig.toml: no trace needs [ecu], for each logs its drive, or no setpoint")
    if not fitted:
        found = "has no trace that can be fitted."
        required = "At least one trace must log what drove it and what came of it, and not be held out."
        raise MeasurementError(rig.folder, found, required, "Add one, or take it out of [holdout].")
    return Prepared(tuple(fitted), tuple(held_out), tuple(notes))
