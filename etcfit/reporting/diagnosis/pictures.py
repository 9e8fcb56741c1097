"""All pictures of a diagnosis: where each goes in RUN/pictures/diagnosis and how it is drawn.

Those of its final model, as of any fit, are `..pictures.jobs` of it.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

from ...diagnosis.findings import Diagnosis
from ...problem.trace import Trace
from ..drawing import Job
from ..pictures import all_traces, file_name
from . import chart, missing, overlay, rounds, unexplained
from .ledger import headline, ledger

_FITTED = 3  # fitted traces that are drawn besides those held out


def jobs(diagnosis: Diagnosis) -> list[Job]:
    """Every picture: path below RUN/pictures/diagnosis, and the call that draws it."""
    return [*summary(diagnosis), *_details(diagnosis), *_overlays(diagnosis)]


def summary(d: Diagnosis) -> list[Job]:
    """The picture that sums up a diagnosis, as `jobs` has it; none where no error is known."""
    entries = ledger(d)
    if not any(entry.known() for entry in entries):
        return []
    return [(Path("ledger.png"), partial(chart.draw, entries, headline(d), d.after.rig.config.synthetic))]


def _details(d: Diagnosis) -> Iterator[Job]:
    synthetic = d.after.rig.config.synthetic
    for enters in ("torque", "voltage"):
        picture = missing.MissingPicture.of(d, enters)
        if picture is not None:
            yield Path(f"missing_{enters}.png"), partial(missing.draw, picture)
    if d.unexplained is not None:
        yield Path("unexplained.png"), partial(unexplained.draw, d.unexplained, d.after.rig.config.travel, synthetic)
    steps = rounds.steps(d)
    if d.added or any(step.others for step in steps):
        yield Path("rounds.png"), partial(rounds.draw, steps, d.added, synthetic)


def _overlays(d: Diagnosis) -> Iterator[Job]:
    """Traces of another rig, those held out, then the driven ones fitted that the first model predicts worst."""
    every = all_traces(d.after)
    shown = [*(each.trace for each in d.aside), *(t for t in every if t.measurement.held_out)]
    driven = [t for t in every if not t.measurement.held_out and t.input and not t.test.boundary.plate_held]
    driven.sort(key=lambda trace: -_worst(d, trace))
    for trace in (*shown, *driven[:_FITTED]):
        yield Path("traces") / file_name(trace), partial(overlay.draw, overlay.Overlay.of(d, trace))


def _worst(d: Diagnosis, trace: Trace) -> float:
    return max((row.rms / row.sigma for row in d.before.score_fit if row.file == trace.measurement.file), default=0.0)
