"""Could the data have told an effect that was missed? The model with all that is there is fitted, and judged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np


def missed_effects(before: Any, after: Any, names: Sequence[str], missing: Sequence[str]) -> dict[str, Any]:
    """What the diagnosis would say of each missing effect beside all others, at the best end that two fits reach.

    Args:
        before: the fit of Eqs. 1-2.
        after: the fit with what was found; its values are one start, the graph readings and nominal values the other.
        names: all effects in the folder.
        missing: those of them that were not named.
    Returns:
        `chi2`, per sample, None where no fit comes near the data; and of each missing effect its change of `bic`, what
        is `required`, and whether these data `tell` it: worth its parameters, and not contradicted by what is held out.
    """
    from etcfit.diagnosis.choice import is_accepted
    from etcfit.diagnosis.composition import carried
    from etcfit.diagnosis.refit import refit_fully, start
    from etcfit.diagnosis.score import baseline
    from etcfit.diagnosis.settings import DEFAULT
    from etcfit.diagnosis.trial import judge_trial
    from etcfit.estimation.joint_fit import fit_near, quiet
    from etcfit.model.effects import EFFECT_BY_NAME

    known = before.rig.config.effects  # the fit adds effects of its own, as a phase of the edges
    rig = replace(before.rig, config=replace(before.rig.config, effects=(*known, *names)))
    ends = [end for about in (after.values, None) if (end := fit_near(rig, quiet, about=about)) is not None]
    if not ends:
        return {"chi2": None}
    first, effects = start(before, DEFAULT), tuple(EFFECT_BY_NAME[name] for name in names)

    def judged(end: Any) -> Any:
        s = first.with_effects(effects, end.values)
        x = carried(end.x, end.problem.layout, s.problem.free_parameters, end.values)
        return refit_fully(replace(s, x=x, end=end.end), quiet)

    s = min((judged(end) for end in ends), key=lambda m: np.inf if m.far else m.chi2_per_sample)
    if s.far:
        return {"chi2": None}
    out: dict[str, Any] = {"chi2": s.chi2_per_sample}
    for name in missing:
        effect = EFFECT_BY_NAME[name]
        verdict = judge_trial(effect, baseline(s.without(effect).optimised()), s).verdict
        required = verdict.required_bic_change(DEFAULT)
        out[name] = {"bic": verdict.bic_change, "required": required, "tell": is_accepted(verdict, DEFAULT)}
    return out
