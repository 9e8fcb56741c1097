"""Computes the figures that a production line measures from the fitted models of many units; a new figure is an entry
of FIGURES.

`predict` gives the same figures for a hot or cold fleet, on a weak or a charged battery.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from ..control.motion import Bands, Experiment, Motion, Watching, simulate_motion
from ..control.pid.conditions import DRY_FRICTION, scaled
from ..control.pid.loop import Body
from ..control.safety.unpowered import release_plates
from ..estimation.fitted_model import FleetModel
from ..model.effects import AbstractEffect, Inputs, State
from ..model.effects.friction import PreslidingFriction
from ..model.effects.paper import CoulombFriction
from ..model.effects.sensors import PositionSensorNonlinearity
from ..model.linear import holding_against
from ..model.throttle import Throttle

PerUnit = Float[np.ndarray, " U"]

EARLY, LATE = 0.1, 0.9  # shares of a stroke between which it is timed: IEEE Std 181-2011
MIDDLE = 0.5  # share of the travel at which the holding current and its hysteresis are given
RETURNED = 0.05  # distance from the unpowered position within which a plate counts as back, share of the travel
BENCH_SUPPLY = 12.0  # V
LOW_SUPPLY, HIGH_SUPPLY = 9.0, 14.0  # V, whose opening times are compared: ISO 16750-2, code C
STEP, LONGEST = 1e-4, 3.0  # s: step of the integration, and simulated time
AT_REST = 0.1  # s without any motion after which a plate is at rest

BENCH = 20.0  # temperature at which the units were measured, degrees Celsius
COPPER = 0.00393  # growth of the winding's resistance, 1/K, about 20 degrees Celsius: IEC 60028
# growth of the magnets' flux, 1/K, and of K_b and K_m with it: -0.002 for hard ferrite, -0.001 for sintered NdFeB
# (Modelica Standard Library 4, Magnetic.FluxTubes.Material.HardMagnetic). ASSUMED: the small DC motors of throttles
# have ferrite
MAGNET = -0.002
HOT, COLD = BENCH + 80.0, -40.0  # degrees Celsius
SUPPLIES = (9.0, 12.0, 14.0, 16.0)  # V, of the predictions

_ANGLES = 201  # angles between which the unpowered position is sought
_HALVINGS = 24  # bisections between two of them
_SENSOR_ANGLES = 401
_ENDS = (0.025, 0.975)


@dataclass(frozen=True)
class Condition:
    """A condition that holds for all units."""

    name: str  # such as "hot, 9 V"
    supply: float  # V
    winding: float  # its temperature, and that of the magnets, degrees Celsius
    friction: float = 1.0  # dry friction over that of the bench

    def acting_on(self, throttles: Throttle) -> Throttle:
        """The units under this condition.

            R = R_a (1 + copper (T - T_bench)),    K_b, K_m times 1 + magnet (T - T_bench),    T_f, ... times friction

        Viscous friction, springs and inductance stay as at the bench; the magnets are assumed as warm as the winding,
        which is nearly true after a while.
        """
        warmer = self.winding - BENCH
        magnet = 1.0 + MAGNET * warmer
        dry = dict.fromkeys(DRY_FRICTION, self.friction)
        return scaled(throttles, {"R_a": 1.0 + COPPER * warmer, "K_b": magnet, "K_m": magnet, **dry})


AS_MEASURED = Condition("bench", BENCH_SUPPLY, BENCH)


@dataclass(frozen=True, eq=False)
class Station:
    """U units at one test station of the line, under one condition; simulations that several figures share are kept."""

    model: FleetModel
    condition: Condition = AS_MEASURED

    @property
    def count(self) -> int:
        """U."""
        return len(self.model.units)

    @cached_property
    def throttles(self) -> Throttle:
        """The units under the condition, parameters of shape (U,)."""
        return self.condition.acting_on(self.model.throttles)

    @cached_property
    def body(self) -> Body:
        """Gear ratio and stops, rad."""
        return Body(self.model.config.gear_ratio, *self.model.config.stops)

    def angle(self, share: float) -> float:
        """Angle at a share of the travel, rad."""
        return self.body.lower + share * (self.body.upper - self.body.lower)

    def opening(self, supply: float) -> PerUnit:
        """Time from 10 to 90 % of the travel at a supply (V), from rest at the closed stop, s; infinite for never."""
        return self._stroke(self.body.lower, supply, Bands(self._marks(), np.full((self.count, 2), np.inf)))

    def closing(self, supply: float) -> PerUnit:
        """Time from 90 to 10 % of the travel at the reversed supply (V), from rest at the open stop, s; infinite for
        never."""
        marks = self.body.upper + self.body.lower - self._marks()
        return self._stroke(self.body.upper, -supply, Bands(np.full((self.count, 2), -np.inf), marks))

    def _marks(self) -> np.ndarray:
        return np.tile([self.angle(EARLY), self.angle(LATE)], (self.count, 1))

    def _stroke(self, begin: float, volts: float, bands: Bands) -> PerUnit:
        what = Experiment(*(np.full(self.count, each) for each in (begin, volts, 1.0)))
        early, late = simulate_motion(self.throttles, what, bands, self.body, Watching(STEP, LONGEST, AT_REST)).first.T
        return np.where(np.isfinite(late), late - np.where(np.isfinite(early), early, 0.0), np.inf)

    @cached_property
    def cut(self) -> Motion:
        """Motion after release from the open stop, terminals open."""
        return self._fall(0.0)

    @cached_property
    def shorted(self) -> Motion:
        """Motion after release from the open stop, terminals shorted."""
        return self._fall(1.0)

    def _fall(self, circuit: float) -> Motion:
        angles, how = np.full(self.count, self.body.upper), Watching(STEP, LONGEST, AT_REST)
        return release_plates(self.throttles, angles, self.homes, circuit, self.body, RETURNED, how)

    @cached_property
    def homes(self) -> PerUnit:
        """Position to which the springs alone bring the plate, rad: zero current holds it in the middle of its dry
        friction there."""
        angles = np.linspace(self.body.lower, self.body.upper, _ANGLES)
        current = np.asarray(_currents(self.slid, angles, self.body))
        crosses = (current[:, :-1] < 0.0) & (current[:, 1:] >= 0.0)
        k = np.argmax(crosses, axis=1)
        low, high = angles[k], angles[k + 1]
        for _ in range(_HALVINGS):  # a limp-home spring's corner is far narrower than the grid
            middle = 0.5 * (low + high)
            opens = self.held(middle, 0.0)[0] < 0.0
            low, high = np.where(opens, middle, low), np.where(opens, high, middle)
        pressed = np.where(current[:, 0] < 0.0, self.body.upper, self.body.lower)
        return np.where(crosses.any(axis=1), 0.5 * (low + high), pressed)

    @cached_property
    def slid(self) -> Throttle:
        """The units with every dry contact sliding; a contact that yields first (T_z) carries its largest torque."""
        effects = self.throttles.effects
        contacts = [effect for effect in effects if isinstance(effect, PreslidingFriction)]
        if not contacts:
            return self.throttles
        extra = sum(np.asarray(contact.T_z) for contact in contacts)

        def each(effect: AbstractEffect) -> AbstractEffect:
            if isinstance(effect, PreslidingFriction):
                return replace(effect, T_z=0.0 * np.asarray(effect.T_z))
            return replace(effect, T_f=effect.T_f + extra) if isinstance(effect, CoulombFriction) else effect

        return replace(self.throttles, effects=tuple(each(effect) for effect in effects))

    def held(self, angles: PerUnit, share: float) -> tuple[PerUnit, PerUnit]:
        """Current (A) and voltage (V) at which each plate, at its own angle, is about to open (share 1), about to close
        (-1), or held in the middle of its dry friction (0)."""
        current, volts = _held(self.slid, angles, share, self.body)
        return np.asarray(current), np.asarray(volts)

    @cached_property
    def middle_currents(self) -> tuple[PerUnit, PerUnit]:
        """Currents of a slow opening ramp and of a slow closing ramp at mid-travel, A."""
        angles = np.full(self.count, self.angle(MIDDLE))
        return self.held(angles, 1.0)[0], self.held(angles, -1.0)[0]


@jax.jit
def _held(throttles: Throttle, angles: Any, share: Any, body: Body) -> Any:
    return jax.vmap(lambda throttle, theta: holding_against(throttle, theta, share, *body))(throttles, angles)


@jax.jit
def _currents(throttles: Throttle, angles: Any, body: Body) -> Any:
    """Shape (U, A)."""

    def each(throttle: Throttle) -> Any:
        return jax.vmap(lambda theta: holding_against(throttle, theta, 0.0, *body)[0])(angles)

    return jax.vmap(each)(throttles)


class FigureResult(NamedTuple):
    """A figure of every unit."""

    value: PerUnit  # SI, shape (U,); NaN where a unit has none
    why: str = ""  # reason for NaN; "" where there is none


@dataclass(frozen=True)
class Figure:
    """One figure of a line: a number a unit, computed from its fitted model."""

    name: str  # its name in fleet.json and in the limits of fleet.toml
    unit: str  # SI
    meaning: str  # one line
    source: str  # of its definition
    values: Callable[[Station], PerUnit]  # of all units at a station, SI, shape (U,); not finite where a unit has none
    why: str  # reason why a unit has none

    def measure(self, station: Station) -> FigureResult:
        """The figure of every unit at a station."""
        value = self.values(station)
        known = np.isfinite(value)
        return FigureResult(np.where(known, value, np.nan), "" if known.all() else self.why)


def _supply_response(station: Station) -> PerUnit:
    """Opening time at 9 V over that at 14 V, whatever the condition's own supply."""
    slow, fast = station.opening(LOW_SUPPLY), station.opening(HIGH_SUPPLY)
    both = np.isfinite(slow) & np.isfinite(fast)
    return np.where(both, slow, np.nan) / np.where(both, fast, 1.0)


