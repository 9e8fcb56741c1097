"""What a fit and a diagnosis know at their end, saved whole and loaded whole: no stage re-derives it."""

from __future__ import annotations

import json
import os
import shlex
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from ..errors import UsageError, command
from ..estimation.result import FitResult
from ..files import held, write_json
from ..rig.base import FRAMES, Rig
from ..rig.reader import KNOWN_TESTS, digests_of
from . import codec
from .fit import FIT
from .manifest import (
    CONVERGED,
    DIAGNOSIS_ROUNDS,
    DIAGNOSIS_STATE,
    FIT_STATE,
    NOT_CONVERGED,
    STAGE_FILES,
    Record,
    failure_of,
    is_latest,
    read_records,
    replacing,
    require,
    seen_from,
)

if TYPE_CHECKING:  # who saves a fit needs none of what these load
    from ..diagnosis.findings import Diagnosis

T = TypeVar("T")


def exit_of(result: FitResult) -> int:
    """Exit status of a stage that shows this model."""
    return CONVERGED if result.converged else NOT_CONVERGED


def save_fit(run: Path, result: FitResult, beside: Callable[[Path], None] | None = None) -> None:
    """RUN/fit.json and RUN/fit_state.npz, and a word on them in RUN/run.json.

    Args:
        run: the run folder; made if absent. What later stages made from another fit is moved to RUN/superseded.
        result: a fit, converged or not.
        beside: what to do, in a folder that stands for RUN until all is there, before the files take their places.
    Raises:
        UsageError: RUN was written by another version, another process writes there, or it lies among the measurements.
    """
    if result.rig.folder != FRAMES:
        refuse_among_measurements(Path(result.rig.folder), run)
    folder = FRAMES if result.rig.folder == FRAMES else seen_from(run, Path(result.rig.folder))
    with replacing(run, "fit", exit_of(result), asdict(result.settings), result.rig.digests, folder) as draft:
        codec.save(draft / FIT_STATE, result)
        write_json(draft / "fit.json", "fit", FIT.json(result))
        if beside is not None:
            beside(draft)


def save_diagnosis(run: Path, diagnosis: Diagnosis, beside: Callable[[Path], None] | None = None) -> None:
    """RUN/diagnosis.json and RUN/diagnosis_state.npz; the fit it began from is saved first where RUN holds another.

    The rounds that were kept while it was under way are deleted.
    """
    from .diagnosis import DIAGNOSIS

    with held(run):
        # the fit in RUN is this very one where its file would be the same byte for byte
        is_there = (run / FIT_STATE).is_file() and "fit" in read_records(run)
        if not (is_there and codec.same(run / FIT_STATE, diagnosis.before)):
            save_fit(run, diagnosis.before)
        with replacing(run, "diagnose", exit_of(diagnosis.after), asdict(diagnosis.settings)) as draft:
            codec.save(draft / DIAGNOSIS_STATE, diagnosis, {FIT_STATE: diagnosis.before})
            write_json(draft / "diagnosis.json", "diagnosis", DIAGNOSIS.json(diagnosis))
            if beside is not None:
                beside(draft)
        (run / DIAGNOSIS_ROUNDS).unlink(missing_ok=True)


def load_fit(run: Path) -> FitResult:
    """The fit that `save_fit` wrote, bit for bit.

    Raises:
        UsageError: there is none, it is not the one that was written, or its measurements have changed since.
    """
    record = require(run, "fit")
    _must_be_measured_so(run, record)
    return _loaded(run / FIT_STATE, FitResult, STAGE_FILES["fit"].command_for(run, record))


def load_diagnosis(run: Path) -> Diagnosis:
    """The diagnosis that `save_diagnosis` wrote, bit for bit, with the fit that it began from."""
    from ..diagnosis.findings import Diagnosis

    record = require(run, "diagnose")
    return _loaded(run / DIAGNOSIS_STATE, Diagnosis, STAGE_FILES["diagnose"].command_for(run, record), load_fit(run))


def load_final(run: Path) -> FitResult:
    """The final model of the diagnosis where RUN holds one, else the fit."""
    return load_diagnosis(run).after if has_diagnosis(run) else load_fit(run)


def has_diagnosis(run: Path) -> bool:
    """Whether a diagnosis lies in RUN, on its manifest or not: one that is not must be refused, not passed over."""
    return "diagnose" in read_records(run) or (run / DIAGNOSIS_STATE).is_file()


