"""What a planner knows of a rig: its parameters, its supply, how well it measures, where its plate rests."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..rig import TEST_BY_NAME, TESTS
from ..rig.base import AbstractRigTest, Rig, RigConfig
from .settings import PlanSettings

# noise of a sensor that this rig has not been seen with, SI
USUAL = PlanSettings().noise


@dataclass(frozen=True, eq=False)
class Setting:
    """A rig as a planner sees it.

    Args:
        config: the rig.
        values: of all parameters, SI, by symbol.
        supply: V.
        noise: standard deviation of one sample by channel, SI.
        assumed: channels whose noise is not the rig's own.
        rest: where the plate rests without a drive, rad.
        rate: at which driven plates are logged, Hz.
        duration: of such a log, s.
        logged: by rig test, the channels that this rig logs in it: those seen in a trace of the same boundary, for a
            shaft's speed is seen with the gear apart only, and an EMF at open terminals.
        settings: of the plans.
    """

    config: RigConfig
    values: Mapping[str, float]
    supply: float
    noise: Mapping[str, float]
    assumed: frozenset[str]
    rest: float
    rate: float
    duration: float
    logged: Mapping[str, frozenset[str]]
    settings: PlanSettings = PlanSettings()

    @classmethod
    def of(cls, rig: Rig, values: Mapping[str, float], settings: PlanSettings = PlanSettings()) -> Setting:
        """From what was measured, as far as that tells; the rest from the settings.

        Args:
            rig: a measurement folder.
            values: of all parameters, SI, by symbol.
            settings: what is taken for what was not measured.
        """
        seen: dict[str, list[float]] = {}
        for trace in rig.measurements:
            for name, channel in trace.channels.items():
                seen.setdefault(name, []).append(max(channel.sigma, channel.quantum / np.sqrt(12.0)))
        own = {name: float(np.median(sigmas)) for name, sigmas in seen.items()}
        driven = [t for t in rig.measurements if t.test in ("response", "static_load", "drive")]
        rests = [t.channels["position"].value[0] for t in driven if "position" in t.channels]
        responses = [t.time for t in rig.measurements if t.test == "response"]
        volts = [np.abs(t.channels["voltage"].value).max() for t in rig.measurements if "voltage" in t.channels]
        return cls(
            config=rig.config,
            values=values,
            supply=rig.config.supply_V or float(max(volts, default=settings.supply)),
            noise=settings.noise | own,
            assumed=frozenset(settings.noise) - frozenset(own),
            rest=float(np.clip(np.median(rests) if rests else 0.0, *rig.config.travel)),
            rate=1.0 / float(np.median([np.median(np.diff(t)) for t in responses])) if responses else settings.rate,
            duration=float(np.median([np.ptp(t) for t in responses])) if responses else settings.duration,
            logged={test.name: _logged(test, rig) for test in TESTS},
            settings=settings,
        )

    @property
    def open(self) -> float:
        """The upper stop, rad; a quarter turn from rest where there is none."""
        upper = self.config.travel[1]
        return upper if np.isfinite(upper) else self.rest + 0.5 * np.pi

    def volts(self, torque: float) -> float:
        """Steady voltage whose motor torque is this one at the plate: R_a T / (N K_m), V."""
        return float(self.values["R_a"] * torque / (self.config.gear_ratio * self.values["K_m"]))

    def balance(self, angle: float) -> float:
        """Voltage that holds the plate at this angle by the start model, V."""
        return self.volts(self.values["T_PL"] + self.values["K_s"] * angle)

    @property
    def friction(self) -> float:
        """Voltage that overcomes dry friction, V."""
        return self.volts(self.values["T_f"])

    def within(self, volts: float) -> float:
        """What the supply can give of it, V."""
        return float(np.clip(volts, -self.supply, self.supply))


_ANYWHERE = frozenset({"current", "position"})  # seen whatever is done to the rig


def _logged(test: AbstractRigTest, rig: Rig) -> frozenset[str]:
    """Channels of a rig test that this rig logs, see `Setting`."""
    alike = [m for m in rig.measurements if TEST_BY_NAME[m.test].boundary == test.boundary]
    seen = frozenset(name for m in (alike or rig.measurements) for name in m.channels)
    return frozenset(test.observes) & (seen if alike else seen & _ANYWHERE)
