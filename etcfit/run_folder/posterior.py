"""posterior.json, declared, and posterior.nc in ArviZ's layout: groups `posterior`, `unconstrained_posterior`,
`sample_stats`.

Written through xarray, whose groups are ArviZ's: `arviz.from_netcdf` reads it, and nothing of ArviZ need be imported.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..diagnosis.formula_errors import percent_off
from ..errors import UsageError
from ..estimation.identifiability import listed
from ..files import plain, whole
from ..posterior.profile import Profile
from ..posterior.sampling import DRAWS_PER_TAU, Band, Marginal, Posterior, apart
from ..posterior.target import tempering
from .declared import REASON, WARNINGS, Record, by_name, file_of, key, list_of
from .fit import STATUSES

_ENGINE = "h5netcdf"  # of xarray


class _Written(NamedTuple):
    posterior: Posterior
    profiles: Mapping[str, Profile]
    bands: Sequence[Band]


def posterior_json(posterior: Posterior, profiles: Mapping[str, Profile], bands: Sequence[Band]) -> dict[str, Any]:
    """The object of posterior.json: every parameter that moves, in SI, and how far the chain came."""
    return plain(POSTERIOR.written(_Written(posterior, profiles, bands)))


def parameters_json(posterior: Posterior, profiles: Mapping[str, Profile]) -> dict[str, Any]:
    """The key `parameters` of posterior.json."""
    return plain(POSTERIOR.written(_Written(posterior, profiles, ()), "parameters"))["parameters"]


def _marginals(of: _Written) -> dict[str, dict[str, Any]]:
    """By symbol; one that is not identifiable gets no number: its draws show what was believed, not what was seen."""
    described = of.posterior.described
    return {
        s: vars(m) | {
            "known": None if m.status == "not identifiable" else m, "unit": described[s][0], "meaning": described[s][1],
            "apart": disagree(m, of.profiles.get(s)), "profile": of.profiles.get(s),
        }
        for s, m in of.posterior.marginals.items()
    }  # fmt: skip


def disagree(m: Marginal, profile: Profile | None) -> bool:
    """Whether Laplace, profile and posterior differ by more than 20 % in width."""
    if m.status == "not identifiable":
        return False
    return apart(m.sd, m.laplace, profile.sd if profile else None)


def _by_coordinate(posterior: Posterior, values: np.ndarray) -> dict[str, float]:
    return dict(zip(posterior.chain.symbols, values.tolist(), strict=True))


def _warnings(posterior: Posterior) -> list[str]:
    """Of the chain alone: those of its model stand in the model's own file."""
    here = posterior.convergence
    return [*([] if here.converged else [f"NO POSTERIOR YET: {here.reason}"]), *narrower(posterior)]


def narrower(posterior: Posterior) -> list[str]:
    """Why the posterior may be narrower than the intervals that stand beside it."""
    effects = posterior.exact
    as_exact = (
        f"Posterior, profiles and the standard errors beside them take the formula of {listed(effects)} as exact; the "
        f"intervals of the diagnosis, which are wider, allow for {percent_off(effects)}."
    ) if effects else ""  # fmt: skip
    return [words for words in (as_exact, tempering(posterior.target.factors)) if words]


PROFILE = Record(
    kind=key("text", "bounded, one-sided or flat."),
    ci95=key("[number?]", "95 % interval; null at a side where it has no end.",
        lambda profile: [profile.low, profile.high]),
    sd=key("number?", "Half its width as a standard deviation."),
    value=key("[number?]?", "Values at which it was computed."),
    rise=key("[number?]?", "By how much -2 log likelihood rises there."),
)  # fmt: skip
MARGINAL = Record(
    "One parameter, SI.",
    mean=key("number?", "Posterior mean; null where it is not identifiable, for its draws show what was believed, not "
        "what was seen.", "known.mean"),
    sd=key("number?", "Posterior standard deviation.", "known.sd"),
    median=key("number?", "Posterior median.", "known.median"),
    ci95=key("[number]?", "2.5 and 97.5 % quantiles.",
        lambda each: each["known"] and [each["low"], each["high"]], minItems=2, maxItems=2),
    unit=key("text", "SI unit."),
    meaning=key("text", "In words."),
    status=key("text", "As in fit.json.", enum=STATUSES),
    ess=key("number?", "Effective number of independent draws."),
    r_hat=key("number?", "Disagreement of the ensembles; 1 where there is none."),
    laplace_sd=key("number?", "Standard error by the normal approximation, for comparison.", "laplace"),
    apart=key("flag", "Laplace, profile and posterior differ by more than 20 % in width."),
    profile=key(PROFILE, "Profile likelihood, made of weakly determined parameters only; else null.",
        null=True, optional=True),
)  # fmt: skip
TEMPERED = Record(
    "One channel.",
    file=key("text", "The trace."),
    channel=key("text", "Quantity."),
    factor=key("number", "By which its log-likelihood is divided."),
)  # fmt: skip
BAND = Record(
    "One trace.",
    file=key("text", "The trace.", "trace.measurement.file"),
    held_out=key("flag", "It was not fitted.", "trace.measurement.held_out"),
    inside95=key("{number?}", "By channel, 0 to 1.",
        lambda band: dict(zip(band.trace.channels, band.inside, strict=True))),
)  # fmt: skip
POSTERIOR = file_of(
    "The posterior in numbers, and how far its chain came: written by `etcfit sample`.",
    "posterior.fit.rig.config", "posterior.fit", "posterior.fit.rig",
    converged=key("flag", "Whether the chain is long enough to be called a posterior. False also means exit status 3.",
        "posterior.convergence.converged"),
    reason=REASON.taken_from("posterior.convergence.reason"),
    parameters=key(by_name(MARGINAL), "By symbol, parameters and combinations.", _marginals),
    draws=key("whole", "Draws kept after the burn-in.",
        lambda of: int(np.prod(of.posterior.points.shape[:3]))),
    ensembles=key("whole", "Ensembles of walkers that know nothing of each other.",
        lambda of: len(of.posterior.chain.ensembles)),
    walkers=key("whole", "Walkers of each.", lambda of: of.posterior.chain.ensembles[0].points.shape[1]),
    steps=key("whole", "Steps of each ensemble.", "posterior.convergence.steps"),
    burn_in=key("whole", "Steps left out at the beginning.", "posterior.convergence.burn"),
    tau=key("{number?}", "By coordinate: integrated autocorrelation time, steps.",
        lambda of: _by_coordinate(of.posterior, of.posterior.convergence.tau)),
    acceptance=key("number?", "Share of proposals that were accepted.", "posterior.convergence.acceptance"),
    effective_samples=key("number?", "Fewest effective samples of any coordinate.", "posterior.convergence.effective"),
    tempering=key(list_of(TEMPERED), "Channels whose likelihood counts for less because their residual is too large or "
        "not independent.", lambda of: [{"file": file, "channel": channel, "factor": factor}
            for (file, channel), factor in of.posterior.target.factors.items() if factor > 1.0]),
    exact=key("[text]", "Effects whose formulas the posterior takes as exact, while the diagnosis' intervals allow for "
        "an error.", "posterior.exact"),
    mode_moved_sd=key("{number?}", "By coordinate: from the fit's optimum to the posterior's mode, in standard "
        "errors.", lambda of: _by_coordinate(of.posterior, (of.posterior.target.mode - of.posterior.fit.x)
        / np.sqrt(np.diag(of.posterior.fit.covariance)))),
    predictive=key(list_of(BAND), "Share of each trace's samples inside the 95 % predictive band.", "bands"),
    settings=key("object", "What the sampling decided by: every field of `etcfit.SamplingSettings`.",
        "posterior.settings"),
    warnings=WARNINGS.taken_from(lambda of: _warnings(of.posterior)),
)  # fmt: skip


