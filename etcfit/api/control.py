"""From a fit to its linear plant and to gains: what verbs and stages do alike."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from ..errors import UsageError

if TYPE_CHECKING:
    import numpy as np

    from ..car_log.log import Series
    from ..control.design import Design
    from ..control.frequency import FrequencyResponse
    from ..control.linearise import Reduction
    from ..control.request import DesignRequest
    from ..control.settings import DesignSettings, FrequencySettings
    from ..estimation.fitted_model import Fitted, FleetModel
    from ..estimation.result import FitResult
    from ..model.ecu import Ecu
    from ..model.ecus import EcuProfile
    from ..rig.base import RigConfig
    from .progress import Report


class Plant(NamedTuple):
    """The linear plant of a fit.

    Args:
        reduction: about a plate held at a share of its travel.
        response: what the sine traces say; None where the rig has none.
    """

    reduction: Reduction
    response: FrequencyResponse | None


def plant_of(
    result: FitResult,
    input_unit: str,
    output_unit: str,
    share: float,
    report: Report,
    settings: FrequencySettings | None = None,
) -> Plant:
    """Linearise a fitted model, and fit the rig's sine traces where it has some.

    Args:
        result: the fit.
        input_unit, output_unit, share: as `control.linearise.reduce` takes them.
        report: progress.
        settings: which sine traces count; the defaults where None.
    """
    from ..control.frequency import frequency_response
    from ..control.linearise import motor_constants, reduce, stops
    from ..control.settings import FrequencySettings
    from ..run_folder import sines_of

    report("linearising", 0.3)
    fitted, sines = result.fitted(), sines_of(result)
    reduction = reduce(fitted, input_unit, output_unit, share)
    reduction = replace(reduction, constants=motor_constants(fitted, *stops(fitted), share))
    if not sines:
        return Plant(reduction, None)
    report("fitting sines", 0.6)
    return Plant(reduction, frequency_response(fitted, sines, settings or FrequencySettings()))


def design_of(
    fitted: Fitted,
    asked: DesignRequest,
    drawn: np.ndarray | None,
    report: Report,
    settings: DesignSettings | None = None,
) -> Design:
    """Gains by every rule for an ECU that reads the position by an ADC over its travel.

    Args:
        fitted: the model.
        asked: what gains are asked for.
        drawn: coordinates of further models, shape (D, P), or None.
        report: progress.
        settings: draws, and the budgets of simulation and rules; the defaults where None.
    Raises:
        MeasurementError: the log cannot be read, or has no setpoint.
        UsageError: no such make, a field given that its source fixes otherwise, or parts of another design.
    """
    from ..control.design import design
    from ..control.fleet import design_for_parts
    from ..control.pid import Requirements
    from ..control.settings import DesignSettings

    computer, make = _computer(fitted, asked)
    log = None if asked.log is None else setpoint_of(Path(asked.log), fitted.config)
    given = (computer, Requirements(**asked.limits), asked.rule, drawn, asked.feed_forward, report,
             settings or DesignSettings(), make, log)  # fmt: skip
    if asked.parts is None:
        found = design(fitted, *given, present=asked.present)
    else:
        from ..run_folder.parts import parts_of

        found = design_for_parts(fitted, parts_of(Path(asked.parts)), *given, present=asked.present)
    return replace(found, anyway=True) if asked.anyway else found


def fleet_design_of(
    model: FleetModel, asked: DesignRequest, report: Report, settings: DesignSettings | None = None
) -> Design:
    """Gains by every rule that nearly all units of a fleet meet the requirements with.

    Args:
        model: the units.
        asked, report, settings: see `design_of`; no `parts`.
    Raises:
        MeasurementError, UsageError: as `design_of`.
    """
    from ..control.fleet import design_for_fleet, future_units
    from ..control.pid import Requirements
    from ..control.settings import DesignSettings

    computer, make = _computer(model.nominal, asked)
    log = None if asked.log is None else setpoint_of(Path(asked.log), model.config)
    return design_for_fleet(
        model,
        computer,
        Requirements(**asked.limits),
        asked.rule,
        future_units(model),
        asked.feed_forward,
        report,
        settings or DesignSettings(),
        profile=make,
        log=log,
        present=asked.present,
    )


def _computer(fitted: Fitted, asked: DesignRequest) -> tuple[Ecu, EcuProfile | None]:
    """The ECU by what is given of it and what its make fixes."""
    from ..control.design import ecu_of
    from ..control.linearise import stops
    from ..model.ecus import named

    make, ecu = None if asked.profile is None else named(asked.profile), asked.ecu
    if make is not None:
        if clash := make.clashes(ecu):
            raise UsageError(f"{clash[0]}: {make.title} fixes it at {make.fixes[clash[0]]:g}. Leave it out.")
        ecu = make.completed(ecu)
    lower, upper = stops(fitted)
    return ecu_of(fitted, **({"resolution": (upper - lower) / 2**asked.adc_bits} | dict(ecu))), make


def setpoint_of(path: Path, config: RigConfig) -> Series:
    """What the ECU asked of the plate in a log from the car, per cent of the travel.

    Raises:
        MeasurementError: the log cannot be read, or has no setpoint.
    """
    from ..car_log.read import read_log
    from ..errors import MeasurementError

    log = read_log(path, config, "rig.toml")
    if log.setpoint is None:
        raise MeasurementError(str(path), "no setpoint among its columns.", "Gains are tried on what a log asks for.",
                               log.hint)  # fmt: skip
    return log.setpoint
