"""What rig.toml needs and no file says: the ends of the sensor, the travel. Guessed from all records together."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..rig.base import RigConfig
from ..rig.units import is_percent
from .record import Record
from .settings import GuessSettings
from .signs import opening

_USUAL_DEG = 0.0, 90.0
_CHARGED_V, _BENCH_V = 13.8, 12.0  # a lead battery's charger; a supply for its nominal voltage


@dataclass(frozen=True)
class NameplateGuess:
    """One table or key of rig.toml.

    Args:
        text: the lines.
        short: in a few words.
        reason: why.
    """

    text: str
    short: str
    reason: str


def sensor_guess(records: Sequence[Record], known: RigConfig | None, settings: GuessSettings) -> NameplateGuess | None:
    """[tps] from the lowest and highest reading; None where it is known, or no sensor was logged in volts."""
    having = [record for record in records if record.take("tps") is not None]
    if not having or (known is not None and known.tps is not None):
        return None
    low, high = _ends([record.signals["tps"] for record in having], settings)
    rising = sum(opening(record, settings) for record in having) >= 0.0
    closed, opened = (low, high) if rising else (high, low)
    closed, opened = round(closed, 4), round(opened, 4)
    way = "rises" if rising else "falls"
    reason = (
        f"lowest and highest reading of {len(having)} records, it {way} while the plate opens; 90 degrees are "
        "assumed. The ends are right only if the plate reached both stops"
    )
    text = f"[tps]\nclosed_V = {closed}\nopen_V = {opened}\ntravel_deg = 90.0\n"
    return NameplateGuess(text, f"[tps] {closed:g} V closed, {opened:g} V open, 90 degrees", reason)


def travel_guess(records: Sequence[Record], known: RigConfig | None, settings: GuessSettings) -> NameplateGuess | None:
    """travel_deg where angles leave the usual 0 to 90 degrees and nobody gave it."""
    having = [record for record in records if (take := record.take("position")) and not is_percent(take.unit)]
    if not having or known is not None:
        return None
    low, high = (math.degrees(each) for each in _ends([record.signals["position"] for record in having], settings))
    if _USUAL_DEG[0] - settings.beyond_deg <= low and high <= _USUAL_DEG[1] + settings.beyond_deg:
        return None
    low, high = round(low, 1), round(high, 1)
    text = f"travel_deg = [{low}, {high}]\n"
    reason = f"lowest and highest angle of {len(having)} records, beyond the usual 0 to 90"
    return NameplateGuess(text, f"[rig] {text.strip()}", reason)


def supply_guess(records: Sequence[Record], known: RigConfig | None, settings: GuessSettings) -> NameplateGuess | None:
    """supply_V where a duty is all that says what drives the plate: a car's battery that is charged, or a bench's."""
    having = [record for record in records if record.take("duty") and not {"voltage", "supply"} & set(record.signals)]
    if not having or known is not None:
        return None
    car = any(record.sheet.is_ecu for record in having)
    volts = _CHARGED_V if car else _BENCH_V
    reason = (
        f"a duty without a supply in {len(having)} records; {volts:g} V is usual {'in a car' if car else 'on a bench'}"
    )
    return NameplateGuess(f"supply_V = {volts}\n", f"[rig] supply_V = {volts}", reason)


def _ends(readings: Sequence[np.ndarray], settings: GuessSettings) -> tuple[float, float]:
    """Of each record apart, so that a long one does not hide what a short one reached."""
    low = min(float(np.quantile(each, settings.end_quantile)) for each in readings)
    return low, max(float(np.quantile(each, 1.0 - settings.end_quantile)) for each in readings)
