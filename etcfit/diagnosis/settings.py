"""Settings of `diagnose`: how long to search, how far held-out errors may rise, how sure a name must be.

Thresholds that the recorded folders were calibrated with are constants beside their formulas.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..ranges import check_ranges, real, whole

TRIAL_RISE = 0.02
"""Allowed relative rise of the held-out free-run RMS in a trial: 2 %, a slip that falls on another sample."""
FAR_RISE = 2.0
"""Allowed relative rise far from the data: 200 %, because the fit there does not minimise the free-run error."""


@dataclass(frozen=True)
class DiagnosisSettings:
    """The settings of `diagnose`; recorded in diagnosis.json under "settings".

    Words used below: sigma is the declared noise of one sample; chi2 is the sum of squares of the whitened residual, 1
    a sample where only noise is left; a model is far from the data where it is too wrong to be whitened, so that its
    samples are weighed by their residuals; a trial is a quick refit under the whitening of the model before it; a full
    refit renews whitening, releases and outliers; the promise of an effect is the fall of chi2 that the linear score
    test predicts for it.

    Raises:
        ValueError: a value lies outside its range; names field, value and range.
    """

    rounds: int = whole(8, 1)
    """Most rounds; each adds one effect at most."""
    refits: int = whole(4, 1)
    """Most effects of the throttle refitted in one round, the most promising first."""
    rig_refits: int = whole(3, 1)
    """Most effects of the rig refitted in one round in addition, and as many of single channels of single traces; also
    the most with which the joint fit is repeated where the model stays far from its data."""
    refits_side_by_side: int = whole(2, 1)
    """Refits that run at a time, in threads; changes the time taken, never the result."""
    strong_bic_change: float = real(-10.0, high=0.0)
    """Change of BIC below which an effect is worth its parameters (Kass and Raftery 1995: very strong evidence)."""
    refit_rise: float = real(0.2, 0.0)
    """Allowed relative rise of the held-out free-run RMS after a full refit, and of the final model run free: 20 %."""
    folds: int = whole(3, 1)
    """Groups of traces left out in turn where rig.toml holds none out."""
    free_pool: int = whole(6, 0)
    """Most effects from which a set is grown in the free run where the model stays far from its data, among those that
    were accepted in any round; 0: no set is grown."""
    orders: int = whole(2, 0)
    """Most other orders of the effects that are carried on where the model stays far from its data; 0: none."""
    pieces: int = whole(3, 0)
    """Number of traces, and of tests, without which the fit is repeated where one effect does not explain the data; the
    worst predicted are taken; 0: none."""
    single_traces: int = whole(8, 1)
    """Number of single traces, those with the largest gain, that are tried with a late log; as many are tried with a
    warm winding; as many of their channels are tried as late, and as many with a wrong scale or zero."""
    lapse: float = real(0.1, above=0.0, below=1.0)
    """Least probability that a named effect is really something else, however strong the evidence; also the least
    probability that something without a name remains besides the named effects."""
    missed: float = real(0.1, above=0.0, below=1.0)
    """Probability that an effect is present although none was found."""
    slow_log: float = real(0.5, 0.0, below=1.0)
    """Probability that events between two samples cause a misfit, where the log is too slow for the dynamics in it."""
    suspicion: float = real(0.8, 0.0, 1.0)
    """Probability below which a name is a suspicion: the report then names the measurement that decides, and no line of
    rig.toml to change."""

    __post_init__ = check_ranges

    def rise_in_trial(self, far: bool) -> float:
        """Allowed relative rise of the held-out RMS in a trial."""
        return FAR_RISE if far else TRIAL_RISE

    def rise_in_refit(self, far: bool) -> float:
        """Allowed relative rise of the held-out RMS after a full refit."""
        return FAR_RISE if far else self.refit_rise


DEFAULT = DiagnosisSettings()
