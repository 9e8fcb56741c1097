"""Engine computers with an unpublished controller: what their makers state, and assumptions for the rest."""

from __future__ import annotations

from functools import partial

from ..ecu import Notation
from .profile import NOT_DIVIDED, BiasTable, EcuProfile, Limit, Scheduling

_NO_UNIT_NO_CLOCK = (
    "gains in % of duty over % of travel, per s and times s; the help names no unit: set the proportional gain "
    "alone first and see that an error of 1 % gives as many % of duty",
    "clock and derivative filter as the options and [ecu] of rig.toml say; the help names neither",
)
LINK = EcuProfile(
    name="link",
    title="Link G4X/G5",
    source="Link, PCLink help for G4X: E-Throttle, and its first-time setup (a PID behind a PWM output with DC clamp "
    "values, tables of target positions)",
    notation=Notation("%", "%"),
    gains=("Proportional Gain", "Integral Gain", "Derivative Gain"),
    fixes={},
    assumes={"duty": 1.0},
    assumed=(
        *_NO_UNIT_NO_CLOCK,
        "the PID of the textbook: a derivative of the error, an integral that stops at the DC clamp",
        "no feed-forward: none is described",
    ),
    limits=(Limit("DC clamp", "%", lambda ecu, travel: 100.0 * ecu.duty),),
)
"""Closed: the help says what the settings are, not what the controller computes."""


EMTRON = EcuProfile(
    name="emtron",
    title="Emtron",
    source="Emtron, help: DBW Closed Loop Control (DBW PID Setup) and DBW Closed Loop tables",
    notation=Notation("%", "%"),
    gains=("DBW Proportional Gain Table", "DBW Integral Gain Table", "DBW Derivative Gain Table"),
    fixes={"derivative_weight": 1.0},
    assumes={"duty": 1.0, "integral": 1.0},
    assumed=(
        *_NO_UNIT_NO_CLOCK,
        "an integral that runs on up to its limit, and a feed-forward table of 8 points",
        "one number in every cell of the gain tables; no target filter, no dead band of the output",
    ),
    limits=(
        Limit("DBW Min Duty Clamp Table", "%", lambda ecu, travel: -100.0 * ecu.duty),
        Limit("DBW Max Duty Clamp Table", "%", lambda ecu, travel: 100.0 * ecu.duty),
        Limit("DBW Neg Integral Limit Table", "%", lambda ecu, travel: -100.0 * min(ecu.integral or 1.0, 1.0)),
        Limit("DBW Pos Integral Limit Table", "%", lambda ecu, travel: 100.0 * min(ecu.integral or 1.0, 1.0)),
        Limit("DBW Deadband +/-", "%", lambda ecu, travel: 0.0),
        Limit("DBW Target Filter", "ms", lambda ecu, travel: 0.0),
    ),
    bias=BiasTable("target", "DBW Feed Forward %DC Table"),
    scheduling=Scheduling.TABLE,
)
"""The help's own words: derivative "gain is based on the rate of change of error"; limits "the maximum I gain
compensation used by the closed loop system", and the minimum; clamps "the minimum duty cycle that can be used"; "a Feed
Forward Table to provide a base duty for the PID function"; within the dead band "the output control signal is held
constant", which `Ecu` does not know: it is written as 0. Of each gain: "this table can be expanded into 3D (X axis
enabled), and any runtime can be used", with an example in which the proportional gain "is spanned across Battery
Voltage". The firmware is closed.
"""


# a make that publishes no unit of its gains
_unpublished = partial(
    EcuProfile, notation=None, gains=("proportional", "integral", "derivative"), fixes={},
    assumes={"duty": 1.0, "compensated": 0.0},
)  # fmt: skip


def _assumed(looked_in: str, *further: str) -> tuple[str, ...]:
    """What is assumed of such a make; `looked_in`: what names neither clock nor filter."""
    return (f"clock and derivative filter as the options and [ecu] of rig.toml say: {looked_in} neither",
            "the PID of the textbook: a derivative of the error, an integral that stops at the duty's limit",
            "a duty of up to 100 %", NOT_DIVIDED, *further)  # fmt: skip


