"""Computes the most that the probability of a name may be, from what the final model leaves.

    credit_by_round, doubted_effects    share of the misfit at its place that an effect explains
    left_share                          share of the first model's misfit that has no name
    held_out_share                      share of the held-out traces' free-run error that all effects together explain
    largest_probability                 the limits that hold for any evidence

`probabilities` calls it with the reports of the rounds.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

from ..model.rig_effects import Place, rig_effect
from .findings import RoundReport, Whiteness
from .formula_errors import FORMULA_CEILING
from .settings import DiagnosisSettings

# ---- The share of the misfit at its place that a named effect explains, and the share left for other causes
#
# The residual of each round shows, by trace and channel, how far the misfit exceeds noise and the errors of inexact
# formulas (`formula_errors`). An effect that a round added lowers it by G. Another cause may explain: the misfit left
# at the end, R; and, for a mistake of the rig in one test or trace, the gains G_o of other mistakes there, because one
# unknown cause changes a trace in many ways, and two mistakes at one place are rare.
#
#     p <= G / (G + R + sum of G_o of other mistakes at its place)
#
# G and R are sums of n (rms^2 - 1) of the whitened residual over the samples where the effect acts: so a mistake in one
# trace must bring that trace to its noise, however much a folder of many traces gains. R of a white residual is 0. What
# inexact formulas take up in that residual beyond `FORMULA_CEILING` is added to R of an effect of the throttle:
# formulas 10 % off can imitate any effect that is no larger.
#
# Source: none. It replaces a fixed probability that a name is wrong.

LEAST_CREDIT = 0.5  # least share of the misfit at its place that a named effect must explain; see `credit_by_round`
LEAST_CREDIT_OF_A_MISTAKE = 0.7  # the same of a mistake of the rig, which leaves noise where it is what is wrong
FAR_CHI2 = 10.0  # chi2 above noise a sample of a model that is far from the data

UNSAID = "stays in the model but is not named: another cause is likelier to explain the same misfit."

_EVERYWHERE = Place()


def credit_by_round(
    rounds: Sequence[RoundReport], added: Collection[str], corrected: Collection[str] = ()
) -> list[float]:
    """For each round the largest probability that the effect it added may have, from 0 to 1.

    It is 1 where the share explained is unknown: there is no later round, or the effect did not stay in the model.

    Args:
        corrected: effects whose formulas a curve corrects.
    """
    return [_credit(k, rounds, added, bool(corrected)) for k in range(len(rounds))]


def doubted_effects(
    rounds: Sequence[RoundReport], added: Collection[str], corrected: Collection[str] = ()
) -> list[str]:
    """Effects that stay in the model but are not named, because another cause is likelier.

    Args: as of `credit_by_round`.
    """
    believed = zip(rounds, credit_by_round(rounds, added, corrected), strict=True)
    return [str(each.added) for each, credit in believed if credit < _least_credit(each.added)]


def _least_credit(name: str | None) -> float:
    return LEAST_CREDIT if name is None or rig_effect(name) is None else LEAST_CREDIT_OF_A_MISTAKE


def left_share(rounds: Sequence[RoundReport], doubted: Collection[str] = ()) -> float:
    """Share of the first model's misfit above noise that has no name, from 0 to 1: the misfit of the last model, what
    formula errors take up in it, and the share that effects in doubt explain."""
    first, last = rounds[0].evidence.rows, rounds[-1].evidence.rows
    left = 0.0 if rounds[-1].evidence.white else sum(map(_chi2_left, last))
    left += _taken_up_by_formulas(rounds)
    left += sum(_gain(k, rounds, _EVERYWHERE) for k in range(len(rounds) - 1) if rounds[k].added in doubted)
    return left / max(left, sum(map(_excess, first)), 1e-300)


def _credit(k: int, rounds: Sequence[RoundReport], added: Collection[str], corrected: bool) -> float:
    name = rounds[k].added
    if name is None or name not in added or k + 1 == len(rounds):
        return 1.0
    place = _place(name)
    own = _gain(k, rounds, place)
    others = [j for j in range(len(rounds) - 1) if j != k and rounds[j].added in added]
    of_a_formula = corrected and rig_effect(name) is None
    elsewise = 0.0 if of_a_formula else sum(_chi2_left(row) for row in rounds[-1].evidence.rows if _is_at(row, place))
    elsewise += 0.0 if rig_effect(name) else _taken_up_by_formulas(rounds)
    elsewise += sum(_gain(j, rounds, place) for j in others if _in_one_test(_place(str(rounds[j].added)), place))
    return own / (own + elsewise) if elsewise else 1.0


def _taken_up_by_formulas(rounds: Sequence[RoundReport]) -> float:
    """chi2 of the last model that formula errors take up, beyond what may be put down to them."""
    last = rounds[-1]
    if last.chi2_per_sample is None:
        return 0.0
    n = sum(row.n for row in last.evidence.rows)
    above_noise = n * (last.chi2_per_sample - 1.0 - FORMULA_CEILING)
    return max(0.0, above_noise - max(0.0, sum(map(_excess, last.evidence.rows))))


def _in_one_test(one: Place, other: Place) -> bool:
    return _test(one) == _test(other) != ""


def _gain(k: int, rounds: Sequence[RoundReport], place: Place) -> float:
    """Fall of chi2 of the samples at a place in a round; 0 where chi2 rose.

    Where it rose far from the data, because every model has weights of its own there, it is the fall until the end."""
    before, after, end = (
        sum(_excess(row) for row in rounds[j].evidence.rows if _is_at(row, place)) for j in (k, k + 1, -1)
    )
    far = before > FAR_CHI2 * sum(row.n for row in rounds[k].evidence.rows)
    return max(0.0, before - (end if far and after > before else after))


def _excess(row: Whiteness) -> float:
    return row.n * (row.rms**2 - 1.0)


def _chi2_left(row: Whiteness) -> float:
    return 0.0 if row.white else max(0.0, _excess(row))


def _place(name: str) -> Place:
    """The place where an effect acts; an effect of the throttle acts everywhere."""
    effect = rig_effect(name)
    return _EVERYWHERE if effect is None else effect.place


def _test(place: Place) -> str:
    return place.test or place.file.partition("/")[0]


def _is_at(row: Whiteness, place: Place) -> bool:
    return (not place.file or row.file == place.file) and (not place.test or row.test == place.test)


# ---- The most that any name may have, however strong its evidence


MISFIT_LEFT = 0.05  # chi2 above noise a sample, left at the end, from which on another cause is at work
BESIDE_A_MISFIT = 0.3  # most probability of a mistake of the rig there
LARGE_MISFIT = 3.0  # chi2 a sample of the last model, formulas taken as exact, from which on it is not the right one
BESIDE_A_LARGE_MISFIT = 0.7  # most probability of any effect there
STRAYING = 5.0  # chi2 a sample up to which the free run of held-out traces strays without any effect


def largest_probability(
    name: str | None, rounds: Sequence[RoundReport], curve: bool, settings: DiagnosisSettings
) -> float:
    """The largest probability that an effect may have, however strong its evidence.

    It is smaller for a mistake of the rig where more than noise is left, for any effect where a model near its data
    leaves far more, and for an effect of the throttle where the free run of the held-out traces strays as before
    (`held_out_share`). Held-out traces need not show a mistake of the rig.
    """
    of_the_rig = name is not None and rig_effect(name) is not None
    imitates = of_the_rig and (curve or leaves_more_than_noise(rounds))
    most = BESIDE_A_MISFIT if imitates else BESIDE_A_LARGE_MISFIT if _leaves_far_more(rounds) else 1.0
    return min(most, 1.0 if of_the_rig else held_out_share(rounds), 1.0 - settings.lapse)


def held_out_share(rounds: Sequence[RoundReport]) -> float:
    """Share of the held-out traces' free-run error that all effects together explain, from 0 to 1.

        G / (G + max(0, chi2 - 5)),    G = max(0, chi2 before all rounds - chi2) + 1

    in units of the noise, chi2 being that of the last model a sample; 5 is `STRAYING`, which folders with nothing to
    find reach. 1 where nothing is held out, and where no round was left to begin with the last effect.
    """
    first, last = rounds[0].holdout_rms, rounds[-1].holdout_rms
    if first is None or last is None or rounds[-1].added is not None:
        return 1.0
    explained = max(0.0, first**2 - last**2) + 1.0
    return explained / (explained + max(0.0, last**2 - STRAYING))


def leaves_more_than_noise(rounds: Sequence[RoundReport]) -> bool:
    """Whether the last model leaves more than `MISFIT_LEFT` of chi2 above noise a sample."""
    last = rounds[-1].evidence.rows
    return sum(map(_chi2_left, last)) > MISFIT_LEFT * sum(row.n for row in last)


def _leaves_far_more(rounds: Sequence[RoundReport]) -> bool:
    """Whether the last model is near its data and leaves more than `LARGE_MISFIT`."""
    last = rounds[-1]
    return last.added is None and last.chi2_per_sample is not None and last.chi2_per_sample > LARGE_MISFIT
