"""The verdict on gains in one sentence: page, terminal and notebook have it from here."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from ...estimation.fitted_model import SOUND, FitState
from ...estimation.identifiability import listed
from ..numbers import short
from .words import hardest, missed_margins

CURE = ("Find what the model lacks first (etcfit diagnose), then design again; --anyway gives the gains for an ECU all "
        "the same.")  # fmt: skip


def state_of(made: Mapping[str, Any]) -> FitState:
    """Of the fit behind a plant or gains; sound where their file is older than that."""
    state = made.get("fit")
    if not state:
        return SOUND
    return FitState(state["chi2_per_dof"], state["converged"], state["reason"], state["compromise"])


def cautions(made: Mapping[str, Any]) -> tuple[str, ...]:
    """What a reader must know of the fit behind a plant or gains."""
    return state_of(made).cautions


def doubt(state: FitState) -> str:
    """What stands in place of "met" where the fit is no estimate; "" where it is one."""
    if state.compromise is not None:
        return "of a compromise"
    return "" if state.converged else "not converged"


def withheld(pid: Mapping[str, Any]) -> bool:
    """Whether nothing of pid.json may be typed into an ECU, see `Design.withheld`."""
    return bool(cautions(pid)) and not pid.get("anyway")


def why_withheld(pid: Mapping[str, Any]) -> str:
    """Why nothing may be typed in, and what to do."""
    return f"No gains for an ECU. {' '.join(cautions(pid))} {CURE}"


def sentence(pid: Mapping[str, Any]) -> str:
    """The gains as their ECU writes them, what they meet on the nominal model and in the worst corner, how probably.

    Args:
        pid: the object of pid.json.
    """
    if withheld(pid):
        return why_withheld(pid)
    make, doubts = pid.get("profile"), cautions(pid)
    whose = f"The gains of {pid['rule'].replace('_', ' ')}" + (f" for {make['title']}" if make else "")
    chance = ["of such a model that says little of the plant"] if doubts else _chance(pid)
    said = "; ".join([f"{whose}, {gains_in_words(pid)}, {_nominal(pid)}", *_corner(pid), *chance])
    return " ".join([*doubts, f"{said}."])


def gains_in_words(pid: Mapping[str, Any]) -> str:
    """In the unit of the ECU that they are for: of the make, else of [ecu] in rig.toml, else in SI."""
    if make := pid.get("profile"):
        return ", ".join(f"{name} {_value(each)}" for name, each in make["gains"].items())
    if own := pid.get("as_written"):
        return f"{', '.join(f'{name} {short(own[name], 4)}' for name in 'PID')} ({own['unit']}, {own['form']})"
    units = {"Kp": "V/rad", "Ki": "V/(rad s)", "Kd": "V s/rad"}
    return ", ".join(f"{name} {short(pid['gains'][name], 4)} {unit}" for name, unit in units.items())


def _value(gain: Mapping[str, Any]) -> str:
    """ "168.7 %/% per s"."""
    return f"{short(gain['value'], 4)} {gain['unit'].replace(', ', ' ')}".strip()


def _nominal(pid: Mapping[str, Any]) -> str:
    """What they do on the nominal model."""
    if pid.get("stable") is False:
        return "make a loop that is UNSTABLE on the nominal model"
    figures = pid.get("nonlinear") or {}
    said = _missed(figures, pid) + missed_margins(figures, pid.get("margins_asked") or {})
    if said:
        return f"MISS on the nominal model: {listed(said)}"
    return "meet every requirement on the nominal model"


def _corner(pid: Mapping[str, Any]) -> Iterator[str]:
    """What they do in the worst corner of supply, winding and friction; nothing where that was not tried."""
    found = pid.get("conditions")
    if not found:
        return
    at, where = found["hardest"], "in the worst corner outside the bench"
    place = (f"{at['supply_V']:g} V, winding at {at['winding_degC']:g} °C, dry friction {at['friction_over_bench']:g} "
             "times the bench's")  # fmt: skip
    worst = hardest(found["worst"], pid.get("requirements") or {})
    if not found["stable"]:
        yield f"{where} the loop is UNSTABLE, at {place}"
    elif said := _missed(found["worst"], pid):
        yield f"{where} they MISS: {listed(said)}, hardest at {place}"
    elif worst is not None:
        yield f"{where} they meet every requirement too, most narrowly {worst.says}, at {place}"


def _missed(figures: Mapping[str, float | None], pid: Mapping[str, Any]) -> list[str]:
    """Each requirement that figures miss, in words."""
    limits = pid.get("requirements") or {}
    each = (hardest(figures, {symbol: limit}) for symbol, limit in limits.items())
    return [one.says for one in each if one is not None and not one.met]


def _chance(pid: Mapping[str, Any]) -> Iterator[str]:
    """How many models meet everything, under the conditions of a car where that was tried."""
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
