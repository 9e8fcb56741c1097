"""MuJoCo: a hinge with a motor that takes volts, or with an actuator that takes an angle, as MJCF."""

from __future__ import annotations

from collections.abc import Mapping
from xml.etree import ElementTree as Xml

from ...control.design import gains_as_found
from ...control.pid import Gains, Refusal
from ...errors import UsageError
from ...rig.user_text import xml_comment
from ..base import Export, Format, Source
from ..joint import Joint, cannot_hold, joint_of

# impedance of the friction's constraint: by default a stuck plate creeps by 3e-3 rad in 0.1 s, so by 1e-5
_STICKS = "0.9999 0.9999 0.001 0.5 2"
_SOFT = ("The stops are soft contacts of the engine, and a sticking plate creeps a little: its friction is a soft "
         "constraint.")  # fmt: skip


def _scene(source: Source, joint: Joint, damping: float) -> Xml.Element:
    """The plate on its hinge."""
    body = source.body
    root = Xml.Element("mujoco", {"model": "throttle"})
    Xml.SubElement(root, "compiler", {"angle": "radian"})
    Xml.SubElement(root, "option", {"timestep": repr(source.settings.step), "integrator": "implicitfast",
                                    "gravity": "0 0 0"})  # fmt: skip
    plate = Xml.SubElement(Xml.SubElement(root, "worldbody"), "body", {"name": "plate"})
    inertia = repr(max(joint.inertia, 1e-9))
    Xml.SubElement(plate, "inertial", {"pos": "0 0 0", "mass": "0.05", "diaginertia": " ".join([inertia] * 3)})
    Xml.SubElement(plate, "joint", {
        "name": "plate", "type": "hinge", "axis": "0 0 1", "armature": repr(joint.armature),
        "damping": repr(damping), "frictionloss": repr(joint.friction), "stiffness": repr(joint.stiffness),
        "springref": repr(joint.rest), "solimpfriction": _STICKS, "limited": "true",
        "range": f"{body['lower']!r} {body['upper']!r}",
    })  # fmt: skip
    return root


def _written(
    source: Source, name: str, root: Xml.Element, kind: str, actuator: Mapping[str, str], told: tuple[str, ...],
    lost: tuple[str, ...],
) -> Export:  # fmt: skip
    """The scene with its actuator, what it is and what it leaves out as a comment."""
    Xml.SubElement(Xml.SubElement(root, "actuator"), kind, {"name": "motor", "joint": "plate", **actuator})
    root.insert(0, Xml.Comment(xml_comment((source.title, source.origin, *told, *lost))))
    Xml.indent(root)
    return Export({name: f"{Xml.tostring(root, encoding='unicode')}\n"}, lost)


def _motor(source: Source) -> Export:
    """A motor that takes volts: torque = gear (per_volt ctrl - back_emf gear omega)."""
    joint, supply = joint_of(source), source.fitted.config.supply_V
    limits = {} if supply is None else {"ctrllimited": "true", "ctrlrange": f"{-supply!r} {supply!r}"}
    told = ("ctrl of the motor is its terminal voltage, V. With the terminals open, set its biasprm to 0: what is "
            "left is the free return.",)  # fmt: skip
    actuator = {"gear": repr(joint.gear), "gaintype": "fixed", "biastype": "affine", "gainprm": repr(joint.per_volt),
                "biasprm": f"0 0 {-joint.back_emf!r}", **limits}  # fmt: skip
    lost = (*source.cautions, *cannot_hold(source), _SOFT)
    return _written(source, "etcfit_throttle.xml", _scene(source, joint, joint.damping), "general", actuator, told,
                    lost)  # fmt: skip


def _position(source: Source) -> Export:
    """A servo: force = kp (ctrl - theta) - kv omega within its range, and back-EMF as damping of the joint.

        kp = N K_m Kp / R_a,    kv = N K_m Kd / R_a,    damping = N^2 B_m + B_L + N^2 K_m K_b / R_a

    Source: MuJoCo, XML reference, actuator/position; Eqs. 1-2 with the current in balance.

    Raises:
        UsageError: nobody knows the gains of its controller.
    """
    gains, whose = _gains(source)
    joint, supply = joint_of(source), source.fitted.config.supply_V
    per_volt = joint.gear * joint.per_volt
    low, high = source.travel
    limits = {} if supply is None else {"forcelimited": "true",
                                        "forcerange": f"{-per_volt * supply!r} {per_volt * supply!r}"}  # fmt: skip
    actuator = {"kp": repr(per_volt * float(gains.Kp)), "kv": repr(per_volt * float(gains.Kd)), "ctrllimited": "true",
                "ctrlrange": f"{low!r} {high!r}", **limits}  # fmt: skip
    told = (f"ctrl of the actuator is the angle asked for, rad. kp and kv are the gains of {whose}, times "
            f"N K_m/R_a = {per_volt:.6g} N m/V; damping is the bearings' and the back-EMF's.",)  # fmt: skip
    integral = (f"The integral gain, Ki = {float(gains.Ki):.4g} V/(rad s): a position actuator has none.",)
    lost = (*source.cautions, *cannot_hold(source), _SOFT, *(integral if gains.Ki else ()),
            "The controller's clock, delay and filter, and a derivative of the setpoint.")  # fmt: skip
    root = _scene(source, joint, joint.damping + joint.gear**2 * joint.back_emf)
    return _written(source, "etcfit_servo.xml", root, "position", actuator, told, lost)


def _gains(source: Source) -> tuple[Gains, str]:
    """Of the controller that was designed, else of the one that drove the logs; and whose they are."""
    if source.pid is not None:
        made = source.pid["gains"]
        return Gains(made["Kp"], made["Ki"], made["Kd"]), "pid.json"
    found = gains_as_found(source.fitted)
    if isinstance(found, Refusal):
        raise UsageError(f"A position actuator has gains, and none are known: {found.why}, and none were designed. "
                         f"Run `{source.designing}`, or describe the servo's controller in [ecu] of "
                         "rig.toml.")  # fmt: skip
    return found, "the controller that drove the logs"


FORMAT = Format("mujoco", "MuJoCo joint and actuator (MJCF)", _motor)
POSITION = Format("mujoco-position", "MuJoCo joint and position actuator (MJCF: kp, kv, armature, damping, "
                  "frictionloss)", _position)  # fmt: skip
