"""What the figures of a line are measured by."""

from __future__ import annotations

from dataclasses import dataclass

from ...ranges import check_ranges, real


@dataclass(frozen=True)
class LineSettings:
    """Levels, instants and supplies of the figures.

    Args:
        early, late: shares of a stroke between which its time is taken; 10 and 90 % as of IEEE Std 181-2011.
        middle: share of the travel at which the holding current and its hysteresis are given.
        returned: distance from its unpowered position at which a plate is back, share of the travel.
        supply: of the condition "bench", V.
        low_supply, high_supply: whose opening times are compared, V.
        step: of the integration, s.
        longest: s that a plate is watched.
        at_rest: s without any motion after which it is at rest.
    """

    early: float = real(0.1, 0.0, 0.5)
    late: float = real(0.9, 0.5, 1.0)
    middle: float = real(0.5, 0.0, 1.0)
    returned: float = real(0.05, 1e-4, 0.5)
    supply: float = real(12.0, 0.1, 1e3)
    low_supply: float = real(9.0, 0.1, 1e3)
    high_supply: float = real(14.0, 0.1, 1e3)
    step: float = real(1e-4, 1e-6, 1e-2)
    longest: float = real(3.0, 1e-2, 100.0)
    at_rest: float = real(0.1, 1e-3, 100.0)

    __post_init__ = check_ranges


@dataclass(frozen=True)
class TemperatureSettings:
    """How a throttle body changes with its temperature.

    Args:
        bench: temperature at which the units were measured, degrees Celsius.
        hot: by how much the winding is warmer then, K.
        cold: temperature of the cold one, degrees Celsius.
        copper: growth of the winding's resistance, 1/K, about 20 degrees Celsius: IEC 60028.
        magnet: growth of the magnets' flux, 1/K, and of K_b and K_m with it: -0.002 for hard ferrite, -0.001 for
            sintered NdFeB (Modelica Standard Library 4, Magnetic.FluxTubes.Material.HardMagnetic). Which of them a
            motor has is ASSUMED: small DC motors of throttles have ferrite.
        cold_friction: dry friction over that of the bench in the cold. 1 leaves it alone: how a grease stiffens is
            its own affair, and no measurement at the bench tells it.
    """

    bench: float = real(20.0, -100.0, 400.0)
    hot: float = real(80.0, 0.0, 300.0)
    cold: float = real(-40.0, -100.0, 100.0)
    copper: float = real(0.00393, 0.0, 0.1)
    magnet: float = real(-0.002, -0.01, 0.01)
    cold_friction: float = real(1.0, 0.0, 100.0)

    __post_init__ = check_ranges


LINE, WARMTH = LineSettings(), TemperatureSettings()  # where nobody asks for others
