"""What a synthetic throttle body can have beyond Eqs. 1-2; every default is exactly off.

The formulas stand in `kernel.py`, next to the equations they enter; those of driver and sensors that act in between
true motion and log, in `simulate.py` and `instruments.py`. A new effect is a NamedTuple of floats here, its field in
`Effects`, its three strengths in `strengths.py`, and its term where it acts. Each formula is what a device might do, in
detail another one than a model of the same name is likely to have.
"""

from __future__ import annotations

from typing import NamedTuple


class LimpHomeSpring(NamedTuple):
    """Below the default position the preload changes sign and a stiff second spring pushes the plate open."""

    angle: float = -10.0  # default position, rad; the off value lies below any travel
    stiffness: float = 0.0  # of the spring below it, N m/rad
    preload: float = 0.0  # opening torque just below it, N m
    corner: float = 0.01  # half width over which the two springs hand over, rad


class StribeckFriction(NamedTuple):
    """Breakaway friction above the running one, decaying as a Lorentzian of speed."""

    excess: float = 0.0  # friction at rest over that of motion, N m
    speed: float = 1.0  # speed at which half of it is left, rad/s


class AsymmetricFriction(NamedTuple):
    """Friction beside Eq. 2's, with dry and viscous coefficients of its own for each direction."""

    # opening, closing: dry, N m; what is more one way may be less the other
    opening: float = 0.0
    closing: float = 0.0
    # opening_viscous, closing_viscous: N m s/rad at low speed
    opening_viscous: float = 0.0
    closing_viscous: float = 0.0
    knee: float = 150.0  # speed at which the viscous part has fallen to half of what it would be, rad/s


class LoadDependentFriction(NamedTuple):
    """Gear friction in proportion to the torque through the teeth."""

    share: float = 0.0  # friction per transmitted torque, dimensionless


class MotorCoulombFriction(NamedTuple):
    """Dry friction of the motor's bearings and brushes, with the gear on or apart."""

    torque: float = 0.0  # at rest, at the motor, N m
    growth: float = 0.1  # relative, of a fast motor
    speed: float = 300.0  # motor speed at which half the growth is reached, rad/s


class PreslidingFriction(NamedTuple):
    """Bristles that bend before they slide; they replace the set-valued friction."""

    angle: float = 0.0  # deflection at which T_f is reached in a straight line, rad
    damping: float = 0.3  # ratio, of the plate on the bent bristles


class Backlash(NamedTuple):
    """Motor and plate as two bodies with play between their teeth."""

    gap: float = 0.0  # whole play at the plate's shaft, rad
    stiffness: float = 20e3  # of the teeth, N m/rad at the plate's shaft
    damping: float = 1.0  # of the impact, relative torque per speed, s/rad


class CoggingTorque(NamedTuple):
    """The magnets' detent torque, periodic in the motor's angle."""

    amplitude: float = 0.0  # at the plate, N m
    per_turn: float = 6.0  # detents in one turn of the motor
    phase: float = 0.0  # rad
    second: float = 0.0  # second harmonic over the first
    uneven: float = 0.0  # how much one half turn's detents are stronger than the other's, relative


class QuadraticDrag(NamedTuple):
    """Drag that grows faster than speed."""

    drag: float = 0.0  # torque at 1 rad/s, N m
    power: float = 1.8  # of speed


class AirflowTorque(NamedTuple):
    """The air that flows past the plate closes it, most at part travel."""

    peak: float = 0.0  # largest closing torque, N m
    skew: float = 1.15  # 1 puts the peak at half travel, more puts it beyond


class StopBounce(NamedTuple):
    """The stops give back part of the speed, less of a fast plate's."""

    restitution: float = 0.0  # of a slow impact
    speed: float = 100.0  # at which half of that is left, rad/s


class GravityLoad(NamedTuple):
    """The plate is out of balance."""

    torque: float = 0.0  # weight times arm, closing, N m
    tilt: float = 0.03  # angle of the plate at which it hangs straight, rad


class StiffeningSpring(NamedTuple):
    """Coils that touch: extra closing torque with the third power of the angle."""

    torque: float = 0.0  # with the plate open, N m


