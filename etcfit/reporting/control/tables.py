"""Transfer function and gains for stdout."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import PurePosixPath

import numpy as np
from rich.console import Group, RenderableType
from rich.text import Text

from ...control.design import Design
from ...control.frequency import FrequencyResponse, Ratio, phases
from ...control.frequency.response import POSITION
from ...control.judged import Tuned
from ...control.linearise import SYMBOLS, UNITS, Reduction
from ...control.loop_figures import FIGURES
from ...estimation.fitted_model import Fitted
from ...model.ecu import Ecu, Notation
from ...model.ecus import ECUS
from ...model.feed_forward import Term, listed
from ...run_folder.design import written_for
from ..blocks import cautioned, filled, headed, plain_table, rig_title, sentences, stacked, table
from ..numbers import Digits, short
from .for_an_ecu import snippet, supply_table
from .safety import safety_table
from .sentence import CURE, doubt
from .verdicts import (
    against_effort,
    fleet_table,
    of_models,
    outside_the_bench,
    parts_table,
    scenario_table,
    what_is_asked,
)

_UNNAMED = ("For no ECU in particular: --ecu NAME designs in its own controller and writes what to paste. NAME is "
            "one of")  # fmt: skip


def reduction_table(fitted: Fitted, reduction: Reduction, pade_order: int) -> RenderableType:
    """Coefficients with standard errors, poles, gain and operating point."""
    plant = reduction.plant
    made = plain_table("coefficient", "value", "stderr")
    for name, value, stderr in zip(
        ("b0", "a2", "a1", "a0"), (*plant.num, *plant.den[1:]), reduction.stderr, strict=True
    ):
        digits = Digits.of(value, float(stderr))
        made.add_row(name, digits(value), digits(float(stderr)))
    unit = f"{reduction.output_unit}/{reduction.input_unit}"
    lines = [
        f"G(s) = b0 / (s^3 + a2 s^2 + a1 s + a0), {unit}",
        "poles, 1/s: " + ", ".join(_pole(p) for p in plant.poles),
        f"static gain {short(plant.dc_gain, 4)} {unit}"
        if np.isfinite(plant.dc_gain)
        else "no static gain: without a spring a constant voltage turns it on and on",
        f"about {100.0 * reduction.share:.0f} % of the travel ({short(reduction.theta, 4)} rad), held by "
        f"{short(reduction.volts)} V and {short(reduction.current)} A in the middle of the dry friction",
        "dry friction and preload have no transfer function and are left out",
        _extra(reduction, pade_order),
    ]
    if fitted.state.compromise is not None:
        lines.append("stderr: 1.96 of them reach as far as the ranges that subsets of the data give; no standard error")
    said = (Text("  " + line) for line in lines)
    whole = stacked(rig_title(fitted.config, "transfer function"), *said, made, constants_table(reduction))
    return cautioned(whole, fitted.state)


def constants_table(reduction: Reduction) -> RenderableType | None:
    """kS, kV and kA with their standard errors, by radian and by turn; None where nobody asked for them."""
    found, rows = reduction.constants, []
    if found is None:
        return None
    for name, value, stderr, unit in zip(SYMBOLS, found.values, found.stderr, UNITS, strict=True):
        digits = Digits.of(float(value), float(stderr))
        turn = "" if name == "kS" else f"{short(2.0 * np.pi * float(value), 4)} {unit.replace('rad', 'turn')}"
        rows.append((name, digits(float(value)), digits(float(stderr)), unit, turn))
    title = "Feed-forward v = kS sgn(w) + kV w + kA dw/dt, w of the shaft whose angle was logged"
    return table(title, ("constant", "value", "stderr", "unit", "by turn"), rows)


def _pole(pole: complex) -> str:
    return short(pole.real, 4) + (f" {'+' if pole.imag > 0 else '-'} {short(abs(pole.imag), 4)}j" if pole.imag else "")


def _extra(reduction: Reduction, pade_order: int) -> str:
    plant = reduction.plant
    if not plant.delay and not plant.lag:
        return "the model has neither delay nor sensor lag"
    word = f"behind it a delay of {short(1e3 * plant.delay)} ms and a sensor lag of {short(1e3 * plant.lag)} ms"
    return word + (f", appended with a Pade approximation of order {pade_order}" if pade_order else ", not appended")


def sine_table(response: FrequencyResponse) -> RenderableType:
    """A row a sine trace: the loop as measured, then the plant and how far off the models are."""
    loop = plain_table("trace", "Hz", "cycles", "loop dB", "phase deg", "outside %")
    plant = plain_table("trace", "plant dB", "phase deg", "fitted dB", "deg", "linear dB", "deg")
    points = response.points
    loops = phases([point.closed_loop.value for point in points])
    plants = phases([plant and plant.value for plant in response.plants])
    for k, (point, one) in enumerate(zip(points, response.plants, strict=True)):
        name, outside = PurePosixPath(point.measurement.file).stem, short(100.0 * point.waves.outside[POSITION], 2)
        loop.add_row(name, short(point.frequency), str(point.window.cycles),
                     *_with_margins(point.closed_loop, float(loops[k])), outside)  # fmt: skip
        plant.add_row(name, *(("-", "-") if one is None else _with_margins(one, float(plants[k]))),
                      *_off(one, response.nonlinear[k]), *_off(one, response.linear_plant[k]))  # fmt: skip
    orders = [response.order.says]
    if response.plant_order is not None:
        orders.append(f"Of the plant alone: {response.plant_order.says}")
    words = [
        "loop: position over setpoint; plant: position over voltage, re 1 rad/V; +-: 95 %",
        "outside: share of the position's power that is not in the sine: dry friction, limp-home spring, noise",
        "fitted, linear: plant of the model run free on the logged drive, and of the third order about "
        f"{100.0 * response.share:.0f} % travel, less the measured one; the linear one knows no dry friction",
    ]
    parts = [
        headed("Response to sines: the loop", loop) if points else None,
        headed("Response to sines: the plant", plant) if points else None,
        sentences("How to read it", words if points else ()),
        sentences("Order of lag", orders),
        sentences("Left out", response.warnings),
    ]
    return stacked(*parts)


def _with_margins(ratio: Ratio, phase: float) -> tuple[str, str]:
    decibels, degrees = 20.0 * np.log10(ratio.magnitude), np.degrees(phase)
    high, margin = 20.0 * np.log10(ratio.magnitude_ci95[1]) - decibels, np.degrees(ratio.phase_margin)
    return f"{decibels:.2f} +- {short(high, 2)}", f"{degrees:.1f} +- {short(margin, 2)}"


def _off(measured: Ratio | None, modelled: complex | None) -> tuple[str, str]:
    if measured is None or modelled is None:
        return "-", "-"
    over = modelled / measured.value
    return f"{20.0 * np.log10(abs(over)):+.2f}", f"{np.degrees(np.angle(over)):+.1f}"


def design_table(design: Design) -> RenderableType:
    """Every rule beside the others, then the proposed gains in the units of an ECU.

    Of a model that is no estimate the caution stands first, and what an ECU would take is left out unless it is asked
    for all the same (`Design.withheld`).
    """
    task = design.task
    asked = task.requirements
    source = "posterior" if design.origin == "posterior" else "the fit's Laplace approximation"
    if design.fitted.state.compromise is not None:
        source += ", as wide as the ranges that subsets of the data give"
    words = [
        f"figures are of the nonlinear model, the worst of {len(design.setpoint.scenarios)} scenarios; RMSE is the "
        "tracking error on the trapezoid of 5 to 45 % at 1 Hz, or on the log where that is larger; a settling time of "
        "-: not settled before the setpoint changes again; duty %: its standard deviation while the setpoint rests",
        f"required: {what_is_asked(asked)}; margins {asked.gain_margin_db:g} dB, {asked.phase_margin_deg:g} degrees",
        _judges(design, source),
        *_computer(design),
    ]
    refused = [f"{t.rule}: {t.why}" for t in design.tuned.values() if t.gains is None]
    shown = {symbol: of for symbol, of in FIGURES.items() if of.heading}
    parts = [
        rig_title(design.fitted.config, "PID gains"),
        filled(
            (
                "rule",
                "Kp\nV/rad",
                "Ki\nV/(rad s)",
                "Kd\nV s/rad",
                "met",
                "margins",
                "units" if of_models(design) == "units" else "P(met)",
            ),
            [_gains_row(design, tuned) for tuned in design.tuned.values()],
        ),
        table(
            "What they do",
            ("rule", *(f"{of.heading}\n{of.unit}" for of in shown.values())),
            [
                (tuned.rule, *(short(getattr(tuned.nonlinear, symbol)) for symbol in shown))
                for tuned in design.tuned.values()
                if tuned.nonlinear is not None
            ],
        ),
        sentences("How to read it", words),
        sentences("No gains", refused),
        *(
            [sentences("Nothing to paste", [CURE])]
            if design.withheld
            else [_in_its_own_unit(design), _proposed(design)]
        ),
        fleet_table(design),
        scenario_table(design),
        sentences("Outside the bench", outside_the_bench(design)),
        parts_table(design),
        None if design.withheld else supply_table(task, design.proposed, design.supply_table),
        sentences("Tracking against effort", against_effort(design)),
        safety_table(design),
        sentences(
            "Not met. What binds: eased alone, each of these would let the optimum meet everything", design.limits
        ),
    ]
    return cautioned(stacked(*parts), design.fitted.state)


def _gains_row(design: Design, tuned: Tuned) -> tuple[str, ...]:
    if tuned.gains is None or tuned.nonlinear is None:
        return (tuned.rule, *["-"] * 6)
    gains = (short(g) for g in tuned.gains)
    if word := doubt(design.fitted.state):  # what a model that is no estimate meets is no success
        return (tuned.rule, *gains, word if tuned.stable else "unstable", "-", "-")
    figures, asked = tuned.nonlinear, design.task.requirements
    safe = figures.gain_margin_db >= asked.gain_margin_db and figures.phase_margin_deg >= asked.phase_margin_deg
    met = ("yes" if tuned.meets_all else "no") if tuned.stable else "unstable"
    return (tuned.rule, *gains, met, "yes" if safe else "no", f"{tuned.probability_met:.2f}")


def _judges(design: Design, source: str) -> str:
    """The models beside the nominal one."""
    if doubt(design.fitted.state):
        return f"met, margins and P(met) are not said of a model that is not the plant; the draws are from {source}"
    what = f"share of {design.draws} models whose response meets everything and whose linear loop is stable; "
    if design.origin == "fleet":
        return f"units: {what}the mean unit, on which all other figures are, then extreme and random ones of the fleet"
    return f"P(met): {what}drawn from {source}"


def _computer(design: Design) -> list[str]:
    """The ECU that all gains are tried in, and which of them it has now."""
    ecu = design.task.ecu
    clock, late, slow = (f"{short(1e3 * each)} ms" for each in (ecu.period, ecu.delay, ecu.filter))
    limits = f"ECU: ticks of {clock}, delay {late}, derivative filter {slow}, output within {short(ecu.limit)} V"
    limits += "".join(f", {habit}" for habit in _habits(ecu))
    if design.fitted.config.ecu is None:
        return [limits]
    return [f"{limits}; what the command does not give is [ecu]'s of rig.toml",
            "as_found: the gains that the ECU of the logs has, as rig.toml or the fit tells them"]  # fmt: skip


def _habits(ecu: Ecu) -> Iterator[str]:
    """What not every ECU has."""
    if ecu.lag:
        yield f"its input filtered by {short(1e3 * ecu.lag)} ms"
    if ecu.noise:
        yield f"noise of a reading {short(np.degrees(ecu.noise), 2)} degrees"
    if ecu.integral:
        yield f"integral within {short(ecu.integral * ecu.supply)} V"
    if ecu.dead_band:
        yield f"integral still within {short(np.degrees(ecu.dead_band))} degrees"
    if ecu.compensated:
        yield "divided by the battery voltage"
    if ecu.slew:
        yield f"output no faster than {short(ecu.slew)} V/s"
    if ecu.setpoint_weight != 1.0:
        yield f"proportional part of {short(ecu.setpoint_weight)} setpoint - position"
    if ecu.derivative_weight != 1.0:
        yield "derivative of the position alone" if ecu.derivative_weight == 0.0 else (
            f"derivative of {short(ecu.derivative_weight)} setpoint - position")  # fmt: skip


def _in_its_own_unit(design: Design) -> RenderableType | None:
    """Every rule's gains as [ecu] of rig.toml writes them: numbers to type in."""
    notation = design.fitted.config.notation
    if notation is None:
        return None
    rows = [(tuned.rule, *(short(g, 4) for g in design.written(tuned.gains, notation)))
            for tuned in design.tuned.values() if tuned.gains is not None]  # fmt: skip
    clock = {"seconds": "I per s, D in s", "ticks": f"I and D by the tick of {short(1e3 * design.task.ecu.period)} ms"}
    title = f"The same gains as [ecu] of rig.toml writes them: {notation.unit}, {clock[notation.form]}"
    return table(title, ("rule", "P", "I", "D"), rows)


