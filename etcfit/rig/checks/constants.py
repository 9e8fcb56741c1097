"""Finds wrong units, a wrong gear ratio and extra resistors, by motor constants in which rig tests contradict each
other.

A unit that is wrong by 1000, 60, 2 pi ... in one rig test with plausible numbers, and a miscounted gear ratio.

    logged = c x true:  current  R -> R/c            voltage  R -> c R, k -> c k
                        position k -> k/c            EMF      k -> c k           motor speed  k -> k/c

R and k of `circuit.py` are the same in every test: k is N K_b at the plate and K_b at the motor. A test that differs
from the median of the others by one of the usual factors has a wrong unit; where every test at the plate differs from
the motor alone by one factor that belongs to no unit, the gear ratio is wrong, N = k at the plate / k at the motor.

More resistance in the circuit of one rig test than in that of another: harness, shunt, or a forgotten resistor.

    v = (R + R_s) i + L di/dt + k w + V_b sgn i

R and the brushes' V_b are read from a test in which several levels of current separate them, R_s from each other test.
A resistor increases R, so the test with the larger R has it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import exp, log, pi
from statistics import median

from .. import TEST_BY_NAME
from ..base import Finding
from .base import Records, by_chance, scaled_unit
from .circuit import Value, excess

ERRORS = 8.0  # least size of a reading, and least difference of two readings, in standard errors

# factors by which the numbers of a channel may be too large or too small
SLIPS: Mapping[str, tuple[float, ...]] = {
    "voltage": (1e3, 1e6),
    "emf": (1e3, 1e6),
    "current": (1e3, 1e6),
    "position": (180.0 / pi, 1e3, 2.0 * pi, 360.0),
    "motor_speed": (30.0 / pi, 60.0, 2.0 * pi, 180.0 / pi),
}
# logged unit, factor -> the real unit of the numbers; any other pair is written as a number and a unit
BETTER: Mapping[tuple[str, int], str] = {
    ("A", 1000): "mA", ("mA", -1000): "A", ("V", 1000): "mV", ("mV", -1000): "V",
    ("rad", 57): "deg", ("deg", -57): "rad", ("rad/s", 10): "rpm", ("rpm", -10): "rad/s",
}  # fmt: skip
NEAR = 0.2  # relative deviation within which a factor counts as a usual one
SURELY = 100.0  # factor beyond which no other cause is possible
# Deviation from a usual factor below which a smaller factor has no other cause either: a gear ratio that is miscounted
# by 30/pi within a few per cent is less likely than rad/s under the header rpm. Readings of k are 3 % off at times.
CLOSELY = 0.07
GEAR_SHARE = 0.1  # least relative error of the gear ratio

REFERENCE = ("resistance", "static_load", "response")  # tests that show the resistance, best first
MORE = 0.12  # least difference, share of R: a warm winding causes smaller ones
MOST = 5.0  # times R: for a larger difference a wrong unit is likelier
LEAST_AMPERES = 0.05  # A: least typical current that shows a resistance


def unit_scale(records: Records) -> Iterator[Finding]:
    """Channels whose numbers are wrong by the factor of a unit."""
    R, k = _sure(records, "R"), _sure(records, "k")
    for test in records.circuits:
        r, s = _against(R, test), _against(k, test)
        for channel, c, seen in _slips(records, test, r, s):
            logged = next(t.channels[channel] for t in records.tests[test] if channel in t.channels)
            key = logged.unit, round(c) if c > 1.0 else -round(1.0 / c)
            unit = BETTER.get(key) or scaled_unit(logged.unit, 1.0 / c)
            what = f"{c:.4g} times too large" if c > 1.0 else f"{1.0 / c:.4g} times too small"
            off = [f"{ratio:.3g} times the {each}" for ratio, each in ((r, "resistance"), (s, "back-EMF constant"))
                   if ratio is not None and abs(log(ratio)) > 0.2]  # fmt: skip
            found = (f"The numbers of {test}'s '{logged.header}' are {what}: its circuit shows {' and '.join(off)} "
                     "what the other tests show.")  # fmt: skip
            gear = " If the unit is right, gear_ratio in rig.toml is wrong." if channel == "motor_speed" else ""
            sure = max(c, 1.0 / c) > SURELY or abs(log(abs(seen) / c)) < CLOSELY
            mend = f"Name the column '{logged.name} [{unit}]' there.{gear}"
            yield Finding("unit_scale", c, "", 0.0, found, mend, test, channel=channel, sure=sure)


def _sure(records: Records, name: str) -> dict[str, float]:
    """Significant readings by test; k referred to the motor."""
    values: dict[str, float] = {}
    for test, circuit in records.circuits.items():
        value: Value | None = getattr(circuit, name)
        if value is not None and value.value > ERRORS * value.error:
            apart = TEST_BY_NAME[test].boundary.gear_apart
            values[test] = value.value / (1.0 if name == "R" or apart else records.config.gear_ratio)
    return values


def _against(values: Mapping[str, float], test: str) -> float | None:
    """A test's reading over the median (of logarithms) of the others'; None where either is missing."""
    others = [log(value) for name, value in values.items() if name != test]
    return values[test] / exp(median(others)) if test in values and others else None


def _slips(records: Records, test: str, r: float | None, s: float | None) -> Iterator[tuple[str, float, float]]:
    """Channel, usual factor and observed factor."""
    boundary = TEST_BY_NAME[test].boundary
    if boundary.terminals_open:
        if s is not None and (c := _usual("emf", s)):
            yield ("emf" if any("emf" in t.channels for t in records.tests[test]) else "voltage"), c, s
    elif r is not None and (c := _usual("voltage", r)) and (s is None or _usual("voltage", s)):
        if s is not None:
            yield "voltage", c, r
        else:
            yield "current", _usual("current", 1.0 / r) or 1.0 / c, 1.0 / r
    elif r is not None and (c := _usual("current", 1.0 / r)):
        yield "current", c, 1.0 / r
    elif s is not None:
        channel = "motor_speed" if boundary.gear_apart else "position"
        if c := _usual(channel, 1.0 / s):
            yield channel, c, 1.0 / s


def _usual(channel: str, factor: float) -> float | None:
    """The usual factor that is near a factor, or None."""
    both = (c for slip in SLIPS[channel] for c in (slip, 1.0 / slip))
    return next((c for c in both if abs(log(abs(factor) / c)) < NEAR), None)


def gear_ratio(records: Records) -> Iterator[Finding]:
    """A gear ratio that the tests contradict, where a wrong unit is not the likelier mistake."""
    sure = {t: c.k for t, c in records.circuits.items() if c.k and c.k.value > ERRORS * c.k.error}
    alone = [k.value for t, k in sure.items() if TEST_BY_NAME[t].boundary.gear_apart]
    plate = [k.value for t, k in sure.items() if not TEST_BY_NAME[t].boundary.gear_apart]
    if not alone or len(plate) < 2 or max(plate) > (1.0 + GEAR_SHARE) * min(plate):
        return
    found, given = exp(median(map(log, plate))) / alone[0], records.config.gear_ratio
    off = log(found / given)
    slips = [abs(abs(off) - log(slip)) < CLOSELY for slip in SLIPS["motor_speed"]]
    if abs(off) < GEAR_SHARE or any(slips):
        return
    words = "is not given" if not records.config.gear_ratio_given else f"is {given:.6g}"
    yield Finding(
        "gear_ratio", found / given, "", 0.0,
        f"The back-EMF constants of plate and motor alone have the ratio {found:.4g}, but gear_ratio {words} in "
        "rig.toml.",
        f"Count the teeth; if the ratio is right, write [rig] gear_ratio = {found:.4g} in rig.toml.",
    )  # fmt: skip


def series_resistance(records: Records) -> Iterator[Finding]:
    """Tests with more resistance in their circuit, except where rig.toml states the series resistance of the test."""
    unstated = {name: c for name, c in records.circuits.items() if name not in records.config.series_ohm}
    sure = {name: c.R for name, c in unstated.items() if c.R and c.R.value > ERRORS * c.R.error
            and c.amperes > LEAST_AMPERES and (c.k is None or c.k.value > 0.0)}  # fmt: skip
    base = next((name for name in REFERENCE if name in sure), None)
    if base is None:
        return
    R, drop = sure[base], unstated[base].drop
    others = {name: value for name, c in unstated.items() if name != base and c.amperes > LEAST_AMPERES
              and (value := excess(records.tests[name], records.config, drop)) is not None}  # fmt: skip
    larger = {name: value for name, value in others.items() if _more(value, R)}
    smaller = {name: value for name, value in others.items() if _more(R, value)}
    for name, value in larger.items():
        yield _resistor(name, value, base, R)
    if smaller and not larger:
        name, value = max(smaller.items(), key=lambda item: -item[1].error)
        yield _resistor(base, R, name, value)


def _more(a: Value, b: Value) -> bool:
    """Whether the resistance a is larger than b by more than errors and a warm winding explain."""
    more, error = a.value - b.value, (a.error**2 + b.error**2) ** 0.5
    return b.value > 0.0 and MORE * b.value < more < MOST * b.value and more > ERRORS * error


def _resistor(test: str, a: Value, other: str, b: Value) -> Finding:
    more, error = a.value - b.value, (a.error**2 + b.error**2) ** 0.5
    found = (f"The circuit of {test} shows {a.value:.4g} ohm, that of {other} {b.value:.4g}: {more:.3g} ohm more "
             f"({more / error:.0f} standard errors).")  # fmt: skip
    return Finding("series_resistance", more, "ohm", by_chance(more / error), found,
                   f'Write [tests.{test}] series_ohm = "free" in rig.toml.', test)  # fmt: skip
