"""Input and result of a tuning rule."""

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
    """The input of a rule."""

    plant: TransferFunction  # linear, rad/V, with its delays
    ecu: Ecu  # clock and limits of the controller
    requirements: Requirements  # limits of the figures
    loop: Loop  # the fitted nonlinear plant under its ECU, nominal model first, then draws
    setpoint: Setpoint = field(default_factory=trapezoid)  # on which gains are judged
    # gains of the ECU that drove the logs, or why they are unknown
    as_found: Gains | Refusal = Refusal("no ECU is described")
    settings: DesignSettings = DesignSettings()  # budgets of the rules that simulate experiments
    profile: EcuProfile | None = None  # make of the ECU; None where none is named
    terms: tuple[Term, ...] = ()  # terms of feed-forward in the loop
    # gains that the ECU has now, in its own numbers, see `control.own_numbers`
    present: Mapping[str, float] = field(default_factory=dict)


Rule = Callable[[Task], Gains | Refusal]