def _proposed(design: Design) -> RenderableType:
    gains, ecu = design.chosen.gains, design.task.ecu
    assert gains is not None, "the proposed rule has gains"
    native = design.written(gains, Notation(form="ticks"))
    rows = [("continuous time", gains, "V/rad, s"), (f"ticks of {short(1e3 * ecu.period)} ms", native, "V/rad, ticks")]
    if (make := design.task.profile) is not None and make.notation is not None:
        rows.append((make.title, design.written(gains, make.notation), make.notation.title))
    if (own := design.fitted.config.notation) is not None:
        rows.append(("as in rig.toml", design.written(gains, own), own.title))
    made = filled(("proposed", "P", "I", "D", "unit"),
                  [(name, *(short(g, 5) for g in each), unit) for name, each, unit in rows])  # fmt: skip
    written = written_for(design)
    ecus = Group(Text(), Text(f"{_UNNAMED} {', '.join(ECUS)}.")) if written is None else snippet(written)
    # with which terms of feed-forward, and whether there is any
    others = listed(term for term in design.terms if term is not Term.SPRING)
    ahead = _spring(design) + (f"; with {' and '.join(others)} put ahead by code of yours" if others else "")
    return headed(f"Gains of {design.chosen.rule}, found {ahead}",
                  Group(made, Text(), _curve(design), Text(_moving(design)), ecus))  # fmt: skip


