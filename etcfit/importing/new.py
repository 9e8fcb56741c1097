"""A folder for a new rig: a rig.toml that explains every key, and a folder for each rig test."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path

from ..datasets.base import refuse_to_overwrite, write_folder
from ..errors import UsageError
from ..rig import TESTS
from ..rig.base import AbstractRigTest
from ..rig.toml import closest

UNKNOWN = "..."  # invalid TOML: the reader stops at this line until it is filled in


@dataclass(frozen=True)
class Nameplate:
    """Values on a throttle or in its data sheet; a text where a number must be filled in."""

    title: str  # `name` in rig.toml
    source: str  # source of the values
    # gear_ratio, supply_V: N; V
    gear_ratio: str = UNKNOWN
    supply_V: str = "12.0"
    travel_deg: str = "[0.0, 90.0]"  # closed and open stop
    # closed_V, open_V: reading of the position sensor at these stops
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
# rig test -> how to record one trace of it; a new rig test without an entry has only its list of signals
RECORD: dict[str, str] = {
    "resistance": "Hold the plate. Put on 4 to 7 constant voltages, 0.5 to 3 V, a file each, half a second at 1 kHz.",
    "inductance": "Hold the plate. Step from 0 to 1 V; sample at 20 kHz or more, 20 ms with 2 ms before the step.",
    "back_emf": "Open the terminals. Hold the plate open by hand, start the log, let go; 1 kHz, half a second.",
    "static_load": "Raise the voltage slowly from 0 until the plate is open, lower it again: 10 s each way, 250 Hz.",
    "viscous": "Take the gear apart. Step the motor to 2 to 12 V, a file each, until its speed is constant; 1 kHz.",
    "inertia": "Open the terminals. Hold the plate open by hand, start the log, let go; 1 kHz, half a second.",
    "response": "Drive the plate by steps, a chirp, a multisine: 5 s each at 1 kHz; keep one file for [holdout].",
    "closed_loop": "Let the ECU follow steps and ramps of a setpoint on the bench; 100 Hz or more, 10 s.",
    "sine": "Let the ECU follow a sine setpoint, one file a frequency, 0.5 to 10 Hz, ten periods each.",
    "drive": "Log a drive in the car: time, position, setpoint; minutes.",
}


def new_folder(to: Path, like: str | None = None) -> Path:
    """Write rig.toml and a folder for each rig test, completely or not at all.

    Args:
        to: the folder; it must not exist, or be empty.
        like: a known nameplate; None for an empty one.
    Raises:
        UsageError: `to` is not empty, or the nameplate is unknown.
    """
    refuse_to_overwrite(to)
    if like is not None and like not in NAMEPLATES:
        known = f"Known: {', '.join(NAMEPLATES)}."
        raise UsageError(f"--like {like}: no such nameplate. {closest(like, NAMEPLATES, known)}")
    pages = {f"{test.name}/README.txt": how_to_record(test) for test in TESTS}
    return write_folder(to, {"rig.toml": template(ANY if like is None else NAMEPLATES[like]), **pages})


def how_to_record(test: AbstractRigTest) -> str:
    """Text of the README in the folder of a rig test."""
    needs = "; ".join(" or ".join(group) for group in test.needs)
    says = RECORD.get(test.name, "")
    return f"{test.title}. One CSV a trace.\n{says}\nNeeded: time; {needs}.\n"


def template(plate: Nameplate) -> str:
    """A rig.toml that explains every key; values to fill in are written as `...`, which the reader refuses."""
    fill = f"# Fill in every `{UNKNOWN}`; a line that you cannot fill in, put a # before it.\n"
    lacks = UNKNOWN in (plate.gear_ratio, plate.closed_V, plate.open_V)
    return _TEMPLATE.format(fill=fill if lacks else "", **asdict(plate))


_TEMPLATE = """\
# A rig: nameplate, sensors, what is known. Numbers: {source}.
{fill}# Lines behind # are examples: take the # away to use one. docs/reference/folder.md has every key.

[rig]
name = "{title}"
synthetic = false            # true: the data came from a simulation, and every report says so
gear_ratio = {gear_ratio}           # motor turns for one turn of the plate: count the teeth
supply_V = {supply_V}              # V, of the driver; used where a log has duty but no voltage
travel_deg = {travel_deg}    # closed and open stop; -inf and inf: no stop

# Position sensor, only for columns `tps [V]`. A sensor that falls while the plate opens: closed_V > open_V.
[tps]
closed_V = {closed_V}              # V, plate at its closed stop
open_V = {open_V}                # V, plate at its open stop
travel_deg = 90.0            # angle between the two, degrees

# Headers of your logger -> ours, `quantity [unit]`. A number before the unit turns a sign or scales: "current [-1 A]".
# Quantities: time voltage current tps position emf motor_speed setpoint duty supply torque temperature
[columns]
# "TP (Main) (V)" = "tps [V]"
# "Comment" = "ignore"

# Standard deviation of one sample; one that is missing is estimated from the data, and every result says so.
[noise]
# voltage_V = 0.01
# current_A = 0.01
# tps_V = 0.003

# How far a calibration may be off, which no trace can tell: it widens the intervals.
[accuracy]
# current = "1 % + 5 mA"     # a bound, as data sheets state it
# gear = "0.5 %"
# sensor_end_points = "0.5 deg"

# Extra resistance in the circuit of one test only (harness, shunt), ohm; "free": the fit finds it.
[tests.inductance]
series_ohm = "free"

# What is known, SI. K_m = "K_b" holds anyway: energy conservation ties them.
[parameters]
# J_L = {{ value = 0.0011, sd = 0.0002 }}   # a prior
# B_L = {{ fixed = 0.0 }}                   # held
# R_a = 1.5                               # where the fit starts if the data give nothing better

# Effects beyond Eqs. 1-2 that are known from the start; `etcfit diagnose` finds the others.
[model]
# effects = ["limp_home_spring"]

# Traces that are never fitted, only predicted and scored.
[holdout]
# files = ["response/drive_4.csv", "static_load/ramp_2.csv"]

# The controller of traces that log a setpoint and no voltage (closed_loop, sine, drive): take all five lines or none.
# [ecu]
# P = 4.0                    # a number is known, "free" is estimated
# I = "free"
# D = "free"
# unit = "%/%"               # output for an error of one
# period_ms = 1.0            # of its clock
# form = "seconds"           # "ticks": I per tick and D in ticks
# filter_ms = 2.0            # low-pass of the derivative
# delay_ms = 0.0             # from its reading to its output
# duty = 0.9                 # largest that it puts out, a share of the supply
# integral = 0.3             # largest that its integral may hold, likewise; leave it out where it has no such limit
# slew_V_per_s = 400.0       # largest change of its output; leave it out likewise
# dead_band_deg = 0.0        # error below which its integral is held
# setpoint_weight = 1.0      # 0: its P acts on the position alone
# derivative_weight = 1.0    # 0: its D does
# bias_percent = [[0, -20], [10, 0], [20, 18], [100, 25]]  # its bias table: % of the travel, % of duty
"""