def _loaded(path: Path, kind: type[T], again: str, fit: FitResult | None = None) -> T:
    try:
        found = codec.load(path, {} if fit is None else {FIT_STATE: fit})
        if not isinstance(found, kind):
            raise codec.Unreadable(f"it holds {type(found).__name__}, not {kind.__name__}")
        return found
    except codec.Unreadable as error:
        raise UsageError(f"{path} was not written by this version of etcfit, or not whole ({error}). "
                         f"Run `{again}` again.") from None  # fmt: skip


def is_same_model(one: FitResult, other: FitResult) -> bool:
    """Whether both have the same measurements and the same parameters to the last bit; their intervals may differ, as
    where formulas are taken as exact."""
    if one is other:
        return True
    if one.rig.digests != other.rig.digests or list(one.values) != list(other.values):
        return False
    return np.array_equal(list(one.values.values()), list(other.values.values()), equal_nan=True)


def _must_be_measured_so(run: Path, record: Record) -> None:
    """Refuse a fit whose measurements have changed since; where they were taken away what was saved will do."""
    folder = measurements_of(run, record)
    if folder is None or not folder.is_dir():
        return
    if changed := changes_of(folder, record):
        raise UsageError(f"{folder} has changed since {run} was fitted to it ({', '.join(changed)}). "
                         f"Run `{command('fit', folder, '--out', run)}` again.")  # fmt: skip


def measurements_of(run: Path, record: Record) -> Path | None:
    """The measurement folder of a fit; None where its traces were data frames."""
    if not record.folder or record.folder == FRAMES:
        return None
    return Path(os.path.normpath(run / record.folder))


def changes_of(folder: Path, record: Record) -> list[str]:
    """Files of a measurement folder that are not what the fit read, new ones and lost ones among them."""
    now = digests_of(folder)
    return sorted(file for file in {*now, *record.inputs} if now.get(file) != record.inputs.get(file))


def is_done(run: Path, stage: str, folder: Path) -> bool:
    """Whether a stage need not run again: its files are those it wrote, from what lies in RUN and in FOLDER now."""
    records = read_records(run)
    if not is_latest(run, stage, records):
        return False
    return stage != "fit" or not changes_of(folder, records["fit"])


def last_failure(run: Path) -> str:
    """Why the last model in RUN did not converge, or ""."""
    records = read_records(run)
    for stage, name in (("diagnose", "diagnosis.json"), ("fit", "fit.json")):
        if stage in records:
            content = json.loads((run / name).read_text(encoding="utf-8"))
            return failure_of(content["converged"], content["reason"])
    return ""


def refuse_among_measurements(folder: Path, run: Path) -> None:
    """A run folder must be no measurement folder and lie in none of its rig tests: files of both would be mixed."""
    place, target = folder.resolve(), run.resolve()
    if not target.is_relative_to(place):
        return
    below = target.relative_to(place).parts
    if not below or below[0] in KNOWN_TESTS:
        what = f"lies in {folder / below[0]}, the folder of a rig test" if below else "is the measurement folder itself"
        elsewhere = shlex.quote(str(Path("runs") / place.name))
        raise UsageError(f"{run} {what}. Name a run folder outside of it: --out {elsewhere}.")


def refuse_measurement_folder(out: Path) -> None:
    """As `refuse_among_measurements`, of the nearest measurement folder: `out` itself or one that it lies in."""
    target = out.resolve()
    nearest = next((each for each in (target, *target.parents) if (each / "rig.toml").is_file()), None)
    if nearest is not None:
        refuse_among_measurements(nearest, out)


def must_belong(run: Path, folder: Path) -> None:
    """Refuse a run folder that was made from other measurements."""
    record = read_records(run).get("fit")
    made_from = None if record is None else measurements_of(run, record)
    if record is not None and (made_from is None or made_from.resolve() != folder.resolve()):
        raise UsageError(f"{run} was made from {made_from or 'data frames'}, not from {folder}. Name another run "
                         "folder with --out, or delete this one.")  # fmt: skip


def fitted_to(run: Path, rig: Rig) -> FitResult:
    """The last model in RUN, as `load_final`, for whoever looks at its measurements once more.

    Raises:
        UsageError: no fit there, or of other measurements.
    """
    must_belong(run, Path(rig.folder))
    return load_final(run)
