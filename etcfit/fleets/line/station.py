"""All units of a fleet at one test station of the line: what several figures need is simulated once."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from ...control.motion import Bands, Experiment, Motion, Watching, moved
from ...control.pid.loop import Body
from ...control.safety.unpowered import falls
from ...control.settings import SafetySettings
from ...estimation.fleet_model import FleetModel
from ...model.effects import AbstractEffect
from ...model.effects.coulomb_friction import CoulombFriction
from ...model.effects.presliding_friction import PreslidingFriction
from ...model.linear import holding_against
from ...model.throttle import Throttle
from .conditions import Condition
from .settings import LINE, WARMTH, LineSettings, TemperatureSettings

PerUnit = Float[np.ndarray, " U"]
_FINE = 201  # angles between which the unpowered position is looked for
_HALVINGS = 24  # of what lies between two of them


@dataclass(frozen=True, eq=False)
class Station:
    """U units under one condition.

    Args:
        model: the units.
        condition: of all of them.
        settings: of the figures.
        warmth: what a temperature does.
    """

    model: FleetModel
    condition: Condition
    settings: LineSettings = LINE
    warmth: TemperatureSettings = WARMTH

    @property
    def count(self) -> int:
        """U."""
        return len(self.model.units)

    @cached_property
    def throttles(self) -> Throttle:
        """The units under the condition, parameters of shape (U,)."""
        return self.condition.acting_on(self.model.throttles, self.warmth)

    @cached_property
    def body(self) -> Body:
        """Gear ratio and stops, rad; a quarter turn from zero where the rig has no stops."""
        lower, upper = self.model.config.travel
        lower = lower if np.isfinite(lower) else 0.0
        return Body(self.model.config.gear_ratio, lower, upper if np.isfinite(upper) else lower + 0.5 * np.pi)

    @property
    def travel(self) -> float:
        """rad."""
        return self.body.upper - self.body.lower

    def angle(self, share: float) -> float:
        """rad, of a share of the travel."""
        return self.body.lower + share * self.travel

    def opening(self, supply: float) -> PerUnit:
        """s from `early` to `late` of the travel at a supply (V), from rest at the closed stop; infinite for never."""
        return self._stroke(self.body.lower, supply, Bands(self._marks(), np.full((self.count, 2), np.inf)))

    def closing(self, supply: float) -> PerUnit:
        """Likewise from the open stop at the supply's reverse."""
        marks = self.body.upper + self.body.lower - self._marks()
        return self._stroke(self.body.upper, -supply, Bands(np.full((self.count, 2), -np.inf), marks))

    def _marks(self) -> np.ndarray:
        return np.tile([self.angle(self.settings.early), self.angle(self.settings.late)], (self.count, 1))

    def _stroke(self, begin: float, volts: float, bands: Bands) -> PerUnit:
        what = Experiment(*(np.full(self.count, each) for each in (begin, volts, 1.0)))
        s = self.settings
        first = moved(self.throttles, what, bands, self.body, Watching(s.step, s.longest, s.at_rest)).first
        return np.where(np.isfinite(first[:, 1]), first[:, 1] - np.where(np.isfinite(first[:, 0]), first[:, 0], 0.0),
                        np.inf)  # fmt: skip

    @cached_property
    def cut(self) -> Motion:
        """Let go from the open stop, terminals open."""
        return self._fall(0.0)

    @cached_property
    def shorted(self) -> Motion:
        """Let go from the open stop, terminals shorted."""
        return self._fall(1.0)

    def _fall(self, circuit: float) -> Motion:
        s = self.settings
        how = replace(SafetySettings(), returned=s.returned, falls=s.longest, fall_step=s.step, at_rest=s.at_rest)
        return falls(self.throttles, np.full(self.count, self.body.upper), self.homes, circuit, self.body, how)

    @cached_property
    def homes(self) -> PerUnit:
        """Where the springs alone bring the plate, rad: where no current holds it in the middle of its dry friction."""
        angles = np.linspace(self.body.lower, self.body.upper, _FINE)
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
        """The units with every dry contact sliding: one that yields before (T_z) carries all that it can."""

        contacts = [effect for effect in self.throttles.effects if isinstance(effect, PreslidingFriction)]
        if not contacts:
            return self.throttles
        extra = sum(np.asarray(contact.T_z) for contact in contacts)

        def each(effect: AbstractEffect) -> AbstractEffect:
            if isinstance(effect, PreslidingFriction):
                return replace(effect, T_z=0.0 * np.asarray(effect.T_z))
            return replace(effect, T_f=effect.T_f + extra) if isinstance(effect, CoulombFriction) else effect

        return replace(self.throttles, effects=tuple(each(effect) for effect in self.throttles.effects))

    def held(self, angles: PerUnit, share: float) -> tuple[PerUnit, PerUnit]:
        """Current (A) and voltage (V) at which each plate, at an angle of its own, is about to open (share 1), about
        to close (-1), or held in the middle of its dry friction (0)."""
        current, volts = _held(self.slid, angles, share, self.body)
        return np.asarray(current), np.asarray(volts)


@jax.jit
def _held(throttles: Throttle, angles: Any, share: Any, body: Body) -> Any:
    return jax.vmap(lambda throttle, theta: holding_against(throttle, theta, share, *body))(throttles, angles)


@jax.jit
def _currents(throttles: Throttle, angles: Any, body: Body) -> Any:
    """Shape (U, A)."""

    def each(throttle: Throttle) -> Any:
        return jax.vmap(lambda theta: holding_against(throttle, theta, 0.0, *body)[0])(angles)

    return jax.vmap(each)(throttles)
