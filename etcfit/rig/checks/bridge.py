"""Mistakes in current and voltage caused by the bridge, its supply and the instruments there.

Current of the supply instead of the motor: i_s = d i, d = v / V_s. A held winding then shows V/i = R V_s / V, which
falls as the voltage rises; no winding does that, and i_s V_s / v shows a constant resistance.

Current without its sign: never below zero although the voltage drives in both directions. For both see `circuit.py`.

A voltage channel that samples the PWM itself: it shows zero or the full supply, while the current does not follow.

    R^2 of the voltage in   i_(k+1) - i_k = a + b i_k + sum_j c_j v_(k+1-j),   j = 0 ... 4

A voltage that really jumps like this drives the current up and down. A voltage sampled from a much faster PWM jumps at
random, or in a slow beat of the two frequencies; the steps of the current and the circuit's equation, v = R i + L di/dt
+ k w over windows of some samples, do not follow it.

A bridge that coasts in its off time: where the current stops within a period, the mean voltage is not duty x supply.

    share = (d omega / d V) / (omega / V)   at settled speeds,   V = duty x supply

With dry and viscous friction omega = (V - V_f)/k, so the share is 1 or more; a drag that grows with the square of speed
makes it 1/2 at least. Where a bridge leaves the terminals open in the off time, they show the EMF of the turning motor
as soon as the current has stopped: a light load then turns nearly as fast as under the full supply, and the share falls
towards 0.

Source: Erickson and Maksimovic 2020, ch. 5 (discontinuous conduction). Differs from source: no converter is calculated.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from .. import TEST_BY_NAME
from ..base import Channel, Finding, Measurement, RigConfig
from ..signals import Plateau, drive_voltage, on_times, plateaus
from .base import Records, found_in
from .circuit import OtherCurrent, Value, left_by, supply_of, values_of, windows_of

# Factor by which another interpretation of the current must reduce the unexplained voltage. Where a test shows the
# current of a supply by this, and no test shows the opposite as clearly, every current is one of the supply.
TIMES = 4.0
SAME_WINDING = 1.4  # largest over smallest resistance of one winding, warm and cold
VOLTS_SPAN = 1.5  # least ratio of the largest to the smallest voltage of the windows
NEGATIVE = 6  # least number of windows in which the sign is negative
BELOW = 6.0  # standard deviations of the noise by which an unsigned current may be below zero

PWM_SAMPLES = 40  # least number of samples of a trace
WITHIN = 0.06  # largest distance of a sample from a level, share of the highest level
LEVELS_APART = 50.0  # least distance of the levels, standard deviations of the noise
ON_LEVEL = 0.97  # least share of the samples on a level
LEAST_JUMPS = 8  # least number of jumps from one level to the other
LAGS = 4  # samples by which the current may be late
FOLLOWS = 0.1  # largest share of the current's steps that the voltage explains
MISSES = 0.025  # least share of the voltage that the circuit's equation leaves unexplained in half of the windows

CONCAVE = 0.4  # largest share
CONCAVE_ERRORS = 3.0  # standard errors by which it must be lower
SPEEDS = 4  # least number of settled speeds in one direction
SPEEDS_SPAN = 1.3  # least ratio of their largest to their smallest voltage
SETTLED = 0.02  # largest relative change of the speed over the last part of a plateau
SPEED_NOISES = 20.0  # least speed over the noise of a speed sample


def supply_current(records: Records) -> Iterator[Finding]:
    """A current of the supply instead of the motor, in every test unless a test contradicts it."""
    read = {test: current.better(current.supply, 0.9) for test, current in records.currents.items()
            if _spans(current)}  # fmt: skip
    shown = {test: found for test, found in read.items() if found is not None and found[0] > TIMES}
    against = [test for test, found in read.items() if found is None or found[0] < 1.0 / TIMES]
    if against:
        yield from (_of_supply(records, {test: found}, test) for test, found in shown.items()
                    if _same_winding(records, found[1], against))  # fmt: skip
    elif shown:
        yield _of_supply(records, shown, None if len(records.currents) > 1 else next(iter(shown)))


def _same_winding(records: Records, R: Value, against: Sequence[str]) -> bool:
    """Whether R from a current of the supply equals that of the tests whose current is the motor's; True where these
    show no R, or where the supply's voltage is unknown, because R is then not in ohm."""
    others = [values["R"].value for test in against if (values := values_of(records.currents[test].motor))
              and "R" in values]  # fmt: skip
    if not others or any(supply_of(records.tests[test], records.config) is None for test in records.currents):
        return True
    return bool(1.0 / SAME_WINDING < R.value / np.median(others) < SAME_WINDING)


