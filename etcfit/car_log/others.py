"""Finds further quantities of the throttle in a log, by the names that ECUs give them: duty, and both sensors of the
plate."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from ..importing.names import FIRST_SENSOR, LOGGED_DUTY, SECOND_SENSOR
from .log import Series

DUTY, SECOND, VOLTS_1, VOLTS_2 = "duty", "position 2", "sensor 1", "sensor 2"

_HEADER = re.compile(r"(?P<name>.+?)\s*(?:[\[(]\s*(?P<unit>[^\[\]()]*?)\s*[\])])?\s*")


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.casefold())


def _named(header: str, names: Sequence[str], units: Sequence[str]) -> tuple[int, str] | None:
    """Rank of a header among some names, 0 the surest, and its unit; None where it is none of them."""
    match = _HEADER.fullmatch(header.strip())
    if match is None:
        return None
    name, unit = _plain(match["name"]), (match["unit"] or "").casefold()
    if name not in names:  # brackets that are part of the name, as in "TP (Sub)"
        name, unit = _plain(header), ""
    if name.endswith("voltage") and not unit:
        unit = "v"
    return (names.index(name), unit) if name in names and unit in units else None


def found(header: Sequence[str]) -> dict[str, tuple[int, str]]:
    """Column and unit of each quantity found in a header."""
    wanted = {DUTY: (LOGGED_DUTY, ("%", "", "1")), SECOND: (SECOND_SENSOR, ("%", "")),
              VOLTS_1: (FIRST_SENSOR, ("v", "mv")), VOLTS_2: (SECOND_SENSOR, ("v", "mv"))}  # fmt: skip
    out: dict[str, tuple[int, str]] = {}
    for quantity, (names, units) in wanted.items():
        ranked = [(named[0], k, named[1]) for k, text in enumerate(header) if (named := _named(text, names, units))]
        if ranked:
            _, place, unit = min(ranked)
            out[quantity] = place, unit
    return out


def series(time: np.ndarray, columns: Sequence[np.ndarray], places: Mapping[str, tuple[int, str]]) -> dict[str, Series]:
    """Each quantity at the times at which it was logged: duty and position in per cent, sensors in V.

    Args:
        time: s, shape (n,).
        columns: of the table, shape (n,) each.
        places: as of `found`.
    """
    out = {}
    for quantity, (place, unit) in places.items():
        logged = Series.rising(time, columns[place])
        if logged.time.size < 2:
            continue
        scale = 1e-3 if unit == "mv" else 1.0
        if quantity == DUTY and (unit == "1" or (not unit and np.abs(logged.value).max() <= 1.0)):
            scale = 100.0
        out[quantity] = Series(logged.time, scale * logged.value)
    return out
