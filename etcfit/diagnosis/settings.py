"""Every choice of policy in a diagnosis: what counts as evidence, what may get worse, how long is searched.

Bounds of formulas, numerical ranks and sizes of memory are no policy: they are constants of the files that use them.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..estimation.settings import GuideSettings
from ..ranges import check_ranges, real, whole


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

    rounds: int = whole(8, 1)
    """Most rounds; each adds one effect at most."""
    refits: int = whole(4, 1)
    """Most effects of the throttle refitted in one round, the most promising first."""
    rig_refits: int = whole(3, 1)
    """Most effects of the rig refitted in one round beside them, as many of single channels of single traces; and of
    those with which the joint fit is made anew, where the model stays far from its data."""
    refits_side_by_side: int = whole(2, 1)
    """Refits that run at a time, in threads; changes the time taken, never the result."""

    # ---- which candidates are worth a refit

    least_promise: float = real(0.3, 0.0, 1.0)
    """Share of the fall in -2 log likelihood that BIC would ask, which the score test must promise."""
    rival_promise: float = real(0.3, 0.0, 1.0)
    """Share of the largest promise of the round that another candidate must exceed."""
    rival_promise_far: float = real(0.1, 0.0, 1.0)
    """That share far from the data, where a linear promise is a rough one."""

    # ---- what is evidence

    strong_bic_change: float = real(-10.0, high=0.0)
    """Change of BIC below which an effect is worth its parameters (Kass and Raftery 1995: very strong evidence)."""
    least_part: float = real(0.2, 0.0)
    """Fall of chi2 over what the effect leaves above the noise; one that explains less imitates something else."""
    least_part_of_one: float = real(1.0, 0.0)
    """The same of an effect in one channel of one trace."""
    tied_likelihood: float = real(6.0, 0.0)
    """Difference in -2 log likelihood below which two effects explain the data equally well."""

    # ---- what the traces held out may lose

    trial_rise: float = real(0.02, 0.0)
    """Allowed relative rise of the held-out free-run RMS in a trial: 2 %, a slip that falls on another sample."""
    refit_rise: float = real(0.2, 0.0)
    """Allowed relative rise of the held-out free-run RMS after a full refit, and of the final model run free: 20 %."""
    far_rise: float = real(2.0, 0.0)
    """Allowed relative rise far from the data: 200 %, for there the free run itself is not what was fitted."""
    spared_gain: float = real(0.01, 0.0, 1.0)
    """Held-out chi2 may rise by this share of what chi2 of the fitted traces falls: they may not show the effect."""
    folds: int = whole(3, 1)
    """Groups of traces left out in turn where rig.toml holds none out."""
    fold_tolerance: float = real(1e-3, above=0.0)
    """Relative change of chi2 that ends a refit without one group."""

    # ---- trials

    trial_tolerance: float = real(1e-3, above=0.0)
    """Relative change of chi2 that ends the refit of a trial."""
    steepest_start: float = real(3.0, 1.0)
    """Chi2 with which a trial may begin, over that of the model without the effect."""
    start_halvings: int = whole(8, 0)
    """How often the amplitudes are halved at most until a trial begins below that."""
    second_trial_share: float = real(0.5, 0.0, 1.0)
    """Share of chi2 above the noise which a contradicted effect must explain to be judged again after a full refit."""

    # ---- full refits

    refit_tolerance: float = real(1e-4, above=0.0)
    """Relative change of chi2 that ends the descent before the first whitening."""
    near_chi2_per_dof: float = real(10.0, above=0.0)
    """Chi2 per degree of freedom below which a model that was far from the data counts as near them."""
    whitening_rounds: int = whole(10, 1)
    """Most rounds of whitening and refitting."""
    still: float = real(0.2, above=0.0)
    """A round of whitening that moves no parameter by more standard errors is the last."""
    reweighings: int = whole(2, 1)
    """How often the samples are weighed by what is left in them, far from the data."""
    worse_chi2: float = real(1.5, 1.0)
    """Chi2 per sample after a full refit over that before, from which on the refit is refused."""

    # ---- looking back

    exchange_rival: float = real(0.5, 0.0, 1.0)
    """Share of the fall of chi2 of the effect added that another must exceed to be asked again in the final model."""

    imitated: float = real(0.05, 0.0, 1.0)
    """Share of an effect's signature that nothing at work can imitate, below which it may be put in place of two."""
    merges: int = whole(2, 0)
    """Such effects tried at most, the most imitated first."""
    handing_over: int = whole(8, 1)
    """Steps in which two effects are led to their off values."""

    # ---- sets of effects

    pair_refits: int = whole(2, 0)
    """Most pairs of effects refitted beside what the rounds found, the most promising first; 0: none."""

    free_pool: int = whole(6, 0)
    """Most effects, of those that stood in any round, from which a set is grown in the free run where the model stays
    far from its data; 0: none is."""

    # ---- what is of another rig

    pieces: int = whole(3, 0)
    """Traces, and as many tests, without which the fit is made where one effect does not explain the data, those that
    it predicts worst; 0: none."""

    # ---- what single traces show, and what is logged late

    single_traces: int = whole(8, 1)
    """Single traces, those that stand out the most, of which it is asked whether they were logged late; as many of
    which it is asked whether their winding was warm; and as many of their channels, of which it is asked whether they
    are late, and again whether they read too much or a wrong zero."""
    late_stretches: int = whole(20, 2)
    """Equal parts of a trace: what is late must explain more than the one of them that gains most, one event."""

    # ---- formulas that are not exact

    formula_ceiling: float = real(0.04, 0.0)
    """Chi2 that may be put down to an inexact formula: at most this share of the number of samples."""
    formula_stretches: int = whole(6, 1)
    """Equal parts of a trace, over each of which the error of a formula is taken to be constant."""

    # ---- what is left, and what it has done to the parameters

    curve_length: float = real(3.0, above=0.0)
    """Knots over which a random curve forgets what it was."""
    curve_evidence: float = real(10.0, 0.0)
    """Rise of -2 log likelihood without random curves, one event left out, from which on they are taken to be there."""
    large_curve: float = real(0.05, above=0.0, below=1.0)
    """Probability that a random curve is larger than is typical of what it enters, before the data are asked."""
    curve_stretches: int = whole(20, 1)
    """Equal parts of a trace, one of which counts as one event."""

    # ---- evidence of the residual

    white_p: float = real(1e-4, above=0.0, below=1.0)
    """p-value of a test for autocorrelation or correlation below which a residual is not white."""
    large_rms: float = real(0.03, 0.0)
    """Excess of a residual's RMS over 1 sigma that a wrong estimate of the noise may explain."""
    large_rms_deviations: float = real(5.0, 0.0)
    """Standard deviations of the RMS of white noise, 1/sqrt(2 n), that are allowed beside that excess."""
    share_bins: int = whole(24, 2)
    """Bins of equal count along an axis, whose means are the curve that takes a share of the variance away."""
    share_samples: int = whole(200, 1)
    """Fewest samples from which such a share is read."""
    share_told: float = real(0.05, 0.0, 1.0)
    """Share of the variance from which on it is spoken of."""

    # ---- the guide that draws the plate along the measured angle

    guide: GuideSettings = GuideSettings()
    """How stiff it is; far from the data models are compared under it."""

    # ---- what has no name

    curve_refits: int = whole(1, 1)
    """Smooth curves refitted, the most promising first."""
    name_keeps: float = real(0.9, above=0.0, below=1.0)
    """Share of the log-likelihood gained by a free curve which one effect must gain to keep its name."""
    names_hold: float = real(0.8, 0.0, 1.0)
    """Share of the log-likelihood gained by one curve which all effects together must gain to keep their names."""
    curve_asked: float = real(1.5, 0.0)
    """Chi2 per sample of the final model from which on it is asked whether one curve does more than all effects."""

    # ---- probabilities

    bic_temper: float = real(10.0, 1.0)
    """By how much a change of BIC overstates its evidence."""
    lapse: float = real(0.1, above=0.0, below=1.0)
    """Least probability that what was named is something else, however strong the evidence; and the least that
    something without a name is left beside it."""
    least_credit: float = real(0.5, 0.0, 1.0)
    """Share of what is missing where it acts that a name must explain, beside what may be something else; one that
    explains less, of a model near its data, is not said."""
    missed: float = real(0.1, above=0.0, below=1.0)
    """Probability that something is there of which nothing was found."""
    slow_log: float = real(0.5, 0.0, below=1.0)
    """Probability that a misfit is of what acted between two samples, where the log is slower than what acts in it."""
    suspicion: float = real(0.8, 0.0, 1.0)
    """Probability below which a name is a suspicion: what to measure is said, and no line of rig.toml to change."""

    # ---- the final model

    free_spread: float = real(0.1, above=0.0)
    """Spread of the search for the best free run, in units of each coordinate's reach (1: a change of 100 %)."""

    __post_init__ = check_ranges

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
