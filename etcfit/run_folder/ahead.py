"""What is put ahead of the PID beside a table: for pid.json, and as lines for the code of one who writes his own."""

from __future__ import annotations

from typing import Any

from ..control.design import Design
from ..control.pid.feedforward import Sliding
from ..model.feed_forward import Term, listed


def ahead_json(design: Design) -> dict[str, Any]:
    """Terms with which the gains were found; the numbers of those that follow the setpoint's rate, asked for or not."""
    sliding = design.sliding
    return {
        "terms": listed(design.terms),
        "friction": {
            "opening_V": sliding.opening,
            "closing_V": sliding.closing,
            "full_from_rad_per_s": sliding.full,
        },
        "rate": {"V_s_per_rad": sliding.slope},
        "rate_filter_s": design.task.ecu.filter,
    }


def code(design: Design) -> list[str]:
    """Lines of C that a user runs at each tick behind the PID, all in % of duty and of the travel; none without terms.

    `target` and `output` are the setpoint and what the PID made of it; `rate` begins at 0 and `before` at the target;
    `constrain(x, low, high)` is Arduino's, and `table` the bias table.
    """
    sliding, ecu, body = design.task.loop.sliding, design.task.ecu, design.task.loop.body
    if sliding is None:
        return []
    travel = body.upper - body.lower
    spring = "table(target) + " if Term.SPRING in design.terms else ""
    most = 100.0 * ecu.duty
    return [
        f"rate = ({ecu.filter:g} * rate + target - before) / {ecu.filter + ecu.period:g};",
        "before = target;",
        f"ahead = {spring}{_formula(sliding, ecu.supply, travel)};",
        f"duty = constrain(output + ahead, {-most:g}, {most:g});",
    ]


def _formula(sliding: Sliding, supply: float, travel: float) -> str:
    """See `Sliding`; its terms that are 0 are left out."""
    volts, per_second = 100.0 / supply, 100.0 / travel
    full = f"{per_second * sliding.full:.6g}"
    parts = []
    if sliding.opening or sliding.closing:
        parts += [f"{volts * sliding.opening:.6g} * constrain(rate / {full}, 0, 1)",
                  f"{-volts * sliding.closing:.6g} * constrain(-rate / {full}, 0, 1)"]  # fmt: skip
    if sliding.slope:
        parts.append(f"{volts * sliding.slope / per_second:.6g} * rate")
    return " + ".join(parts)
