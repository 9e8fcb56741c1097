"""The linear plant, of transfer_function.json, and the sine traces, of frequency_response.json; for every view."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ..blocks import cautioned, rig_title, stacked
from ..numbers import Digits, short
from ..table import Column, Notes, Part, Table, there
from .sentence import state_of

if TYPE_CHECKING:  # a page does not need these modules
    from rich.console import RenderableType

    from ...control.frequency import FrequencyResponse
    from ...control.linearise import Reduction
    from ...estimation.fitted_model import Fitted

Plant = Mapping[str, Any]


def plant_tables(plant: Plant) -> list[Table]:
    """Coefficients, poles, gain and operating point; constants of a feed-forward if requested."""
    every = (coefficients_table(plant), constants_table(plant)) if plant else ()
    return [table for table in every if table is not None]


def coefficients_table(plant: Plant) -> Table:
    """b0, a2, a1, a0 with their standard errors, without the leading 1 of the denominator."""
    stderr, order = plant.get("stderr") or {}, len(plant["den"]) - 1
    rows = []
    for letter, key in (("b", "num"), ("a", "den")):
        values, errors = plant[key], stderr.get(key) or []
        errors = [None] * (len(values) - len(errors)) + list(errors)
        rows += [{"coefficient": f"{letter}{len(values) - 1 - k}", "value": value, "stderr": error}
                 for k, (value, error) in enumerate(zip(values, errors, strict=True))
                 if letter == "b" or k]  # fmt: skip
    return Table(f"Linear model of order {order}, {unit_of(plant)}",
                 (Column("coefficient", "coefficient", "word"), *known()), rows, plant_words(plant))  # fmt: skip


def known(value: str = "value", stderr: str = "stderr") -> tuple[Column, Column]:
    """Columns of a value and its standard error, with significant digits only."""
    return (Column("value", lambda row: Digits.of_value(row[value], row[stderr])(row[value])),
            Column("std. error", lambda row: Digits.of_value(row[value], row[stderr])(row[stderr])))  # fmt: skip


def unit_of(plant: Plant) -> str:
    """Unit of the gain: output over input."""
    return f"{plant['output']['unit']}/{plant['input']['unit']}"


def plant_words(plant: Plant) -> list[str]:
    """Formula, poles, gain, operating point, and the omissions of the formula."""
    gain = plant.get("open_loop_dc_gain")
    said = [
        "G(s) = b0 / (s^3 + a2 s^2 + a1 s + a0)",
        "poles, 1/s: " + ", ".join(pole(*each) for each in plant.get("poles") or ()),
        "no static gain: without a spring a constant voltage turns it on and on" if gain is None else
        f"static gain {short(gain, 4)} {unit_of(plant)}",
        operating_point(plant),
        "dry friction and preload have no transfer function and are left out",
        _behind(plant),
    ]  # fmt: skip
    if state_of(plant).compromise is not None:
        said.append("stderr: 1.96 of them reach as far as the ranges that subsets of the data give; no standard error")
    return [each for each in said if each]


def operating_point(plant: Plant) -> str:
    """The operating point, and the voltage and current that hold the plate there."""
    about = plant.get("operating_point")
    if not isinstance(about, Mapping) or "position_pct" not in about:
        return ""
    return (f"about {about['position_pct']:.0f} % of the travel ({short(about['position_rad'], 4)} rad), held by "
            f"{short(about['voltage_V'])} V and {short(about['current_A'])} A in the middle of the dry "
            "friction")  # fmt: skip


def _behind(plant: Plant) -> str:
    """Delay and sensor lag."""
    if "delay_s" not in plant:
        return ""
    if not plant["delay_s"] and not plant["sensor_lag_s"]:
        return "the model has neither delay nor sensor lag"
    extra = plant.get("with_delay_and_lag")
    word = (f"behind it a delay of {short(1e3 * plant['delay_s'])} ms and a sensor lag of "
            f"{short(1e3 * plant['sensor_lag_s'])} ms")  # fmt: skip
    return f"{word}, appended with a Pade approximation of order {extra['pade_order']}" if extra else (
        f"{word}, not appended")  # fmt: skip


def pole(real: float, imaginary: float) -> str:
    """ "-81" or "-16.3 + 5.2j"."""
    if not imaginary:
        return short(real, 4)
    return f"{short(real, 4)} {'+' if imaginary > 0.0 else '-'} {short(abs(imaginary), 4)}j"


def constants_table(plant: Plant) -> Table | None:
    """kS, kV and kA with their standard errors, by radian and by turn; None if not requested."""
    found = plant.get("feedforward")
    if not found:
        return None
    rows = [{"constant": name, "value": found[name], "stderr": found["stderr"][name], "unit": unit}
            for name, unit in found["unit"].items()]  # fmt: skip

    def by_turn(row: Mapping[str, Any]) -> str:
        turn = short(2.0 * math.pi * row["value"], 4)
        return "" if row["constant"] == "kS" else f"{turn} {row['unit'].replace('rad', 'turn')}"

    return Table("Feed-forward v = kS sgn(w) + kV w + kA dw/dt, w of the shaft whose angle was logged",
                 (Column("constant", "constant", "word"), *known(), Column("unit", "unit", "unit"),
                  Column("by turn", by_turn)), rows)  # fmt: skip


def sine_parts(response: Mapping[str, Any]) -> list[Part]:
    """One row per sine trace, the order of lag, and the omitted traces."""
    if not response:
        return []
    order = response.get("order") or {}
    said = [f"{name}{order[key]['says']}" for key, name in (("closed_loop", ""), ("plant", "Of the plant alone: "))
            if order.get(key)]  # fmt: skip
    return there(sines_table(response), Notes("Order of lag", said), Notes("Left out", response.get("warnings") or ()))


def sines_table(response: Mapping[str, Any]) -> Table | None:
    """The measured loop and plant, and the plant of both models."""
    points = response.get("points")
    if not points:
        return None
    of = (("loop", "measured", "closed_loop"), ("plant", "measured", "plant"),
          ("fitted", "modelled", "nonlinear_plant"), ("linear", "modelled", "linear_plant"))  # fmt: skip
    ratios = [Column(f"{name} {unit}", lambda row, where=where, key=key, k=k: _ratio(row[where][key])[k])
              for name, where, key in of for k, unit in enumerate(("dB", "deg"))]  # fmt: skip
    outside = Column("outside %", lambda row: short(100.0 * row["outside_fundamental"]["position"], 2))
    share = (response.get("linear") or {}).get("position_pct")
    words = [
        "loop: position over setpoint; plant: position over voltage, re 1 rad/V; +-: 95 %",
        "outside: share of the position's power that is not in the sine: dry friction, limp-home spring, noise",
        "fitted, linear: plant of the model run free on the logged drive, and of the third order"
        + ("" if share is None else f" about {share:.0f} % travel") + "; the linear one knows no dry friction",
    ]  # fmt: skip
    columns = (Column("trace", "file", "path"), Column("Hz", "frequency_Hz"), Column("cycles", "cycles"),
               *ratios[:2], outside, *ratios[2:])  # fmt: skip
    return Table("Response to sines", columns, points, words)


def _ratio(value: Mapping[str, Any] | None) -> tuple[str, str]:
    """Magnitude in dB and phase in degrees, with their margins if they were measured."""
    if value is None:
        return "-", "-"
    decibels, degrees = 20.0 * math.log10(value["magnitude"]), math.degrees(value["phase_rad"])
    if "magnitude_ci95" not in value:
        return f"{decibels:.2f}", f"{degrees:.1f}"
    more = 20.0 * math.log10(value["magnitude_ci95"][1]) - decibels
    late = math.degrees(value["phase_ci95_rad"][1]) - degrees
    return f"{decibels:.2f} +- {short(more, 2)}", f"{degrees:.1f} +- {short(late, 2)}"


def reduction_table(fitted: Fitted, reduction: Reduction, pade_order: int) -> RenderableType:
    """Coefficients with standard errors, poles, gain and operating point."""
    from ...run_folder.plant import reduction_json

    parts = plant_tables(reduction_json(fitted, reduction, pade_order))
    return cautioned(stacked(rig_title(fitted.config, "transfer function"), *parts), fitted.state)


def sine_table(fitted: Fitted, response: FrequencyResponse) -> RenderableType:
    """One row per sine trace: the measured loop, then the measured plant and those of the models."""
    from ...run_folder.plant import frequency_json

    return stacked(*sine_parts(frequency_json(fitted, response)))
