"""Expresses proposed gains for an ECU that publishes no unit of its gains: relative to the gains or the stability limit
that its user knows.

The user states them as `present` of a design (`Task.present`). `reporting` prints `sentences`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

from ..errors import UsageError
from ..model.ecu import Terms
from .pid import Gains, Refusal, Task
from .pid.formulas import Ultimate, ultimate

PRESENT = (*Terms._fields, "swings_at")  # numbers of the ECU that a user may state


class Share(NamedTuple):
    """One proposed gain, relative to known gains."""

    of_present: float | None  # over the present gain of the ECU; None where that is unknown
    value: float | None  # in the ECU's own number; None where the meaning of its numbers is unknown
    of_ultimate: float | None  # over the ultimate gain, at which P alone makes the plate oscillate; None for I and D
    seconds: float | None  # for I Kp / Ki, for D Kd / Kp; None for P, and where the gain is 0
    ratio: str = ""  # meaning of `seconds` in words

    @property
    def known(self) -> dict[str, float | None]:
        """All of these except the value, by name."""
        return {"of_present": self.of_present, "of_ultimate": self.of_ultimate, "seconds": self.seconds}

    @property
    def shown(self) -> tuple[float, str]:
        """The most useful known one of these, and its unit in words."""
        if self.value is not None:
            return self.value, "in its own number"
        if self.of_present is not None:
            return self.of_present, "times yours"
        if self.of_ultimate is not None:
            return self.of_ultimate, "times the P at which P alone becomes unstable"
        return (0.0, "") if self.seconds is None else (self.seconds, f"s ({self.ratio})")


def checked(present: Mapping[str, float]) -> Mapping[str, float]:
    """The present gains of an ECU as given, checked.

    Raises:
        UsageError: a name that is not in `PRESENT`, or a number below 0.
    """
    if unknown := sorted(set(present) - set(PRESENT)):
        raise UsageError(f"present: {', '.join(unknown)} is none of {', '.join(PRESENT)}.")
    if below := [f"{name} {value:g}" for name, value in present.items() if not 0.0 <= value < float("inf")]:
        raise UsageError(f"present: {', '.join(below)}: a gain is 0 or more. Turn the sign of the motor instead.")
    return present


def shares(task: Task, gains: Gains) -> tuple[Share, Share, Share]:
    """Proposed P, I and D relative to known gains.

        of_present = K / K_now,   value = of_present times the present number,   of_ultimate = Kp / K_u

    K_now are the gains of the ECU that drove the logs, from [ecu] of rig.toml or from the fit. Where they are unknown,
    the P at which P alone makes the plate oscillate gives the meaning of the ECU's number of P: K_u over that number.
    """
    now = task.as_found if isinstance(task.as_found, Gains) else None
    most, swings_at = ultimate(task.plant, task.ecu.late), task.present.get("swings_at")
    of_ultimate = float(gains.Kp / most.gain) if isinstance(most, Ultimate) else None
    found = []
    for k, name in enumerate(Terms._fields):
        have, number = None if now is None or not now[k] > 0.0 else now[k], task.present.get(name)
        ratio = None if have is None else float(gains[k] / have)
        value = None if ratio is None or not number else ratio * number
        if name == "P" and value is None and of_ultimate is not None and swings_at:
            value = of_ultimate * swings_at
            ratio = value / number if number and ratio is None else ratio
        times = {"P": (0.0, 0.0), "I": (gains.Kp, gains.Ki), "D": (gains.Kd, gains.Kp)}[name]
        seconds = float(times[0] / times[1]) if times[0] > 0.0 and times[1] > 0.0 else None
        found.append(Share(ratio, value, of_ultimate if name == "P" else None, seconds,
                           {"P": "", "I": "P over I", "D": "D over P"}[name]))  # fmt: skip
    return found[0], found[1], found[2]


def sentences(task: Task, gains: Gains, title: str) -> Iterator[str]:
    """Sentences on the meaning of the shares, the distance of the present P from instability, and how to find unknown
    gains."""
    P, *rest = shares(task, gains)
    most, swings_at, number = ultimate(task.plant, task.ecu.late), task.present.get("swings_at"), task.present.get("P")
    yield f"{title} publishes no unit of its gains: they are given relative to the gains that you know"
    if isinstance(most, Refusal):
        yield most.why
    elif P.of_present is not None:
        reserve = most.gain / float(gains.Kp) * P.of_present
        yield (f"P alone becomes unstable at about {reserve:.2g} times yours (I and D at 0, a plate without dry "
               f"friction); proposed is {P.of_present:.2g} times yours")  # fmt: skip
        if swings_at and number and isinstance(task.as_found, Gains):
            yield f"by the model your plate oscillates at a P of {reserve * number:.3g}; you found {swings_at:g}"
    else:
        yield (f"P alone becomes unstable at about {most.gain / float(gains.Kp):.2g} times the proposed P. Set I and D "
               "to 0, raise P on the bench until the plate keeps oscillating, and give that number as --swings-at: "
               "then P is given in the ECU's own number")  # fmt: skip
    if any(each.of_present is None for each in rest):
        yield ("I and D are times: P over I, and D over P. For shares of yours write [ecu] in rig.toml with P, I and D "
               '"free" and fit logs that have a setpoint: the fit finds your gains; --present P,I,D states your '
               "numbers of them")  # fmt: skip
