"""Throttles whose nameplate is known, for `etcfit new --like NAME`. A newcomer adds one entry."""

from __future__ import annotations

from dataclasses import dataclass

UNKNOWN = "..."  # no TOML: the reader stops at its line until somebody fills it in


@dataclass(frozen=True)
class Nameplate:
    """What stands on a throttle, or in its data sheet; a text where a number must be filled in.

    Args:
        title: `name` in rig.toml.
        source: who says so.
        gear_ratio, supply_V: N; V.
        travel_deg: closed and open stop.
        closed_V, open_V: of the position sensor at these stops.
    """

    title: str
    source: str
    gear_ratio: str = UNKNOWN
    supply_V: str = "12.0"
    travel_deg: str = "[0.0, 90.0]"
    closed_V: str = UNKNOWN
    open_V: str = UNKNOWN


ANY = Nameplate("my throttle", "usual values; those of this throttle are to be filled in")
NAMEPLATES: dict[str, Nameplate] = {
    "bosch-0280750148": Nameplate(
        "Bosch 0280750148, bench", "the paper, Table 1", "20.68", closed_V="0.45", open_V="4.73"
    ),
    "kassel": Nameplate(
        "Kassel throttle valve (make unknown)", "`etcfit fetch kassel-throttle`: read off its record",
        closed_V="4.59", open_V="0.702",
    ),
}  # fmt: skip
