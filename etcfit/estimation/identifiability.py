"""What the data determine: singular values of the scaled Jacobian, and the parameters that each weak direction
mixes."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass

import numpy as np

from ..problem.free_parameters import SERIES, Layout
from ..problem.trace import Trace
from ..rig.user_text import toml_string
from .settings import IdentifiabilitySettings

# standard deviation of the prior of a parameter without a given prior, in reaches of its coordinate: about a factor of
# 20 up or down. It is part of the definition of covariance and posterior, so it is not a setting
WIDE = 3.0
_NAMED_SHARE = 0.1  # a symbol is named in a direction if its component is more than this share of the largest one
WEAK = 0.1  # standard deviation over reach above which a direction is reported as badly known


@dataclass(frozen=True, eq=False)
class Direction:
    """A combination of parameters that the data determine badly or not at all."""

    symbols: tuple[str, ...]  # the parameters it mixes, largest share first
    shares: tuple[float, ...]  # their components, in coordinates (relative changes for positive parameters)
    sd: float  # standard deviation along it, reaches; inf without any information
    # standard deviation above which it counts as not determined at all, reaches
    unknown: float = IdentifiabilitySettings().unknown

    @property
    def null(self) -> bool:
        """Whether the data do not determine it at all, rather than badly."""
        return self.sd > self.unknown


@dataclass(frozen=True, eq=False)
class Identifiability:
    """Verdict on one model and one set of traces."""

    symbols: tuple[str, ...]  # free parameters, P
    singular_values: np.ndarray  # of the whitened Jacobian in coordinates, falling, shape (P,)
    directions: tuple[Direction, ...]  # the null and the weak ones, worst first
    # covariance of the coordinates, with the prior (`WIDE`) where the data have no information, (P, P)
    covariance: np.ndarray
    lost: tuple[str, ...]  # symbols that are not identifiable


def analyse(
    layout: Layout,
    x: np.ndarray,
    information: np.ndarray,
    settings: IdentifiabilitySettings = IdentifiabilitySettings(),
) -> Identifiability:
    """Judge a Fisher information F by the eigenvalues of R F R, R the diagonal matrix of reaches.

        sd_k = 1 / sqrt(eigenvalue_k)

    Args:
        information: J^T J of the whitened residual and the user's priors, shape (P, P).
    """
    reach = layout.reach(x)
    values, vectors = np.linalg.eigh(information * np.outer(reach, reach))  # relative changes
    values = np.maximum(values, 0.0)
    sd = 1.0 / np.sqrt(np.maximum(values, 1e-300))
    null = sd > settings.unknown
    directions = [*_readable(layout.free, vectors[:, null], sd[null], settings)]
    for k in np.flatnonzero(~null & (sd > WEAK)):
        directions.append(_direction(layout.free, vectors[:, k], sd[k], settings))
    # by eigenvectors: an inverse would lose the null directions in rounding errors
    relative = (vectors / (values + 1.0 / WIDE**2)) @ vectors.T
    unsure = np.diag(relative) > settings.unknown**2
    if null.any():
        straying = np.sum(vectors[:, null] ** 2 / (values[null] + 1.0 / WIDE**2), axis=1)
        unsure |= _scaled(layout.relative_size(x), np.diag(relative), straying, settings.unknown)
    lost = tuple(s for s, is_lost in zip(layout.free, unsure, strict=True) if is_lost)
    covariance = relative * np.outer(reach, reach)
    return Identifiability(layout.free, np.sqrt(values[::-1]), tuple(directions), covariance, lost)


def _scaled(size: np.ndarray, variance: np.ndarray, straying: np.ndarray, unknown: float) -> np.ndarray:
    """Whether parameters are known only up to a scale: not 0 without their variance along null directions, which is
    large compared with their own size. Compared with their reach that would be a small error.

    Args:
        size: size of the parameters in reaches, shape (P,).
        variance: variance of the parameters, reaches^2.
        straying: its part along null directions.
        unknown: share of its size up to which a parameter counts as known.
    """
    rest = np.maximum(variance - straying, 0.0)
    return (straying > (unknown * size) ** 2) & (size**2 > 4.0 * rest)


def _direction(symbols: tuple[str, ...], vector: np.ndarray, sd: float, settings: IdentifiabilitySettings) -> Direction:
    """A direction from its unit vector, shape (P,), with the symbols of large enough shares, largest first."""
    vector = vector * np.sign(vector[np.argmax(np.abs(vector))])
    order = [k for k in np.argsort(-np.abs(vector)) if abs(vector[k]) > _NAMED_SHARE * np.abs(vector).max()]
    shares = tuple(float(vector[k]) for k in order)
    return Direction(tuple(symbols[k] for k in order), shares, float(sd), settings.unknown)


def _readable(
    symbols: tuple[str, ...], basis: np.ndarray, sd: np.ndarray, settings: IdentifiabilitySettings
) -> list[Direction]:
    """Directions that span a null space, chosen so that the largest component of each is another symbol.

    Args:
        basis: any orthonormal basis of the space, shape (P, K).
        sd: standard deviations along the basis, shape (K,).
    """
    out, rest = [], basis.copy()
    leaders: list[int] = []
    for _ in range(basis.shape[1]):
        weight = np.where(np.isin(np.arange(len(symbols)), leaders), -1.0, np.linalg.norm(rest, axis=1))
        leaders.append(int(np.argmax(weight)))
        row = rest[leaders[-1]] / np.linalg.norm(rest[leaders[-1]])
        rest = rest - np.outer(rest @ row, row)
    if leaders:
        sparse = basis @ np.linalg.inv(basis[leaders])
        for k in range(sparse.shape[1]):
            unit = sparse[:, k] / np.linalg.norm(sparse[:, k])
            out.append(_direction(symbols, unit, float(np.max(sd)), settings))
    return out


# ---- The meaning of a direction that the data do not determine, and the measurement that would: one sentence each.
#
# The first rule that applies gives the sentence. A new parameter needs no rule: the last rules apply to any symbols. A
# test that was made already is not advised as if it had not been made.

ELECTRICAL = frozenset({"R_a", "L_a"})
MECHANICAL = frozenset({"J_m", "J_L", "B_m", "B_L", "K_s", "T_PL", "T_f"})


@dataclass(frozen=True)
class Way:
    """A rig test that determines parameters."""

    test: str  # its name
    name: str  # its name in words, with the article
    how: str  # how it is made

    def __str__(self) -> str:
        return f"{self.name} ({self.test}/: {self.how})"


@dataclass(frozen=True)
class Cure:
    """The measurements that would separate parameters."""

    tests: tuple[Way, ...] = ()  # rig tests that do so together
    besides: str = ""  # an alternative without another test; "" if there is none
    verb: str = "separates them"  # the verb of the sentence, as "determines R_a"; "" if `besides` is a whole sentence

    def words(self, made: Collection[str]) -> str:
        """The cure for a rig with these tests: a test that was made is not advised as if it had not been made."""
        absent = [str(way) for way in self.tests if way.test not in made]
        if absent or not self.tests:
            ways = [" beside ".join(absent), self.besides]
            return f"{' or '.join(way for way in ways if way)} {self.verb}".rstrip()
        there = listed(f"{way.test}/" for way in self.tests)
        more = f"`etcfit check --advise` says how much one more trace ({self.tests[-1].how}) would help"
        besides = f"{self.besides} {self.verb}, and " if self.besides else ""
        tells = "tells" if len(self.tests) == 1 else "tell"
        return f"{there} {'is' if len(self.tests) == 1 else 'are'} there but {tells} too little: {besides}{more}"


@dataclass(frozen=True)
class Rule:
    """Applies to sets of symbols with all of `every`, at least `some_count` of `some`, and none outside `within`."""

    says: str  # what the data show of them; follows the symbols' names
    cure: Cure  # what would separate them
    every: frozenset[str] = frozenset()
    some: frozenset[str] = MECHANICAL
    some_count: int = 0
    within: frozenset[str] | None = None

    def fits(self, symbols: frozenset[str]) -> bool:
        inside = self.within is None or symbols <= self.within
        return inside and self.every <= symbols and len(self.some & symbols) >= self.some_count


RESISTANCE = Way("resistance", "a resistance test", "plate held, constant voltages")
INDUCTANCE = Way("inductance", "an inductance test", "plate held, voltage step")
BACK_EMF = Way("back_emf", "a back-EMF test", "terminals open, plate let go")
ALONE = Way("viscous", "a motor-alone test", "gear apart, voltage steps to several speeds")
FALL = Way("inertia", "a free fall of the plate", "terminals open, plate let go from open")
RAMP = Way("static_load", "a slow voltage ramp", "up and down over the whole travel")

_INERTIAS, _DAMPINGS = frozenset({"J_m", "J_L"}), frozenset({"B_m", "B_L"})

RULES: tuple[Rule, ...] = (
    Rule("share one scale, because the output of the ECU was not logged and none of its gains is known",
         Cure(besides="a logged voltage or current, one known gain ([ecu] in rig.toml), or tests that measure the "
                      "plate", verb="fixes it"),
         every=frozenset({"K_p"}), some=frozenset({"K_p", "K_i", "K_d", "V_e"}) | MECHANICAL, some_count=2),
    Rule("share one scale, because nothing measures a torque",
         Cure(besides="only K_m = K_b, a torque sensor, or one known torque or inertia", verb="fixes it"),
         every=frozenset({"K_m"}), some_count=2),
    Rule("share one scale, because without a current only torque per volt is seen",
         Cure(besides="log the current, or fix R_a and K_b in rig.toml", verb=""),
         every=frozenset({"R_a"}), some_count=2),
    Rule("share one scale, because only ratios of torques are seen",
         Cure(besides="a logged torque or current, or one known torque or inertia,", verb="fixes it"), some_count=4),
    Rule("are seen only as N^2 J_m + J_L", Cure((ALONE,)), every=_INERTIAS, within=_INERTIAS),
    Rule("are seen only as N^2 B_m + B_L", Cure((ALONE,)), every=_DAMPINGS, within=_DAMPINGS),
    Rule("are seen only as N^2 J_m + J_L and N^2 B_m + B_L", Cure((ALONE,)),
         some_count=3, within=_INERTIAS | _DAMPINGS),
    Rule("brake alike, because without a current back-EMF looks like viscous friction",
         Cure((BACK_EMF,), besides="a logged current"), every=frozenset({"K_b"}), some=_DAMPINGS, some_count=1),
    Rule("look alike over the small angle that the plate moves", Cure((RAMP,)),
         every=frozenset({"K_s", "T_PL"}), within=frozenset({"K_s", "T_PL"})),
    Rule("look alike, because the plate hardly moves, or in one direction only", Cure((RAMP,)),
         every=frozenset({"T_PL", "T_f"}), within=frozenset({"K_s", "T_PL", "T_f"})),
    Rule("look alike, because the plate moves at one speed only", Cure(besides="slow and fast motion"),
         every=frozenset({"T_f"}), some=_DAMPINGS, some_count=1, within=_DAMPINGS | {"T_f"}),
    Rule("are seen only as the ratio L_a/R_a", Cure((RESISTANCE,), verb="fixes R_a"),
         every=ELECTRICAL, within=ELECTRICAL),
)  # fmt: skip


def _cure_by_tests(symbol: str, *tests: Way, besides: str = "") -> tuple[str, Cure]:
    return symbol, Cure(tests, besides, f"tells {symbol}")


# the measurement that determines one parameter by itself
TOLD_BY: dict[str, Cure] = dict(
    (
        _cure_by_tests("R_a", RESISTANCE),
        _cure_by_tests("L_a", INDUCTANCE, besides="sampling faster than L_a/R_a, about 1 ms,"),
        _cure_by_tests("K_b", BACK_EMF),
        _cure_by_tests("K_m", besides="the tie K_m = K_b, or a torque sensor,"),
        _cure_by_tests("J_m", ALONE),
        _cure_by_tests("B_m", ALONE),
        _cure_by_tests("J_L", FALL, ALONE),
        _cure_by_tests("B_L", FALL, ALONE),
        _cure_by_tests("K_s", RAMP),
        _cure_by_tests("T_PL", RAMP),
        _cure_by_tests("T_f", RAMP),
    )
)

# gain of the ECU -> the motion that excites it
EXCITED_BY: dict[str, str] = {
    "K_p": "any motion of the setpoint",
    "K_i": "an error that lasts",
    "K_d": "a quick change of the setpoint",
    "V_e": "a setpoint that drives the ECU to its limit",
}


def sentences(directions: Iterable[Direction], traces: Iterable[Trace]) -> tuple[str, ...]:
    """Each null or weak direction in words, with a cure that these traces do not contain."""
    made = frozenset(trace.test.name for trace in traces)
    return tuple(sentence(direction, made) for direction in directions)


def sentence(direction: Direction, made: Collection[str] = ()) -> str:
    """A null or weak direction in words, with its cure."""
    says, cure = _verdict(direction.symbols, made)
    apart = "" if direction.null else f" (known to {100.0 * direction.sd:.0f} % only)"
    return f"{listed(direction.symbols)} {says}{apart}: {cure}."


def _verdict(symbols: tuple[str, ...], made: Collection[str]) -> tuple[str, str]:
    if len(symbols) == 1:
        return "is hardly seen in these data", _cure_for_symbol(symbols[0], made)
    if series := [s.removeprefix(SERIES) for s in symbols if s.startswith(SERIES)]:
        keys = listed(f"tests.{test}.series_ohm" for test in series)
        return "are resistances in one circuit, seen only as a sum", (
            f"a resistance test without a series resistance of its own, or a number for {keys}, separates them"
        )
    rule = next((rule for rule in RULES if rule.fits(frozenset(symbols))), None)
    if rule is None:
        return "are seen only in one combination", _cure_for_symbol(symbols[0], made)
    return rule.says, rule.cure.words(made)


def _cure_for_symbol(symbol: str, made: Collection[str]) -> str:
    if symbol in TOLD_BY:
        return TOLD_BY[symbol].words(made)
    if symbol in EXCITED_BY:
        return f"{EXCITED_BY[symbol]} beside tests that log a voltage, or a number in [ecu], tells {symbol}"
    written = toml_string(symbol) if "." in symbol else symbol  # as rig.toml has it
    return f"fix {written} in rig.toml if it is known, or log what depends on it"


def listed(words: Iterable[str]) -> str:
    """a, b and c."""
    *most, last = words
    return f"{', '.join(most)} and {last}" if most else last
