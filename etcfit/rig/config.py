"""rig.toml -> RigConfig: every key checked, every value in SI."""

from __future__ import annotations

import difflib
import math
import re
import tomllib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from ..errors import MeasurementError
from .base import CHANNELS, Fixed, Knowledge, Prior, RigConfig, Start, Tied, TpsCalibration
from .header import DROP, HeaderError, parse_header
from .table import decode
from .units import EXAMPLES, UnitError, to_channel

TABLES = ("rig", "tps", "columns", "noise", "tests", "parameters", "model", "holdout")
RIG_KEYS = ("name", "synthetic", "gear_ratio", "supply_V", "travel_deg")
TPS_KEYS = ("closed_V", "open_V", "travel_deg")
UNIT_SLUGS = {"rad_s": "rad/s", "deg_s": "deg/s", "N_m": "N*m", "mN_m": "mN*m", "N_cm": "N*cm", "": "1"}


@dataclass(frozen=True)
class Toml:
    """A parsed rig.toml that knows its own path and where each key stands."""

    path: str
    text: str
    tables: Mapping[str, Any]

    def wrong(self, key: str, found: str, required: str, mend: str) -> MeasurementError:
        """The error for `table.key`, with its line where it can be found."""
        line = _line_of(self.text, key)
        return MeasurementError(f"{self.path}:{line}" if line else self.path, f"{key}: {found}", required, mend)

    def table(self, name: str, keys: Iterable[str] | None = None) -> Mapping[str, Any]:
        """The table of that name, {} where absent; only the given keys may stand in it."""
        value = self.tables.get(name, {})
        if not isinstance(value, dict):
            raise self.wrong(name, f"found {value!r}.", "It must be a table.", f"Write [{name}] on a line of its own.")
        if keys is not None:
            self.only(value, tuple(keys), f"{name}.")
        return value

    def only(self, value: Mapping[str, Any], keys: tuple[str, ...], prefix: str = "") -> None:
        """Refuse keys that are not known."""
        for key in value:
            if key not in keys:
                raise self.wrong(f"{prefix}{key}", "unknown key.", f"Known here: {', '.join(keys)}.",
                                 closest(key, keys, "Delete it."))  # fmt: skip


def read_config(path: str | Path) -> RigConfig:
    """Read and check a rig.toml.

    Raises:
        MeasurementError: it is not there, is no TOML, or holds an unknown key or a value of the wrong kind.
    """
    return parse_config(read_text(path), str(path))


def read_text(path: str | Path) -> str:
    """The text of a rig.toml, whatever Unicode encoding its editor chose."""
    try:
        return decode(Path(path).read_bytes(), str(path)).removeprefix("\ufeff")
    except OSError as err:
        raise MeasurementError(str(path), f"no rig.toml can be read here ({err.strerror}).",
                               "Every measurement folder needs one.",
                               'Create it with two lines: [rig] and name = "...".') from err  # fmt: skip


def parse_config(text: str, path: str) -> RigConfig:
    """As `read_config`, from the text itself."""
    toml = Toml(path, text, _parse(text, path))
    toml.only(toml.tables, TABLES)
    rig = toml.table("rig", RIG_KEYS)
    travel, tps = _travel(toml, rig), _tps(toml)
    gear_ratio, parameters = _gear_ratio(toml, rig), _parameters(toml)
    if "synthetic" in rig and not isinstance(rig["synthetic"], bool):
        raise toml.wrong("rig.synthetic", f"found {rig['synthetic']!r}.", "It must be true or false.", "Correct it.")
    return RigConfig(
        name=_text(toml, "rig.name", rig.get("name", Path(path).absolute().parent.name)),
        synthetic=rig.get("synthetic", False),
        gear_ratio=1.0 if gear_ratio is None else gear_ratio,
        gear_ratio_given=gear_ratio is not None,
        supply_V=_positive(toml, "rig.supply_V", rig["supply_V"]) if "supply_V" in rig else None,
        travel=travel,
        tps=tps,
        columns=_columns(toml),
        noise=_noise(toml, travel, tps),
        series_ohm=_series_ohm(toml),
        parameters=parameters,
        effects=_strings(toml, "model", "effects"),
        holdout=tuple(PurePosixPath(f.replace("\\", "/")).as_posix() for f in _strings(toml, "holdout", "files")),
    )


def closest(name: str, known: Iterable[str], otherwise: str) -> str:
    """A cure for a misspelt name."""
    known = tuple(known)
    folded = {k.casefold(): k for k in known}
    match = difflib.get_close_matches(name.casefold(), folded, n=1, cutoff=0.6)
    return f"Did you mean '{folded[match[0]]}'?" if match else otherwise


