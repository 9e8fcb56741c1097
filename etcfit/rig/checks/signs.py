"""Finds channels with the wrong sign, and columns with exchanged headers.

Wrong sign: current against voltage, EMF and motor speed against the motion.

    R < 0:  voltage or current has the wrong sign     k < 0:  EMF, motor speed, or both leads of the motor

in the equation of `circuit.py`, whose R and k are positive; and a motor alone takes up energy and turns with its
voltage, integral v i dt > 0 and integral v omega dt > 0. Positive voltage, current and motor speed open the plate, and
the EMF is negative while the plate falls.

Voltage and current exchanged, or position and setpoint:

    v = R i + L di/dt + k w   read with v and i exchanged:   i = v/R - (L/R) di/dt - (k/R) w

so L and k come out negative while R > 0, because current lags voltage and never leads it. Where both are constant, R
comes out as 1/R of the other tests, or the resolutions of the two converters are exchanged. A setpoint leads its
position.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import log
from statistics import median

import numpy as np

from .. import TEST_BY_NAME
from ..base import Channel, Finding, Measurement
from ..signals import on_times
from .base import Records, Signs, column, found_in

ERRORS = 5.0  # standard errors by which a reading must be below zero
OPPOSED = 10.0  # standard deviations of the channel's noise by which an integral must be below zero
INVERSE = 0.15  # relative deviation within which R counts as 1/R of the other tests
APART = 1.5  # factor from which on R, or the resolutions of two converters, count as different
LEADS = 0.1  # largest lead of a position over its setpoint that is tried, share of the trace
BETTER = 0.02  # least gain of correlation of the lead over the lag


def channel_sign(records: Records) -> Iterator[Finding]:
    """Channels with the wrong sign, test by test."""
    for traces in records.tests.values():
        turned: dict[str, list[Measurement]] = {}
        for trace in traces:
            signs = records.signs(trace, ERRORS)
            for name in _turned(trace, signs) if signs else ():
                turned.setdefault(name, []).append(trace)
        for name, having in turned.items():
            logged = having[0].channels
            against = {"emf": "the plate's motion", "motor_speed": "voltage and current", "current": "the voltage",
                       "voltage": "the current" if len(logged) < 3 else "the motion"}[name]  # fmt: skip
            header = column(logged.get(name) or logged["voltage"], -1.0)
            yield found_in([trace.file for trace in having], traces, Finding(
                "channel_sign", -1.0, "", 0.0, f"{name.replace('_', ' ')} has the opposite sign of {against}.",
                f"Name its column '{header}' there, or exchange the leads and log again.", channel=name, sure=True,
            ))  # fmt: skip


def _turned(trace: Measurement, signs: Signs) -> tuple[str, ...]:
    """Channels with the wrong sign."""
    boundary = TEST_BY_NAME[trace.test].boundary
    if boundary.terminals_open:
        return ("emf" if "emf" in trace.channels else "voltage",) if signs.k < 0 else ()
    if boundary.gear_apart:  # a spinning motor hides R, and the brushes' drop hides k
        if _opposed(trace, "current"):
            return (_driver(trace, signs),)
        return ("motor_speed",) if _opposed(trace, "motor_speed") else ()
    if signs.R < 0:
        return (_driver(trace, signs),)
    return ("voltage", "current") if signs.k < 0 else ()


def _opposed(trace: Measurement, name: str) -> bool:
    """Whether integral v i dt < 0, or v omega dt < 0, beyond the channel's noise: a motor that starts from rest, with
    no other drive, neither delivers energy nor runs against its voltage."""
    voltage, channel = trace.channels.get("voltage"), trace.channels.get(name)
    if voltage is None or channel is None:
        return False
    volts = on_times(voltage, channel.time)
    return float(np.sum(volts * channel.value)) < -OPPOSED * channel.sigma * float(np.sqrt(np.sum(volts**2)))


def _driver(trace: Measurement, signs: Signs) -> str:
    """Voltage or current, whichever contradicts the motion; with the plate held the one below zero."""
    if signs.k:
        return "current" if signs.k > 0 else "voltage"
    return "current" if float(np.mean(trace.channels["current"].value)) < 0.0 else "voltage"


def swapped_columns(records: Records) -> Iterator[Finding]:
    """Voltage and current, or position and setpoint, with exchanged headers."""
    late = {test: [t for t in traces if _runs_ahead(t, records)] for test, traces in records.tests.items()}
    sound = records.without(test for test, having in late.items() if having)
    for test, traces in records.tests.items():
        if late[test]:
            yield _exchanged(("voltage", "current"), late[test], traces, True,
                             "current leads voltage, as if the two columns were exchanged")  # fmt: skip
        elif having := [t for t in traces if _inverse(t, sound)]:
            yield _exchanged(("voltage", "current"), having, traces, False,
                             "voltage over current is what current over voltage is in the other tests")  # fmt: skip
        if having := [t for t in traces if {"setpoint", "position"} <= set(t.channels) and _follows(t)]:
            yield _exchanged(("position", "setpoint"), having, traces, False,
                             "the position leads its setpoint, as if the two columns were exchanged")  # fmt: skip


def _exchanged(
    names: tuple[str, str], having: list[Measurement], traces: tuple[Measurement, ...], sure: bool, words: str
) -> Finding:
    one, other = (having[0].channels[name].header for name in names)
    return found_in([trace.file for trace in having], traces, Finding(
        "swapped_columns", 1.0, "", 0.0, f"{words}.", f"Exchange the headers '{one}' and '{other}' there.",
        channel=names[0], sure=sure,
    ))  # fmt: skip


def _runs_ahead(trace: Measurement, records: Records) -> bool:
    """Whether L < 0 and, where the plate moves, k < 0; a motor with exchanged leads has k < 0 too, but L > 0."""
    signs, boundary = records.signs(trace, ERRORS), TEST_BY_NAME[trace.test].boundary
    if signs is None or signs.R <= 0 or boundary.terminals_open:
        return False
    if boundary.plate_held:
        return signs.L < 0
    if signs.k >= 0 or signs.L != 0:
        return signs.k < 0 and signs.L < 0
    own, others = _resistances(trace, records)  # R must be nearer to 1/R of the other tests than to their R
    return own is not None and bool(others) and abs(log(own * median(others))) < abs(log(own / median(others)))


def _inverse(trace: Measurement, records: Records) -> bool:
    """Whether a held plate at rest shows 1/R of the other tests, or exchanged resolutions; and not their R."""
    own, others = _resistances(trace, records)
    circuit = records.circuits.get(trace.test)
    if own is None or not others or circuit is None or circuit.k is not None or circuit.L is not None:
        return False
    known = median(others)
    alike = abs(own / known - 1.0) < INVERSE and abs(own * known - 1.0) > INVERSE
    sure = max(own / known, known / own) > APART or _steps_exchanged(trace.test, records)
    return not alike and sure and abs(own * known - 1.0) < INVERSE


def _resistances(trace: Measurement, records: Records) -> tuple[float | None, list[float]]:
    """Resistance in the trace's test, ohm, and in each of the others."""
    R = {test: c.R.value for test, c in records.circuits.items() if c.R and c.R.value > 0.0}
    return R.get(trace.test), [value for test, value in R.items() if test != trace.test]


