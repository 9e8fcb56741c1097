"""Mechanisms of a diagnosis: each can be watched, and switched off to see what it is worth.

A mechanism is one function of `etcfit.diagnosis`. Switched off, another function takes its place in all modules of the
diagnosis. A record says in `acted` which mechanisms changed something in its folder: without one that did not act the
record would be the same, so that an ablation runs only the folders in which it acted.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np

WITHOUT = "ETCFIT_BANK_WITHOUT"  # environment variable: the mechanism that is switched off in the processes of the bank
_ROOM = "etcfit.diagnosis"


class Mechanism(NamedTuple):
    """One mechanism.

    Attributes:
        does: what it does, in words.
        where: module and function, or module, class and method.
        off: takes its place; called with the function itself and with its arguments.
        acted: whether a result, with the arguments it came from, differs from what `off` returns. It may say so too
            often, never too seldom.
    """

    does: str
    where: str
    off: Callable[..., Any]
    acted: Callable[..., Any] = lambda result, *_: bool(result)


def _exact(*_: Any) -> Any:
    return import_module(f"{_ROOM}.formula_errors").EXACT


def _looked_back(_: Any, s: Any, found: Any, *__: Any) -> Any:
    return import_module(f"{_ROOM}.exchange").LookBack(s, tuple(found))


def _turned(result: Any, _: Any, found: Any, *__: Any) -> bool:
    names = [[(each.effect, *each.ties) for each in of] for of in (result.found, found)]
    return bool(result.changed) or names[0] != names[1]


def _first_accepted(verdicts: Any, settings: Any) -> Any:
    good = (v.effect for v in verdicts if v.is_strong(settings) and v.helps_elsewhere())
    return next(good, None)


def _nothing(value: Any) -> Callable[..., Any]:
    return lambda *_, **__: value


def _argument(k: int) -> Callable[..., Any]:
    return lambda _, *given, **__: given[k]


def _zeros(function: Callable[..., Any], *given: Any) -> Any:
    return np.zeros_like(function(*given))


MECHANISMS: Mapping[str, Mechanism] = {
    "checks first": Mechanism(
        "effects that the rig's checks found are tried before any round",
        "rounds.first_from_checks", _argument(1), lambda out, _, progress, *__: out is not progress),
    "another rig": Mechanism(
        "a trace or a test that is of another throttle is set aside",
        "other_rig.of_another_rig", _nothing(None)),
    "deeper optimum": Mechanism(
        "a round is made anew where the model before reaches, without the effect, most of its gain",
        "loop.deeper_optimum", _nothing(None)),
    "second trial": Mechanism(
        "an effect that held-out traces contradict is judged again after a full refit",
        "choice.deserves_second_trial", _nothing(False)),
    "several starts": Mechanism(
        "a refit starts from up to four variants of an effect",
        "loop.starts_of", lambda _, best, *__: [best], lambda out, *_: len(out) > 1),
    "population": Mechanism(
        "a population searches with an effect whose chi2 has many valleys",
        "candidate_model.CandidateModel.searched", _argument(0)),
    "cross-validation": Mechanism(
        "where nothing is held out, effects are judged on traces left out in turn",
        "loop._cross_validated", lambda _, s, trials: list(trials),
        lambda out, _, trials: any(a is not b for a, b in zip(out, trials, strict=True))),
    "least part": Mechanism(
        "an effect must explain a fifth of what it leaves above noise",
        "choice.choose", lambda choose, verdicts, settings, noise=np.inf: choose(verdicts, settings, np.inf),
        lambda out, verdicts, settings, *_: out.effect is not _first_accepted(verdicts, settings)),
    "size of a mistake": Mechanism(
        "a mistake of the rig of an unusual size, or in one channel of one trace, is less likely",
        "trial.surprise", _nothing(0.0)),
    "gain in one event": Mechanism(
        "a lateness that gains in one event alone gains nothing",
        "rig_screen.gain_in_one_event", _nothing(0.0)),
    "hidden by the guide": Mechanism(
        "far from the data, the fit is made anew with each effect that the guide hides",
        "rounds.find_masked_effect", _nothing(None)),
    "exchange": Mechanism(
        "each effect is compared again with its rivals in the final model",
        "exchange.exchanged", _looked_back, _turned),
    "pruning": Mechanism(
        "effects no longer worth their parameters are taken away",
        "exchange.pruned", lambda _, s, *__: (s, ()), lambda out, *_: bool(out[1])),
    "free sets": Mechanism(
        "far from the data, sets of effects are compared by their free runs",
        "free_sets.searched_free", lambda _, result, first, progress, *__: (progress, ()),
        lambda out, result, first, progress, *_: out[0] is not progress),
    "other orders": Mechanism(
        "far from the data, the rounds are carried on from other effects that were as likely too",
        "orders.other_turns", _nothing([])),
    "corrected formula": Mechanism(
        "a curve of the shape of a named effect corrects its formula: nothing without a name is left",
        "unexplained.corrected_formulas", _nothing(())),
    "free run worse": Mechanism(
        "all effects are taken away where the free run of held-out traces is clearly worse",
        "statements.runs_free_worse", _nothing(False)),
    "held-out noise": Mechanism(
        "held-out traces that are noise by the filter contradict no effect",
        "trial.is_noise", _nothing(False)),
    "formula errors": Mechanism(
        "evidence beside an effect with an inexact formula allows for its errors",
        "formula_errors.FormulaErrors.of_model", _exact),
    "credit": Mechanism(
        "an effect that explains too little of the misfit at its place is not named",
        "credit.doubted_effects", _nothing([])),
    "white but for one event": Mechanism(
        "a residual that is noise but for one event of one trace counts as noise",
        "evidence.white_but_for_one_event", _nothing(False)),
    "intervals: formulas": Mechanism(
        "intervals allow for formulas that are 2 or 10 % off",
        "formula_errors.formula_covariance", _zeros, lambda out, *_: np.any(out)),
    "intervals: ties": Mechanism(
        "intervals allow for effects that tie",
        "score.tie_covariance", _zeros, lambda out, *_: np.any(out)),
    "intervals: the rest": Mechanism(
        "intervals allow for curves in what is left",
        "unexplained.allowing_for_the_rest",
        lambda _, result, after, *__: import_module(f"{_ROOM}.unexplained").Allowed(after),
        lambda out, result, after, *_: out.after is not after),
    "intervals: faint effects": Mechanism(
        "intervals allow for effects too faint to be named",
        "faint_effects.allowing_for_faint_effects", _argument(0), lambda out, after, *_: out is not after),
    "intervals: reconciled": Mechanism(
        "a test that contradicts others by noise alone makes no compromise where widened intervals cover it",
        "course.reconciled", _argument(0), lambda out, after, *_: out is not after),
}  # fmt: skip

_ACTED: set[str] = set()
_INSTALLED: list[str] = []


def watched(without: str = "") -> set[str]:
    """A set, empty at first, to which each mechanism of this process that acts adds its name.

    Args:
        without: the mechanism that is switched off; "": none.
    """
    if not _INSTALLED:
        import_module(f"{_ROOM}.course")
        for name in MECHANISMS:
            _install(name, off=name == without)
        _INSTALLED.append(without)
    assert without in _INSTALLED  # one process has one
    _ACTED.clear()
    return _ACTED


def itself(where: str) -> tuple[Any, Any]:
    """The module or class of a mechanism's function, and the function."""
    module, *inner, function = where.split(".")
    holder = import_module(f"{_ROOM}.{module}")
    for each in inner:
        holder = getattr(holder, each)
    return holder, getattr(holder, function)


def _install(name: str, off: bool) -> None:
    mechanism = MECHANISMS[name]
    holder, function = itself(mechanism.where)

    def instead(*given: Any, **named: Any) -> Any:
        if off:
            _ACTED.add(name)
            return mechanism.off(function, *given, **named)
        result = function(*given, **named)
        if mechanism.acted(result, *given):
            _ACTED.add(name)
        return result

    last = mechanism.where.rpartition(".")[2]
    if isinstance(holder, type):
        setattr(holder, last, staticmethod(instead) if hasattr(function, "__self__") else instead)
        return
    for each in [m for n, m in sys.modules.items() if n.startswith(_ROOM)]:
        if getattr(each, last, None) is function:
            setattr(each, last, instead)
