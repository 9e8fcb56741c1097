"""One turn of the loop: screen every effect, refit the best few, choose the one that helps most."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from ..estimation.joint_fit import MISFIT, Report, approach, rounds
from ..estimation.levenberg_marquardt import descend
from ..estimation.remedies import listed
from ..estimation.result import FitResult, Termination
from ..problem.problem import EstimationProblem
from ..problem.residual import WeightedData
from ..problem.weights import discounted, forgiving, free_running
from .composition import Composition, Effect, compose, resting
from .cross_validation import folds, left_out
from .missing_torque import pull_of
from .model_discrepancy import inexact, left_by
from .screen import Background, Signature, screen, variants
from .trial import ASTRAY, CandidateModel, Score, TrialVerdict, compare, score

_SIDE_BY_SIDE = 2  # refits at a time: they run outside the interpreter lock
_REFITS = 4  # candidates refitted in full in one round
ROUNDS = 8
STRONG = -10.0  # BIC change that counts as evidence (Kass and Raftery 1995: very strong)
_PROMISE = 0.3  # share of what BIC asks that the screening must promise for a refit
_TOLERANCE = 1e-4  # relative change of chi2 that ends a descent on the way
_WEIGHINGS = 2  # of a guided residual by what is left in it
_WHITENINGS = 10  # rounds of whitening after an effect was added
_NEARER = 10.0  # chi2 per degree of freedom below which a model that was far from the data comes near them
_STILL = 0.2  # standard errors that a round of whitening may still move a parameter
_RIVAL = 0.3  # share of the best candidate's promise that makes another a rival worth a refit
_RIVAL_FAR = 0.1  # the same far from the data, where the linearised promise is rough
_MAIN = 0.5  # share of the chi2 above the noise from which on an effect explains most of what is left
_PART = 0.2  # share of what an effect leaves that it must explain itself
_SAME = 6.0  # difference of two models' -2 log likelihood that these data cannot tell


@dataclass(frozen=True, eq=False)
class Round:
    """One turn of the loop.

    Args:
        before: the model as it stood, and its score.
        screened: every candidate's signature, the most promising first; none where what is left is not worth a look.
        verdicts: candidates refitted, the best first.
        added: the one that was added, or None.
        ties: others that explain these data as well as the one added.
        why: one sentence.
    """

    before: CandidateModel
    score: Score
    screened: tuple[Signature, ...]
    verdicts: tuple[TrialVerdict, ...]
    added: Effect | None
    ties: tuple[Effect, ...]
    why: str

    @property
    def best(self) -> TrialVerdict:
        """The verdict on the one that was added."""
        return next(v for v in self.verdicts if v.effect is self.added)


def start(result: FitResult) -> CandidateModel:
    """A fit, taken up as the model of the first round."""
    problem = result.problem
    composition = compose(result.rig, problem.batch.traces)
    free_parameters = composition.lean(())
    holdout = result.holdout.batch.traces if result.holdout is not None else ()
    end = Termination(result.converged, result.reason, far=result.far)
    standing = whitened(composition, (), problem.with_parameters(free_parameters), holdout, result.x, end)
    return _weighed(standing, holdout) if result.far else standing


def _weighed(s: CandidateModel, held_out: tuple) -> CandidateModel:
    """Far from the data: at the optimum of the guided residual, and weighed by what is left there."""
    for _ in range(_WEIGHINGS):
        s = whitened(s.composition, s.added, s.problem, held_out, s.optimised().x, s.end)
    return s


def whitened(
    composition: Composition,
    added: tuple[Effect, ...],
    problem: EstimationProblem,
    held_out: tuple,
    x: np.ndarray,
    end: Termination,
) -> CandidateModel:
    """A standing whose residual is whitened at x; far from the data, guided along them and weighed by what is left."""

    def made(b: EstimationProblem) -> tuple[EstimationProblem, WeightedData]:
        if not end.far:
            b = b.guided(0.0)
            return b, b.weighted(b.kalman(x))
        b = discounted(b.guided(guide_stiffness), x)
        return b, b.weighted(free_running(b))

    guide_stiffness = pull_of(problem, x)
    problem, weighted = made(problem)
    beside = made(problem.beside(held_out, x)) if held_out else None
    return CandidateModel(composition, added, problem, weighted, beside, x, end)


def refit_fully(s: CandidateModel, report: Report) -> CandidateModel:
    """The model refitted in full: through the rounds of the fit where it comes near the data."""
    s, held_out = s.lean(), s.held_out
    problem = s.problem.reprepared(s.x)
    weighted = problem.weighted(forgiving(problem))
    x, _ = descend(problem, s.x, weighted, _TOLERANCE)
    if s.far:
        x = min(x, approach(problem, s.x, _TOLERANCE)[0], key=lambda end: problem.chi2(end, weighted))
    if problem.chi2(x, weighted) / max(1.0, weighted.samples - x.size) > (_NEARER if s.far else MISFIT):
        end = Termination(True, "optimum of the guided residual", far=True)
        return _weighed(whitened(s.composition, s.added, problem, held_out, s.x, end), held_out)
    new = _in_rounds(s, problem, x, report)
    return _in_rounds(s, problem, s.x, report) if new.spoilt(s) else new


def _in_rounds(s: CandidateModel, problem: EstimationProblem, x: np.ndarray, report: Report) -> CandidateModel:
    """The model refitted from x, whitened anew until nothing moves."""
    problem, _, x, end = rounds(problem.with_release_times(x), x, report, _STILL, _WHITENINGS)
    return whitened(s.composition, s.added, problem, s.held_out, x, end)


def turn(s: CandidateModel, report: Report, least: float = 0.0) -> Round:
    """One round; nothing is read into a chi2 of no more than `least` above the noise's."""
    before = score(s)
    if least > 0.0 and before.chi2 - s.weighted.samples < least:
        return Round(s, before, (), (), None, (), _within(s, max(0.0, before.chi2 / s.weighted.samples - 1.0)))
    candidates = [e for e in s.composition.candidates if not s.at_work(e)]
    report(f"screening {len(candidates)} effects", 0.1)
    signatures = screened(s, candidates)
    promising = _promising(signatures, before, _RIVAL_FAR if s.far else _RIVAL)
    verdicts = _refitted(s, promising, before, report)
    if s.holdout is None:
        verdicts = _crossed(s, verdicts)
    # far from the data every sample is weighed by what is left in it, so chi2 says nothing of noise
    added, ties, why = choose(verdicts, before.chi2 - least, np.inf if s.far else s.weighted.samples + least)
    return Round(s, before, signatures, tuple(verdicts), added, ties, why)