def _sensor_linearity(station: Station) -> PerUnit:
    """max |reading - angle| over the travel, of a sensor calibrated at the stops."""
    bent = next((each for each in station.throttles.effects if isinstance(each, PositionSensorNonlinearity)), None)
    if bent is None:
        return np.full(station.count, np.nan)
    u = Inputs(0.0, 0.0, 0.0, 1.0, 0.0, *station.body)
    angles = np.linspace(station.body.lower, station.body.upper, _SENSOR_ANGLES)
    return np.max(np.abs([np.asarray(bent(State(0.0, theta, 0.0), (), u).position) for theta in angles]), axis=0)


# the registry of figures; tables and pages have this order
FIGURES: tuple[Figure, ...] = (
    Figure("default_position", "rad", "angle at which the plate rests without a current, let go from open",
           "Deur et al. 2004 (limp-home position); from open, since dry friction keeps a memory of the side",
           lambda station: np.where(station.cut.still > 0.0, station.cut.angle, np.nan),
           f"still moving after {LONGEST:g} s"),
    Figure("opening_time", "s", "time from 10 to 90 % of the travel at the full supply, opening",
           "transition duration, IEEE Std 181-2011, of a step of full duty",
           lambda station: station.opening(station.condition.supply), "never reaches 90 % of the travel"),
    Figure("closing_time", "s", "time from 90 to 10 % of the travel at the full supply in reverse, closing",
           "transition duration, IEEE Std 181-2011, of a step of full duty",
           lambda station: station.closing(station.condition.supply), "never reaches 10 % of the travel"),
    Figure("unpowered_return", "s", "time from full open to within 5 % of the unpowered position, terminals open",
           "control.safety.unpowered: FMVSS 124 requires it of the driver's control",
           lambda station: station.cut.stays[:, 0],
           "rests more than 5 % of the travel from where its springs bring it"),
    Figure("unpowered_return_shorted", "s",
           "time from full open to within 5 % of the unpowered position, terminals shorted",
           "control.safety.unpowered",
           lambda station: station.shorted.stays[:, 0],
           f"not back within {LONGEST:g} s: dry friction or the motor's brake holds it"),
    Figure("supply_response", "1", "opening time at 9 V over that at 14 V",
           "this project; 9 to 16 V as of ISO 16750-2, code C",
           _supply_response, "does not open fully at 9 V"),
    Figure("holding_current", "A", "current that holds the plate at mid-travel, the middle of its hysteresis",
           "the paper, Eq. 2 at rest",
           lambda station: 0.5 * (station.middle_currents[0] + station.middle_currents[1]), "no current holds it"),
    Figure("current_hysteresis", "A", "half the difference of the slow opening and closing current at mid-travel",
           "the paper, Eq. 2 at rest: T_f / (N K_m) of Eqs. 1-2",
           lambda station: 0.5 * (station.middle_currents[0] - station.middle_currents[1]), "no current moves it"),
    Figure("breakaway_voltage_opening", "V",
           "voltage at which a slow ramp starts to open the plate from its unpowered position",
           "the paper, Eqs. 1-2 at rest",
           lambda station: station.held(station.cut.angle, 1.0)[1], "no voltage moves it"),
    Figure("breakaway_voltage_closing", "V", "voltage of a falling slow ramp at which the plate leaves the open stop",
           "the paper, Eqs. 1-2 at rest",
           lambda station: station.held(np.full(station.count, station.body.upper), -1.0)[1], "no voltage moves it"),
    Figure("sensor_linearity", "rad", "largest deviation of the position sensor from the line through the stops",
           "Fraden 2016, terminal points",
           _sensor_linearity, "not modelled: the model has no position_sensor_nonlinearity"),
)  # fmt: skip