def require_netcdf() -> None:
    """A netCDF file can be written here, found out before hours of sampling by writing one."""
    import xarray

    try:
        with tempfile.TemporaryDirectory() as scratch:
            xarray.DataTree(xarray.Dataset({"x": 0.0})).to_netcdf(Path(scratch) / "x.nc", engine=_ENGINE)
    except (ImportError, ValueError) as error:  # xarray's, of an engine that is not there
        raise UsageError(f"posterior.nc cannot be written here: {error} "
                         "Install etcfit again, with all that it depends on.") from error  # fmt: skip


def write_netcdf(path: Path, posterior: Posterior) -> None:
    """posterior.nc, written whole or not at all: one chain a walker, thinned to a quarter of tau.

    Groups:
        posterior: parameters and combinations, SI, with `unit` and `meaning`.
        unconstrained_posterior: the coordinates that were sampled.
        sample_stats: log-probability `lp`.
    """
    import xarray

    thin = max(1, int(np.nan_to_num(posterior.convergence.longest, nan=1.0) / DRAWS_PER_TAU))
    described = posterior.described
    draws = {s: (d[:, ::thin], dict(zip(("unit", "meaning"), described[s], strict=True)))
             for s, d in posterior.draws.items()}  # fmt: skip
    points = {s: (posterior.points[:, ::thin, :, k], {"unit": "1", "meaning": f"coordinate of {s}"})
              for k, s in enumerate(posterior.chain.symbols)}  # fmt: skip
    burn = posterior.convergence.burn
    lp = np.stack([e.log_probability[burn::thin] for e in posterior.chain.ensembles])
    stats = {"lp": (lp, {"unit": "1", "meaning": "log-probability of the coordinates, to a constant"})}
    groups = {"posterior": draws, "unconstrained_posterior": points, "sample_stats": stats}
    tree = xarray.DataTree.from_dict({name: _dataset(of) for name, of in groups.items()})
    # what the file says of itself; netCDF knows no booleans
    config, here = posterior.fit.rig.config, posterior.convergence
    tree.attrs = {
        "schema": "etcfit.posterior/1", "rig": config.name, "synthetic": int(config.synthetic),
        "converged": int(here.converged), "reason": here.reason, "thin": thin, "burn_in": here.burn,
        "inference_library": "emcee", "inference_library_version": metadata.version("emcee"),
    }  # fmt: skip
    with whole(path) as draft:
        tree.to_netcdf(draft, engine=_ENGINE)


def _dataset(of: Mapping[str, tuple[np.ndarray, dict[str, str]]]) -> Any:
    """Of arrays (E, N, W); every walker is a chain of ArviZ's, and says to which ensemble it belongs."""
    import xarray

    arrays = {s: (("chain", "draw"), np.swapaxes(a, 1, 2).reshape(-1, a.shape[1]), attrs)
              for s, (a, attrs) in of.items()}  # fmt: skip
    ensembles, steps, walkers = next(iter(of.values()))[0].shape
    coords = {"chain": np.arange(ensembles * walkers), "draw": np.arange(steps),
              "ensemble": ("chain", np.repeat(np.arange(ensembles), walkers))}  # fmt: skip
    return xarray.Dataset(arrays, coords)