def screened(s: CandidateModel, candidates: Sequence[Effect]) -> tuple[Signature, ...]:
    """Every candidate's signature; what the fitted parameters can do is the same in a lean model, for less."""
    whole, lean = s.composed(), s.lean()
    return screen(
        Background.of(lean.problem, lean.x, lean.weighted), whole.problem, whole.x, whole.weighted, candidates
    )


def _within(s: CandidateModel, excess: float) -> str:
    names = listed(e.name for e in s.added)
    return (
        f"What is left adds {100 * excess:.2g} % to the noise, no more than a formula of {names} that is "
        f"{100 * inexact(s):.0f} % off would leave: nothing is read into it."
    )


def _crossed(s: CandidateModel, verdicts: Sequence[TrialVerdict]) -> list[TrialVerdict]:
    """Those that BIC would have, with their change on traces left out in turn."""
    if not folds(s) or not any(v.bic_change < STRONG for v in verdicts):
        return list(verdicts)
    base = left_out(s)
    return [replace(v, holdout_chi2_change=left_out(v.standing) - base) if v.bic_change < STRONG else v
            for v in verdicts]  # fmt: skip


def _promising(signatures: Sequence[Signature], before: Score, rival: float) -> list[Signature]:
    """Those that promise near enough to what BIC asks, and near enough to the best."""
    least = rival * max((g.gain for g in signatures), default=0.0)
    return [g for g in signatures if promises(g, before) and g.gain > least][:_REFITS]


def promises(g: Signature, before: Score) -> bool:
    """Whether the screening comes near enough to what BIC asks for a refit to be worth its time."""
    return g.gain * _per_chi2(before) > _PROMISE * _asked(g, before)


def _refitted(s: CandidateModel, promising: Sequence[Signature], before: Score, report: Report) -> list[TrialVerdict]:
    """Each candidate in full, the best first: the first alone, for it may have to compile, then side by side."""
    if not promising:
        return []
    report(f"refitting with {promising[0].variant.effect.name}", 0.2)
    verdicts = [_tried(s, promising[0], before)]
    with ThreadPoolExecutor(_SIDE_BY_SIDE) as pool:
        jobs = [pool.submit(_tried, s, signature, before) for signature in promising[1:]]
        for k, (signature, job) in enumerate(zip(promising[1:], jobs, strict=True), 1):
            report(f"refitting with {signature.variant.effect.name}", 0.2 + 0.6 * k / len(promising))
            verdicts.append(job.result())
    return sorted((_asked_again(s, v, before, report) for v in verdicts), key=lambda v: v.bic_change)