def _spans(current: OtherCurrent) -> bool:
    low, high = np.quantile(np.abs(current.motor.volts / current.motor.seconds), [0.05, 0.95])
    return bool(high > VOLTS_SPAN * low)


def _of_supply(records: Records, shown: Mapping[str, tuple[float, Value]], place: str | None) -> Finding:
    test = max(shown, key=lambda name: shown[name][0])
    times, R = shown[test]
    traces = [t for t in records.tests[test] if "current" in t.channels]
    channel, known = traces[0].channels["current"], supply_of(traces, records.config)
    motor = records.currents[test].motor
    high, low = np.quantile(np.abs(motor.volts / np.where(motor.amperes == 0.0, np.nan, motor.amperes)), [0.95, 0.05])
    ohms = f", and R is {R.value:.4g} ohm" if known else ""
    found = (f"'{channel.header}' is the current of the supply, not of the motor: in {' and '.join(shown)} voltage "
             f"over current falls as the voltage rises, in {test} from {high:.3g} to {low:.3g} ohm. Divided by the "
             f"duty it leaves {times:.0f} times less of the voltage unexplained there{ohms}.")  # fmt: skip
    where = f"of {place}" if place else "of every test that logged it so"
    unknown = "" if known else " Write [rig] supply_V, the supply's voltage, in rig.toml."
    mend = (f"Name the column 'supply_current [{channel.unit}]' in each trace {where}, so that it is divided by the "
            f"duty; or log the motor's own current.{unknown}")  # fmt: skip
    return Finding("supply_current", R.value if known else times, "ohm" if known else "", 0.0, found, mend, place,
                   channel="current")  # fmt: skip


def unsigned_current(records: Records) -> Iterator[Finding]:
    """A current without its sign: with the reconstructed sign it leaves far less of the voltage unexplained."""
    for test, current in records.currents.items():
        channels = [t.channels["current"] for t in records.tests[test] if "current" in t.channels]
        rows = (current.sign < 0.0) & (current.motor.volts < 0.0)
        one_sign = all(float(np.min(c.value)) >= -BELOW * max(c.sigma, c.quantum) for c in channels)
        better = current.better(current.unsigned, 0.5, rows) if rows.sum() >= NEGATIVE and one_sign else None
        if better is not None and better[0] > TIMES:
            yield Finding(
                "unsigned_current", int(rows.sum()) / rows.size, "", 0.0,
                f"In {test} '{channels[0].header}' has lost its sign: it is never below zero, though the voltage "
                f"drives the motor backwards in {int(rows.sum())} of {rows.size} stretches; with the sign of the "
                f"voltage less the EMF it leaves {better[0]:.0f} times less of the voltage unexplained there.",
                "Log the current with a sensor that shows its sign; until then map the column to \"ignore\" under "
                "[columns], or empty its cells where the current flows backwards.", test, channel="current", sure=True,
            )  # fmt: skip


def switched_voltage(records: Records) -> Iterator[Finding]:
    """A voltage that shows the switching of a PWM."""
    for traces, found in records.where(_pwm_jumps):
        channel, jumps = next(t for t in traces if t.file in found).channels["voltage"], sum(found.values())
        highest = np.max(np.abs(channel.logged(channel.value)))
        yield found_in(found, traces, Finding(
            "switched_voltage", jumps, "jumps", 0.0,
            f"'{channel.header}' shows the switching of a PWM at single instants: it "
            f"is 0 or {highest:.3g} {channel.unit}, jumps {jumps} times, and the current does not follow.",
            "Log the duty and the supply instead ('duty [%]', and 'supply [V]' or [rig] supply_V in rig.toml), or the "
            "voltage behind a filter that is far slower than the PWM and far faster than the motor.",
            channel="voltage", sure=True,
        ))  # fmt: skip


