"""All pictures of a posterior: where each goes and how it is drawn, in the order of interest."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

from ...estimation.intervals import intervals, lumped
from ...posterior.predictive import Band
from ...posterior.profile import Profile
from ...posterior.sampling import Posterior
from ...posterior.truth import truths
from ...run_folder.fit import readings_of
from ...run_folder.posterior import disagree
from ..drawing import Job
from ..pictures import file_name
from . import bands as bands_
from . import corner, spreads
from . import profiles as profiles_


def jobs(posterior: Posterior, profiles: Mapping[str, Profile], bands: Sequence[Band]) -> list[Job]:
    """Every picture: path below RUN/pictures/posterior, and the call that draws it."""
    config = posterior.fit.rig.config
    units = {s: unit for s, (unit, _) in posterior.described.items()}
    profiled: Job = (
        Path("profiles.png"),
        partial(profiles_.draw, config.name, [*profiles.values()], units, config.synthetic),
    )
    return [
        (Path("intervals.png"), partial(spreads.draw, config.name, _spreads(posterior, profiles), config.synthetic)),
        (Path("corner.png"), partial(corner.draw, _corner(posterior, units))),
        *([profiled] if profiles else []),
        *((Path("bands") / file_name(b.trace), partial(bands_.draw, b, config.synthetic)) for b in bands),
    ]


def _spreads(posterior: Posterior, profiles: Mapping[str, Profile]) -> list[spreads.Spread]:
    """Of whatever both the fit and the posterior put a number to, ties aside."""
    fit, read, true = posterior.fit, readings_of(posterior.fit), truths(posterior.fit.rig)
    known = intervals(fit) | lumped(fit)
    out = []
    for s, m in posterior.marginals.items():
        profile, fitted = profiles.get(s), known[s]
        if m.status != "estimated":
            continue
        ends = None if profile is None or profile.low is None or profile.high is None else (profile.low, profile.high)
        unit = posterior.described[s][0]
        out.append(spreads.Spread(s, unit, fitted.value, fitted.stderr or None, m.mean, m.sd, m.low, m.high, ends,
                                  read.get(s), true.get(s), disagree(m, profile)))  # fmt: skip
    return out


def _corner(posterior: Posterior, units: Mapping[str, str]) -> corner.CornerPicture:
    config = posterior.fit.rig.config
    draws = {s: posterior.draws[s].ravel() for s in posterior.chain.symbols}
    return corner.CornerPicture(config.name, draws, units, truths(posterior.fit.rig), config.synthetic)