def _steps_exchanged(test: str, records: Records) -> bool:
    """Whether this test's voltage has the resolution of the other tests' current, and vice versa."""

    def step(here: bool, name: str) -> float:
        """Median resolution of a channel's converter, SI; 0 where the data show none."""
        having = [t for t in records.traces if (t.test == test) is here and name in t.channels]
        return median([t.channels[name].quantum for t in having]) if having else 0.0

    own, foreign = (tuple(step(here, name) for name in ("voltage", "current")) for here in (True, False))
    if min(*own, *foreign) <= 0.0 or max(foreign[0] / foreign[1], foreign[1] / foreign[0]) < APART:
        return False
    return all(abs(a / b - 1.0) < INVERSE for a, b in zip(own, reversed(foreign), strict=True))


def _follows(trace: Measurement) -> bool:
    """Whether the setpoint resembles the earlier position, and the position does not resemble the earlier setpoint."""
    position, setpoint = trace.channels["position"], trace.channels["setpoint"]
    ahead, behind = (_best(*pair) for pair in ((setpoint, position), (position, setpoint)))
    return ahead > behind + BETTER and _roughness(setpoint) > _roughness(position)


def _best(late: Channel, early: Channel) -> float:
    """Greatest correlation of `late` with `early` shifted by one sample up to `LEADS` of the trace."""
    a, b = late.value - np.mean(late.value), on_times(early, late.time) - np.mean(early.value)
    size = float(np.sqrt(np.sum(a**2) * np.sum(b**2)))
    steps = np.unique(np.geomspace(1, max(2, int(LEADS * a.size)), 60).astype(int))
    return max((float(np.sum(a[k:] * b[:-k])) / size for k in steps), default=0.0) if size > 0.0 else 0.0


def _roughness(channel: Channel) -> float:
    """Median change from sample to sample over the span: small for a setpoint, which has no noise."""
    span = float(np.ptp(channel.value))
    return float(np.median(np.abs(np.diff(channel.value, 2)))) / span if span > 0.0 else 0.0
