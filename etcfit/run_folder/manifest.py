"""RUN/run.json: which stage made what, from what; a stage is stale when a hash says so, never by a file's time.

    stages: {NAME: {at, settings, inputs: {FILE: sha256}, outputs: {FILE: sha256}, exit, seconds}}
    aside: {NAME: settings}, of stages that ran once and whose files no longer hold

Inputs of the fit are files of the measurement folder, those of every other stage files of RUN, and of a design the log
and the fleet that it was asked for, as seen from RUN; null stands for one that was not there. A stage that ends
replaces its outputs, all of them or none, and until then the old ones and their record stand (`commit`); what later
stages made from the old ones is moved to RUN/superseded/, so that nothing is lost and no two models are ever mixed.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from shlex import quote
from typing import Any, NamedTuple

from .. import __version__
from ..errors import UsageError, command
from ..files import SUPERSEDED, held, plain, write_json
from ..files import digest as sha256_of
from . import declared
from .commit import all_or_none, settle
from .declared import by_name, key

MANIFEST = "run.json"
FIT_STATE, DIAGNOSIS_STATE = "fit_state.npz", "diagnosis_state.npz"
DIAGNOSIS_ROUNDS = "diagnosis_rounds.npz"  # of a diagnosis under way
POSTERIOR = "posterior.nc"
FLEET = "fleet.json"  # of many units; its run folder has no manifest
CONVERGED, NOT_CONVERGED = 0, 3  # exit statuses of a stage, by the model that it shows


def failure_of(converged: bool, reason: str) -> str:
    """Why the model that is shown did not converge, or ""."""
    return "" if converged else f"the fit of the model that is shown did not converge: {reason}"


@dataclass(frozen=True)
class StageFiles:
    """What a stage makes, and from what."""

    makes: tuple[str, ...]  # files below RUN that it leaves there; the first always, another may have nothing to say
    # the models below RUN that it is made from, where they are there: its files are of no use once these are others.
    # Those of the fit are the measurements.
    needs: tuple[str, ...] = ()
    # what it takes in besides where it is there: its files are true without, and better made again
    uses: tuple[str, ...] = ()
    # the same, of a later stage: its files hold where that comes afterwards, and are better made again where what they
    # were made with has changed
    may_use: tuple[str, ...] = ()
    beside: tuple[str, ...] = ()  # pictures, and a page on demand, that go along with its files
    command: str = ""  # what writes them

    def command_for(self, run: Path, record: Record | None = None) -> str:
        """The command with its run folder, and the folder of the measurements where the record knows it."""
        known = None if record is None or (record.folder or "").startswith("<") else record.folder  # <frames>: none
        folder = os.path.normpath(run / known) if known else "FOLDER"
        return self.command.format(run=quote(str(run)), folder=quote(folder))


_MODEL = (FIT_STATE, DIAGNOSIS_STATE)
_RESULTS = ("fit.json", "diagnosis.json", "posterior.json", "transfer_function.json", "frequency_response.json",
            "pid.json")  # fmt: skip
_CONTROL = "pictures/control"
_AGES = 1e9  # s that no stage takes
_OF_DESIGN = tuple(f"{_CONTROL}/{name}.png" for name in ("responses", "scenarios", "front", "safety"))
# in order: a stage needs only what stages before it make
STAGE_FILES: Mapping[str, StageFiles] = {
    "fit": StageFiles(("fit.json", FIT_STATE), command="etcfit fit {folder} --out {run}"),
    "diagnose": StageFiles(
        ("diagnosis.json", DIAGNOSIS_STATE), (FIT_STATE,), (), (), ("pictures/diagnosis", "pictures/before"),
        "etcfit diagnose {run}",
    ),
    "reduce": StageFiles(
        ("transfer_function.json", "frequency_response.json"), _MODEL, (), (),
        (f"{_CONTROL}/bode.png", f"{_CONTROL}/sines.png"), "etcfit reduce {run}",
    ),
    "design": StageFiles(
        ("pid.json",), _MODEL, (), (POSTERIOR,), _OF_DESIGN, "etcfit design {run}"
    ),
    "sample": StageFiles(("posterior.json", POSTERIOR), _MODEL, (), (), ("pictures/posterior",), "etcfit sample {run}"),
    "report": StageFiles(
        ("report.html",), _MODEL, _RESULTS, (), ("report_interactive.html",), "etcfit report {run}"
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Record:
    """The last time a stage ran."""

    at: str  # when it ended, ISO 8601
    settings: Mapping[str, Any]  # what it ran with
    # inputs, outputs: SHA-256 by file; null for one that was not there
    inputs: Mapping[str, str | None]
    outputs: Mapping[str, str | None]
    exit: int  # its exit status
    folder: str | None = None  # where the measurements lie, as seen from RUN; of the fit only
    seconds: float | None = None  # how long it took; None where nobody noted it


_HASH = {"pattern": "^[0-9a-f]{64}$"}
STAGE = declared.Record(
    "The last time this stage ran.",
    at=key("text", "When it ended, ISO 8601 with its offset from UTC."),
    settings=key("object", "Options and settings it ran with."),
    inputs=key("{text?}", "SHA-256 of every file it read, by path. A stage is stale when a hash differs, never by a "
        "file's time.", each=_HASH),
    outputs=key("{text?}", "SHA-256 of every file it wrote, by path below RUN.", each=_HASH),
    exit=key("whole", "Its exit status."),
    folder=key("text", "Where the measurements lie, as seen from RUN; of the fit only.", optional=True),
    seconds=key("number", "How long it took, where that was noted: what the next one says it will take.",
        optional=True),
)  # fmt: skip
RUN = declared.Record(
    "The manifest of a run folder: which stage made what, from what. Written by every command that writes to RUN.",
    version=key("text", "Version of etcfit that wrote the manifest last.", lambda _: __version__),
    stages=key(by_name(STAGE), "By name of the stage: fit, diagnose, reduce, design, sample, report."),
    aside=key("{object}", "By name of a stage that ran once and whose files no longer hold (moved to superseded/): the "
        "options and settings it ran with. `etcfit run` makes it anew with those options.", optional=True),
)  # fmt: skip


def is_fleet(run: Path) -> bool:
    """Whether a run folder is that of a fleet."""
    return (run / FLEET).is_file()


def digest(path: Path) -> str | None:
    """SHA-256 of a file; None where there is none."""
    return sha256_of(path) if path.is_file() else None


def read_records(run: Path) -> dict[str, Record]:
    """The stages that ran, by name.

    Raises:
        UsageError: RUN was written by another version, or its manifest is not one.
    """
    return _read(run).stages


def settings_before(run: Path) -> dict[str, Mapping[str, Any]]:
    """What each stage last ran with, by name, whether its files still hold or not."""
    return _read(run).settings


class _Manifest(NamedTuple):
    """run.json as it lies there: see the head of this file."""

    stages: dict[str, Record]
    aside: dict[str, Mapping[str, Any]]

    @property
    def settings(self) -> dict[str, Mapping[str, Any]]:
        """What each stage last ran with, by name, whether its files still hold or not."""
        return self.aside | {name: record.settings for name, record in self.stages.items()}


def _read(run: Path) -> _Manifest:
    settle(run, _take_down)
    found = [name for files in STAGE_FILES.values() for name in files.makes if (run / name).is_file()]
    if found and not (run / MANIFEST).is_file():
        raise _foreign(run, f"holds {found[0]} but no {MANIFEST}: an older version of etcfit (0.1) wrote it")
    return _as_it_lies(run)


def _as_it_lies(run: Path) -> _Manifest:
    path = run / MANIFEST
    if not path.is_file():
        return _Manifest({}, {})
    try:
        content = json.loads(path.read_bytes())
        version, stages = str(content["version"]), content["stages"]
        if content["schema"] != "etcfit.run/1" or _series(version) != _series(__version__):
            raise _foreign(run, f"was written by etcfit {version}, and this is {__version__}")
        aside = content.get("aside", {})
        if not _is_object(aside) or not all(map(_is_object, aside.values())):
            raise ValueError("aside holds no settings by name")
        return _Manifest({name: _record(name, stage) for name, stage in stages.items()}, aside)
    except (OSError, KeyError, ValueError, TypeError, AttributeError, RecursionError) as error:
        why = f"{type(error).__name__}: {error}"[:200]
        raise UsageError(f"{path} cannot be read as the manifest of a run ({why}). Fit again into another "
                         f"folder: `{STAGE_FILES['fit'].command_for(Path('OTHER'))}`. Or delete {run} and run the "
                         "same command again.") from None  # fmt: skip


def _is_object(value: Any) -> bool:
    return isinstance(value, dict)


def _are_hashes(value: Any) -> bool:
    return _is_object(value) and all(sha is None or isinstance(sha, str) for sha in value.values())


_OF_A_RECORD: Mapping[str, Callable[[Any], bool]] = {
    "at": lambda value: isinstance(value, str),
    "settings": _is_object,
    "inputs": _are_hashes,
    "outputs": _are_hashes,
    "exit": lambda value: isinstance(value, int),
    "folder": lambda value: value is None or isinstance(value, str),
    "seconds": lambda value: value is None or (isinstance(value, int | float) and 0.0 <= value < _AGES),
}


def _record(name: str, stage: Mapping[str, Any]) -> Record:
    """One stage of the manifest, each key of the kind that `Record` says."""
    for known, fits in _OF_A_RECORD.items():
        if not fits(stage.get(known)):
            raise ValueError(f"{known} of stage {name} is {json.dumps(stage.get(known))[:60]}")
    fields: dict[str, Any] = {known: stage.get(known) for known in _OF_A_RECORD}
    return Record(**fields)


def _series(version: str) -> list[str]:
    """Major and minor number: within them, files are read by each other's programs."""
    return version.split(".")[:2]


