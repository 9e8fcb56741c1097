"""MuJoCo: a hinge with a motor that takes volts, as MJCF."""

from __future__ import annotations

from xml.etree import ElementTree as Xml

from ...rig.comments import xml_comment
from ..base import Export, Format, Source
from ..joint import cannot_hold, joint_of

_SOFT = "The stops are soft contacts of the engine, and a sticking plate creeps: its friction is a soft constraint."


def _export(source: Source) -> Export:
    lost = (*source.cautions, *cannot_hold(source), _SOFT)
    joint, body, supply = joint_of(source), source.body, source.fitted.config.supply_V
    root = Xml.Element("mujoco", {"model": "throttle"})
    Xml.SubElement(root, "compiler", {"angle": "radian"})
    Xml.SubElement(root, "option", {"timestep": repr(source.settings.step), "integrator": "implicitfast",
                                    "gravity": "0 0 0"})  # fmt: skip
    plate = Xml.SubElement(Xml.SubElement(root, "worldbody"), "body", {"name": "plate"})
    inertia = repr(max(joint.inertia, 1e-9))
    Xml.SubElement(plate, "inertial", {"pos": "0 0 0", "mass": "0.05", "diaginertia": " ".join([inertia] * 3)})
    Xml.SubElement(plate, "joint", {
        "name": "plate", "type": "hinge", "axis": "0 0 1", "armature": repr(joint.armature),
        "damping": repr(joint.damping), "frictionloss": repr(joint.friction), "stiffness": repr(joint.stiffness),
        "springref": repr(joint.rest), "limited": "true", "range": f"{body['lower']!r} {body['upper']!r}",
    })  # fmt: skip
    limits = {} if supply is None else {"ctrllimited": "true", "ctrlrange": f"{-supply!r} {supply!r}"}
    Xml.SubElement(Xml.SubElement(root, "actuator"), "general", {
        "name": "motor", "joint": "plate", "gear": repr(joint.gear), "gaintype": "fixed", "biastype": "affine",
        "gainprm": repr(joint.per_volt), "biasprm": f"0 0 {-joint.back_emf!r}", **limits,
    })  # fmt: skip
    meaning = ("ctrl of the motor is its terminal voltage, V. With the terminals open, set its biasprm to 0: what is "
               "left is the free return.",)  # fmt: skip
    root.insert(0, Xml.Comment(xml_comment((source.title, source.origin, *meaning, *lost))))
    Xml.indent(root)
    return Export({"etcfit_throttle.xml": f"{Xml.tostring(root, encoding='unicode')}\n"}, lost)


FORMAT = Format("mujoco", "MuJoCo joint and actuator (MJCF)", _export)
