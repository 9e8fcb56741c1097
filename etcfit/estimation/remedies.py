"""What a direction that the data do not determine means, and which measurement would determine it: one sentence each.

The first rule that fits speaks. A newcomer's parameter needs no rule: the last ones speak for any symbols.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from ..problem.free_parameters import SERIES
from .identifiability import Direction

ELECTRICAL = frozenset({"R_a", "L_a"})
MECHANICAL = frozenset({"J_m", "J_L", "B_m", "B_L", "K_s", "T_PL", "T_f"})


@dataclass(frozen=True)
class Rule:
    """Applies to symbols that hold all of `every`, at least `some_count` of `some`, and nothing outside `within`.

    Args:
        says: what the data see of them; follows the symbols' names.
        cure: what would tell them apart.
    """

    says: str
    cure: str
    every: frozenset[str] = frozenset()
    some: frozenset[str] = MECHANICAL
    some_count: int = 0
    within: frozenset[str] | None = None

    def fits(self, symbols: frozenset[str]) -> bool:
        inside = self.within is None or symbols <= self.within
        return inside and self.every <= symbols and len(self.some & symbols) >= self.some_count


_INERTIAS, _DAMPINGS = frozenset({"J_m", "J_L"}), frozenset({"B_m", "B_L"})
_ALONE = "a motor-alone test (viscous/, gear apart) separates them"
_RAMP = "a slow voltage ramp up and down over the whole travel (static_load/) separates them"

RULES: tuple[Rule, ...] = (
    Rule("share one scale, for nobody logged what the ECU put out and none of its gains is known",
         "a logged voltage or current, one known gain ([ecu] in rig.toml), or tests that measure the plate fix it",
         every=frozenset({"K_p"}), some=frozenset({"K_p", "K_i", "K_d"}) | MECHANICAL, some_count=2),
    Rule("share one scale, for nothing measures a torque",
         "only K_m = K_b, a torque sensor, or one known torque or inertia fixes it",
         every=frozenset({"K_m"}), some_count=2),
    Rule("share one scale, for without a current only torque per volt is seen",
         "log the current, or fix R_a and K_b in rig.toml", every=frozenset({"R_a"}), some_count=2),
    Rule("share one scale, for only ratios of torques are seen",
         "a logged torque or current, or one known torque or inertia, fixes it", some_count=4),
    Rule("are seen only as N^2 J_m + J_L", _ALONE, every=_INERTIAS, within=_INERTIAS),
    Rule("are seen only as N^2 B_m + B_L", _ALONE, every=_DAMPINGS, within=_DAMPINGS),
    Rule("are seen only as N^2 J_m + J_L and N^2 B_m + B_L", _ALONE, some_count=3, within=_INERTIAS | _DAMPINGS),
    Rule("brake alike, for without a current back-EMF looks like viscous friction",
         "log the current, or the EMF with open terminals (back_emf/)",
         every=frozenset({"K_b"}), some=_DAMPINGS, some_count=1),
    Rule("look alike over the small angle that the plate moves", _RAMP,
         every=frozenset({"K_s", "T_PL"}), within=frozenset({"K_s", "T_PL"})),
    Rule("look alike, for the plate hardly moves, or one way only", _RAMP,
         every=frozenset({"T_PL", "T_f"}), within=frozenset({"K_s", "T_PL", "T_f"})),
    Rule("look alike, for the plate moves at one speed only", "slow and fast motion separates them",
         every=frozenset({"T_f"}), some=_DAMPINGS, some_count=1, within=_DAMPINGS | {"T_f"}),
    Rule("are seen only as the ratio L_a/R_a", "a resistance test (resistance/: plate held) fixes R_a",
         every=ELECTRICAL, within=ELECTRICAL),
)  # fmt: skip

# the measurement that tells one parameter on its own
TOLD_BY: dict[str, str] = {
    "R_a": "a resistance test (resistance/: plate held, constant voltages)",
    "L_a": "an inductance test (inductance/: plate held, voltage step) or sampling faster than L_a/R_a, about 1 ms,",
    "K_b": "a back-EMF test (back_emf/: terminals open, plate let go)",
    "K_m": "the tie K_m = K_b, or a torque sensor,",
    "J_m": "a motor-alone test with voltage steps (viscous/)",
    "B_m": "a motor-alone test at several speeds (viscous/)",
    "J_L": "a free fall of the plate (inertia/) beside a motor-alone test (viscous/)",
    "B_L": "a fast free fall of the plate (inertia/) beside a motor-alone test (viscous/)",
    "K_s": "a slow voltage ramp up and down (static_load/)",
    "T_PL": "a slow voltage ramp up and down (static_load/)",
    "T_f": "a slow voltage ramp up and down (static_load/)",
}

# the gain of the ECU that multiplies what motion
EXCITED_BY: dict[str, str] = {
    "K_p": "any motion of the setpoint",
    "K_i": "an error that lasts",
    "K_d": "a quick change of the setpoint",
}


def sentence(direction: Direction) -> str:
    """A null or weak direction in words, with its cure.

    Args:
        direction: as found by `identifiability.analyse`.
    """
    says, cure = _verdict(direction.symbols)
    apart = "" if direction.null else f" (known to {100.0 * direction.sd:.0f} % only)"
    return f"{listed(direction.symbols)} {says}{apart}: {cure}."


def _verdict(symbols: tuple[str, ...]) -> tuple[str, str]:
    if len(symbols) == 1:
        return "is hardly seen in these data", _told(symbols[0])
    if series := [s.removeprefix(SERIES) for s in symbols if s.startswith(SERIES)]:
        keys = listed(f"tests.{test}.series_ohm" for test in series)
        return "are resistances in one circuit, seen only as a sum", (
            f"a resistance test without a series resistance of its own, or a number for {keys}, separates them"
        )
    rule = next((rule for rule in RULES if rule.fits(frozenset(symbols))), None)
    if rule is None:
        return "are seen only in one combination", _told(symbols[0])
    return rule.says, rule.cure


def _told(symbol: str) -> str:
    if symbol in TOLD_BY:
        return f"{TOLD_BY[symbol]} tells {symbol}"
    if symbol in EXCITED_BY:
        return f"{EXCITED_BY[symbol]} beside tests that log a voltage, or a number in [ecu], tells {symbol}"
    return f"fix {symbol} in rig.toml if it is known, or log what depends on it"


def listed(words: Iterable[str]) -> str:
    """a, b and c."""
    *most, last = words
    return f"{', '.join(most)} and {last}" if most else last
