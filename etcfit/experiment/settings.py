"""What `check` and the advice on the next measurement decide by."""

from __future__ import annotations

from dataclasses import dataclass

from ..errors import SettingsError
from ..ranges import check_ranges, real, reals, whole


@dataclass(frozen=True)
class CheckSettings:
    """What is odd about a clock or a channel.

    Args:
        gap: an interval of more median intervals than this is a gap.
        run: samples in a row on the extreme value that count as clipped, at least.
    """

    gap: float = real(3.0, 1.0, 1e6)
    run: int = whole(5, 1, 10**6)

    __post_init__ = check_ranges


@dataclass(frozen=True)
class PlanSettings:
    """How a trace that does not exist yet would be made, as far as the rig's own traces do not tell.

    Args:
        supply: where neither rig.toml nor a logged voltage tells it, V.
        rate: at which a driven plate is logged where no response was, Hz.
        duration: of such a log, s.
        lowest: frequency at which a sine sweep begins, Hz.
        bands: frequencies at which the sweeps to choose from end, Hz.
    """

    supply: float = real(12.0, 0.1, 1e4)
    rate: float = real(1000.0, 1.0, 1e6)
    duration: float = real(4.0, 0.01, 1e4)
    lowest: float = real(0.3, 1e-3, 1e3)
    bands: tuple[float, ...] = reals((1.0, 4.0, 12.0), 1e-3, 1e4)

    def __post_init__(self) -> None:
        check_ranges(self)
        if min(self.bands) <= self.lowest:
            raise SettingsError(
                f"PlanSettings.bands = {self.bands!r}: each must be greater than lowest, {self.lowest:g}."
            )


@dataclass(frozen=True)
class AdviceSettings:
    """When one more trace tells two parameters apart.

    rho is the correlation of two estimates. 1 / (1 - rho^2) is the factor by which it makes the variance of either
    larger than it would be were the other one known.

    Args:
        apart: share of 1 / (1 - rho^2) that may be left if a trace is to be said to separate them; dimensionless.
        plan: how the trace would be made.
    """

    apart: float = real(0.9, 0.0, 1.0)
    plan: PlanSettings = PlanSettings()

    __post_init__ = check_ranges


@dataclass(frozen=True)
class CampaignSettings:
    """What the next tests may do to the rig, and by what they are chosen.

    Args:
        current: limit of the winding's current, A.
        temperature: limit of the winding's temperature, degC.
        ambient: where each test begins, degC.
        supply: share of the supply that a test may ask for.
        margin: least distance from an end stop while the plate is driven about, share of the travel.
        draws: models over which a test must stay within the limits, the fitted one besides.
        tests: how many to choose, at most.
        least: drop of the criterion below which a test is not worth its while, relative.
        handling: time that setting up one test takes, s: information is weighed against the time spent.
        durations: of the excitation, s, each a candidate.
        play: clock of what is played, Hz.
        seed: of the draws.
        plan: how traces are logged and, of rig tests that were not made yet, made.
    """

    current: float = real(5.0, above=0.0, high=1e3)
    temperature: float = real(120.0, 0.0, 300.0)
    ambient: float = real(25.0, -50.0, 200.0)
    supply: float = real(0.95, above=0.0, high=1.0)
    margin: float = real(0.04, 0.0, 0.4)
    draws: int = whole(6, 0, 1000)
    tests: int = whole(4, 1, 50)
    least: float = real(0.03, 0.0, 1.0)
    handling: float = real(10.0, 0.0, 1e5)
    durations: tuple[float, ...] = reals((3.0, 6.0), 0.1, 1e3)
    play: float = real(1000.0, 10.0, 1e5)
    seed: int = whole(0, 0)
    plan: PlanSettings = PlanSettings()

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.temperature <= self.ambient:
            raise SettingsError(
                f"CampaignSettings.temperature = {self.temperature!r}: it must be above ambient, {self.ambient:g} degC."
            )
