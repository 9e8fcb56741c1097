"""What a tuning rule is given, and what it gives back."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from ...model.ecu import Ecu
from ...model.ecus import EcuProfile
from ...model.feed_forward import Term
from ...model.linear import TransferFunction
from ...model.pid import Gains
from ..loop_figures import Requirements
from ..setpoint import Setpoint, trapezoid
from ..settings import DesignSettings
from .loop import Loop


@dataclass(frozen=True)
class Refusal:
    """Why a rule has no gains for this plant."""

    why: str


@dataclass(frozen=True, eq=False)
class Task:
    """What a rule may use.

    Args:
        plant: linear, rad/V, with what delays it.
        ecu: the controller's own limits.
        requirements: what is asked for.
        loop: the fitted nonlinear plant under its ECU, nominal model first, then draws.
        setpoint: on which gains are judged.
        as_found: gains of the ECU that drove the logs, or why nobody knows them.
        settings: budgets of the rules that experiment.
        profile: the make of ECU that this controller is; None where none is named.
        terms: of feed-forward in the loop.
        present: gains that the ECU has now, in its own numbers, see `control.own_numbers`.
    """

    plant: TransferFunction
    ecu: Ecu
    requirements: Requirements
    loop: Loop
    setpoint: Setpoint = field(default_factory=trapezoid)
    as_found: Gains | Refusal = Refusal("no ECU is described")
    settings: DesignSettings = DesignSettings()
    profile: EcuProfile | None = None
    terms: tuple[Term, ...] = ()
    present: Mapping[str, float] = field(default_factory=dict)


Rule = Callable[[Task], Gains | Refusal]
