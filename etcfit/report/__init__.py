"""What a person sees of a fit: tables for the terminal, pictures for the run folder. The only matplotlib; lazy."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ..fit import FitResult
from ..run_folder import fit_json, write_json, write_state

Report = Callable[[str, float], None]


def write_run(run_dir: Path | str, result: FitResult, report: Report | None = None) -> None:
    """Write a fit to its run folder: fit.json, the state that later commands start from, and the pictures.

    Args:
        run_dir: RUN; made if absent. A file of the same name is replaced, whole or not at all.
        result: a fit, converged or not.
        report: called with what is being written and the share done.
    """
    run = Path(run_dir)
    write_json(run / "fit.json", "fit", fit_json(result))
    write_state(run, result)
    from . import pictures, style

    jobs = pictures.jobs(result)
    for k, (path, draw) in enumerate(jobs):
        if report is not None:
            report(f"drawing {path}", k / len(jobs))
        with style.drawing():
            style.save(draw(), run / "pictures" / path)
