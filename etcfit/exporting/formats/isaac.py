"""Isaac Lab: a configuration of the actuator, and the efforts that it has no field for."""

from __future__ import annotations

from ...rig.user_text import python_comment
from ..base import Export, Format, Source
from ..joint import cannot_hold, joint_of
from ..rendering import rendered

_LOST = (
    "Spring and preload: an actuator has no passive spring. spring_effort below is their torque.",
    "The voltage: an actuator takes a torque. motor_effort below is the motor's.",
    "friction and dynamic_friction are torques from Isaac Sim 5.0 on. In Isaac Sim 4.5 friction is a coefficient "
    "without unit: leave it out there.",
)


def _export(source: Source) -> Export:
    joint, body = joint_of(source), source.body
    lost = (*source.cautions, *cannot_hold(source), *_LOST)
    notes = python_comment((source.title, source.origin, *lost))
    text = rendered("isaac.py.txt", notes=notes, joint=joint, body=body)
    return Export({"etcfit_isaac.py": text}, lost)


FORMAT = Format("isaac", "Isaac Lab actuator configuration", _export)