def _asked_again(s: CandidateModel, v: TrialVerdict, before: Score, report: Report) -> TrialVerdict:
    """The verdict; one that explains most of what is left and yet is contradicted by the traces held out may stand in a
    valley of its own, or where the old whitening draws it: it is judged once more where a refit in full ends."""
    main = not s.far and v.gain > _MAIN * (before.chi2 - s.weighted.samples)
    if not main or v.bic_change > STRONG or v.helps_elsewhere():
        return v
    report(f"refitting with {v.effect.name} in full", 0.8)
    there = replace(v.standing, x=refit_fully(v.standing, report).x)
    again = replace(judged(v.effect, before, there), slack=ASTRAY)
    return again if again.bic_change < STRONG and again.helps_elsewhere() else v


def _per_chi2(before: Score) -> float:
    """What one unit of chi2 is worth in -2 log likelihood."""
    return before.count / max(before.chi2, 1e-300)


def _asked(g: Signature, before: Score) -> float:
    return len(g.variant.amplitudes) * np.log(before.count) - STRONG


def _tried(s: CandidateModel, g: Signature, before: Score) -> TrialVerdict:
    return tried(s, g.variant.effect, g.values, before)


def tried(s: CandidateModel, effect: Effect, values: Mapping[str, float], before: Score) -> TrialVerdict:
    """The verdict on an effect that starts at `values` (SI), beside the model as it stands."""
    return judged(effect, before, s.trying(effect, values).optimised())


def judged(effect: Effect, before: Score, s: CandidateModel) -> TrialVerdict:
    """The verdict on a model that has one effect more than the one scored before."""
    return compare(effect, before, s, len(resting(effect)), len(variants(effect)))


def choose(
    verdicts: Sequence[TrialVerdict], most: float = np.inf, noise: float = np.inf
) -> tuple[Effect | None, tuple[Effect, ...], str]:
    """Which effect to add, which others do as well, and why.

    One that leaves a chi2 above `most` is not proven. One that explains little beside what it leaves above `noise`
    imitates a part of something else.
    """
    worth = [v for v in verdicts if v.bic_change < STRONG]
    good = [v for v in worth if v.helps_elsewhere()]
    main = [v for v in good if v.gain > _PART * (v.score.chi2 - noise)]
    proven = [v for v in main if v.score.chi2 < most]
    if not verdicts:
        return None, (), "No effect of the catalogue promises to explain anything more."
    if not worth:
        best = verdicts[0]
        return (
            None,
            (),
            (
                f"{best.effect.name} does best, but is not worth its parameters (BIC {best.bic_change:+.1f}, "
                f"{STRONG:.0f} asked)."
            ),
        )
    if not good:
        return None, (), f"{worth[0].effect.name} helps on the fitted traces only, not on those held out."
    if not main:
        return None, (), (
            f"{good[0].effect.name} does best, but explains less than {100 * _PART:.0f} % of what it leaves: "
            "what is missing is something else."
        )  # fmt: skip
    if not proven:
        return None, (), (
            f"{main[0].effect.name} would explain a little more (BIC {main[0].bic_change:+.0f}), but no more "
            "than the inexact formula of an effect found before would leave: not proven."
        )  # fmt: skip
    best = proven[0]
    ties = tuple(v.effect for v in proven[1:] if alike(v, best))
    held = "" if best.holdout_rms_ratio is None else f", held-out error x {best.holdout_rms_ratio:.3f}"
    words = (
        f"{best.effect.name} explains most: fitted error x {best.fit_rms_ratio:.3f}{held}, BIC {best.bic_change:+.0f}."
    )
    if ties:
        words += f" {listed(e.name for e in ties)} would do as well: these data cannot tell them apart."
    return best.effect, ties, words


def alike(v: TrialVerdict, best: TrialVerdict) -> bool:
    """Two effects explain the data equally well, or their difference is within what an inexact formula leaves.

    (chi2_v - chi2_best) n / chi2_best < max(6, left n / chi2_best),    left by the less exact formula of the two

    Parsimony chooses which of them stands in the model; it does not prove that one.
    """
    left = left_by(max(v.effect.inexact, best.effect.inexact), best.gain, best.standing.weighted.samples)
    apart = v.score.chi2 - best.score.chi2
    return apart < left or apart * _per_chi2(best.score) < _SAME