class FrictionSpot(NamedTuple):
    """A rough place on the shaft: extra dry friction within a narrow band of angle."""

    torque: float = 0.0  # in its middle, N m
    angle: float = 0.7  # of the middle, rad
    width: float = 0.06  # half width, rad


class FrictionDrift(NamedTuple):
    """Dry friction grows while a trace runs, and from trace to trace."""

    running: float = 0.0  # N m per second of this trace
    session: float = 0.0  # N m per second of everything logged before
    before: float = 0.0  # seconds logged before; the session fills it in


class FrictionTide(NamedTuple):
    """Dry friction comes and goes with the time of day, torque sin(2 pi t / period)."""

    torque: float = 0.0  # N m
    period: float = 20.0  # s
    before: float = 0.0  # seconds logged before; the session fills it in


class TorqueRipple(NamedTuple):
    """The motor's torque, and not its EMF, varies with its angle: T (1 + share sin(n a)), a the motor's angle."""

    share: float = 0.0  # of the torque
    per_turn: float = 11.0  # n, commutator bars and slots in one turn of the motor


class SupplyCycling(NamedTuple):
    """A load on a thermostat takes a share of the driver's supply while it is on; the log has the command."""

    share: float = 0.0  # of the supply that is missing while it is on
    period: float = 0.7  # s
    edge: float = 0.05  # of the sine at which it has switched, dimensionless: small is sudden
    before: float = 0.0  # seconds logged before; the session fills it in


class BrushVoltageDrop(NamedTuple):
    """Voltage between brush and commutator, V (1 - exp(-|i|/i_0))."""

    volts: float = 0.0  # of both brushes, V
    current: float = 0.06  # i_0, A


class WindingHeating(NamedTuple):
    """The winding warms by its own loss, the housing by the winding, and resistance follows; each trace begins cold."""

    coefficient: float = 0.0  # relative resistance per kelvin, 1/K (copper 0.0039)
    capacity: float = 1.0  # of the winding, J/K
    conductance: float = 0.0  # winding to housing, W/K
    housing_capacity: float = 1e12  # J/K; by default a housing that nothing warms
    housing_conductance: float = 0.0  # to the air, W/K


class DriverDeadZone(NamedTuple):
    """The driver loses a constant voltage, v - V z / (1 + z^6)^(1/6) with z = v/V; the log has the command."""

    volts: float = 0.0  # lost, V


class CurrentLimit(NamedTuple):
    """The driver takes back voltage once the current exceeds its limit; the log has the command."""

    amps: float = 0.0  # the limit, A; 0 for none
    ohms: float = 15.0  # voltage taken back per excess
    corner: float = 0.05  # width over which it sets in, A


class ActuationDelay(NamedTuple):
    """The driver acts at the next PWM period after a delay, and takes a moment to; the log has the command."""

    delay: float = 0.0  # s
    period: float = 50e-6  # of the PWM, s
    rise: float = 10e-6  # of a jump at the terminals, s


class TorqueSaturation(NamedTuple):
    """The iron saturates: motor torque limit tanh(k_t i / limit)."""

    limit: float = 0.0  # at the plate, N m; 0 for none


class PositionSensorLag(NamedTuple):
    """RC filter at the sensor, and a faster one behind it."""

    time: float = 0.0  # of the first, s
    second: float = 0.15  # time of the second over that of the first


class PositionSensorNonlinearity(NamedTuple):
    """The reading bends by bow sin(pi s) + wave sin(2 pi s), s the share of travel."""

    # bow, wave: rad
    bow: float = 0.0
    wave: float = 0.0


class SensorDeadSpot(NamedTuple):
    """A worn place of the potentiometer: the reading stays at what it was when the wiper came upon it."""

    angle: float = 0.6  # of its middle, rad
    width: float = 0.0  # whole, rad


class SensorHysteresis(NamedTuple):
    """A loose coupling at the sensor: the reading follows only after the plate has turned through the play."""

    play: float = 0.0  # whole, rad


