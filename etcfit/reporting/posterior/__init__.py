"""What a person sees of a posterior: the table for stdout."""

from __future__ import annotations

from collections.abc import Mapping

from rich.console import RenderableType
from rich.text import Text

from ...posterior.profile import Profile
from ...posterior.sampling import Marginal, Posterior
from ...run_folder.posterior import disagree, narrower
from ..blocks import filled, outcome, rig_title, sentences, spaced, stacked, table
from ..numbers import Digits, short
from ..tables import STATUS_STYLE


def posterior_table(posterior: Posterior, profiles: Mapping[str, Profile]) -> RenderableType:
    """Parameters with their spread by Laplace, profile and posterior side by side, profiles, and the chain's end."""
    chain, here = posterior.chain, posterior.convergence
    walkers = chain.ensembles[0].points.shape[1]
    sampled = f"{len(chain.ensembles)} ensembles of {walkers} walkers, {here.steps} steps, {here.burn} of them burn-in"
    end = f"{here.reason.rstrip('.')}; {100.0 * here.acceptance:.0f} % of moves accepted"
    return stacked(
        rig_title(posterior.fit.rig.config, sampled),
        _parameters(posterior, profiles),
        table(
            "Profile likelihood of what is weakly determined",
            ("parameter", "profile", "rises by 3.84 at", "and at", "unit"),
            [(s, p.kind, short(p.low), short(p.high), posterior.described[s][0]) for s, p in profiles.items()],
            left=2,
            words=("unit",),
        ),
        spaced(outcome(here.converged, ("Converged", "NO POSTERIOR YET"), end)),
        sentences("Warnings", narrower(posterior)),
    )


def _parameters(posterior: Posterior, profiles: Mapping[str, Profile]) -> RenderableType:
    rows = [(*_row(symbol, m, profiles.get(symbol)), posterior.described[symbol][0],
             Text(m.status, style=STATUS_STYLE[m.status])) for symbol, m in posterior.marginals.items()]  # fmt: skip
    sd = "sd: Laplace", "sd: profile", "sd: posterior"
    head = "parameter", "mean", "95 % interval", *sd, "apart", "ESS", "R-hat", "unit", "status"
    spare = "ESS", *sd, "R-hat"
    return filled(head, rows, words=("apart", "unit", "status"), prose=("status",), spare=spare,
                  file="RUN/posterior.json")  # fmt: skip


def _row(symbol: str, m: Marginal, profile: Profile | None) -> tuple[str | Text, ...]:
    tail = f"{m.ess:.0f}", f"{m.r_hat:.3f}"
    profiled = "" if profile is None else short(profile.sd) if profile.sd else profile.kind
    if m.status == "not identifiable":
        return symbol, "-", "-", "-", profiled, "-", "", *tail
    digits = Digits.of(m.mean, m.sd)
    flag = Text("> 20 %" if disagree(m, profile) else "", style="bold yellow")
    return symbol, digits(m.mean), digits.span(m.low, m.high), short(m.laplace), profiled, short(m.sd), flag, *tail
