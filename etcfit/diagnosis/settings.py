"""Every choice of policy in a diagnosis: what counts as evidence, what may get worse, how long is searched.

Bounds of formulas, numerical ranks and sizes of memory are no policy: they are constants of the files that use them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import Any


@dataclass(frozen=True)
class Allowed:
    """The values that a setting may have.

    Args:
        words: the range, as an error message says it.
        holds: whether a number lies in it; False for NaN.
    """

    words: str
    holds: Callable[[float], bool]


POSITIVE = Allowed("greater than 0", lambda value: 0.0 < value < math.inf)
NOT_NEGATIVE = Allowed("0 or more", lambda value: 0.0 <= value < math.inf)
NOT_POSITIVE = Allowed("0 or less", lambda value: -math.inf < value <= 0.0)
AT_LEAST_ONE = Allowed("1 or more", lambda value: 1.0 <= value < math.inf)
SHARE = Allowed("from 0 to 1", lambda value: 0.0 <= value <= 1.0)
PART = Allowed("greater than 0 and less than 1", lambda value: 0.0 < value < 1.0)


def _setting(default: float, allowed: Allowed) -> Any:
    """A field of the settings; one whose default is an int takes whole numbers only."""
    return field(default=default, metadata={"allowed": allowed})


@dataclass(frozen=True)
class DiagnosisSettings:
    """What `diagnose` decides by; recorded in diagnosis.json under "settings".

    Words used below: sigma is the declared noise of one sample; chi2 is the sum of squares of the whitened residual, 1
    a sample where only noise is left; a model is far from the data where it is too wrong to be whitened, so that its
    samples are weighed by what is left in them; a trial is a quick refit under the whitening of the model before it; a
    full refit renews whitening, releases and outliers; the promise of an effect is the fall of chi2 that the linear
    score test expects of it.

    Raises:
        ValueError: a value lies outside its range; names field, value and range.
    """

    # ---- the loop

    rounds: int = _setting(8, AT_LEAST_ONE)
    """Most rounds; each adds one effect at most."""
    refits: int = _setting(4, AT_LEAST_ONE)
    """Most effects of the throttle refitted in one round, the most promising first."""
    rig_refits: int = _setting(3, AT_LEAST_ONE)
    """Most effects of the rig refitted in one round beside them; and of those with which the joint fit is made anew,
    where the model stays far from its data."""
    refits_side_by_side: int = _setting(2, AT_LEAST_ONE)
    """Refits that run at a time, in threads; changes the time taken, never the result."""

    # ---- which candidates are worth a refit

    least_promise: float = _setting(0.3, SHARE)
    """Share of the fall in -2 log likelihood that BIC would ask, which the score test must promise."""
    rival_promise: float = _setting(0.3, SHARE)
    """Share of the largest promise of the round that another candidate must exceed."""
    rival_promise_far: float = _setting(0.1, SHARE)
    """That share far from the data, where a linear promise is a rough one."""

    # ---- what is evidence

    strong_bic_change: float = _setting(-10.0, NOT_POSITIVE)
    """Change of BIC below which an effect is worth its parameters (Kass and Raftery 1995: very strong evidence)."""
    least_part: float = _setting(0.2, NOT_NEGATIVE)
    """Fall of chi2 over what the effect leaves above the noise; one that explains less imitates something else."""
    tied_likelihood: float = _setting(6.0, NOT_NEGATIVE)
    """Difference in -2 log likelihood below which two effects explain the data equally well."""

    # ---- what the traces held out may lose

    trial_rise: float = _setting(0.02, NOT_NEGATIVE)
    """Allowed relative rise of the held-out free-run RMS in a trial: 2 %, a slip that falls on another sample."""
    refit_rise: float = _setting(0.2, NOT_NEGATIVE)
    """Allowed relative rise of the held-out free-run RMS after a full refit, and of the final model run free: 20 %."""
    far_rise: float = _setting(2.0, NOT_NEGATIVE)
    """Allowed relative rise far from the data: 200 %, for there the free run itself is not what was fitted."""
    spared_gain: float = _setting(0.01, SHARE)
    """Held-out chi2 may rise by this share of what chi2 of the fitted traces falls: they may not show the effect."""
    folds: int = _setting(3, AT_LEAST_ONE)
    """Groups of traces left out in turn where rig.toml holds none out."""
    fold_tolerance: float = _setting(1e-3, POSITIVE)
    """Relative change of chi2 that ends a refit without one group."""

    # ---- trials

    trial_tolerance: float = _setting(1e-3, POSITIVE)
    """Relative change of chi2 that ends the refit of a trial."""
    steepest_start: float = _setting(3.0, AT_LEAST_ONE)
    """Chi2 with which a trial may begin, over that of the model without the effect."""
    start_halvings: int = _setting(8, NOT_NEGATIVE)
    """How often the amplitudes are halved at most until a trial begins below that."""
    second_trial_share: float = _setting(0.5, SHARE)
    """Share of chi2 above the noise which a contradicted effect must explain to be judged again after a full refit."""

    # ---- full refits

    refit_tolerance: float = _setting(1e-4, POSITIVE)
    """Relative change of chi2 that ends the descent before the first whitening."""
    near_chi2_per_dof: float = _setting(10.0, POSITIVE)
    """Chi2 per degree of freedom below which a model that was far from the data counts as near them."""
    whitening_rounds: int = _setting(10, AT_LEAST_ONE)
    """Most rounds of whitening and refitting."""
    still: float = _setting(0.2, POSITIVE)
    """A round of whitening that moves no parameter by more standard errors is the last."""
    reweighings: int = _setting(2, AT_LEAST_ONE)
    """How often the samples are weighed by what is left in them, far from the data."""
    worse_chi2: float = _setting(1.5, AT_LEAST_ONE)
    """Chi2 per sample after a full refit over that before, from which on the refit is refused."""

    # ---- looking back

    exchange_rival: float = _setting(0.5, SHARE)
    """Share of the fall of chi2 of the effect added that another must exceed to be asked again in the final model."""

    # ---- sets of effects

    pair_refits: int = _setting(2, NOT_NEGATIVE)
    """Most pairs of effects refitted beside what the rounds found, the most promising first; 0: none."""

    # ---- formulas that are not exact

    formula_ceiling: float = _setting(0.04, NOT_NEGATIVE)
    """Chi2 that may be put down to an inexact formula: at most this share of the number of samples."""
    formula_stretches: int = _setting(6, AT_LEAST_ONE)
    """Equal parts of a trace, over each of which the error of a formula is taken to be constant."""

    # ---- evidence of the residual

    white_p: float = _setting(1e-4, PART)
    """p-value of a test for autocorrelation or correlation below which a residual is not white."""
    large_rms: float = _setting(0.03, NOT_NEGATIVE)
    """Excess of a residual's RMS over 1 sigma that a wrong estimate of the noise may explain."""
    large_rms_deviations: float = _setting(5.0, NOT_NEGATIVE)
    """Standard deviations of the RMS of white noise, 1/sqrt(2 n), that are allowed beside that excess."""
    share_bins: int = _setting(24, Allowed("2 or more", lambda value: 2 <= value < math.inf))
    """Bins of equal count along an axis, whose means are the curve that takes a share of the variance away."""
    share_samples: int = _setting(200, AT_LEAST_ONE)
    """Fewest samples from which such a share is read."""
    share_told: float = _setting(0.05, SHARE)
    """Share of the variance from which on it is spoken of."""

    # ---- the guide that draws the plate along the measured angle

    guide_give: float = _setting(0.01, PART)
    """How far the guide gives way to a torque as large as dry friction, over the travel that was measured."""
    guide_bandwidth: float = _setting(15.0, POSITIVE)
    """Hz; bandwidth by which the guide's least stiffness is measured."""
    guide_bandwidth_of_rate: float = _setting(0.1, PART)
    """Most that this bandwidth may be, over the sample rate."""
    guide_least: float = _setting(0.003, POSITIVE)
    """Least stiffness of the guide over J w^2, w its bandwidth: for plates with hardly any dry friction."""
    guide_stable: float = _setting(0.3, PART)
    """Most stiffness of the guide over that at which guide and coil would swing."""

    # ---- what has no name

    curve_refits: int = _setting(1, AT_LEAST_ONE)
    """Smooth curves refitted, the most promising first."""
    name_keeps: float = _setting(0.9, PART)
    """Share of the log-likelihood gained by a free curve which one effect must gain to keep its name."""
    names_hold: float = _setting(0.8, SHARE)
    """Share of the log-likelihood gained by one curve which all effects together must gain to keep their names."""
    curve_asked: float = _setting(1.5, NOT_NEGATIVE)
    """Chi2 per sample of the final model from which on it is asked whether one curve does more than all effects."""

    # ---- probabilities

    bic_temper: float = _setting(10.0, AT_LEAST_ONE)
    """By how much a change of BIC overstates its evidence."""
    lapse: float = _setting(0.1, PART)
    """Probability that what was named is something else, however strong the evidence."""
    missed: float = _setting(0.1, PART)
    """Probability that something is there of which nothing was found."""

    # ---- the final model

    free_spread: float = _setting(0.1, POSITIVE)
    """Spread of the search for the best free run, in units of each coordinate's reach (1: a change of 100 %)."""

    def __post_init__(self) -> None:
        for each in fields(self):
            value, allowed = getattr(self, each.name), each.metadata["allowed"]
            whole = isinstance(each.default, int)
            kind = int if whole else (int, float)
            if isinstance(value, bool) or not isinstance(value, kind) or not allowed.holds(value):
                number = "a whole number" if whole else "a number"
                raise ValueError(f"DiagnosisSettings.{each.name} = {value!r}: it must be {number}, {allowed.words}.")

    def rise_in_trial(self, far: bool) -> float:
        """Allowed relative rise of the held-out RMS in a trial."""
        return self.far_rise if far else self.trial_rise

    def rise_in_refit(self, far: bool) -> float:
        """Allowed relative rise of the held-out RMS after a full refit."""
        return self.far_rise if far else self.refit_rise

    @property
    def surely_named(self) -> float:
        """k/(1 - k), k = `name_keeps`: an effect whose BIC fell so many times more than a curve adds beside it keeps
        its name without being asked, for the curve alone explains no more than both together."""
        return self.name_keeps / (1.0 - self.name_keeps)


DEFAULT = DiagnosisSettings()
