"""All verbs one after the other on a small rig that is really fitted, and what they leave in the run folder."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import pytest

import etcfit
import folders
from etcfit.api import verbs
from etcfit.control.pid import RULES


class Unsampled:
    """Stands for a posterior, which takes minutes; it remembers where it was saved."""

    def __init__(self) -> None:
        self.saved: list[Any] = []

    def save(self, run: Any, quiet: bool = False) -> None:
        self.saved.append(run)


@pytest.mark.slow  # a diagnosis compiles for minutes
def test_run_leaves_every_file_and_a_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    posterior = Unsampled()
    monkeypatch.setattr(verbs, "sample", lambda found, keep, quiet: posterior)
    monkeypatch.setattr("etcfit.control.design.RULES", {"manual": RULES["manual"]})
    monkeypatch.setattr("etcfit.control.design.binding", lambda task, setpoint: ("stub",))
    monkeypatch.setattr(verbs, "design", partial(verbs.design, rule="manual"))
    run = tmp_path / "new" / "run"
    found = etcfit.run(folders.write(tmp_path / "rig", folders.held()), run)
    made = {"fit.json", "diagnosis.json", "transfer_function.json", "pid.json", "report.html"}
    assert made <= {path.name for path in run.iterdir()}
    assert posterior.saved == [run]
    assert found.final.parameters.loc["R_a", "status"] == "estimated"