def _moving(design: Design) -> str:
    """What a moving plate takes beside the curve, and who can put it ahead."""
    sliding, profile = design.sliding, design.task.profile
    said = (f"a moving plate takes more: dry friction {short(sliding.opening)} V opening, {short(sliding.closing)} V "
            f"closing; back-EMF and drag {short(sliding.slope)} V s/rad of the setpoint's rate")  # fmt: skip
    if design.task.loop.sliding is not None:
        return said
    if profile is not None and not profile.code:
        return f"{said}; {profile.title} cannot put these ahead"
    return f"{said}; --feed-forward-terms friction,rate puts them ahead where you write the code"


def _spring(design: Design) -> str:
    """Whether with the curve of the springs, and whether there is any."""
    profile = design.task.profile
    if design.task.loop.bias is not None:
        return "with the bias curve"
    if profile is not None and profile.bias is None:
        return f"without a bias curve: {profile.title} has none"
    return "WITHOUT the bias curve: leave it at 0, or design with --feed-forward"


def _curve(design: Design) -> RenderableType:
    """Duty that holds the plate, and at which it begins to move."""
    bias, supply = design.bias, design.task.ecu.supply
    places = design.task.loop.share(bias.angles)
    rows = [(short(100.0 * float(place), 4), *(short(100.0 * float(v) / supply, 4) for v in volts))
            for place, *volts in zip(places, bias.hold, bias.opening, bias.closing, strict=True)]  # fmt: skip
    return filled(("bias curve at, % of travel", "holding duty %", "opening %", "closing %"), rows, left=0)
