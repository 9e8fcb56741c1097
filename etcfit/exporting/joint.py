"""The throttle as a joint of a physics engine (MuJoCo, Isaac Lab): Eqs. 1-2 with the current in balance at every
instant. In MuJoCo it has a motor that takes volts, or an actuator that takes an angle.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from xml.etree import ElementTree as Xml

from ..control.design import gains_as_found
from ..control.pid import Gains, Refusal
from ..errors import UsageError
from ..rig.user_text import python_comment, xml_comment
from .base import Export, Format, Source, rendered

_SOFTEST = 1e-6  # N m/rad: least stiffness, so that a preload alone still has a rest angle
# impedance of the friction's constraint: by default a stuck plate creeps by 3e-3 rad in 0.1 s, so by 1e-5
_STICKS = "0.9999 0.9999 0.001 0.5 2"
_SOFT = ("The stops are soft contacts of the engine, and a sticking plate creeps a little: its friction is a soft "
         "constraint.")  # fmt: skip
_ISAAC_LACKS = (
    "Spring and preload: an actuator has no passive spring. spring_effort below is their torque.",
    "The voltage: an actuator takes a torque. motor_effort below is the motor's.",
    "friction and dynamic_friction are torques from Isaac Sim 5.0 on. In Isaac Sim 4.5 friction is a coefficient "
    "without unit: leave it out there.",
)


@dataclass(frozen=True)
class Joint:
    """Constants of a hinge with a DC motor, at the plate unless stated otherwise."""

    armature: float  # inertia of the motor, N^2 J_m, kg m2
    inertia: float  # of the plate, J_L, kg m2
    damping: float  # N^2 B_m + B_L, N m s/rad
    friction: float  # T_f, N m
    stiffness: float  # K_s, N m/rad
    rest: float  # angle at which the spring is relaxed, -T_PL/K_s, rad
    gear: float  # N
    per_volt: float  # torque of the motor's own shaft, K_m/R_a, N m/V
    back_emf: float  # K_m K_b/R_a, N m s/rad, at the motor's own shaft


def _joint(source: Source) -> Joint:
    v, n = source.values, source.body["N"]
    stiffness = max(v["K_s"], _SOFTEST)
    return Joint(
        armature=n**2 * v["J_m"],
        inertia=v["J_L"],
        damping=n**2 * v["B_m"] + v["B_L"],
        friction=v["T_f"],
        stiffness=stiffness,
        rest=-v["T_PL"] / stiffness,
        gear=n,
        per_volt=v["K_m"] / v["R_a"],
        back_emf=v["K_m"] * v["K_b"] / v["R_a"],
    )


def _cannot_hold(source: Source) -> Iterator[str]:
    """Sentences on what such a joint leaves out."""
    yield from source.cautions
    v = source.values
    yield (f"The inductance L_a: the current follows the voltage at once instead of within L_a/R_a = "
           f"{1e3 * v['L_a'] / v['R_a']:.2g} ms.")  # fmt: skip
    if lost := [effect.name for effect in source.beyond_the_paper]:
        yield f"Effects of the model that have no place here: {', '.join(lost)}. The formats c and fmu hold them."


def _mjcf(
    source: Source, name: str, damping: float, kind: str, actuator: Mapping[str, str], says: str, lost: tuple[str, ...]
) -> Export:
    """The plate on its hinge with its actuator, and a comment on what it is and leaves out."""
    joint, body = _joint(source), source.body
    root = Xml.Element("mujoco", {"model": "throttle"})
    root.append(Xml.Comment(xml_comment((source.title, source.origin, says, *lost))))
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
    Xml.SubElement(Xml.SubElement(root, "actuator"), kind, {"name": "motor", "joint": "plate", **actuator})
    Xml.indent(root)
    return Export({name: f"{Xml.tostring(root, encoding='unicode')}\n"}, lost)


def _motor(source: Source) -> Export:
    """A motor that takes volts: torque = gear (per_volt ctrl - back_emf gear omega)."""
    joint, supply = _joint(source), source.fitted.config.supply_V
    limits = {} if supply is None else {"ctrllimited": "true", "ctrlrange": f"{-supply!r} {supply!r}"}
    says = ("ctrl of the motor is its terminal voltage, V. With the terminals open, set its biasprm to 0: what is "
            "left is the free return.")  # fmt: skip
    actuator = {"gear": repr(joint.gear), "gaintype": "fixed", "biastype": "affine", "gainprm": repr(joint.per_volt),
                "biasprm": f"0 0 {-joint.back_emf!r}", **limits}  # fmt: skip
    lost = (*_cannot_hold(source), _SOFT)
    return _mjcf(source, "etcfit_throttle.xml", joint.damping, "general", actuator, says, lost)


def _position(source: Source) -> Export:
    """A servo: force = kp (ctrl - theta) - kv omega within its range, and back-EMF as damping of the joint.

        kp = N K_m Kp / R_a,    kv = N K_m Kd / R_a,    damping = N^2 B_m + B_L + N^2 K_m K_b / R_a

    Source: MuJoCo, XML reference, actuator/position; Eqs. 1-2 with the current in balance.
    """
    gains, whose = _gains(source)
    joint, supply = _joint(source), source.fitted.config.supply_V
    per_volt = joint.gear * joint.per_volt
    low, high = source.travel
    limits = {} if supply is None else {"forcelimited": "true",
                                        "forcerange": f"{-per_volt * supply!r} {per_volt * supply!r}"}  # fmt: skip
    actuator = {"kp": repr(per_volt * float(gains.Kp)), "kv": repr(per_volt * float(gains.Kd)), "ctrllimited": "true",
                "ctrlrange": f"{low!r} {high!r}", **limits}  # fmt: skip
    says = (f"ctrl of the actuator is the setpoint of the angle, rad. kp and kv are the gains of {whose}, times "
            f"N K_m/R_a = {per_volt:.6g} N m/V; damping is the bearings' and the back-EMF's.")  # fmt: skip
    integral = (f"The integral gain, Ki = {float(gains.Ki):.4g} V/(rad s): a position actuator has none.",)
    lost = (*_cannot_hold(source), _SOFT, *(integral if gains.Ki else ()),
            "The controller's clock, delay and filter, and a derivative of the setpoint.")  # fmt: skip
    damping = joint.damping + joint.gear**2 * joint.back_emf
    return _mjcf(source, "etcfit_servo.xml", damping, "position", actuator, says, lost)


def _gains(source: Source) -> tuple[Gains, str]:
    """Gains of the designed controller, else of the one that drove the logs; and its name."""
    if (designed := source.designed) is not None:
        return designed, "pid.json"
    found = gains_as_found(source.fitted)
    if isinstance(found, Refusal):
        raise UsageError(f"A position actuator has gains, and none are known: {found.why}, and none were designed. "
                         f"Run `{source.designing}`, or describe the servo's controller in [ecu] of "
                         "rig.toml.")  # fmt: skip
    return found, "the controller that drove the logs"


def _isaac(source: Source) -> Export:
    """A configuration of the actuator, and the efforts without a field in it."""
    lost = (*_cannot_hold(source), *_ISAAC_LACKS)
    notes = python_comment((source.title, source.origin, *lost))
    text = rendered("isaac.py.txt", notes=notes, joint=_joint(source), body=source.body)
    return Export({"etcfit_isaac.py": text}, lost)


MUJOCO = Format("mujoco", "MuJoCo joint and actuator (MJCF)", _motor)
POSITION = Format("mujoco-position", "MuJoCo joint and position actuator (MJCF: kp, kv, armature, damping, "
                  "frictionloss)", _position)  # fmt: skip
ISAAC = Format("isaac", "Isaac Lab actuator configuration", _isaac)
