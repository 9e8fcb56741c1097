"""Requirements in words, those that a rule misses, and the verdict on gains in one sentence, for every view."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

from ...control.loop_figures import FIGURES, MARGINS, OF_THE_PAPER, REQUIRED, Requirements
from ...estimation.fitted_model import SOUND, FitState
from ...estimation.identifiability import listed
from ..numbers import short

if TYPE_CHECKING:  # the verdict of a page does not need this module
    from ...control.judged import Tuned


class Hardest(NamedTuple):
    """A requirement and its figure."""

    symbol: str  # symbol in `LoopFigures`
    figure: float  # infinite if, for example, a response does not settle
    limit: float  # upper limit of the figure

    @property
    def met(self) -> bool:
        """Whether the figure meets the requirement."""
        return self.figure < self.limit

    @property
    def strain(self) -> float:
        """The figure over its limit: above 1 the requirement is missed."""
        return self.figure / self.limit

    @property
    def says(self) -> str:
        """ "overshoot 54.2 % (limit 20 %)"."""
        of = FIGURES[self.symbol]
        if math.isfinite(self.figure):
            said = f"{of.name} {short(self.figure)} {of.unit}"
        else:
            said = "settling: never" if self.symbol == "settling_s" else f"no finite {of.name}"
        return f"{said} (limit {self.limit:g} {of.unit})"


def hardest(figures: Mapping[str, float | None], limits: Mapping[str, float | None]) -> Hardest | None:
    """The requirement that is missed by most, or met most narrowly; None without limits.

    Args:
        figures: figures by requirement; None or NaN if never reached. Requirements without a figure are not judged.
        limits: upper limits by requirement; None or infinite for none.
    """
    required = {symbol: limit for symbol, limit in limits.items() if limit is not None and math.isfinite(limit)}
    reached = {symbol: math.inf if figure is None or math.isnan(figure) else float(figure)
               for symbol, figure in figures.items()}  # fmt: skip
    every = [Hardest(symbol, reached[symbol], limit) for symbol, limit in required.items() if symbol in reached]
    return max(every, key=lambda each: each.strain, default=None)


def missed_margins(figures: Mapping[str, float | None], required: Mapping[str, float]) -> list[str]:
    """Each stability margin below its requirement, in words; a loop without a margin misses none."""
    less = ((FIGURES[symbol], figures.get(symbol), required[symbol]) for symbol in MARGINS if symbol in required)
    return [f"{of.name} {short(value)} {of.unit} (at least {least:g} {of.unit})"
            for of, value, least in less if value is not None and value < least]  # fmt: skip


GAINS = {"Kp": "V/rad", "Ki": "V/(rad s)", "Kd": "V s/rad"}
UNSTABLE = "UNSTABLE"


class Place(NamedTuple):
    """The scenario with the largest ratio of a figure to its limit."""

    scenario: str
    hardest: Hardest


def misses(tuned: Tuned, required: Requirements, but: Collection[str] = ()) -> list[str]:
    """Every requirement and margin that the gains of a rule miss, in words, the worst first; only "UNSTABLE" if so.

    Requirements in `but` do not count.
    """
    assert tuned.nonlinear is not None, "a rule with gains has been tried"
    if not tuned.stable:
        return [UNSTABLE]
    figures, limits = tuned.nonlinear.known(), required.limits((*REQUIRED, *MARGINS))
    each = [hardest(figures, {symbol: limits[symbol]}) for symbol in REQUIRED if symbol not in but]
    missed = sorted((one for one in each if one is not None and not one.met), key=lambda one: -one.strain)
    return [one.says for one in missed] + missed_margins(figures, limits)


def hardest_place(tuned: Tuned, required: Requirements) -> Place | None:
    """The hardest scenario for the gains of a rule; None if no scenario is judged."""
    limits = required.limits(OF_THE_PAPER)
    every = []
    for name, figures in tuned.scenarios.items():
        judged = {symbol: value for symbol, value in figures.known().items() if symbol in limits and value == value}
        worst = hardest(judged, {symbol: limits[symbol] for symbol in judged})
        every += [] if worst is None else [Place(name, worst)]
    return max(every, key=lambda place: place.hardest.strain, default=None)


CURE = ("Find what the model lacks first (etcfit diagnose), then design again; --anyway gives the gains for an ECU all "
        "the same.")  # fmt: skip


def state_of(made: Mapping[str, Any]) -> FitState:
    """State of the fit behind a plant or gains; sound for older files."""
    state = made.get("fit")
    if not state:
        return SOUND
    return FitState(state["chi2_per_dof"], state["converged"], state["reason"], state["compromise"])


def cautions(made: Mapping[str, Any]) -> tuple[str, ...]:
    """Cautions of the fit behind a plant or gains."""
    return state_of(made).cautions


def doubt(state: FitState) -> str:
    """The word in place of "met" if the fit is no estimate; "" if it is one."""
    if state.compromise is not None:
        return "of a compromise"
    return "" if state.converged else "not converged"


def withheld(pid: Mapping[str, Any]) -> bool:
    """Whether the gains of pid.json must not be typed into an ECU, see `Design.withheld`."""
    return bool(cautions(pid)) and not pid.get("anyway")


def why_withheld(pid: Mapping[str, Any]) -> str:
    """Why no gains are given, and what to do."""
    return f"No gains for an ECU. {' '.join(cautions(pid))} {CURE}"


def sentence(pid: Mapping[str, Any]) -> str:
    """The gains of pid.json in the ECU's own numbers, and what they meet on the nominal model and in the worst
    corner."""
    if withheld(pid):
        return why_withheld(pid)
    make, doubts = pid.get("profile"), cautions(pid)
    whose = f"The gains of {pid['rule'].replace('_', ' ')}" + (f" for {make['title']}" if make else "")
    chance = ["of such a model that says little of the plant"] if doubts else _chance(pid)
    said = "; ".join([f"{whose}, {gains_in_words(pid)}, {_nominal(pid)}", *_corner(pid), *chance])
    return " ".join([*doubts, f"{said}."])


def gains_in_words(pid: Mapping[str, Any]) -> str:
    """Gains in the unit of their ECU: that of the make, else of [ecu] in rig.toml, else SI."""
    if make := pid.get("profile"):
        return ", ".join(f"{name} {short(each['value'], 4)} {each['unit'].replace(', ', ' ')}".strip()
                         for name, each in make["gains"].items())  # fmt: skip
    if own := pid.get("as_written"):
        return f"{', '.join(f'{name} {short(own[name], 4)}' for name in 'PID')} ({own['unit']}, {own['form']})"
    return ", ".join(f"{name} {short(pid['gains'][name], 4)} {unit}" for name, unit in GAINS.items())


def _nominal(pid: Mapping[str, Any]) -> str:
    """Their result on the nominal model."""
    said = missed_on_nominal(pid)
    if said == [UNSTABLE]:
        return "make a loop that is UNSTABLE on the nominal model"
    if said:
        return f"MISS on the nominal model: {listed(said)}"
    return "meet every requirement on the nominal model"


def _corner(pid: Mapping[str, Any]) -> Iterator[str]:
    """Their result in the worst corner of supply, winding and friction; "" if that was not tried."""
    found = pid.get("conditions")
    if not found:
        return
    where, place = "in the worst corner outside the bench", place_of_corner(found)
    worst = hardest(found["worst"], pid.get("requirements") or {})
    said = missed_in_corner(pid)
    if said == [UNSTABLE]:
        yield f"{where} the loop is UNSTABLE, at {place}"
    elif said:
        yield f"{where} they MISS: {listed(said)}, hardest at {place}"
    elif worst is not None:
        yield f"{where} they meet every requirement too, most narrowly {worst.says}, at {place}"


def place_of_corner(found: Mapping[str, Any]) -> str:
    """The hardest corner of `conditions` of pid.json, in words."""
    at = found["hardest"]
    return (f"{at['supply_V']:g} V, winding at {at['winding_degC']:g} °C, dry friction {at['friction_over_bench']:g} "
            "times the bench's")  # fmt: skip


def missed_on_nominal(pid: Mapping[str, Any]) -> list[str]:
    """Requirements that the gains of pid.json miss on the nominal model, in words; only "UNSTABLE" if so."""
    if pid.get("stable") is False:
        return [UNSTABLE]
    figures = pid.get("nonlinear") or {}
    return _missed(figures, pid) + missed_margins(figures, pid.get("margins_asked") or {})


def missed_in_corner(pid: Mapping[str, Any]) -> list[str]:
    """The same in the worst corner of supply, winding and friction; () if that was not tried."""
    found = pid.get("conditions")
    if not found:
        return []
    return _missed(found["worst"], pid) if found["stable"] else [UNSTABLE]


def _missed(figures: Mapping[str, float | None], pid: Mapping[str, Any]) -> list[str]:
    """Each missed requirement, in words."""
    limits = pid.get("requirements") or {}
    each = (hardest(figures, {symbol: limit}) for symbol, limit in limits.items())
    return [one.says for one in each if one is not None and not one.met]


def _chance(pid: Mapping[str, Any]) -> Iterator[str]:
    """The number of models that meet everything, under the conditions of a car if that was tried."""
    if pid.get("fleet"):
        yield pid["fleet"]["says"]
        return
    outside, here = pid.get("conditions") or {}, pid.get("posterior") or {}
    if (chance := outside.get("probability_met")) is not None:
        yield f"under all such conditions they meet everything with probability {short(chance, 2)}"
    elif (chance := here.get("probability_met")) is not None:
        yield f"they meet everything with probability {short(chance, 2)} over draws of the parameters"
    if parts := pid.get("parts"):
        share = parts["rules"][pid["rule"]]["drawn"]["share_met"]
        yield f"they do on {100.0 * share:.0f} % of parts drawn from the fleet “{parts['name']}”"
