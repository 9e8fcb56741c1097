"""What the proposed gains do where something fails, of pid.json: for every view."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..numbers import or_never, short
from ..table import Cell, Column, Notes, Part, Table


def safety_parts(pid: Mapping[str, Any]) -> list[Part]:
    """Jam check and heat in sentences, then a row a failure; nothing where the file is older than that."""
    safe = pid.get("safety")
    if not safe:
        return []
    settings = pid["settings"]
    return [Notes("Jam check", _jam_words(safe, settings["safety"])), *_tables(safe, settings["safety"]),
            Notes("Holding", _holding_words(safe["holding"], settings))]  # fmt: skip


def _tables(safe: Mapping[str, Any], settings: Mapping[str, Any]) -> list[Table]:
    """Sensor, supply and springs."""
    sensor = (f"The position sensor fails (at {settings['supply']:g} V; two sensors: {pct(settings['apart'])} % apart "
              f"for {settings['apart_for']:g} s; worst of hot and cold, little and much friction)")  # fmt: skip
    crank = " then ".join(f"{v:g} V for {1e3 * t:g} ms" for v, t in
                          zip(settings["crank"], settings["crank_for"], strict=True))  # fmt: skip
    sags = f"The supply sags (dip: {settings['dip']:g} V for {1e3 * settings['dip_for']:g} ms; crank: {crank})"
    trips = {None: "-", True: Cell("YES", "bad"), False: "no"}
    return [
        Table(sensor, (Column("sensor at 25 %", "fault", "word"), *_columns({
            "unchecked\nopens to %": "opens_pct", "jam check\nafter s": "jam_after_s", "jam check\nopens to %":
            "jam_opens_pct", "two sensors\nafter s": "apart_after_s", "two sensors\nopens to %": "apart_opens_pct"})),
            safe["sensor"]),
        Table(sags, (Column("supply", "name", "word"), *_columns({
            "held %": "opening_pct", "falls %": "closes_pct", "overshoots %": "opens_pct", "back s": "back_after_s",
            "integral %": "integral_pct"}), Column("seen as jam", lambda row: trips[row["false_trip"]], "word")),
            safe["supply"]),
        Table("The springs bring it back", (*_columns({
            "no current, from %": "opening_pct", "open terminals s": "open_terminals_s", "shorted s":
            "shorted_terminals_s"}), Column("rests at %", lambda row: " to ".join(map(short, row["rests_pct"])))),
            safe["unpowered"]),
    ]  # fmt: skip


def _columns(shown: Mapping[str, str]) -> list[Column]:
    return [Column(head, lambda row, key=key: or_never(row[key])) for head, key in shown.items()]


def _jam_words(safe: Mapping[str, Any], settings: Mapping[str, Any]) -> list[str]:
    """The pair proposed, why, and its margins."""
    seen, check = safe["envelope"], safe["jam"]
    tried = (f"{seen['models']} models, each under conditions of a car, in every scenario: error up to "
             f"{short(seen['largest_pct'])} %")  # fmt: skip
    slowest = f"{settings['within']:g} s at {settings['reserve']:g} times in hand"
    if check is None:
        return [tried, f"none proposed: no threshold up to {pct(settings['most'])} % is undercut within {slowest}"]
    kept = "no error tried is kept up so long" if check["sustained_pct"] == 0.0 else (
        f"the largest error kept up so long is {short(check['sustained_pct'])} %")  # fmt: skip
    told = ", ".join(f"{name} {short(after)} s" for name, after in check["told_after_s"].items() if after is not None)
    return [
        tried,
        f"proposed: an error above {short(check['error_pct'])} % for more than {check['timeout_s']:g} s; the least "
        f"threshold that gets along with {slowest}",
        f"no false trip: a sound throttle is further off for {short(check['longest_above_s'])} s at most, {kept}",
        f"a plate held since the first change of a scenario is told after: {told or 'none'}; while no more is asked "
        "of it than the threshold, never",
    ]


def _holding_words(held: Mapping[str, Any], settings: Mapping[str, Any]) -> list[str]:
    """Current, heat, and how long the full duty may last."""
    k = int(np.argmax(np.abs(held["current_A"])))
    said = [f"{short(abs(held['current_A'][k]))} A and {short(held['winding_W'][k])} W in the winding at most, at "
            f"{short(held['position_pct'][k])} % of the travel; full duty against a stop: "
            f"{short(held['full_duty_A'])} A, {short(held['full_duty_W'])} W"]  # fmt: skip
    if not held["heating_known"]:
        return [*said, "how warm the winding becomes is not known: the model has no winding heating; power is all "
                "there is"]  # fmt: skip
    limit = f"{settings['safety']['insulation']:g} degrees Celsius"
    longest = held["full_duty_s"]
    lasts = f"never up to {limit}" if longest is None else f"{short(longest)} s to {limit}"
    return [*said, f"in the long run {short(max(held['winding_rise_K']))} K warmer; full duty from "
            f"{settings['conditions']['bench']:g}: {lasts}"]  # fmt: skip


def pct(share: float) -> str:
    """A share in per cent."""
    return short(100.0 * share)
