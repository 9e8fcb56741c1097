"""posterior.json, and posterior.nc in ArviZ's layout: groups `posterior`, `unconstrained_posterior`, `sample_stats`.

Written through xarray, whose groups are ArviZ's: `arviz.from_netcdf` reads it, and nothing of ArviZ need be imported.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from ..diagnosis.model_discrepancy import percent_off
from ..errors import UsageError
from ..estimation.identifiability import listed
from ..files import plain, whole
from ..posterior.profile import Profile
from ..posterior.sampling import DRAWS_PER_TAU, Band, Marginal, Posterior, apart
from ..posterior.target import tempering
from .fit import effects_of, versions

_ENGINE = "h5netcdf"  # of xarray


def posterior_json(posterior: Posterior, profiles: Mapping[str, Profile], bands: Sequence[Band]) -> dict[str, Any]:
    """The object of posterior.json: every parameter that moves, in SI, and how far the chain came."""
    fit, chain, here = posterior.fit, posterior.chain, posterior.convergence
    config = fit.rig.config
    return {
        "rig": config.name,
        "synthetic": config.synthetic,
        "converged": here.converged,
        "reason": here.reason,
        "model": {"effects": list(effects_of(fit))},
        "fit": plain(fit.state),
        "parameters": parameters_json(posterior, profiles),
        "draws": int(np.prod(posterior.points.shape[:3])),
        "ensembles": len(chain.ensembles),
        "walkers": chain.ensembles[0].points.shape[1],
        "steps": here.steps,
        "burn_in": here.burn,
        "tau": plain(dict(zip(chain.symbols, here.tau.tolist(), strict=True))),
        "acceptance": here.acceptance,
        "effective_samples": here.effective,
        "tempering": [{"file": file, "channel": channel, "factor": f}
                      for (file, channel), f in posterior.target.factors.items() if f > 1.0],
        "exact": list(posterior.exact),
        "mode_moved_sd": plain(dict(zip(chain.symbols, _moved(posterior).tolist(), strict=True))),
        "predictive": [_predicted(band) for band in bands],
        "settings": plain(posterior.settings),
        "warnings": list(_warnings(posterior)),
        "folder": fit.rig.folder,
        "files": dict(fit.rig.digests),
        "versions": versions(),
    }  # fmt: skip


def _predicted(band: Band) -> dict[str, Any]:
    """Share of a trace's samples inside the 95 % band, by channel."""
    measurement = band.trace.measurement
    inside = dict(zip(band.trace.channels, band.inside, strict=True))
    return {"file": measurement.file, "held_out": measurement.held_out, "inside95": inside}


def parameters_json(posterior: Posterior, profiles: Mapping[str, Profile]) -> dict[str, Any]:
    """By symbol; one that is not identifiable gets no number: its draws show what was believed, not what was seen."""
    described = posterior.described
    return {s: plain(_numbers(m) | {"unit": described[s][0], "meaning": described[s][1], "status": m.status,
                                    "ess": m.ess, "r_hat": m.r_hat, "laplace_sd": m.laplace,
                                    "apart": disagree(m, profiles.get(s)), "profile": _profile(profiles.get(s))})
            for s, m in posterior.marginals.items()}  # fmt: skip


def disagree(m: Marginal, profile: Profile | None) -> bool:
    """Whether Laplace, profile and posterior differ by more than 20 % in width."""
    if m.status == "not identifiable":
        return False
    return apart(m.sd, m.laplace, profile.sd if profile else None)


def _numbers(m: Marginal) -> dict[str, Any]:
    if m.status == "not identifiable":
        return {"mean": None, "sd": None, "median": None, "ci95": None}
    return {"mean": m.mean, "sd": m.sd, "median": m.median, "ci95": [m.low, m.high]}


def _profile(profile: Profile | None) -> dict[str, Any] | None:
    return profile and {"kind": profile.kind, "ci95": [profile.low, profile.high], "sd": profile.sd,
                        "value": profile.value, "rise": profile.rise}  # fmt: skip


def _moved(posterior: Posterior) -> np.ndarray:
    """From the fit's optimum to the mode, in standard errors of the fit."""
    return (posterior.target.mode - posterior.fit.x) / np.sqrt(np.diag(posterior.fit.covariance))


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


def require_netcdf() -> None:
    """A netCDF file can be written here, found out before hours of sampling by writing one.

    Raises:
        UsageError: it cannot.
    """
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
    tree.attrs = _attributes(posterior, thin)
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


def _attributes(posterior: Posterior, thin: int) -> dict[str, Any]:
    """What the file says of itself; netCDF knows no booleans."""
    config, here = posterior.fit.rig.config, posterior.convergence
    return {
        "schema": "etcfit.posterior/1", "rig": config.name, "synthetic": int(config.synthetic),
        "converged": int(here.converged), "reason": here.reason, "thin": thin, "burn_in": here.burn,
        "inference_library": "emcee", "inference_library_version": metadata.version("emcee"),
    }  # fmt: skip
