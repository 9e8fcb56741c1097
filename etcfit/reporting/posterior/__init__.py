"""A posterior, of posterior.json, for every view."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.console import RenderableType

from ...posterior.profile import Profile
from ...posterior.sampling import Posterior
from ...run_folder.posterior import narrower, parameters_json
from ..blocks import outcome, rig_title, spaced, stacked
from ..numbers import mean_digits, short
from ..table import Cell, Column, Notes, Part, Table, there
from ..tables import LOST, status_cell


def posterior_table(posterior: Posterior, profiles: Mapping[str, Profile]) -> RenderableType:
    """For stdout: parameters, profiles, and the chain's end."""
    chain, here = posterior.chain, posterior.convergence
    walkers = chain.ensembles[0].points.shape[1]
    sampled = f"{len(chain.ensembles)} ensembles of {walkers} walkers, {here.steps} steps, {here.burn} of them burn-in"
    end = f"{here.reason.rstrip('.')}; {100.0 * here.acceptance:.0f} % of moves accepted"
    parts = posterior_parts({"parameters": parameters_json(posterior, profiles), "exact": posterior.exact})
    return stacked(
        rig_title(posterior.fit.rig.config, sampled),
        *parts,
        spaced(outcome(here.converged, ("Converged", "NO POSTERIOR YET"), end)),
        Notes("Warnings", narrower(posterior)),
    )


def posterior_parts(posterior: Mapping[str, Any]) -> list[Part]:
    """Parameters with their spread by Laplace, profile and posterior, then the profiles."""
    parameters = posterior.get("parameters")
    return there(parameters_table(posterior), _profiles(parameters)) if parameters else []


def parameters_table(posterior: Mapping[str, Any]) -> Table:
    """One row per parameter; no number if it is not identifiable."""
    rows = [{"symbol": symbol, **each} for symbol, each in posterior["parameters"].items()]
    exact = ", formulas of effects taken as exact (intervals of the fit allow for inexact ones)"
    differ = "; in red where fit, profile and posterior differ by more than 20 % in width"
    title = f"Posterior{exact if posterior.get('exact') else ''}{differ if any(r.get('apart') for r in rows) else ''}"
    columns = (
        Column("parameter", "symbol", "symbol"),
        Column("meaning", lambda row: row.get("meaning", ""), "prose", spare=1),
        Column("mean", lambda row: mean_digits(row)(row["mean"])),
        Column("95 % interval", lambda row: mean_digits(row).span(*(row["ci95"] or (None, None)))),
        Column("sd: Laplace", lambda row: "-" if row.get("status") == LOST else short(row.get("laplace_sd")), spare=3),
        Column("sd: profile", _profiled, spare=4),
        Column("sd: posterior", lambda row: mean_digits(row)(row["sd"]), spare=5),
        Column("apart", lambda row: Cell("> 20 %", "bad") if row.get("apart") else "", "word"),
        Column("ESS", lambda row: "-" if row.get("ess") is None else f"{row['ess']:.0f}", spare=2),
        Column("R-hat", lambda row: short(row.get("r_hat"), 4), spare=6),
        Column("unit", "unit", "unit"),
        Column("status", lambda row: status_cell({"status": "", **row}), "prose"),
    )
    return Table(title, columns, rows, file="RUN/posterior.json")


def _profiled(row: Mapping[str, Any]) -> str:
    """The standard deviation of a profile, or the kind of profile if it has none."""
    profile = row.get("profile") or {}
    return short(profile["sd"]) if profile.get("sd") else profile.get("kind", "")


def _profiles(parameters: Mapping[str, Any]) -> Table:
    rows = [{"symbol": symbol, "unit": each["unit"], **each["profile"]} for symbol, each in parameters.items()
            if (each.get("profile") or {}).get("ci95")]  # fmt: skip
    columns = (Column("parameter", "symbol", "symbol"), Column("profile", "kind", "word"),
               Column("rises by 3.84 at", lambda row: short(row["ci95"][0])),
               Column("and at", lambda row: short(row["ci95"][1])), Column("unit", "unit", "unit"))  # fmt: skip
    return Table("Profile likelihood of what is weakly determined", columns, rows)