FIGURE_BY_NAME: Mapping[str, Figure] = {figure.name: figure for figure in FIGURES}


def measured(model: FleetModel, condition: Condition = AS_MEASURED) -> dict[str, FigureResult]:
    """Every figure of every unit under a condition, by the figure's name, in the order of `FIGURES`."""
    station = Station(model, condition)
    return {figure.name: figure.measure(station) for figure in FIGURES}


@dataclass(frozen=True)
class Spread:
    """A figure over the units of a fleet."""

    # statistics over the units that have the figure, SI; None where no unit has it
    mean: float | None
    sd: float | None  # standard deviation; None for one unit too
    low: float | None  # 2.5 %
    high: float | None  # 97.5 %
    unit: str  # SI
    told: int  # number of units that have the figure
    why: str  # why the others have none

    @classmethod
    def over_units(cls, figure: FigureResult, unit: str) -> Spread:
        """The spread of a figure over the units."""
        known = figure.value[np.isfinite(figure.value)]
        if not known.size:
            return cls(None, None, None, None, unit, 0, figure.why)
        low, high = (float(v) for v in np.quantile(known, _ENDS))
        sd = float(np.std(known, ddof=1)) if known.size > 1 else None
        return cls(float(np.mean(known)), sd, low, high, unit, known.size, figure.why)


