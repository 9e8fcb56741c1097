"""[ecu] of rig.toml: the controller of traces that log a setpoint but no voltage, with known or unknown gains."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise
from typing import Any

from ..model.ecu import ERRORS, FORMS, OUTPUTS, BiasPoints, Ecu, Notation, Terms
from .base import Fixed, Knowledge, Prior, Start
from .toml import Limits, Toml, shown

GAINS = {"P": "K_p", "I": "K_i", "D": "K_d"}
TIMES = {"filter_ms": "filter", "delay_ms": "delay"}  # times with a default, and their fields of `Ecu`
SUPPLY_SD = 0.1  # standard deviation of the supply under load, share of the nameplate's
CLOCK = Limits(0.01, 1000.0, " ms", "Correct it; an ECU's clock ticks every 1 to 10 ms.")
TIME = CLOCK._replace(low=0.0)
_MEND = "Correct it, or leave it out."
LIMITS: Mapping[str, tuple[str, float, Limits]] = {
    "duty": ("duty", 1.0, Limits(1e-3, 1.0, "", _MEND)),  # 0 would be no output
    "integral": ("integral", 1.0, Limits(0.0, 10.0, "", _MEND)),
    "slew_V_per_s": ("slew", 1.0, Limits(0.0, 1e6, "", _MEND)),
    "dead_band_deg": ("dead_band", math.pi / 180.0, Limits(0.0, 90.0, "", _MEND)),
    "setpoint_weight": ("setpoint_weight", 1.0, Limits(0.0, 1.0, "", _MEND)),
    "derivative_weight": ("derivative_weight", 1.0, Limits(0.0, 1.0, "", _MEND)),
}
"""Key -> its field of `Ecu`, its unit in SI, and its range."""
KEYS = ("P", "I", "D", "unit", "form", "period_ms", *TIMES, *LIMITS, "bias_percent")


def read_ecu(
    toml: Toml, travel: tuple[float, float]
) -> tuple[Ecu | None, Notation | None, dict[str, Knowledge], BiasPoints]:
    """The content of [ecu]: limits of the ECU, notation of its gains, its parameters of the model (SI), and its bias.

    None, None, {} and () where there is no [ecu]; no notation where it names no unit, because all its gains are free.

    Raises:
        MeasurementError: a key is unknown, missing or of the wrong kind, the supply is missing, or a gain is given
            twice.
    """
    table = toml.table("ecu", KEYS)
    if "ecu" not in toml.tables:
        return None, None, {}, ()
    for key in (*GAINS, "period_ms"):
        if key not in table:
            raise toml.wrong(f"ecu.{key}", "missing.", "[ecu] needs P, I, D and period_ms.",
                             f'Add {key} = ..., or {key} = "free".' if key in GAINS else
                             "Add the period of its clock, as period_ms = 1.0.")  # fmt: skip
    supply = toml.table("rig").get("supply_V")
    if supply is None:
        raise toml.wrong("ecu", "no [rig] supply_V.", "An ECU's output is clamped at the supply.",
                         "Add supply_V = 12.0 below [rig].")  # fmt: skip
    period = 1e-3 * toml.within("ecu.period_ms", table["period_ms"], CLOCK)
    given = {field: 1e-3 * toml.within(f"ecu.{key}", table[key], TIME) for key, field in TIMES.items() if key in table}
    given |= {field: unit * toml.within(f"ecu.{key}", table[key], allowed)
              for key, (field, unit, allowed) in LIMITS.items() if key in table}  # fmt: skip
    ecu = Ecu(period, toml.positive("rig.supply_V", supply), **given)
    notation = _notation(toml, table, travel)
    scales = notation.units(ecu, travel[1] - travel[0])._asdict()
    read = {symbol: _gain(toml, key, table[key], scales[key]) for key, symbol in GAINS.items()}
    gains = {symbol: gain for symbol, gain in read.items() if gain is not None}
    # The limit of the output is a nameplate value with an uncertainty, because the supply at the limit was not logged.
    # Where no gain determines the scale of the voltage, the limit must not determine it either.
    volts = ecu.constants["V_e"]
    scaled = any(isinstance(gain, (Fixed, Prior)) and gain.value > 0.0 for gain in gains.values())
    gains |= {symbol: Fixed(value) for symbol, value in ecu.constants.items()}
    gains["V_e"] = Prior(volts, SUPPLY_SD * volts) if scaled else Start(volts)
    for symbol in (*GAINS.values(), *ecu.constants):
        if symbol in toml.table("parameters"):
            raise toml.wrong(f"parameters.{symbol}", "is given by [ecu] already.", "A quantity is given in one place.",
                             "Delete it here.")  # fmt: skip
    return ecu, notation if "unit" in table else None, gains, _bias(toml, table.get("bias_percent", []), travel)


def _bias(toml: Toml, value: Any, travel: tuple[float, float]) -> BiasPoints:
    """The bias points, rad and shares, from rising pairs of % of the travel and % of duty."""
    rows = value if isinstance(value, list) else [None]
    pairs = [row for row in rows if isinstance(row, list) and len(row) == 2 and all(
             isinstance(x, (int, float)) and not isinstance(x, bool) and abs(x) <= 100.0 for x in row)]  # fmt: skip
    rising = all(a[0] < b[0] for a, b in pairwise(pairs))
    if len(pairs) < len(rows) or not rising:
        raise toml.refused("ecu.bias_percent", value,
                           "It must be a list of pairs, % of the travel, rising, and % of duty.",
                           "Write bias_percent = [[0, -20], [10, 0], [20, 18], [100, 25]].")  # fmt: skip
    if pairs and not math.isfinite(travel[1] - travel[0]):
        raise toml.refused("ecu.bias_percent", value, "A % of the travel needs end stops.", "Give [rig] travel_deg.")
    return tuple((travel[0] + 0.01 * at * (travel[1] - travel[0]), 0.01 * duty) for at, duty in pairs)


def ecu_lines(ecu: Ecu, notation: Notation, gains: Terms, bias_percent: BiasPoints = ()) -> list[str]:
    """The lines of [ecu] of a rig.toml; defaults are left out, except the times."""
    usual = Ecu()
    lines = ["[ecu]", *(f"{key} = {value:.10g}" for key, value in gains._asdict().items())]
    lines += [f'unit = "{notation.unit}"', f'form = "{notation.form}"', f"period_ms = {1e3 * ecu.period:.10g}"]
    lines += [f"{key} = {1e3 * getattr(ecu, field):.10g}" for key, field in TIMES.items()]
    lines += [f"{key} = {getattr(ecu, field) / unit:.10g}" for key, (field, unit, _) in LIMITS.items()
              if getattr(ecu, field) != getattr(usual, field)]  # fmt: skip
    pairs = ", ".join(f"[{at:.10g}, {duty:.10g}]" for at, duty in bias_percent)
    return [*lines, f"bias_percent = [{pairs}]"] if pairs else lines


def _notation(toml: Toml, table: Mapping[str, Any], travel: tuple[float, float]) -> Notation:
    """The notation of the gains; volts, radians and seconds by default."""
    unit, form = table.get("unit"), toml.string("ecu.form", table.get("form", "seconds"))
    if form not in FORMS:
        raise toml.refused("ecu.form", form,
                           'It must be "seconds" (I per s, D in s) or "ticks" (I per tick, D in ticks).',
                           "Correct it, or leave it out for seconds.")  # fmt: skip
    free = unit is None and all(table[key] == "free" for key in GAINS)
    # "%/deg" is % of duty for a degree
    output, slash, error = ("V/rad" if free else unit if isinstance(unit, str) else "").partition("/")
    output, error = output.strip(), error.strip()
    if not slash or output not in OUTPUTS or error not in ERRORS:
        listed = ", ".join(f"{o}/{e}" for o in OUTPUTS for e in ERRORS)
        raise toml.wrong("ecu.unit", "missing." if unit is None else f"found {shown(unit)}.",
                         f"Output for an error of one, of: {listed} (output % is duty, error % is travel).",
                         'Write unit = "%/%", say, or all gains as "free".')  # fmt: skip
    if "%" in error and not math.isfinite(travel[1] - travel[0]):
        raise toml.refused("ecu.unit", unit, "A % of the travel needs end stops.",
                           "Give [rig] travel_deg, or the unit in deg.")  # fmt: skip
    return Notation(output, error, form)


def _gain(toml: Toml, key: str, value: Any, scale: float) -> Knowledge | None:
    """SI; None where it is "free"."""
    where = f"ecu.{key}"
    if value == "free":
        return None
    if isinstance(value, dict):
        if set(value) == {"value", "scale"} and value["scale"] == "free":
            return Start(scale * toml.positive(where, value["value"]))
        if set(value) == {"value", "sd"}:
            return Prior(scale * toml.positive(where, value["value"]), scale * toml.positive(where, value["sd"]))
    elif isinstance(value, (int, float)) and not isinstance(value, bool) and toml.finite(where, value) >= 0.0:
        return Fixed(scale * value)
    raise toml.wrong(where, f"found {shown(value)}.",
                     'It must be a number of 0 or more, "free", {value = 4.0, scale = "free"} or '
                     "{value = 4.0, sd = 0.4}.", "Write it in one of these forms.")  # fmt: skip