class CurrentSensorOffset(NamedTuple):
    """Added to every reading of a current."""

    amps: float = 0.0  # A
    scatter: float = 0.02  # of it from trace to trace, relative


class ChannelDelay(NamedTuple):
    """The current was sampled earlier than its row says."""

    time: float = 0.0  # s
    scatter: float = 0.02  # of it from trace to trace, relative


class Effects(NamedTuple):
    """One of each; named as in docs/reference/effects.md, and at the end those that no catalogue has."""

    limp_home_spring: LimpHomeSpring = LimpHomeSpring()
    stribeck_friction: StribeckFriction = StribeckFriction()
    load_dependent_friction: LoadDependentFriction = LoadDependentFriction()
    cogging_torque: CoggingTorque = CoggingTorque()
    winding_heating: WindingHeating = WindingHeating()
    brush_voltage_drop: BrushVoltageDrop = BrushVoltageDrop()
    driver_dead_zone: DriverDeadZone = DriverDeadZone()
    actuation_delay: ActuationDelay = ActuationDelay()
    torque_saturation: TorqueSaturation = TorqueSaturation()
    asymmetric_friction: AsymmetricFriction = AsymmetricFriction()
    motor_coulomb_friction: MotorCoulombFriction = MotorCoulombFriction()
    presliding_friction: PreslidingFriction = PreslidingFriction()
    backlash: Backlash = Backlash()
    quadratic_drag: QuadraticDrag = QuadraticDrag()
    airflow_torque: AirflowTorque = AirflowTorque()
    stop_bounce: StopBounce = StopBounce()
    gravity_load: GravityLoad = GravityLoad()
    position_sensor_lag: PositionSensorLag = PositionSensorLag()
    position_sensor_nonlinearity: PositionSensorNonlinearity = PositionSensorNonlinearity()
    current_sensor_offset: CurrentSensorOffset = CurrentSensorOffset()
    channel_delay: ChannelDelay = ChannelDelay()
    friction_spot: FrictionSpot = FrictionSpot()
    stiffening_spring: StiffeningSpring = StiffeningSpring()
    current_limit: CurrentLimit = CurrentLimit()
    sensor_dead_spot: SensorDeadSpot = SensorDeadSpot()
    friction_drift: FrictionDrift = FrictionDrift()
    friction_tide: FrictionTide = FrictionTide()
    torque_ripple: TorqueRipple = TorqueRipple()
    supply_cycling: SupplyCycling = SupplyCycling()
    sensor_hysteresis: SensorHysteresis = SensorHysteresis()

    @property
    def on(self) -> tuple[str, ...]:
        """Names of those that differ from their default."""
        return tuple(name for name, effect in self._asdict().items() if effect != type(effect)())


NONE = Effects()

OUTSIDE = ("friction_spot", "stiffening_spring", "current_limit", "sensor_dead_spot", "friction_drift")
# no catalogue has these either; they came later, and seeds that draw from OUTSIDE go on to name what they named before
FURTHER = ("friction_tide", "torque_ripple", "supply_cycling", "sensor_hysteresis")
CATALOGUE = tuple(name for name in Effects._fields if name not in (*OUTSIDE, *FURTHER))

# what a motor with its gear apart still has, and whatever drives and senses it
AT_THE_MOTOR = (
    "cogging_torque",
    "winding_heating",
    "brush_voltage_drop",
    "driver_dead_zone",
    "actuation_delay",
    "torque_saturation",
    "motor_coulomb_friction",
    "current_sensor_offset",
    "channel_delay",
    "current_limit",
    "torque_ripple",
    "supply_cycling",
)


def combine(a: Effects, b: Effects) -> Effects:
    """Both at once.

    Raises:
        ValueError: an effect is on in both.
    """
    if both := set(a.on) & set(b.on):
        raise ValueError(f"on in both: {', '.join(sorted(both))}")
    return a._replace(**{name: getattr(b, name) for name in b.on})


def at_the_motor(effects: Effects) -> Effects:
    """Those that are left with the gear apart."""
    return Effects(**{name: getattr(effects, name) for name in AT_THE_MOTOR})