def _foreign(run: Path, why: str) -> UsageError:
    return UsageError(f"{run} {why}. Nothing in it was changed. Name another run folder with --out and fit again, "
                      f"or delete {run}.")  # fmt: skip


@contextmanager
def replacing(
    run: Path,
    stage: str,
    exit: int,
    settings: Mapping[str, Any],
    inputs: Mapping[str, str | None] | None = None,
    folder: str | None = None,
    outside: Sequence[Path] = (),
) -> Iterator[Path]:
    """A folder for the files of a stage, which take their places in RUN once the block ends well, with a word on the
    manifest; what later stages had made from those they replace goes aside. All of it is done, or none: until then the
    old files and their record stand, however this process ends.

    Args:
        run, stage: which; the run folder is made if absent.
        exit: its exit status.
        settings: what it ran with.
        inputs: SHA-256 by file; those of RUN where not given.
        folder: of the measurements.
        outside: files outside of RUN that it read besides.
    Raises:
        UsageError: another process writes there, or another version wrote RUN.
    """
    with held(run):
        read_records(run)
        files = STAGE_FILES[stage]
        of_run = (*files.needs, *files.uses, *files.may_use)
        taken = {name: digest(run / name) for name in of_run} if inputs is None else dict(inputs)
        taken |= {seen_from(run, path): digest(path) for path in outside}
        with all_or_none(run) as draft:
            yield draft.files
            outputs = {name: digest(draft.files / name) for name in files.makes}
            now = datetime.now(UTC).isoformat(timespec="seconds")
            draft.note({stage: STAGE.written(Record(now, plain(settings), taken, outputs, exit, folder))})
        settle(run, _take_down)


