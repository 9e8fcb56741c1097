"""posterior.json and posterior.nc say what was sampled, in which units, of what data, and whether it is a posterior."""

from __future__ import annotations

import pickle
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray

import results
from etcfit.posterior.chain import Convergence
from etcfit.posterior.profile import Profile
from etcfit.posterior.sampling import Band, Posterior, apart
from etcfit.posterior.settings import SamplingSettings
from etcfit.ranges import from_json
from etcfit.reporting.blocks import render
from etcfit.reporting.pictures import file_name
from etcfit.reporting.posterior import pictures, posterior_table
from etcfit.run_folder.posterior import disagree, posterior_json, write_netcdf
from schemas import written_valid


@pytest.fixture(scope="module")
def posterior(tmp_path_factory: pytest.TempPathFactory) -> Posterior:
    """Of a fit made by hand in which J_L is lost."""
    return results.posterior_of(results.result(results.rig(tmp_path_factory.mktemp("rig")), lost=("J_L",)), 150)


@pytest.fixture
def profiles(posterior: Posterior) -> dict[str, Profile]:
    return results.profiles_of(posterior.fit)


@pytest.fixture
def band(posterior: Posterior) -> Band:
    trace = posterior.fit.problem.batch.traces[0]
    return Band(trace, trace.data - 1.0 * trace.sigma, np.broadcast_to(trace.sigma, trace.data.shape))


def test_the_json_has_every_parameter_that_moves(
    posterior: Posterior, profiles: dict[str, Profile], band: Band, tmp_path: Path
) -> None:
    found = written_valid(tmp_path, "posterior", posterior_json(posterior, profiles, [band]))
    assert from_json(SamplingSettings, found["settings"]) == posterior.settings
    assert found["schema"] == "etcfit.posterior/1"
    assert found["synthetic"] is True
    assert found["fit"] == {"chi2_per_dof": 1.02, "converged": True, "reason": posterior.fit.reason, "compromise": None}
    assert (found["converged"], found["reason"]) == (posterior.convergence.converged, posterior.convergence.reason)
    assert {"R_a", "K_m", "J_eq", "series_ohm.inductance"} <= set(found["parameters"])
    assert "B_m" not in found["parameters"]  # fixed
    r_a = found["parameters"]["R_a"]
    assert r_a["unit"] == "ohm"
    assert r_a["meaning"] == "armature resistance"
    assert r_a["ci95"][0] < r_a["mean"] < r_a["ci95"][1]
    assert r_a["sd"] == pytest.approx(r_a["laplace_sd"], rel=0.05)
    assert r_a["ess"] > 500
    assert r_a["r_hat"] == pytest.approx(1.0, abs=0.02)
    assert found["parameters"]["K_m"]["status"] == "tied"
    assert found["predictive"][0]["inside95"] == dict.fromkeys(band.trace.channels, 1.0)
    assert found["tempering"] == [{"file": "response/1.csv", "channel": "current", "factor": 3.0}]


def test_what_is_not_identifiable_gets_no_number_but_its_profile(
    posterior: Posterior, profiles: dict[str, Profile]
) -> None:
    lost = posterior_json(posterior, profiles, [])["parameters"]["J_L"]
    assert lost["status"] == "not identifiable"
    assert (lost["mean"], lost["sd"], lost["ci95"]) == (None, None, None)
    assert lost["profile"]["kind"] == "one-sided"


def test_a_chain_that_is_too_short_says_so_everywhere(posterior: Posterior) -> None:
    short = replace(posterior, convergence=Convergence.judge([_shorter(e) for e in posterior.chain.ensembles]))
    found = posterior_json(short, {}, [])
    assert found["converged"] is False
    assert any("NO POSTERIOR YET" in text for text in found["warnings"])
    text = render(posterior_table(short, {}))
    assert "NO POSTERIOR YET" in text
    assert ".;" not in text


def _shorter(e: Any) -> Any:
    return replace(e, points=e.points[:20], log_probability=e.log_probability[:20])


