"""MoTeC M1."""

from __future__ import annotations

from .profile import NOT_DIVIDED, BiasTable, EcuProfile

MOTEC = EcuProfile(
    name="motec",
    title="MoTeC M1",
    source="a thread that quotes MoTeC's procedure for M1 "
    "(https://www.hpacademy.com/forum/general-tuning-discussion/show/motec-m1-pid-feed-forward): a Feed "
    "Forward table over the throttle position, sites around every 20 %, 0 and 100 among them, one each 2 % "
    "below and above the position in power save, negative below it and positive above, 0 where the springs "
    "change over, in the unit of Motor Output Duty Cycle",
    notation=None,
    gains=("Proportional Gain", "Integral Gain", "Derivative Gain"),
    fixes={},
    assumes={"duty": 1.0, "compensated": 0.0},
    assumed=(
        "clock and derivative filter as the options and [ecu] of rig.toml say: the thread names neither",
        "the PID of the textbook: a derivative of the error, an integral that stands still at the duty's limit",
        "a duty of up to 100 %",
        NOT_DIVIDED,
        "the names of the gains; the thread does not name them",
        "a feed-forward table of 8 sites",
    ),
    bias=BiasTable("Throttle Position", "Feed Forward"),
)
"""Closed. Six sites every 20 % and two about the change of springs are eight, as many as are chosen here; ours lie
where they miss the holding duty least."""