def _take_down(run: Path, note: Mapping[str, Any]) -> None:
    """Put the stage whose files were put in place on the manifest, and aside what later stages had made from what they
    replaced."""
    for stage, written in note.items():
        record = _record(stage, written)
        for name, sha in record.outputs.items():
            if sha is None:
                _put_aside(run, name)
        names = list(STAGE_FILES)
        _write(run, _without_stale(run, names[names.index(stage) + 1 :], _as_it_lies(run).stages | {stage: record}))


def is_current(run: Path, stage: str, records: Mapping[str, Record]) -> bool:
    """Whether a stage's files are those it wrote, of the model that lies in RUN now (or, of a fit, any folder's)."""
    record = records.get(stage)
    if record is None or any(digest(run / name) != sha for name, sha in record.outputs.items()):
        return False
    return all(record.inputs.get(name) == digest(run / name) for name in STAGE_FILES[stage].needs)


def is_latest(run: Path, stage: str, records: Mapping[str, Record]) -> bool:
    """Whether a stage is current and nothing that it uses besides has changed.

    A file outside of RUN that was taken away has not changed: nothing newer could be made without it. Nor has what a
    later stage made since, where there was nothing of it before.
    """
    current = is_current(run, stage, records)
    if not current or stage == "fit":
        return current
    was, files = records[stage].inputs, STAGE_FILES[stage]
    always = (*files.needs, *files.uses)
    others = [name for name, sha in was.items() if name not in always and sha is not None]
    return all(was.get(name) == digest(run / name) for name in always) and all(
        digest(run / name) in (None, was[name]) for name in others
    )


