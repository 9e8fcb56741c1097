"""Gains of an ECU whose unit is not published: shares of what its user knows, no numbers with a unit made up."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

from ..errors import UsageError
from ..model.ecu import Terms
from .pid import Gains, Refusal, Task
from .pid.formulas import Ultimate, ultimate

PRESENT = (*Terms._fields, "swings_at")  # what a user may know, in the ECU's own numbers


class Share(NamedTuple):
    """One proposed gain."""

    of_present: float | None  # over the one that the ECU has now; None where that is not known
    value: float | None  # in the ECU's own number; None where it is unknown what one of its numbers means
    of_ultimate: float | None  # over the P at which P alone makes the plate swing on; None of I and D
    seconds: float | None  # of I Kp / Ki, of D Kd / Kp; None of P, and where the gain is 0
    ratio: str = ""  # what `seconds` is, in words

    @property
    def known(self) -> dict[str, float | None]:
        """All of these but the value, by name."""
        return {"of_present": self.of_present, "of_ultimate": self.of_ultimate, "seconds": self.seconds}

    @property
    def shown(self) -> tuple[float, str]:
        """The most useful of these that is known, and what it is a number of."""
        if self.value is not None:
            return self.value, "in its own number"
        if self.of_present is not None:
            return self.of_present, "times yours"
        if self.of_ultimate is not None:
            return self.of_ultimate, "times the P at which P alone becomes unstable"
        return (0.0, "") if self.seconds is None else (self.seconds, f"s ({self.ratio})")


def checked(present: Mapping[str, float]) -> Mapping[str, float]:
    """What is known of an ECU's gains, as given.

    Raises:
        UsageError: a name that is none of `PRESENT`, or a number below 0.
    """
    if unknown := sorted(set(present) - set(PRESENT)):
        raise UsageError(f"present: {', '.join(unknown)} is none of {', '.join(PRESENT)}.")
    if below := [f"{name} {value:g}" for name, value in present.items() if not 0.0 <= value < float("inf")]:
        raise UsageError(f"present: {', '.join(below)}: a gain is 0 or more. Turn the sign of the motor instead.")
    return present


def shares(task: Task, gains: Gains) -> tuple[Share, Share, Share]:
    """Proposed P, I and D against what is known.

        of_present = K / K_now,   value = of_present times the present number,   of_ultimate = Kp / K_u

    K_now are the gains of the ECU that drove the logs, as [ecu] of rig.toml has them or the fit finds them. Where they
    are not known, the P at which P alone swings on tells what one of the ECU's numbers of P means: K_u over it.
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


def said(task: Task, gains: Gains, title: str) -> Iterator[str]:
    """What the shares mean, how far the present P is from instability, and how to learn what is not known."""
    P, *rest = shares(task, gains)
    most, swings_at, number = ultimate(task.plant, task.ecu.late), task.present.get("swings_at"), task.present.get("P")
    yield f"{title} publishes no unit of its gains: they are given against what you know of them"
    if isinstance(most, Refusal):
        yield most.why
    elif P.of_present is not None:
        reserve = most.gain / float(gains.Kp) * P.of_present
        yield (f"P alone becomes unstable at about {reserve:.2g} times yours (I and D at 0, a plate without dry "
               f"friction); proposed is {P.of_present:.2g} times yours")  # fmt: skip
        if swings_at and number and isinstance(task.as_found, Gains):
            yield f"by the model yours would swing on at a P of {reserve * number:.3g}; you found {swings_at:g}"
    else:
        yield (f"P alone becomes unstable at about {most.gain / float(gains.Kp):.2g} times the proposed P. Set I and D "
               "to 0, raise P on the bench until the plate swings on, and give that number as --swings-at: then P is "
               "given in the ECU's own number")  # fmt: skip
    if any(each.of_present is None for each in rest):
        yield ("I and D are times: P over I, and D over P. For shares of yours write [ecu] in rig.toml with P, I and D "
               '"free" and fit logs that have a setpoint: the fit finds your gains; --present P,I,D gives your numbers '
               "for them")  # fmt: skip