def _pwm_jumps(trace: Measurement, config: RigConfig) -> int | None:
    """Number of jumps between the levels, where the voltage is that of a PWM; otherwise None."""
    voltage, current = trace.channels.get("voltage"), trace.channels.get("current")
    if voltage is None or current is None or voltage.value.size < PWM_SAMPLES:
        return None
    size = np.abs(voltage.value)
    level = float(np.median(size[size > 0.5 * np.max(size)]))
    high, low = (np.abs(size - at) < WITHIN * level for at in (level, 0.0))
    if level < LEVELS_APART * voltage.sigma or np.mean(high | low) < ON_LEVEL:
        return None
    levels = high[high | low]
    jumps = int(np.sum(levels[1:] != levels[:-1]))
    if jumps < LEAST_JUMPS or _explained(voltage, current) > FOLLOWS:
        return None
    windows = windows_of(trace, config)
    values = values_of(windows) if windows is not None else None
    if windows is None or values is None:
        return None
    return jumps if float(np.median(np.abs(left_by(values, windows)))) > MISSES * level else None


def _explained(voltage: Channel, current: Channel) -> float:
    """Share of the current's steps, without the part that its own past predicts, that the voltage explains."""
    i, v = current.value, on_times(voltage, current.time)
    last = np.column_stack([np.ones(i.size - 1), i[:-1]])[LAGS - 1 :]
    volts = np.column_stack([v[LAGS - j : v.size - j] for j in range(LAGS + 1)])
    steps = np.diff(i)[LAGS - 1 :]
    alone, both = (
        float(np.sum((steps - rows @ np.linalg.lstsq(rows, steps, rcond=None)[0]) ** 2))
        for rows in (last, np.column_stack([last, volts]))
    )
    return 1.0 - both / max(alone, 1e-300)


def coasting_bridge(records: Records) -> Iterator[Finding]:
    """A bridge that coasts in its off time: settled speeds that hardly grow with the voltage."""
    for test, traces in records.tests.items():
        if TEST_BY_NAME[test].boundary.terminals_open:
            continue
        speeds = [pair for trace in traces for pair in _speeds(trace, records.config)]
        for side in (1.0, -1.0):
            every = np.array(sorted((abs(v), abs(w)) for v, w in speeds if side * v > 0.0 and side * w > 0.0))
            # friction hides the bend at small voltages
            found = _concave(every) or _concave(every[len(every) // 2 :])
            if found is not None:
                share, error, low, high = found
                yield Finding(
                    "coasting_bridge", share, "", 0.0,
                    f"In {test} the settled speed hardly grows with the voltage: from {low:.3g} to {high:.3g} V it "
                    f"grows by {100.0 * share:.0f} +- {100.0 * error:.0f} % of a proportional growth. With friction "
                    "this share is 100 % or more, with the drag of air 50 % or more. A bridge that coasts in its off "
                    "time reduces it: where the current stops within a period of the PWM, the mean voltage is not duty "
                    "x supply.",
                    "Let the bridge short the motor in the off time (switch the inputs, not the enable pin: slow "
                    "decay), or log the mean voltage at the terminals; a limit of current or speed would look the "
                    "same.", test,
                )  # fmt: skip
                break


def _speeds(trace: Measurement, config: RigConfig) -> Iterator[tuple[float, float]]:
    """Voltage and settled speed of each plateau, V and rad/s; settled: equal before its last 15 %."""
    drive, speed = drive_voltage(trace, config), trace.channels.get("motor_speed")
    if drive is None or speed is None:
        return
    for plateau in plateaus(drive):
        earlier = Plateau(plateau.start, plateau.stop - 0.15 * (plateau.stop - plateau.start))
        late, before = plateau.settled(speed, 0.15), earlier.settled(speed, 0.15)
        if abs(late) > SPEED_NOISES * speed.sigma and abs(late - before) < SETTLED * abs(late):
            yield plateau.settled(drive), late


def _concave(pairs: np.ndarray) -> tuple[float, float, float, float] | None:
    """Share, its error, and the span of the voltages; None where the curve is not concave.

    Args:
        pairs: absolute values of voltage and speed, shape (n, 2).
    """
    if len(pairs) < SPEEDS:
        return None
    v, w = pairs.T
    low, high = float(v.min()), float(v.max())
    if high < SPEEDS_SPAN * low:
        return None
    (slope, _), covariance = np.polyfit(v, w, 1, cov=True)
    chord = float(np.mean(w) / np.mean(v))
    share, error = float(slope) / chord, float(np.sqrt(covariance[0, 0])) / chord
    return (share, error, low, high) if share + CONCAVE_ERRORS * error < CONCAVE else None
