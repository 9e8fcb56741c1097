"""A posterior for stdout."""

from __future__ import annotations

from collections.abc import Mapping

from rich.console import Group, RenderableType
from rich.text import Text

from ...posterior.profile import Profile
from ...posterior.sampling import Marginal, Posterior
from ...run_folder.posterior import disagree, narrower
from ..blocks import headed, plain_table, rig_title, sentences, spaced
from ..numbers import Digits, short
from ..tables import STATUS_STYLE


def posterior_table(posterior: Posterior, profiles: Mapping[str, Profile]) -> RenderableType:
    """Parameters with their spread by Laplace, profile and posterior side by side, profiles, and the chain's end."""
    parts = [
        rig_title(posterior.fit.rig.config, _sampled(posterior)),
        _parameters(posterior, profiles),
        _profiles(profiles, posterior.described),
        _outcome(posterior),
        sentences("Warnings", narrower(posterior)),
    ]
    return Group(*(part for part in parts if part is not None))


def _sampled(posterior: Posterior) -> str:
    chain, here = posterior.chain, posterior.convergence
    walkers = chain.ensembles[0].points.shape[1]
    return f"{len(chain.ensembles)} ensembles of {walkers} walkers, {here.steps} steps, {here.burn} of them burn-in"


def _parameters(posterior: Posterior, profiles: Mapping[str, Profile]) -> RenderableType:
    table = plain_table(
        "parameter", "mean", "95 % interval", "sd: Laplace", "sd: profile", "sd: posterior", "apart", "ESS", "R-hat",
        "unit", "status", words=("apart", "unit", "status"), prose=("status",),
        spare=("ESS", "sd: Laplace", "sd: profile", "sd: posterior", "R-hat"), file="RUN/posterior.json",
    )  # fmt: skip
    for symbol, m in posterior.marginals.items():
        table.add_row(*_row(symbol, m, profiles.get(symbol)), posterior.described[symbol][0],
                      Text(m.status, style=STATUS_STYLE[m.status]))  # fmt: skip
    return table


def _row(symbol: str, m: Marginal, profile: Profile | None) -> tuple[str | Text, ...]:
    tail = f"{m.ess:.0f}", f"{m.r_hat:.3f}"
    profiled = "" if profile is None else short(profile.sd) if profile.sd else profile.kind
    if m.status == "not identifiable":
        return symbol, "-", "-", "-", profiled, "-", "", *tail
    digits = Digits.of(m.mean, m.sd)
    flag = Text("> 20 %" if disagree(m, profile) else "", style="bold yellow")
    return symbol, digits(m.mean), digits.span(m.low, m.high), short(m.laplace), profiled, short(m.sd), flag, *tail


def _profiles(profiles: Mapping[str, Profile], described: Mapping[str, tuple[str, str]]) -> RenderableType | None:
    table = plain_table("parameter", "profile", "rises by 3.84 at", "and at", "unit", left=2, words=("unit",))
    for symbol, p in profiles.items():
        table.add_row(symbol, p.kind, short(p.low), short(p.high), described[symbol][0])
    return headed("Profile likelihood of what is weakly determined", table) if profiles else None


def _outcome(posterior: Posterior) -> RenderableType:
    here = posterior.convergence
    style, word = ("bold green", "Converged") if here.converged else ("bold red", "NO POSTERIOR YET")
    return spaced(
        Text.assemble((word, style), f": {here.reason.rstrip('.')}; {100.0 * here.acceptance:.0f} % of moves accepted")
    )
