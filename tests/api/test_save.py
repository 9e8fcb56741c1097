"""What is saved comes back, and verbs take the folder it was saved to."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import etcfit
import folders
from etcfit.api.controller import Reduced
from etcfit.api.explanation import Diagnosed, Sampled
from etcfit.api.fit import Fit
from etcfit.api.fleet import Fleet
from etcfit.errors import UsageError
from etcfit.estimation.result import FitResult
from etcfit.run_folder.folder import RunFolder


class Made:
    """Stands for gains, a plant or a chain, of which only the fit is looked at.

    Args:
        fit: that it was made from.
    """

    def __init__(self, fit: FitResult) -> None:
        self.fit = fit


@pytest.fixture(scope="module")
def fit(tmp_path_factory: pytest.TempPathFactory) -> Fit:
    """Of the resistance and inductance tests: seconds."""
    return etcfit.fit(folders.write(tmp_path_factory.mktemp("rig"), folders.held()))


@pytest.mark.parametrize("made", ["fitted", pytest.param("fit", marks=pytest.mark.slow)], ids=["by hand", "by a fit"])
def test_a_fit_comes_back_as_it_was(made: str, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    fit: Fit = request.getfixturevalue(made)
    run = tmp_path / "run"
    assert fit.save(run) == run
    back = etcfit.load(run)
    assert isinstance(back, Fit)
    assert back.parameters.equals(fit.parameters)
    assert back.score.equals(fit.score)
    assert (back.converged, back.reason, back.warnings) == (fit.converged, fit.reason, fit.warnings)
    assert back.traces == fit.traces
    for file in fit.traces:
        assert back.trace(file).to_frame().equals(fit.trace(file).to_frame())
    assert repr(back) == repr(fit)


@pytest.mark.slow
def test_a_diagnosis_comes_back_as_it_was_and_goes_with_the_next_fit(found: Diagnosed, tmp_path: Path) -> None:
    """One made by hand; a real one is read back by every command of `.ci/bare`."""
    found.save(tmp_path)
    back = etcfit.load(str(tmp_path))
    assert isinstance(back, Diagnosed)
    assert back.ledger.equals(found.ledger)
    assert back.verdict == found.verdict
    assert back.final.parameters.equals(found.final.parameters)
    assert etcfit.reduce(tmp_path).coefficients.equals(etcfit.reduce(found).coefficients)
    found.before.save(tmp_path)
    assert isinstance(etcfit.load(tmp_path), Diagnosed), "the same fit: what was made from it still holds"
    Fit(replace(found.before.result, chi2_per_dof=7.0)).save(tmp_path)
    assert isinstance(etcfit.load(tmp_path), Fit)


@pytest.mark.slow
def test_a_page_is_written_of_what_was_saved(fitted: Fit, tmp_path: Path) -> None:
    fitted.save(tmp_path)
    assert etcfit.report(tmp_path) == tmp_path / "report.html"
    assert (tmp_path / "report.html").is_file()
    page = etcfit.report(fitted, tmp_path / "other")
    assert page.is_file()
    assert (tmp_path / "other" / "pictures").is_dir()


def test_a_run_folder_without_a_fit_is_refused(tmp_path: Path) -> None:
    for verb in (etcfit.load, etcfit.diagnose, etcfit.sample, etcfit.reduce, etcfit.design):
        with pytest.raises(UsageError):
            verb(tmp_path)


def saved(kind: str, fit: Fit, run: Path) -> None:
    """Save something that was made from a fit."""
    made: Any = Made(fit.result.taken_as_exact())
    doors = {
        "keep_design": lambda: fit.keep_design(RunFolder(run), made, {}),
        "keep_reduction": lambda: Reduced(fit, made).save(run),
        "keep_posterior": lambda: Sampled(made).save(run),
    }
    doors[kind]()


@pytest.mark.usefixtures("drawn_quickly")
@pytest.mark.parametrize("kind", ["keep_design", "keep_reduction", "keep_posterior"])
def test_nothing_made_from_one_model_is_saved_beside_another(
    kind: str, fitted: Fit, found: Diagnosed, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept: list[Path] = []
    monkeypatch.setattr(f"etcfit.api.work.{kind}", lambda run, *_: kept.append(run.path))
    monkeypatch.setattr("etcfit.posterior.profile.profiles", lambda *_: {})
    fitted.save(tmp_path / "its own")
    other = replace(fitted.result, values={**fitted.result.values, "R_a": 1.0})
    Fit(other).save(tmp_path / "of another")
    found.save(tmp_path / "diagnosed")
    (tmp_path / "fleet").mkdir()
    (tmp_path / "fleet" / "fleet.json").write_text("{}")
    for name in ("its own", "new"):
        saved(kind, fitted, tmp_path / name)
    for name, why in {"of another": "not the one from which this was made", "diagnosed": "not the one from which",
                      "fleet": "the run folder of a fleet"}.items():  # fmt: skip
        with pytest.raises(UsageError, match=why):
            saved(kind, fitted, tmp_path / name)
    saved(kind, found.final, tmp_path / "diagnosed")
    assert [path.name for path in kept] == ["its own", "new", "diagnosed"]


@pytest.mark.usefixtures("drawn_quickly")
def test_gains_of_a_fleet_are_not_saved_beside_a_fit_or_another_fleet(fitted: Fit, tmp_path: Path) -> None:
    files: Any = None
    gains: Any = Made(fitted.result)
    fitted.save(tmp_path / "fit")
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "fleet.json").write_text("{}")
    for name in ("fit", "other"):
        with pytest.raises(UsageError, match=f"{name} holds results of another fleet than .*mine"):
            Fleet(tmp_path / "mine", files).keep_design(RunFolder(tmp_path / name), gains, {})
