"""RUN/report.html: one self-contained page of everything in a run folder.

It is made only from the folder's files (formats.md), so that it can be made again, elsewhere and later, without a
fit. JSON files are read by the keys of formats.md; further keys are allowed, and optional ones may be absent.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...problem.prediction_error import PredictionError
from ...run_folder.manifest import CONVERGED, NOT_CONVERGED, failure_of, replacing, require
from ...run_folder.reading import object_in


@dataclass(frozen=True)
class Page:
    """The written page."""

    path: Path
    failure: str  # why its model did not converge, or ""
    missing: str = ""  # why pictures are missing, or ""


def write_page(run_dir: Path | str) -> Page:
    """Write RUN/report.html, completely or not at all, from RUN/fit.json and the other files in the run folder.

    Returns:
        The page's path, and whether its model converged.
    Raises:
        UsageError: no fit.json, or an invalid file in the run.
    """
    from .render import render  # the closing of a fit reads contents and verdict without these modules

    run = Path(run_dir)
    contents = read_run(run)
    page = render(contents)
    final = contents.final
    converged = final.get("converged", True)
    with replacing(run, "report", CONVERGED if converged else NOT_CONVERGED, {}) as draft:
        (draft / "report.html").write_text(page, encoding="utf-8")
    return Page(run / "report.html", failure_of(converged, final.get("reason", "")))


_STAGE = {"fit": "fit", "diagnosis": "diagnose", "posterior": "sample", "transfer_function": "reduce",
          "frequency_response": "reduce", "pid": "design"}  # fmt: skip
KINDS = tuple(_STAGE)
_NEEDED = {
    "fit": ("model", "parameters", "score"),
    "diagnosis": ("parameters",),
    "pid": ("rule", "gains"),
    "tune": ("says", "steps"),
}
_ROW = ("file", "test", "channel", "unit", "n", "rms", "sigma")


@dataclass(frozen=True)
class Contents:
    """A run folder."""

    run: Path
    files: Mapping[str, Mapping[str, Any]]  # content of each JSON file by kind (see KINDS); absent ones are left out
    hashes: Mapping[str, str]  # SHA-256 of those files by name

    def get(self, kind: str) -> Mapping[str, Any]:
        """The object of a file; empty if there is none."""
        return self.files.get(kind, {})

    @property
    def final(self) -> Mapping[str, Any]:
        """The file of the last model: the diagnosis, or the fit if there is none."""
        return self.files.get("diagnosis") or self.files["fit"]

    @property
    def added(self) -> tuple[str, ...]:
        """Effects that the diagnosis found."""
        return tuple(self.get("diagnosis").get("added") or ())

    @property
    def score(self) -> Mapping[str, Any]:
        """Errors of the final model."""
        return self.get("diagnosis").get("after") or self.files["fit"]["score"]


def read_run(run: Path) -> Contents:
    """Read every JSON file of a run folder.

    Raises:
        UsageError: no fit, or a file of the run is invalid or was made from another model.
    """
    require(run, "fit")
    files, hashes = {}, {}
    for kind in KINDS:
        path = run / f"{kind}.json"
        if path.is_file():
            require(run, _STAGE[kind])
            raw = path.read_bytes()
            files[kind], hashes[path.name] = _object(path, kind, raw), hashlib.sha256(raw).hexdigest()
    return Contents(run, files, hashes)


def logs_of(run: Path) -> Mapping[str, Any]:
    """The object of RUN/drive.json, which no stage makes; empty if there is none."""
    path = run / "drive.json"
    return _object(path, "drive", path.read_bytes()) if path.is_file() else {}


def tuned_of(run: Path) -> Mapping[str, Any]:
    """The object of RUN/tune.json if its gains are those of pid.json, else empty."""
    path, gains = run / "tune.json", run / "pid.json"
    if not path.is_file():
        return {}
    tuned = _object(path, "tune", path.read_bytes())
    of_gains = hashlib.sha256(gains.read_bytes()).hexdigest() if gains.is_file() else ""
    return tuned if tuned.get("pid") == of_gains else {}


def rows_of(rows: Sequence[Mapping[str, Any]]) -> list[PredictionError]:
    """Rows of `score` (formats.md), without rows of a model that could not be simulated."""
    return [
        PredictionError(**{key: row[key] for key in _ROW}) for row in rows if row["rms"] is not None and row["sigma"]
    ]


def _object(path: Path, kind: str, raw: bytes) -> Mapping[str, Any]:
    return object_in(path, kind, _NEEDED.get(kind, ()), "Run the command that writes it again, or delete it.", raw)
