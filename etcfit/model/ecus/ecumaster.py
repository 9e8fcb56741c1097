"""ECUMaster EMU Black and EMU PRO."""

from __future__ import annotations

from .profile import NOT_DIVIDED, BiasTable, EcuProfile

ECUMASTER = EcuProfile(
    name="ecumaster",
    title="ECUMaster EMU",
    source="a thread with settings of an EMU PRO: Rate max, the change of the target that is allowed, in %/s, and a "
    "table Spring force duty cycle base, the duty that holds the plate against its springs "
    "(https://hpacademy.com/forum/general-tuning-discussion/show/setting-up-brzs-throttle-using-ecumaster); "
    "no page of the maker that describes the controller was found",
    notation=None,
    gains=("proportional", "integral", "derivative"),
    fixes={},
    assumes={"duty": 1.0, "compensated": 0.0},
    assumed=(
        "clock and derivative filter as the options and [ecu] of rig.toml say: what was found names neither",
        "the PID of the textbook: a derivative of the error, an integral that stands still at the duty's limit",
        "a duty of up to 100 %",
        NOT_DIVIDED,
        "Rate max so large that it does not act: the gains are tried on steps of the target",
        "a spring force table of 8 points, % of duty over % of position; EMU Black's like that of EMU PRO",
        "gains called by what they are: what was found does not name them",
    ),
    bias=BiasTable("position", "Spring force duty cycle base"),
)
"""Closed. At Rate max the target is a ramp: 800 %/s, as in the thread, opens in an eighth of a second."""
