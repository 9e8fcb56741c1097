"""Settings of design and frequency response: draws, the simulated loop, budgets of the rules, limits for sine
traces."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

from ..ranges import check_ranges, real, reals, whole


def _check_bounds(settings: OptimumSettings | ManualSettings) -> None:
    """Refuse least and largest gains that are not three each, or do not rise."""
    check_ranges(settings)
    name, low, high = type(settings).__name__, settings.lowest, settings.highest
    if len(low) != 3:
        raise ValueError(f"{name}.lowest = {low!r}: it must have three gains, Kp, Ki and Kd.")
    if len(high) != 3 or not all(a < b for a, b in zip(low, high, strict=True)):
        raise ValueError(f"{name}.highest = {high!r}: it must have an entry above each of lowest, {low!r}.")


@dataclass(frozen=True)
class OptimumSettings:
    """The search of the rule `optimal`: scattered gains, then the cross-entropy method.

    Args:
        certain: share of the draws that must meet every requirement.
        few: draws in the second part of the search, including the nominal model; all draws judge its result.
        searches: searches on the nominal model, each with its own scatter: dry friction causes local optima that
            differ by a few per cent.
        sweeps: populations that are scattered over all gains first.
        population: gains tried together.
        elite: best gains of a population, about which the next one is drawn.
        rounds: populations on the nominal model.
        starts: searches on the few draws, each from one of the best results of the former, none near another.
        last_rounds: populations of each of these searches.
        spares: reserves to each requirement during the search, as shares, for draws that it does not use; the next one
            is used where all draws together do not meet the requirements with the one before.
        lowest: least gains, Kp (V/rad), Ki (V/(rad s)) and Kd (V s/rad).
        highest: largest gains, likewise.
        seed: seed of the random numbers.
    """

    certain: float = real(0.95, 0.0, 1.0)
    few: int = whole(24, 1, 100_000)
    searches: int = whole(3, 1, 1000)
    sweeps: int = whole(6, 1, 1000)
    population: int = whole(48, 4, 100_000)
    elite: int = whole(10, 2, 100_000)
    rounds: int = whole(36, 0, 100_000)
    starts: int = whole(3, 1, 1000)
    last_rounds: int = whole(12, 0, 100_000)
    spares: tuple[float, ...] = reals((0.03, 0.06, 0.1), 0.0, 1.0)
    lowest: tuple[float, ...] = reals((0.3, 0.3, 3e-3), 1e-12, 1e12)
    highest: tuple[float, ...] = reals((1e3, 3e5, 40.0), 1e-12, 1e12)
    seed: int = whole(20230701, 0, 2**32 - 1)

    def __post_init__(self) -> None:
        _check_bounds(self)
        if self.elite > self.population:
            raise ValueError(f"OptimumSettings.elite = {self.elite}: it must be at most the population, "
                             f"{self.population}.")  # fmt: skip


@dataclass(frozen=True)
class ManualSettings:
    """The gains that the paper's manual procedure tries.

    Args:
        lowest: least gains tried besides 0, Kp (V/rad), Ki (V/(rad s)) and Kd (V s/rad).
        highest: largest ones, likewise; the rule refuses where the best proportional gain is the largest.
    """

    lowest: tuple[float, ...] = reals((0.2, 0.1, 1e-3), 1e-12, 1e12)
    highest: tuple[float, ...] = reals((1e3, 3e5, 40.0), 1e-12, 1e12)

    __post_init__ = _check_bounds


@dataclass(frozen=True)
class FrequencySettings:
    """Limits for sine traces, and for the order of lag that their points show.

    Args:
        fewest_cycles: least number of cycles that setpoint and position have in common.
        samples_a_cycle: least number of samples a cycle of every signal.
        outside: largest share of the setpoint's power outside its fundamental.
        poor: share of the response that the best lag does not explain, above which it does not describe the points.
    """

    fewest_cycles: int = whole(3, 2, 1000)
    samples_a_cycle: float = real(5.0, 4.0, 1e6)
    outside: float = real(0.10, 0.0, 1.0)
    poor: float = real(0.1, 0.0, 10.0)

    __post_init__ = check_ranges


@dataclass(frozen=True)
class LoopSettings:
    """The simulation of the nonlinear loop.

    Args:
        longest_step: longest step of the integration, s; a tick of the ECU is divided into equal steps.
        seed: seed of the sensor's noise: a sequence for each model, the same for all gains.
        bridge_ohm: resistance of the bridge that drives the motor, both of its closed switches together.
    """

    longest_step: float = real(5e-4, 1e-7, 1.0)
    seed: int = whole(20230701, 0, 2**32 - 1)
    bridge_ohm: float = real(0.2, 0.0, 1e3)

    __post_init__ = check_ranges


@dataclass(frozen=True)
class ScenarioSettings:
    """The scenarios on which gains are judged, in addition to the paper's trapezoid.

    Args:
        low, high: ends of the large steps, shares of the travel.
        small: the small steps, up from a quarter of the travel and back, shares of the travel.
        log: duration that is taken of a log from the car, s.
    """

    low: float = real(0.1, 0.0, 1.0)
    high: float = real(0.7, 0.0, 1.0)
    small: tuple[float, ...] = reals((0.005, 0.01, 0.02), 1e-6, 0.5)
    log: float = real(4.0, 0.1, 1000.0)

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.low >= self.high:
            raise ValueError(f"ScenarioSettings.high = {self.high!r}: it must be above low, {self.low!r}.")


@dataclass(frozen=True)
class ConditionSettings:
    """The conditions of a car under which gains are tried, in addition to those of the bench.

    Args:
        supply: least and largest, V.
        winding: coldest and hottest, degrees Celsius.
        friction: least and largest, over that of the bench.
        bench: temperature of the winding in the measurements, degrees Celsius.
        seed: of the random numbers that draw conditions.
    """

    supply: tuple[float, ...] = reals((9.0, 15.0), 0.1, 1e3)
    winding: tuple[float, ...] = reals((-20.0, 130.0), -100.0, 400.0)
    friction: tuple[float, ...] = reals((0.5, 1.5), 0.0, 100.0)
    bench: float = real(23.0, -100.0, 400.0)
    seed: int = whole(20230702, 0, 2**32 - 1)

    def __post_init__(self) -> None:
        check_ranges(self)
        for name in ("supply", "winding", "friction"):
            ends = getattr(self, name)
            if len(ends) != 2 or not ends[0] <= ends[1]:
                raise ValueError(f"ConditionSettings.{name} = {ends!r}: it must be two numbers, the least first.")


@dataclass(frozen=True)
class SlidingSettings:
    """Feed-forward that follows the setpoint's rate.

    Args:
        full: rate of the setpoint from which on the feed-forward has the full dry friction, travels per second; at a
            smaller rate it has a proportional share, so that noise of a resting setpoint does not make the duty jump.
        rate: speed of the plate at which friction and drag are computed, travels per second; that of the trapezoid.
    """

    full: float = real(0.05, 1e-6, 100.0)
    rate: float = real(4.0, 1e-3, 1000.0)

    __post_init__ = check_ranges


@dataclass(frozen=True)
class ScheduleSettings:
    """Tables of gains.

    Args:
        supplies: at the points of a table over the supply, V, rising.
    """

    supplies: tuple[float, ...] = reals((9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0), 0.1, 1e3)

    def __post_init__(self) -> None:
        check_ranges(self)
        if any(a >= b for a, b in pairwise(self.supplies)):
            raise ValueError(f"ScheduleSettings.supplies = {self.supplies!r}: they must rise.")


@dataclass(frozen=True)
class FrontSettings:
    """The front of tracking against effort.

    Args:
        rounds: populations of the search for each point.
    """

    rounds: int = whole(12, 0, 100_000)

    __post_init__ = check_ranges


@dataclass(frozen=True)
class SafetySettings:
    """Settings of the safety figures.

    Args:
        most: largest threshold of the jam check, share of the travel.
        reserve: timeout over the longest time for which the error of a sound throttle exceeds the threshold.
        within: longest timeout, s; the least threshold with a timeout within it is proposed.
        frozen: setpoint steps while the sensor is stuck, shares of the travel.
        offset: error of one of two sensors that reads too little, share of the travel.
        apart: allowed difference of two sensors, share of the travel.
        apart_for: time for which a larger difference is allowed, s.
        supply: supply when the sensor fails, V: the higher it is, the faster the plate runs away.
        dip: supply during a dip, V.
        dip_for: its duration, s.
        crank: supply while the starter breaks away, and while it turns, V.
        crank_for: duration of each, s.
        openings: setpoints during a dip, and openings from which the spring returns the plate, shares of the travel.
        insulation: allowed temperature of a winding, degrees Celsius; 155 for class F of IEC 60085.
    """

    most: float = real(0.6, above=0.005, high=1.0)  # they begin at `safety.faults._LEAST`
    reserve: float = real(1.5, 1.0, 100.0)
    within: float = real(0.25, 1e-3, 100.0)
    frozen: tuple[float, ...] = reals((0.02, 0.1), 1e-3, 0.7)
    offset: float = real(0.1, 1e-3, 0.7)
    apart: float = real(0.05, 1e-4, 1.0)
    apart_for: float = real(0.05, 0.0, 100.0)
    supply: float = real(15.0, 0.1, 1e3)
    dip: float = real(6.0, 0.0, 1e3)
    dip_for: float = real(0.1, 1e-3, 1.0)
    crank: tuple[float, ...] = reals((6.0, 8.0), 0.0, 1e3)
    crank_for: tuple[float, ...] = reals((0.05, 0.5), 1e-3, 1.0)
    openings: tuple[float, ...] = reals((0.05, 0.25, 0.5, 0.75, 1.0), 0.0, 1.0)
    insulation: float = real(155.0, 0.0, 1000.0)

    def __post_init__(self) -> None:
        check_ranges(self)
        if len(self.crank) != len(self.crank_for):
            raise ValueError(f"SafetySettings.crank_for = {self.crank_for!r}: it must have as many parts as crank.")


@dataclass(frozen=True)
class FleetDesignSettings:
    """Settings of gains for many units.

    Args:
        share: share of the units that must meet every requirement.
        few: number of units that the search uses: extreme ones along the principal directions, and random ones.
        future: number of units drawn from the population to predict the results of future units.
        seed: seed of the random numbers.
    """

    share: float = real(0.99, 0.0, 1.0)
    few: int = whole(32, 2, 100_000)
    future: int = whole(1000, 2, 10**6)
    seed: int = whole(20230703, 0, 2**32 - 1)

    __post_init__ = check_ranges


@dataclass(frozen=True)
class DesignSettings:
    """The plan of a design.

    Args:
        draws: number of models that judge every rule, including the nominal one; the others are drawn from the
            posterior or from the fit.
        seed: seed of the random numbers of the draws.
        loop: the simulation.
        scenarios: scenarios on which gains are judged.
        conditions: conditions of a car, in addition to those of the bench.
        sliding: feed-forward that follows the setpoint's rate.
        schedule: tables of gains.
        front: the front of tracking against effort.
        safety: failures and their checks.
        optimum: the search of the rule `optimal`.
        manual: the rule `manual`.
    """

    draws: int = whole(200, 1, 10**6)
    seed: int = whole(20230701, 0, 2**32 - 1)
    loop: LoopSettings = LoopSettings()
    scenarios: ScenarioSettings = ScenarioSettings()
    conditions: ConditionSettings = ConditionSettings()
    sliding: SlidingSettings = SlidingSettings()
    schedule: ScheduleSettings = ScheduleSettings()
    front: FrontSettings = FrontSettings()
    safety: SafetySettings = SafetySettings()
    optimum: OptimumSettings = OptimumSettings()
    manual: ManualSettings = ManualSettings()

    __post_init__ = check_ranges