def _parse(text: str, path: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as err:
        line = re.search(r"line (\d+)", str(err))
        at_end = text.count("\n") + 1 if "end of document" in str(err) else ""
        place = f"{path}:{line[1] if line else at_end}".rstrip(":")
        raise MeasurementError(place, f"{str(err).split(' (at ')[0]}.", "rig.toml must be valid TOML.",
                               "Correct this line; texts need quotes, decimals a point.") from err  # fmt: skip


def _line_of(text: str, key: str) -> int | None:
    """The line of `table.key`, by eye: good enough to point at."""
    *table, name = key.split(".")
    for tables, sought in ((table, name), (table[:-1], table[-1] if table else ""), ([], key)):
        here: list[str] = []
        for number, line in enumerate(text.split("\n"), 1):
            if header := re.match(r"\s*\[+\s*([^\]]+?)\s*\]", line):
                here = [part.strip("\"' ") for part in header[1].split(".")]
                if here == [*tables, sought]:
                    return number
            elif here == tables and re.match(rf"\s*[\"']?{re.escape(sought)}[\"']?\s*[=.]", line):
                return number
    return None


def _number(toml: Toml, key: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or math.isnan(value):
        raise toml.wrong(key, f"found {value!r}.", "It must be a number.", f"Write {key.split('.')[-1]} = 1.0.")
    try:
        return float(value)
    except OverflowError:
        return math.copysign(math.inf, value)


def _finite(toml: Toml, key: str, value: Any) -> float:
    number = _number(toml, key, value)
    if math.isinf(number):
        raise toml.wrong(key, f"found {value!r}.", "It must be finite.", "Correct it, or leave the key out.")
    return number


def _positive(toml: Toml, key: str, value: Any) -> float:
    number = _finite(toml, key, value)
    if number <= 0:
        raise toml.wrong(key, f"found {value!r}.", "It must be above 0.", "Correct it, or leave the key out.")
    return number


def _text(toml: Toml, key: str, value: Any) -> str:
    if not isinstance(value, str):
        raise toml.wrong(key, f"found {value!r}.", "It must be a text.", 'Put it in quotes: "...".')
    return value


def _strings(toml: Toml, table: str, key: str) -> tuple[str, ...]:
    values = toml.table(table, (key,)).get(key, [])
    if not isinstance(values, list) or not all(isinstance(v, str) for v in values):
        raise toml.wrong(f"{table}.{key}", f"found {values!r}.", "It must be a list of texts.",
                         f'Write {key} = ["...", "..."].')  # fmt: skip
    return tuple(dict.fromkeys(values))


def _gear_ratio(toml: Toml, rig: Mapping[str, Any]) -> float | None:
    """N, given as [rig] gear_ratio or as a parameter; None where it is not."""
    given = {}
    if "gear_ratio" in rig:
        given["rig.gear_ratio"] = _positive(toml, "rig.gear_ratio", rig["gear_ratio"])
    if "N" in (parameters := toml.table("parameters")):
        value = parameters["N"]
        inner = value["fixed"] if isinstance(value, dict) and set(value) == {"fixed"} else value
        if isinstance(inner, (dict, str)):
            raise toml.wrong("parameters.N", f"found {value!r}.", "The gear ratio is counted in teeth, never fitted.",
                             "Write [rig] gear_ratio = 20.68.")  # fmt: skip
        given["parameters.N"] = _positive(toml, "parameters.N", inner)
    if len(set(given.values())) > 1:
        raise toml.wrong("parameters.N", f"found {given['parameters.N']:g}, but [rig] gear_ratio is "
                         f"{given['rig.gear_ratio']:g}.", "They are the same quantity.", "Delete one.")  # fmt: skip
    return next(iter(given.values()), None)


def _travel(toml: Toml, rig: Mapping[str, Any]) -> tuple[float, float]:
    value = rig.get("travel_deg", [0.0, 90.0])
    if not isinstance(value, list) or len(value) != 2:
        raise toml.wrong("rig.travel_deg", f"found {value!r}.", "It must be two numbers, closed stop and open stop.",
                         "Write travel_deg = [0.0, 90.0]; inf and -inf mean no stop.")  # fmt: skip
    closed, opened = (_number(toml, "rig.travel_deg", v) for v in value)
    if not closed < opened or math.inf in (closed, -opened):
        raise toml.wrong("rig.travel_deg", f"found {value!r}.", "The closed stop must lie below the open stop.",
                         "Swap them, or correct them.")  # fmt: skip
    return math.radians(closed), math.radians(opened)


def _tps(toml: Toml) -> TpsCalibration | None:
    table = toml.table("tps", TPS_KEYS)
    if "tps" not in toml.tables:
        return None
    for key in TPS_KEYS:
        if key not in table:
            raise toml.wrong(f"tps.{key}", "missing.", f"[tps] needs {', '.join(TPS_KEYS)}.", f"Add {key} = ...")
    closed, opened = (_finite(toml, f"tps.{key}", table[key]) for key in TPS_KEYS[:2])
    if closed == opened:
        raise toml.wrong("tps.open_V", f"found {opened!r}, the same as closed_V.", "The two ends must differ.",
                         "Measure the sensor at both stops.")  # fmt: skip
    return TpsCalibration(closed, opened, math.radians(_positive(toml, "tps.travel_deg", table["travel_deg"])))


def _columns(toml: Toml) -> dict[str, str]:
    columns: dict[str, str] = {}
    for foreign, ours in toml.table("columns").items():
        key = f"columns.{foreign}"
        name = " ".join(_text(toml, key, ours).split())
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
    for key, value in toml.table("noise").items():
        channel, scale = _noise_key(toml, key, travel, tps)
        if channel in noise:
            raise toml.wrong(f"noise.{key}", f"a second value for {channel}.", "One channel has one noise.",
                             "Delete one.")  # fmt: skip
        noise[channel] = _positive(toml, f"noise.{key}", value) * abs(scale)
    return noise


def _noise_key(
    toml: Toml, key: str, travel: tuple[float, float], tps: TpsCalibration | None
) -> tuple[str, float]:
    known = (*CHANNELS, "tps")
    quantity = next((q for q in known if key == q or key.startswith(f"{q}_")), None)
    if quantity is None:
        raise toml.wrong(f"noise.{key}", "unknown channel.", f"Known: {', '.join(known)}, then _ and the unit.",
                         closest(key.rpartition("_")[0] or key, known, "Write, say, current_A = 0.01."))  # fmt: skip
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
    return channel, conversion.scale


def _series_ohm(toml: Toml) -> dict[str, float | None]:
    """Extra circuit resistance by test, ohm; None where the fit finds it."""
    series: dict[str, float | None] = {}
    for test, table in toml.table("tests").items():
        if not isinstance(table, dict):
            raise toml.wrong(f"tests.{test}", f"found {table!r}.", "It must be a table.", f"Write [tests.{test}].")
        toml.only(table, ("series_ohm",), f"tests.{test}.")
        if "series_ohm" in table:
            series[test] = _ohm(toml, f"tests.{test}.series_ohm", table["series_ohm"])
    return series


def _ohm(toml: Toml, key: str, value: Any) -> float | None:
    if value == "free":
        return None
    if isinstance(value, str) or (number := _finite(toml, key, value)) < 0:
        raise toml.wrong(key, f"found {value!r}.", 'It must be "free" or a number of ohms, 0 or more.', "Correct it.")
    return number


def _parameters(toml: Toml) -> dict[str, Knowledge]:
    table = {symbol: value for symbol, value in toml.table("parameters").items() if symbol != "N"}
    known = {symbol: _knowledge(toml, symbol, value) for symbol, value in table.items()}
    for symbol, knowledge in known.items():
        _refuse_circles(toml, symbol, knowledge, known)
    return known


def _knowledge(toml: Toml, symbol: str, value: Any) -> Knowledge:
    key = f"parameters.{symbol}"
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", symbol):
        raise toml.wrong(key, "no symbol.", "Symbols are letters, digits and _, as R_a.", "Correct or delete it.")
    if isinstance(value, str) and re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", value):
        return Tied(value)
    forms: dict[frozenset[str], Callable[..., Knowledge]] = {
        frozenset({"fixed"}): lambda fixed: Fixed(_finite(toml, key, fixed)),
        frozenset({"value", "sd"}): lambda value, sd: Prior(_finite(toml, key, value), _positive(toml, key, sd)),
    }
    if isinstance(value, dict):
        if form := forms.get(frozenset(value)):
            return form(**value)
    elif isinstance(value, (int, float)) and not isinstance(value, bool):
        return Start(_finite(toml, key, value))
    raise toml.wrong(key, f"found {value!r}.",
                     'It must be a number, "OTHER", {fixed = 0.0} or {value = 1.0, sd = 0.1}.',
                     "Write it in one of these forms.")  # fmt: skip


def _refuse_circles(toml: Toml, symbol: str, knowledge: Knowledge, known: Mapping[str, Knowledge]) -> None:
    seen = [symbol]
    while isinstance(knowledge, Tied):
        if knowledge.to in seen:
            raise toml.wrong(f"parameters.{symbol}", f"tied in a circle: {' = '.join([*seen, knowledge.to])}.",
                             "One of them must be free or have a value.", "Untie one.")  # fmt: skip
        seen.append(knowledge.to)
        knowledge = known.get(knowledge.to, Start(0.0))