MAXXECU = _unpublished(
    name="maxxecu",
    title="MaxxECU",
    source="MaxxECU online help, E-Throttle, Throttle control "
    "(https://www.maxxecu.com/webhelp/settings-ethrottle-throttle_control.html): a PID algorithm that drives "
    "the throttle, a test mode of constant duty; User PID "
    "(https://www.maxxecu.com/webhelp/output_functions-user_pid.html): P, I and D gain, a selectable filter "
    "of D; a user's report of P 60, I 80, D 120 with a gain multiplier of 10 and a feed-forward table, P "
    "alone unstable at about 120 "
    "(https://www.hpacademy.com/forum/general-tuning-discussion/show/drive-by-wire-tuning-maxxecu/)",
    gains=("P gain", "I gain", "D gain"),
    assumed=_assumed(
        "the help of the throttle names",
        "the gain multiplier stays what it is: shares of your gains hold with the same one only",
        "a feed-forward table of 8 points, % of duty over % of target",
    ),
    bias=BiasTable("target", "feed forward"),
)
"""Closed. The help names no unit of a gain; the multiplier of 10 shows that the numbers are not physical."""


ECUMASTER = _unpublished(
    name="ecumaster",
    title="ECUMaster EMU",
    source="a thread with settings of an EMU PRO: Rate max, the change of the target that is allowed, in %/s, and a "
    "table Spring force duty cycle base, the duty that holds the plate against its springs "
    "(https://hpacademy.com/forum/general-tuning-discussion/show/setting-up-brzs-throttle-using-ecumaster); "
    "no page of the maker that describes the controller was found",
    assumed=_assumed(
        "what was found names",
        "Rate max so large that it does not act: the gains are tried on steps of the target",
        "a spring force table of 8 points, % of duty over % of position; EMU Black's like that of EMU PRO",
        "gains called by what they are: what was found does not name them",
    ),
    bias=BiasTable("position", "Spring force duty cycle base"),
)
"""Closed. At Rate max the target is a ramp: 800 %/s, as in the thread, opens in an eighth of a second."""


HALTECH = _unpublished(
    name="haltech",
    title="Haltech Elite/Nexus",
    source="Haltech support, Drive By Wire, Elite "
    "(https://support.haltech.com/portal/en/kb/articles/drive-by-wire-elite): two sensors each of pedal and throttle, "
    "the direction of the motor found by the calibration, the motor cut on a fault; nothing of the controller",
    assumed=_assumed(
        "the article names",
        "no feed-forward: none is described",
        "gains called by what they are: the article does not name them; Nexus like Elite",
    ),
)
"""Closed."""


MOTEC = _unpublished(
    name="motec",
    title="MoTeC M1",
    source="a thread that quotes MoTeC's procedure for M1 "
    "(https://www.hpacademy.com/forum/general-tuning-discussion/show/motec-m1-pid-feed-forward): a Feed "
    "Forward table over the throttle position, sites around every 20 %, 0 and 100 among them, one each 2 % "
    "below and above the position in power save, negative below it and positive above, 0 where the springs "
    "change over, in the unit of Motor Output Duty Cycle",
    gains=("Proportional Gain", "Integral Gain", "Derivative Gain"),
    assumed=_assumed(
        "the thread names",
        "the names of the gains; the thread does not name them",
        "a feed-forward table of 8 sites",
    ),
    bias=BiasTable("Throttle Position", "Feed Forward"),
)
"""Closed. Six sites every 20 % and two about the change of springs are eight, the number chosen here; their places
minimise the error of the holding duty."""


SYVECS = _unpublished(
    name="syvecs",
    title="Syvecs",
    source="no public page of Syvecs that describes its throttle controller was found (November 2026); everything "
    "here is assumed",
    assumed=_assumed(
        "nothing that was found names",
        "no feed-forward: none is known of",
        "gains called by what they are",
    ),
)
"""Closed; its help comes with its program and was not read."""
