"""How much of the misfit where it acts a name answers for, and how much is left for something else.

Each round's residual says by trace and channel how much more than noise is left. A name found in one round lowers it
by G. What may be something else instead: what is left at the end, R; what the formulas of the other names may leave,
phi^2 G_o of each; and of a mistake in one test or trace what other mistakes explain there, for one thing that nobody
thought of bends a trace in many ways, and two people rarely err at one place.

    p <= G / (G + R + sum_o phi_o^2 G_o + sum of G_o of other mistakes at its place)

G and R are sums over the samples where the name acts, n (rms^2 - 1) of the whitened residual: so a mistake in one trace
must leave that trace at its noise, whatever a folder of many traces gains. A residual that is white leaves nothing.

Source: no. It takes the place of a fixed probability that a name is wrong.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

from ..model.rig_effects import Place, rig_effect
from ..problem.free_parameters import effect_named
from .findings import RoundReport, Whiteness
from .settings import DiagnosisSettings

UNSAID = "stays in the model and is not named: something else is likelier to explain what it does."

_EVERYWHERE = Place()


def credits(rounds: Sequence[RoundReport], added: Collection[str]) -> list[float]:
    """Of each round the most that the name which it added may be believed, from 0 to 1; 1 where nothing says how much
    it explained: no later round, or a name that did not stay.

    Args:
        rounds: of the diagnosis.
        added: the effects of its final model.
    """
    return [_credit(k, rounds, added) for k in range(len(rounds))]


def doubted(rounds: Sequence[RoundReport], added: Collection[str], settings: DiagnosisSettings) -> list[str]:
    """Names that stay in the model and are not said, for something else is likelier.

    Args:
        rounds, added: as of `credits`.
        settings: `least_credit`.
    """
    believed = zip(rounds, credits(rounds, added), strict=True)
    return [str(each.added) for each, credit in believed if credit < settings.least_credit]


def left_share(rounds: Sequence[RoundReport], doubted: Collection[str] = ()) -> float:
    """Share of the misfit above noise of the first model that has no name, from 0 to 1: what the last one leaves, and
    what names in doubt explain."""
    first, last = rounds[0].evidence.rows, rounds[-1].evidence.rows
    left = sum(map(_left, last))
    left += sum(_gain(k, rounds, _EVERYWHERE) for k in range(len(rounds) - 1) if rounds[k].added in doubted)
    return left / max(left, sum(map(_excess, first)), 1e-300)


def _credit(k: int, rounds: Sequence[RoundReport], added: Collection[str]) -> float:
    name = rounds[k].added
    if name is None or name not in added or k + 1 == len(rounds):
        return 1.0
    place = _place(name)
    own = _gain(k, rounds, place)
    others = [j for j in range(len(rounds) - 1) if j != k and rounds[j].added in added]
    elsewise = sum(_left(row) for row in rounds[-1].evidence.rows if _is_at(row, place))
    for j in others:
        if gain := _gain(j, rounds, place):
            elsewise += _share_of_another(str(rounds[j].added), place) * gain
    return own / (own + elsewise) if elsewise else 1.0


def _share_of_another(name: str, place: Place) -> float:
    """Share of what another name explains at a place that may be what the one of this place does: all, of two mistakes
    of the rig in one test."""
    test = _test(place)
    return 1.0 if test and _test(_place(name)) == test else effect_named(name).inexact ** 2


def _gain(k: int, rounds: Sequence[RoundReport], place: Place) -> float:
    """By how much chi2 of the samples at a place fell in a round; 0 where it rose."""
    before, after = (sum(_excess(row) for row in rounds[j].evidence.rows if _is_at(row, place)) for j in (k, k + 1))
    return max(0.0, before - after)


def _excess(row: Whiteness) -> float:
    return row.n * (row.rms**2 - 1.0)


def _left(row: Whiteness) -> float:
    return 0.0 if row.white else max(0.0, _excess(row))


def _place(name: str) -> Place:
    """Where an effect acts; everywhere, where it is of the throttle."""
    effect = rig_effect(name)
    return _EVERYWHERE if effect is None else effect.place


def _test(place: Place) -> str:
    return place.test or place.file.partition("/")[0]


def _is_at(row: Whiteness, place: Place) -> bool:
    return (not place.file or row.file == place.file) and (not place.test or row.test == place.test)