@dataclass(frozen=True)
class Prediction:
    """Every figure over the fleet, by name, under one condition."""

    condition: Condition
    figures: Mapping[str, Spread]


def conditions(supplies: tuple[float, ...] = SUPPLIES, cold_friction: float = 1.0) -> tuple[Condition, ...]:
    """Bench, hot and cold at each supply.

    Args:
        supplies: V.
        cold_friction: dry friction in the cold over that of the bench. 1: unchanged, because no measurement at the
            bench shows how the grease stiffens.
    """
    states = (("bench", BENCH, 1.0), ("hot", HOT, 1.0), ("cold", COLD, cold_friction))
    return tuple(
        Condition(f"{name}, {supply:g} V", supply, winding, friction)
        for (name, winding, friction), supply in product(states, supplies)
    )


CONDITIONS = conditions()


def predict(model: FleetModel, under: tuple[Condition, ...] = CONDITIONS) -> tuple[Prediction, ...]:
    """Mean, 2.5 and 97.5 % quantile over the units of each figure, under each condition; compiled one time for all."""
    out = []
    for condition in under:
        found = measured(model, condition)
        figures = {name: Spread.over_units(figure, FIGURE_BY_NAME[name].unit) for name, figure in found.items()}
        out.append(Prediction(condition, figures))
    return tuple(out)
