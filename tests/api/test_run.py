"""All verbs one after the other on a small rig that is really fitted, and what they leave in the run folder."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest

import etcfit
import folders
from etcfit.api import verbs
from etcfit.control.pid import RULES


def test_run_leaves_every_file_and_a_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(verbs, "sample", partial(verbs.sample, steps=60))
    monkeypatch.setattr("etcfit.control.design.RULES", {"manual": RULES["manual"]})
    monkeypatch.setattr("etcfit.control.design.binding", lambda task, setpoint: ("stub",))
    monkeypatch.setattr(verbs, "design", partial(verbs.design, rule="manual"))
    monkeypatch.setattr("etcfit.posterior.profile.profiles", lambda posterior, report: {})
    files = {name: text for name, text in folders.good().items() if not name.startswith(("response", "back_emf"))}
    files["rig.toml"] = folders.TOML + '[tests.inductance]\nseries_ohm = "free"\n'
    run = tmp_path / "new" / "run"
    found = etcfit.run(folders.write(tmp_path / "rig", files), run)
    made = {"fit.json", "diagnosis.json", "posterior.json", "posterior.nc", "transfer_function.json", "pid.json"}
    assert made | {"report.html"} <= {path.name for path in run.iterdir()}
    assert found.final.parameters.loc["R_a", "status"] == "estimated"
