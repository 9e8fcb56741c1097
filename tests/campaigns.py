"""Next tests made by hand, without a model: real candidates of `results.rig`, invented curves and standard errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from etcfit.experiment.campaign import Campaign, Criterion, Forecast, PlannedTest, Winding
from etcfit.experiment.candidates import Candidate, candidates
from etcfit.experiment.plan import Setting
from etcfit.experiment.settings import CampaignSettings
from etcfit.rig import TEST_BY_NAME
from etcfit.rig.base import Rig

VALUES = {"R_a": 1.5, "K_m": 0.019, "K_s": 0.15, "T_PL": 0.36, "T_f": 0.24}
SYMBOLS = ("R_a", "T_f", "series_ohm.inductance")


def setting(rig: Rig) -> Setting:
    """Of the rig, its plate at rest on the closed stop."""
    return replace(Setting.of_rig(rig, VALUES), rest=0.0)


def forecast(candidate: Candidate, angle: Sequence[float] = (0.3, 0.9), amps: float = 2.0) -> Forecast:
    """Of three models: every angle between these, and a current of so many A."""
    time = candidate.plan.time
    wave = 0.5 * (1.0 - np.cos(2.0 * np.pi * time / time[-1]))
    models = np.array([1.0, 0.99, 1.01])[:, None]
    every = {
        "current": models * amps * wave,
        "position": np.clip(angle[0] + models * (angle[1] - angle[0]) * wave, angle[0], angle[1]),
        "motor_speed": models * wave,
        "emf": models * wave,
    }
    seen = TEST_BY_NAME[candidate.plan.test].observes
    return Forecast(time, {name: every[name] for name in seen}, 20.0 * models * wave)


def campaign(rig: Rig, settings: CampaignSettings = CampaignSettings()) -> Campaign:
    """A driven response, a release and a motor alone."""
    s = setting(rig)
    every = candidates(s, settings, {"response"}, ())
    tests = [next(c for c in every if c.kind == kind) for kind in ("multisine", "back_emf", "viscous")]
    sd = [np.array([0.02, 0.04, 0.1]) * 0.7**k for k in range(len(tests) + 1)]
    planned = [PlannedTest(c, forecast(c), sd[k], sd[k + 1], 12.0, f"{c.plan.test}/plan_{k + 1}.csv")
               for k, c in enumerate(tests)]  # fmt: skip
    return Campaign(rig, True, SYMBOLS, dict(VALUES), s, tuple(planned), (("a chirp", "6.0 A, limit 5 A"),),
                    Winding.of_model(VALUES), Criterion.A, settings, ("The fit did not converge.",))  # fmt: skip
