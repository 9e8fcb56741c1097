"""MaxxECU."""

from __future__ import annotations

from .profile import NOT_DIVIDED, BiasTable, EcuProfile

MAXXECU = EcuProfile(
    name="maxxecu",
    title="MaxxECU",
    source="MaxxECU online help, E-Throttle, Throttle control "
    "(https://www.maxxecu.com/webhelp/settings-ethrottle-throttle_control.html): a PID algorithm that drives "
    "the throttle, a test mode of constant duty; User PID "
    "(https://www.maxxecu.com/webhelp/output_functions-user_pid.html): P, I and D gain, a selectable filter "
    "of D; a user's report of P 60, I 80, D 120 with a gain multiplier of 10 and a feed-forward table, P "
    "alone unstable at about 120 "
    "(https://www.hpacademy.com/forum/general-tuning-discussion/show/drive-by-wire-tuning-maxxecu/)",
    notation=None,
    gains=("P gain", "I gain", "D gain"),
    fixes={},
    assumes={"duty": 1.0, "compensated": 0.0},
    assumed=(
        "clock and derivative filter as the options and [ecu] of rig.toml say: the help of the throttle names neither",
        "the PID of the textbook: a derivative of the error, an integral that stands still at the duty's limit",
        "a duty of up to 100 %",
        NOT_DIVIDED,
        "the gain multiplier stays what it is: shares of your gains hold with the same one only",
        "a feed-forward table of 8 points, % of duty over % of target",
    ),
    bias=BiasTable("target", "feed forward"),
)
"""Closed. The help names no unit of a gain; the multiplier of 10 alone says that the numbers are no physical ones."""