def note_seconds(run: Path, stage: str, seconds: float) -> None:
    """Put down how long a stage that ended took, for whoever waits for the next one."""
    with held(run):
        records = read_records(run)
        if stage in records:
            _write(run, records | {stage: replace(records[stage], seconds=round(seconds, 1))})


def seen_from(run: Path, path: Path) -> str:
    """A path outside of RUN as seen from there, so that both can be moved together."""
    try:
        return Path(os.path.relpath(path, run)).as_posix()
    except ValueError:  # another drive
        return str(path.resolve())


def require(run: Path, stage: str) -> Record:
    """The record of a stage whose files can be trusted.

    Raises:
        UsageError: it has not run, its files are not those it wrote, or they were made from something else.
    """
    records = read_records(run)
    record = records.get(stage)
    again = STAGE_FILES[stage].command_for(run, record)
    if record is None and (run / "rig.toml").is_file():
        raise UsageError(f"{run} is a measurement folder, no run folder. Fit it first, into a folder of its own: "
                         f"`{command('fit', run, '--out', Path('runs') / run.resolve().name)}`.")  # fmt: skip
    if record is None:
        made = STAGE_FILES[stage].makes[0]
        raise UsageError(f"{run} holds no finished `etcfit {stage}` ({made} is not there, or not on {MANIFEST}). "
                         f"Run `{again}` first.")  # fmt: skip
    for name, sha in record.outputs.items():
        if digest(run / name) != sha:
            raise UsageError(f"{run / name} is not the file that `etcfit {stage}` wrote there: it was changed, "
                             f"replaced or taken away. Run `{again}` again.")  # fmt: skip
    if not is_current(run, stage, records):
        raise UsageError(f"What `etcfit {stage}` wrote to {run} was made from another model than the one that lies "
                         f"there now. Run `{again}` again.")  # fmt: skip
    return record


def set_aside_stale(run: Path) -> None:
    """Move what no longer holds out of the way, so that a page can be made of the others before it is redone."""
    results = [name for name in STAGE_FILES if name not in ("fit", "report")]
    with held(run):
        _write(run, _without_stale(run, results, read_records(run)))


def _without_stale(run: Path, names: Sequence[str], records: Mapping[str, Record]) -> dict[str, Record]:
    """The records that still hold; files of these stages that do not are moved out of the way."""
    kept = dict(records)
    for name in names:
        if not is_current(run, name, kept):
            kept.pop(name, None)
            for file in (*STAGE_FILES[name].makes, *STAGE_FILES[name].beside):
                _put_aside(run, file)
    return kept


def _put_aside(run: Path, name: str) -> None:
    source, target = run / name, run / SUPERSEDED / name
    if not source.exists():
        return
    if target.is_dir():
        shutil.rmtree(target)
    target.parent.mkdir(parents=True, exist_ok=True)
    source.replace(target)


def _write(run: Path, records: Mapping[str, Record]) -> None:
    stages = {name: records[name] for name in STAGE_FILES if name in records}
    aside = {name: settings for name, settings in _as_it_lies(run).settings.items() if name not in records}
    write_json(run / MANIFEST, "run", RUN.written({"stages": stages, "aside": aside}))