def test_the_file_has_arvizs_groups_with_units_and_meanings(posterior: Posterior, tmp_path: Path) -> None:
    write_netcdf(tmp_path / "posterior.nc", posterior)
    assert [p.name for p in tmp_path.iterdir()] == ["posterior.nc"]
    with xarray.open_datatree(tmp_path / "posterior.nc", engine="h5netcdf") as tree:
        assert set(tree.children) == {"posterior", "unconstrained_posterior", "sample_stats"}
        assert (tree.attrs["synthetic"], tree.attrs["schema"]) == (1, "etcfit.posterior/1")
        r_a = tree["posterior/R_a"]
        assert r_a.dims == ("chain", "draw")
        assert r_a.attrs == {"unit": "ohm", "meaning": "armature resistance"}
        assert float(r_a.to_numpy().mean()) == pytest.approx(posterior.fit.values["R_a"], rel=0.02)
        assert set(np.unique(tree["posterior/ensemble"])) == {0, 1}


@pytest.mark.slow  # importing ArviZ takes seconds
def test_arviz_reads_it(posterior: Posterior, tmp_path: Path) -> None:
    write_netcdf(tmp_path / "posterior.nc", posterior)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # ArviZ announces its next version
        import arviz

        read = arviz.from_netcdf(str(tmp_path / "posterior.nc"))
        rhat = arviz.rhat(read, var_names=["R_a"]).to_array().item()  # pyright: ignore  (ArviZ has no types)
    assert {"posterior", "unconstrained_posterior", "sample_stats"} <= set(read.groups())
    assert rhat == pytest.approx(1.0, abs=0.1)


def test_spreads_are_apart_beyond_a_fifth(posterior: Posterior) -> None:
    assert not apart(1.0, 1.19, None)
    assert apart(1.0, 1.19, 0.98)
    assert not apart(None, None)
    wide = replace(posterior.marginals["R_a"], laplace=0.5 * posterior.marginals["R_a"].sd)
    assert disagree(wide, None)
    assert not disagree(posterior.marginals["R_a"], None)


def test_the_table_sets_all_ways_of_asking_side_by_side(posterior: Posterior, profiles: dict[str, Profile]) -> None:
    text = render(posterior_table(posterior, profiles))
    assert all(word in text for word in ("Laplace", "profile", "posterior", "one-sided", "SYNTHETIC DATA", "tempered"))


def test_it_says_where_formulas_are_exact_here_and_not_in_the_diagnosis(posterior: Posterior) -> None:
    exact = replace(posterior, exact=("limp_home_spring", "stribeck_friction"))
    said = "take the formula of limp_home_spring and stribeck_friction as exact"
    allowed = "intervals of the diagnosis, which are wider, allow for 2 % and 10 %"
    for text in (" ".join(posterior_json(exact, {}, [])["warnings"]), _flat(render(posterior_table(exact, {})))):
        assert said in text
        assert allowed in text
    assert posterior_json(exact, {}, [])["exact"] == ["limp_home_spring", "stribeck_friction"]
    assert posterior_json(posterior, {}, [])["exact"] == []
    assert "as exact" not in " ".join(posterior_json(posterior, {}, [])["warnings"])
    assert "as exact" not in _flat(render(posterior_table(posterior, {})))


def _flat(text: str) -> str:
    return " ".join(text.split())


@pytest.mark.slow  # a hundred panels
def test_every_picture_is_drawn(posterior: Posterior, profiles: dict[str, Profile], band: Band) -> None:
    handed = pickle.loads(pickle.dumps(pictures.jobs(posterior, profiles, [band])))  # to a process beside this one
    drawn = {path.as_posix(): draw() for path, draw in handed}
    assert set(drawn) == {"intervals.png", "corner.png", "profiles.png", f"bands/{file_name(band.trace)}"}
    assert all(any("SYNTHETIC" in text.get_text() for text in fig.texts) for fig in drawn.values())
    labels = [axes.get_xlabel() for axes in drawn["corner.png"].axes if axes.get_xlabel()]
    assert len(labels) == len(posterior.chain.symbols)
    assert all(label.endswith("[%]") for label in labels)
