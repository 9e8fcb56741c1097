"""A run in a few sentences: fit and prediction, mistakes of the rig, known parameters, gains."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any

from markupsafe import Markup, escape

from ...diagnosis.probabilities import UNEXPLAINED
from ...estimation import explained
from ...estimation.contradiction import digits_apart
from ...estimation.goodness import STRAYS, Left
from ...estimation.identifiability import listed
from ...estimation.joint_fit import MISFIT
from ...problem.prediction_error import pooled
from ...rig.base import ALLOWED_FOR
from ..control.sentence import sentence
from ..html import number, symbol, symbols, unit
from ..numbers import is_share, short
from . import Contents, rows_of, tuned_of


def verdict(contents: Contents) -> tuple[Markup, ...]:
    """The sentences at the top of the page; those on the gains are the same as on terminal and notebook, for a run of
    `etcfit tune` its own."""
    left, pid = left_unexplained(contents), contents.get("pid")
    text = Markup("<strong>Something is left that no known effect explains</strong>, with probability {}.")
    tuned = tuned_of(contents.run)
    sentences = (tuned["says"]["answer"], tuned["says"]["requirements"]) if tuned else (sentence(pid) if pid else None,)
    of_gains = [escape(each) for each in sentences if each]
    return (
        *(of_gains if tuned else ()),  # for `tune` the gains come first
        _fits(contents),
        _predicts(contents),
        *([] if left is None else [text.format(number(left, 2))]),
        *(escape(each["sentence"]) for each in contents.get("diagnosis").get("statements") or ()),
        *_mistakes(contents),
        *_contradicts(contents),
        _knows(contents) + Markup("."),
        *(() if tuned else of_gains),
    )


def left_unexplained(contents: Contents) -> float | None:
    """Probability of an unknown cause, if that is above one half."""
    found = (contents.get("diagnosis").get("probabilities") or {}).get(UNEXPLAINED)
    return found if found and found > 0.5 else None


def _mistakes(contents: Contents) -> Iterator[Markup]:
    """Each mistake of the rig that the records show directly, without habits that the fit allows for."""
    rig = contents.get("diagnosis").get("rig")
    for each in rig if isinstance(rig, list) else ():  # the rig's name in older files
        if each.get("effect") or each["kind"] in ALLOWED_FOR:
            continue
        what, where = each["kind"].replace("_", " "), (each["test"] or "every test").replace("_", " ")
        channel = f"{each['channel']}, " if each["channel"] else ""
        text = Markup("<strong>A mistake of the rig: {}</strong> ({}{}). Mend: <code>{}</code>")
        yield text.format(what, channel, where, each["mend"])


def _contradicts(contents: Contents) -> Iterator[Markup]:
    """Each test that the others contradict, with the value without it of the parameter that it pulls most."""
    text = Markup("<strong>{} contradicts the other tests</strong>: without it {} is {} {} instead of {}.")
    for each in contents.final.get("contradictions") or ():
        without, value = each["without"], each["value"]
        digits = 3 if without is None or value is None else digits_apart(without, value)  # enough to differ
        test, of = each["test"].replace("_", " "), unit(each["unit"])
        yield text.format(test, symbol(each["parameter"]), number(without, digits), of, number(value, digits))


def model(contents: Contents) -> str:
    """Eqs. 1-2 and the added effects."""
    return listed(["Eqs. 1–2", *(name.replace("_", " ") for name in contents.added)])


def _fits(contents: Contents) -> Markup:
    final = contents.final
    count = len({row["file"] for row in contents.files["fit"]["score"]["fit"]})
    head = f"{model(contents)}, fitted to {'one trace' if count == 1 else f'all {count} traces at once'},"
    chi2 = contents.score.get("chi2_per_dof")
    if not final.get("converged", True):
        return Markup("{} <strong>did not converge</strong>: the figures below are no results.").format(head)
    if chi2 is None:
        return Markup("{} cannot be simulated over all of them.").format(head)
    if chi2 < MISFIT:
        return Markup("{} leave {}. {}").format(head, residuals(contents.score), _motion(contents.score))
    return Markup(
        "{} stay <strong>far from the data</strong> (χ²/dof {}): parameters are a compromise, not measurements. {}"
    ).format(head, number(chi2), _motion(contents.score))


def _motion(score: Mapping[str, Any]) -> str:
    """The explained share of the motion; "" for an older file."""
    return explained.sentence(score.get("explained"), score.get("explained_holdout"))


def residuals(score: Mapping[str, Any]) -> str:
    """The verdict on the residuals of the fitted traces (`estimation.goodness`), in words."""
    rows, chi2 = score["fit"], f"(χ²/dof {short(score['chi2_per_dof'])})"
    count = Counter(row.get("left") for row in rows)
    if None in count:  # an older file
        return f"residuals {chi2}"
    more, strays = count[Left.MORE] + count[Left.FAR], count[Left.STRAYS]
    if more and len(rows) == 1:
        text = f"a residual that is larger than its noise or not independent {chi2}"
    elif more:
        larger = f"{more} {'is' if more == 1 else 'are'} larger than their noise or not independent"
        text = f"noise in {len(rows) - more} of {len(rows)} residuals {chi2}; {larger}"
    else:
        text = f"nothing but noise{' from sample to sample' if strays else ''} {chi2}"
    stray = f"{strays} of {len(rows)} {'strays' if strays == 1 else 'stray'} by more than {STRAYS:g} σ"
    return text + (f"; run free, {stray}" if strays else "")


def _predicts(contents: Contents) -> Markup:
    after, before = _error(contents.score), _error(contents.get("diagnosis").get("before") or {})
    if after is None:
        return Markup("How well it predicts cannot be said: it could not be simulated.")
    where = "on traces that were never fitted" if contents.score.get("holdout") else "on the fitted traces"
    text = f"Running free {where}, the error is {number(after)} σ of one sample"
    count = len(contents.added)
    if contents.added and before is not None:
        added = "the added effect" if count == 1 else f"the {count} added effects"
        return Markup("{}; it was {} σ before {} came in.").format(text, number(before), added)
    if contents.get("diagnosis"):
        return Markup("{}; no further effect of the catalogue was found to improve on it.").format(text)
    return Markup("{}; what the model may lack has not been looked for (<code>etcfit diagnose</code>).").format(text)


def _error(score: Mapping[str, Any]) -> float | None:
    rows = rows_of(score.get("holdout") or score.get("fit") or ())
    return pooled(rows) if rows else None


def _knows(contents: Contents) -> Markup:
    sought = "estimated", "not identifiable", "compromise"
    free = {s: p for s, p in contents.final["parameters"].items() if p["status"] in sought}
    known = {s: p["stderr"] / abs(p["value"]) for s, p in free.items() if p["stderr"] is not None and p["value"]}
    lost = [s for s, p in free.items() if p["status"] == "not identifiable"]
    unsure = [s for s, p in free.items() if p["status"] == "compromise"]
    if unsure and not known:
        text = (
            "{} of {} free parameters are a <strong>compromise</strong>: subsets of the data give ranges, no estimates"
        )
        return Markup(text).format(len(unsure), len(free))
    if not known:
        return Markup("No parameter is identifiable from these data")
    # a share, such as a place between two samples, may be near 0: then its error over it says nothing
    compared = [s for s in known if not is_share(s, free[s]["unit"])] or list(known)
    worst = max(compared, key=lambda s: known[s])
    text = Markup("{} of {} free parameters are known, {} least well (± {} %)").format(
        len(known), len(free), symbol(worst), number(100.0 * known[worst], 2)
    )
    text += Markup("; a <strong>compromise</strong> are {}").format(symbols(unsure)) if unsure else ""
    return text + (Markup("; these data <strong>cannot tell</strong> {}").format(symbols(lost)) if lost else Markup(""))
