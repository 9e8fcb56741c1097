"""Reads rig.toml as a RigConfig: every key is checked, every value converted to SI."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from pathlib import Path, PurePosixPath
from typing import Any

from ..errors import unseen
from .accuracy import read_accuracy
from .base import CHANNELS, Fixed, Knowledge, Prior, RigConfig, Start, Tied, TpsCalibration
from .columns import DROP, HeaderError, parse_header
from .ecu import read_ecu
from .toml import Limits, Toml, closest, parse, read_text, shown
from .toml_slips import EXAMPLES as EXAMPLE_VALUES
from .units import EXAMPLES, UnitError, to_channel
from .user_text import VISIBLE

TABLES = ("rig", "tps", "columns", "noise", "tests", "parameters", "model", "holdout", "ecu", "accuracy")
RIG_KEYS = ("name", "synthetic", "gear_ratio", "supply_V", "travel_deg")
TPS_KEYS = ("closed_V", "open_V", "travel_deg")
LEAST_TPS_VOLTS = 0.01
POSSIBLE_NOISE = 1e-12, 1e4  # SI, any channel
_SYMBOL = re.compile(r"[A-Za-z][A-Za-z0-9_]*(\.\S(.*\S)?)?")  # behind a point the place of an effect of the rig
UNIT_SLUGS = {"rad_s": "rad/s", "deg_s": "deg/s", "N_m": "N*m", "mN_m": "mN*m", "N_cm": "N*cm", "": "1"}
LEAST_TRAVEL = 0.1  # degrees between the stops


# nameplates: wide limits, which only a wrong digit or unit exceeds, not an unusual rig
GEAR_RATIO = Limits(0.01, 1e4, "", "Count the teeth: motor turns for one turn of the plate, as 20.68.")
SUPPLY = Limits(1.0, 100.0, " V", "Give it in volts, as 12.0.")
STOP = Limits(-3600.0, 3600.0, " degrees", "Give it in degrees, as 90.0; inf and -inf mean no stop.")
SENSOR = Limits(-100.0, 100.0, " V", "Give it in volts, as 4.73.")
SENSOR_TRAVEL = Limits(0.1, 3600.0, " degrees", "Give the angle from closed_V to open_V in degrees, as 90.0.")
SERIES = Limits(0.0, 1e4, " ohm", "Give it in ohms, as 0.5.")


def read_config(path: str | Path) -> RigConfig:
    """Read and check a rig.toml.

    Raises:
        MeasurementError: the file is missing, is no TOML, or holds an unknown key or a value of the wrong kind.
    """
    return parse_config(read_text(path), str(path))


def parse_config(text: str, path: str) -> RigConfig:
    """As `read_config`, from the text itself."""
    return config_of(Toml(path, text, parse(text, path)), Path(path).absolute().parent.name)


def config_of(toml: Toml, name: str) -> RigConfig:
    """As `read_config`, from the tables.

    Raises:
        MeasurementError: as `read_config`.
    """
    toml.only(toml.tables, TABLES)
    rig = toml.table("rig", RIG_KEYS)
    travel, tps = _travel(toml, rig), _tps(toml)
    gear_ratio = _gear_ratio(toml, rig)
    written = {symbol: value for symbol, value in toml.table("parameters").items() if symbol != "N"}
    parameters = {symbol: _knowledge(toml, symbol, value) for symbol, value in written.items()}
    _refuse_circles(toml, parameters)
    ecu, notation, gains, bias = read_ecu(toml, travel)
    name, synthetic = toml.string("rig.name", rig.get("name", name)), rig.get("synthetic", False)
    if found := unseen(name):
        raise toml.wrong("rig.name", f"{found} in it.", VISIBLE, "Type it anew; a line break becomes a space.")
    if not isinstance(synthetic, bool):
        raise toml.refused("rig.synthetic", synthetic, "It must be true or false.", "Correct it.")
    return RigConfig(
        name=name,
        synthetic=synthetic,
        gear_ratio=1.0 if gear_ratio is None else gear_ratio,
        gear_ratio_given=gear_ratio is not None,
        supply_V=toml.within("rig.supply_V", rig["supply_V"], SUPPLY) if "supply_V" in rig else None,
        travel=travel,
        tps=tps,
        columns=_columns(toml),
        noise=_noise(toml, travel, tps),
        series_ohm=_series_ohm(toml),
        parameters=parameters | gains,
        effects=toml.strings("model", "effects"),
        holdout=tuple(PurePosixPath(f.replace("\\", "/")).as_posix() for f in toml.strings("holdout", "files")),
        ecu=ecu,
        notation=notation,
        bias=bias,
        accuracy=read_accuracy(toml, travel, tps),
    )


def _gear_ratio(toml: Toml, rig: Mapping[str, Any]) -> float | None:
    """N, given as [rig] gear_ratio or as a parameter; None where it is not."""
    given = {}
    if "gear_ratio" in rig:
        given["rig.gear_ratio"] = toml.within("rig.gear_ratio", rig["gear_ratio"], GEAR_RATIO)
    if "N" in (parameters := toml.table("parameters")):
        value = parameters["N"]
        inner = value["fixed"] if isinstance(value, dict) and set(value) == {"fixed"} else value
        if isinstance(inner, (dict, str)):
            raise toml.refused("parameters.N", value, "The gear ratio is counted in teeth, never fitted.",
                               "Write [rig] gear_ratio = 20.68.")  # fmt: skip
        given["parameters.N"] = toml.within("parameters.N", inner, GEAR_RATIO)
    if len(set(given.values())) > 1:
        raise toml.wrong("parameters.N", f"found {given['parameters.N']:g}, but [rig] gear_ratio is "
                         f"{given['rig.gear_ratio']:g}.", "They are the same quantity.", "Delete one.")  # fmt: skip
    return next(iter(given.values()), None)


def _travel(toml: Toml, rig: Mapping[str, Any]) -> tuple[float, float]:
    value = rig.get("travel_deg", [0.0, 90.0])
    if not isinstance(value, list) or len(value) != 2:
        raise toml.refused("rig.travel_deg", value, "It must be two numbers, closed stop and open stop.",
                           "Write travel_deg = [0.0, 90.0]; inf and -inf mean no stop.")  # fmt: skip
    closed, opened = (toml.number("rig.travel_deg", v) for v in value)
    if not closed < opened or math.inf in (closed, -opened):
        raise toml.refused("rig.travel_deg", value, "The closed stop must lie below the open stop.",
                           "Swap them, or correct them.")  # fmt: skip
    for stop in (closed, opened):
        if math.isfinite(stop):
            toml.within("rig.travel_deg", stop, STOP)
    if opened - closed < LEAST_TRAVEL:
        raise toml.refused("rig.travel_deg", value, f"The stops must lie {LEAST_TRAVEL:g} degrees apart, or more.",
                           STOP.mend)  # fmt: skip
    return math.radians(closed), math.radians(opened)


def _tps(toml: Toml) -> TpsCalibration | None:
    table = toml.table("tps", TPS_KEYS)
    if "tps" not in toml.tables:
        return None
    for key in TPS_KEYS:
        if key not in table:
            raise toml.wrong(
                f"tps.{key}",
                "missing.",
                f"[tps] needs {', '.join(TPS_KEYS)}.",
                f"Add {key} = {EXAMPLE_VALUES[key]}, or put a # before every line of [tps].",
            )
    # closed_V > open_V: the sensor falls while the plate opens, as the second track of many throttles does
    closed, opened = (toml.within(f"tps.{key}", table[key], SENSOR) for key in TPS_KEYS[:2])
    if abs(opened - closed) < LEAST_TPS_VOLTS:
        raise toml.wrong("tps.open_V", f"found {shown(opened)}, the same as closed_V.", "The two ends must differ.",
                         "Measure the sensor at both stops.")  # fmt: skip
    travel = toml.within("tps.travel_deg", table["travel_deg"], SENSOR_TRAVEL)
    return TpsCalibration(closed, opened, math.radians(travel))


def _columns(toml: Toml) -> dict[str, str]:
    columns: dict[str, str] = {}
    for foreign, ours in toml.table("columns").items():
        key = f"columns.{foreign}"
        name = " ".join(toml.string(key, ours).split())
        if name.casefold() not in DROP:
            try:
                parse_header(name)
            except HeaderError as err:
                raise toml.wrong(key, err.found, err.required, err.mend) from err
        columns[" ".join(foreign.split())] = name
    return columns


def _noise(toml: Toml, travel: tuple[float, float], tps: TpsCalibration | None) -> dict[str, float]:
    """Standard deviations by channel, SI; keys are `<channel>_<unit>`."""
    noise: dict[str, float] = {}
    known = (*CHANNELS, "tps")
    for key, value in toml.table("noise").items():
        quantity = next((q for q in known if key == q or key.startswith(f"{q}_")), None)
        if quantity is None:
            mend = closest(key.rpartition("_")[0] or key, known, "Write, say, current_A = 0.01.")
            required = f"Known: {', '.join(known)}, then _ and the unit."
            raise toml.wrong(f"noise.{key}", "unknown channel.", required, mend)
        slug = key.removeprefix(quantity).removeprefix("_")
        if not slug and quantity != "duty":
            raise toml.wrong(f"noise.{key}", "unit missing.", f"Accepted: {quantity} in {EXAMPLES[quantity]}.",
                             f"Write the unit behind the name, as in {quantity}_{CHANNELS.get(quantity, 'V')}."
                             .replace("/", "_").replace("N*m", "Nm"))  # fmt: skip
        try:
            channel, conversion = to_channel(quantity, UNIT_SLUGS.get(slug, slug), travel, tps)
        except UnitError as err:
            raise toml.wrong(f"noise.{key}", str(err), f"Accepted: {quantity} in {EXAMPLES[quantity]}.",
                             "Correct the unit after the last _, or delete the line.") from err  # fmt: skip
        if channel in noise:
            raise toml.wrong(f"noise.{key}", f"a second value for {channel}.", "One channel has one noise.",
                             "Delete one.")  # fmt: skip
        noise[channel] = toml.positive(f"noise.{key}", value) * abs(conversion.scale)
        if not POSSIBLE_NOISE[0] <= noise[channel] <= POSSIBLE_NOISE[1]:
            raise toml.refused(f"noise.{key}", value, "No channel has such a noise.",
                               "Correct it, or delete the line and have it estimated.")  # fmt: skip
    return noise


def _series_ohm(toml: Toml) -> dict[str, float | None]:
    """Extra circuit resistance by test, ohm; None where the fit finds it."""
    series: dict[str, float | None] = {}
    for test, table in toml.table("tests").items():
        if not isinstance(table, dict):
            raise toml.refused(f"tests.{test}", table, "It must be a table.", f"Write [tests.{test}].")
        toml.only(table, ("series_ohm",), f"tests.{test}.")
        if table.get("series_ohm") == "free":
            series[test] = None
        elif "series_ohm" in table:
            key, value = f"tests.{test}.series_ohm", table["series_ohm"]
            if isinstance(value, str) or (number := toml.finite(key, value)) < 0:
                raise toml.refused(key, value, 'It must be "free" or a number of ohms, 0 or more.', "Correct it.")
            series[test] = toml.within(key, number, SERIES)
    return series


def _knowledge(toml: Toml, symbol: str, value: Any) -> Knowledge:
    key = f"parameters.{symbol}"
    if not _SYMBOL.fullmatch(symbol):
        raise toml.wrong(key, "no symbol.", "Symbols are letters, digits and _, as R_a; behind a point the place of an "
                         'effect of the rig, as "late.response.current".', "Correct or delete it.")  # fmt: skip
    if isinstance(value, str) and _SYMBOL.fullmatch(value):
        return Tied(value)
    forms: dict[frozenset[str], Callable[..., Knowledge]] = {
        frozenset({"fixed"}): lambda fixed: Fixed(toml.finite(key, fixed)),
        frozenset({"value", "sd"}): lambda value, sd: Prior(toml.finite(key, value), toml.positive(key, sd)),
    }
    if isinstance(value, dict):
        if form := forms.get(frozenset(value)):
            return form(**value)
        if len(value) == 1 and not closest(next(iter(value)), ("fixed", "value", "sd"), ""):
            raise toml.refused(key, value, "A symbol with points in it must stand in quotes.",
                               f'Write "{_whole(symbol, value)}" = and then its value.')  # fmt: skip
    elif isinstance(value, (int, float)) and not isinstance(value, bool):
        return Start(toml.finite(key, value))
    raise toml.refused(key, value, 'It must be a number, "OTHER", {fixed = 0.0} or {value = 1.0, sd = 0.1}.',
                       "Write it in one of these forms.")  # fmt: skip


def _whole(symbol: str, value: Any) -> str:
    """The symbol that was written without quotes, so that TOML made a table at each point."""
    while isinstance(value, dict) and len(value) == 1 and "fixed" not in value:
        (name,) = value
        symbol, value = f"{symbol}.{name}", value[name]
    return symbol


def _refuse_circles(toml: Toml, known: Mapping[str, Knowledge]) -> None:
    for symbol, knowledge in known.items():
        seen = [symbol]
        while isinstance(knowledge, Tied):
            if knowledge.to in seen:
                raise toml.wrong(f"parameters.{symbol}", f"tied in a circle: {' = '.join([*seen, knowledge.to])}.",
                                 "One of them must be free or have a value.", "Untie one.")  # fmt: skip
            seen.append(knowledge.to)
            knowledge = known.get(knowledge.to, Start(0.0))
