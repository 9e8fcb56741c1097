"""P(effect | data), "nothing" and "unexplained" on one scale, from the rounds of a diagnosis.

In a round that added an effect every effect refitted competes with adding nothing, by Schwarz's approximation of the
Laplace evidence,

    w_e = exp(-change of BIC / (2 T)),    w_nothing = 1,    p_e = (1 - lapse) w_e / sum of all w

T tempers it: residuals that are not white, and formulas that are not exact, make BIC surer than it should be. `lapse`
is how often a name is wrong however strong its evidence, for the truth may lie outside the catalogue. Over rounds an
effect is there unless none of them puts it there. How well they are calibrated: docs/validation/probabilities.md.

Source: Kass and Raftery 1995, eq. 9 (BIC as evidence). Differs from source: tempered, and with a lapse.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence

from .findings import RoundReport
from .settings import DiagnosisSettings

NOTHING, UNEXPLAINED = "nothing", "unexplained"


def probabilities(
    rounds: Sequence[RoundReport], added: Collection[str], curve: bool, settings: DiagnosisSettings
) -> Mapping[str, float]:
    """Of every effect that was refitted, of "nothing" and of "unexplained", each from 0 to 1.

    They are those of statements that do not exclude each other: two effects may both be there. "nothing" says that
    nothing is missing which these data show: what is too faint for them is not denied.

    Args:
        rounds: of the diagnosis.
        added: the effects that are in its final model and not in doubt.
        curve: whether a curve without a name was found.
        settings: `bic_temper` and the lapses.
    """
    named: dict[str, float] = {}
    for each in rounds:
        for effect, p in _in_round(each, settings).items():
            named[effect] = 1.0 - (1.0 - named.get(effect, 0.0)) * (1.0 - p)
    # what was taken away again, or is in doubt, is no more than what was never added
    withdrawn = {e.added for e in rounds if e.added is not None} - set(added)
    named |= {effect: min(named.get(effect, 1.0), settings.missed) for effect in withdrawn}
    noise = rounds[-1].evidence.white
    silent = not added and not curve and noise
    return {
        **dict(sorted(named.items(), key=lambda item: -item[1])),
        NOTHING: 1.0 - settings.missed if silent else settings.lapse * math.prod(1.0 - p for p in named.values()),
        UNEXPLAINED: settings.missed if silent else _left(bool(added), curve, noise, settings),
    }


def besides(name: str, found: Mapping[str, float], settings: DiagnosisSettings) -> Mapping[str, float]:
    """The same where something else was proven before the rounds: it is there but for a lapse, and "nothing" is not."""
    return {name: 1.0 - settings.lapse, **found, NOTHING: settings.lapse * found[NOTHING]}


def _left(named: bool, curve: bool, noise: bool, settings: DiagnosisSettings) -> float:
    """Probability that something is left which has no name."""
    if curve or not (named or noise):
        return 1.0 - settings.lapse
    return settings.lapse if noise else settings.left_beside_names


def _in_round(each: RoundReport, settings: DiagnosisSettings) -> dict[str, float]:
    """Of the effects refitted in one round; of those that the held-out traces contradict, as of those that are not
    worth their parameters, no more than `missed` all together."""
    changes = {c.effect: c.bic_change for c in each.candidates if c.bic_change is not None}
    best = changes.get(each.added, 0.0) if each.added is not None else 0.0
    weights = {e: math.exp(0.5 * (best - max(b, best)) / settings.bic_temper) for e, b in changes.items()}
    if each.added is None:
        return {e: settings.missed * w / (sum(weights.values()) + 1.0) for e, w in weights.items()}
    standing = {e: w for e, w in weights.items() if e == each.added or e in each.ties or changes[e] >= best}
    total = sum(standing.values()) + math.exp(0.5 * min(best, 0.0) / settings.bic_temper)
    return {e: (1.0 - settings.lapse) * standing.get(e, 0.0) / total for e in changes}
