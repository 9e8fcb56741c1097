"""When a loop, a model or a pair of sensors is good enough: ONE table of thresholds for every command.

Each threshold states its origin: a source, or "assumed".
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Word = Literal["good", "not good", "cannot be said"]

_PAPER = "the paper, section 4.1"


@dataclass(frozen=True)
class Criterion:
    """A threshold: value <= limit is good; where `at_least`, value >= limit is good."""

    name: str  # what is judged, in words
    limit: float  # threshold, in `unit`
    unit: str  # of value and limit
    meaning: str  # how the value is computed
    source: str  # of the threshold
    at_least: bool = False  # the value must not be below the limit

    def judged(self, value: float | None, where: str = "", without: str = "", limit: float | None = None) -> Judgement:
        """A value compared with the threshold.

        Args:
            value: in `unit`; None where it is unknown; infinite where it has no end.
            where: the step, log or range of the value.
            without: why there is no value.
            limit: limit that replaces that of the criterion, where it depends on the log.
        """
        word: Word = "cannot be said"
        limit = self.limit if limit is None else limit
        if value is not None:
            word = "good" if (value >= limit if self.at_least else value <= limit) else "not good"
        return Judgement(self.name, value, limit, self.unit, word, where if value is not None else without,
                         self.source, self.at_least)  # fmt: skip


@dataclass(frozen=True)
class Judgement:
    """One value compared with its threshold."""

    name: str  # what is judged
    value: float | None  # in `unit`; None where it is unknown
    limit: float  # threshold
    unit: str  # of both
    word: Word  # "good", "not good" or "cannot be said"
    where: str  # the step or range at which the value was found, or why there is no value
    source: str  # of the threshold
    at_least: bool = False  # the value must not be below the limit

    @property
    def says(self) -> str:
        """One sentence."""
        if self.value is None:
            return f"{self.name[0].upper()}{self.name[1:]} cannot be said: {self.where}."
        size = "never reached" if self.value == float("inf") else f"{self.value:.3g} {self.unit}"
        bound = f"{'at least' if self.at_least else 'at most'} {self.limit:.3g} {self.unit}"
        place = f" ({self.where})" if self.where else ""
        return f"{self.name[0].upper()}{self.name[1:]}: {size}{place}; good is {bound} ({self.source})."


# definitions of settling, overshoot and steady-state error, the same for a log and for a simulated loop
SETTLED = 0.02  # of the change of the setpoint: within this error the plate counts as settled
TAIL = 0.25  # share of a level, at its end, over which the steady-state error is read
# the paper allows 0.2 % of the travel at rest on its trapezoid; that is negligible on a small step too
NEGLIGIBLE = 2e-3  # share of the travel: a smaller error counts as settled, however small the change
LEAST_OVERSHOT = 0.01  # share of the travel: the overshoot of a smaller change is divided by this
LEAST_HELD = 0.4  # likewise for the steady-state error

OVERSHOOT = Criterion("overshoot", 20.0, "%", "of the step, or of 1 % of the travel where that is more", _PAPER)
SETTLING = Criterion(
    "settling", 0.2, "s", "until the error stays within 2 % of the step, or 0.2 % of the travel", _PAPER
)
HELD = Criterion("error at rest", 0.5, "%", "of the step, or of 40 % of the travel where that is more", _PAPER)
RMSE = Criterion("tracking error", 1.53, "% of travel", "root mean square of position - setpoint (Eq. 9)",
                 "the paper, section 4.3: its final gains on the track; for faster setpoints the error of a loop that "
                 "settles in 0.2 s")  # fmt: skip
LAG = Criterion("lag", 0.1, "s", "delay of the setpoint that makes the error least", "assumed: half the settling")
FAR = 10.0  # % of travel
ASTRAY = Criterion(f"longest time off by more than {FAR:g} %", 1.0, "s", "|position - setpoint| of the travel",
                   "Formula SAE rules 2015, IC1.15.2: the throttle is shut off then")  # fmt: skip
CYCLE = Criterion("oscillation at rest", 100.0 * NEGLIGIBLE, "% of travel", "half of the peak-to-peak motion",
                  "the paper, section 4.1: error that it allows at rest")  # fmt: skip
ACTIVITY = Criterion("duty at rest", 5.0, "%", "standard deviation of the duty while the setpoint rests",
                     "assumed; design requires the same")  # fmt: skip
SATURATED = Criterion("duty at its limit while the setpoint rests", 1.0, "% of the time", "", "assumed")
APART = Criterion("sensors apart", 5.0, "% of travel", "largest difference of both sensors that lasts 0.1 s",
                  "rusEFI and FOME tolerate 5 %; Formula SAE rules 10 % for 0.1 s")  # fmt: skip
EXPLAINED = Criterion("motion explained", 95.0, "%", "1 - sum (y - y_hat)^2 / sum (y - mean y)^2 of the free run",
                      "assumed", at_least=True)  # fmt: skip


@dataclass(frozen=True)
class Verdict:
    """All judgements of one log.

    Without a tracking error the loop is not judged, however well its sensors agree.
    """

    judgements: tuple[Judgement, ...]  # in the order of `criteria`

    @property
    def word(self) -> Word:
        """ "not good" where one judgement is not good; "cannot be said" where there is no tracking error; else
        "good"."""
        if any(each.word == "not good" for each in self.judgements):
            return "not good"
        follows = any(each.name == RMSE.name and each.word == "good" for each in self.judgements)
        return "good" if follows else "cannot be said"

    @property
    def says(self) -> str:
        """The verdict in plain words, the reasons after it."""
        bad = [each for each in self.judgements if each.word == "not good"]
        unknown = [each.name for each in self.judgements if each.word == "cannot be said"]
        good = [each.name for each in self.judgements if each.word == "good"]
        if bad:
            text = f"Not good enough. {' '.join(each.says for each in bad)}"
        elif self.word == "good":
            text = f"Good enough in {', '.join(good)}."
        else:
            text = "Whether the loop is good enough cannot be said from this log."
        return f"{text} Not known from this log: {', '.join(unknown)}." if unknown else text
