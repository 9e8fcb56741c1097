"""Files that take their places in a run folder together: all of them or none, whenever the process is killed.

    RUN/.draft-*   files while they are written; the next writer deletes those of one that was killed
    RUN/.done      the same folder renamed, which is the instant at which all of them count
    RUN/...        each moved to its place, what must be done besides done, and .done deleted

Whoever comes upon RUN/.done finishes it first: every step can be done again.
"""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors import UsageError
from ..files import Busy, held, scratch_folder

_DONE = ".done"
_NOTE = "note.json"
_ALONE = "alone.json"
_MOST_WAIT = 10.0  # s for another process to put its files in place: it takes milliseconds


@dataclass(frozen=True)
class Draft:
    """Files to be."""

    place: Path  # the scratch folder

    @property
    def files(self) -> Path:
        """Stands for RUN: the files lie here as they will lie there."""
        return self.place / "files"

    def alone(self, folder: str) -> None:
        """Delete what lies in a folder of RUN besides the files of this draft."""
        names = [path.name for path in (self.files / folder).iterdir()] if (self.files / folder).is_dir() else []
        (self.place / _ALONE).write_text(json.dumps({folder: names}), encoding="utf-8")

    def note(self, content: Mapping[str, Any]) -> None:
        """What to do besides, for `settle`."""
        (self.place / _NOTE).write_text(json.dumps(content), encoding="utf-8")


@contextmanager
def all_or_none(run: Path) -> Iterator[Draft]:
    """A draft that counts once the block ends well; RUN must be held, and `settle` puts the files in their places.

    Raises:
        OSError: a file cannot be written; the error names the one in RUN.
    """
    with scratch_folder(run) as place:
        draft = Draft(place)
        draft.files.mkdir()
        with _named_in(run, draft.files):
            yield draft
        place.replace(run / _DONE)


@contextmanager
def _named_in(run: Path, files: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        given = Path(str(error.filename or ""))
        if given.is_relative_to(files):
            raise type(error)(error.errno, error.strerror, str(run / given.relative_to(files))) from error
        raise


def settle(run: Path, finish: Callable[[Path, Mapping[str, Any]], None] = lambda run, note: None) -> None:
    """Put files that count in their places, where that was not done yet.

    Args:
        finish: does what was noted, from RUN and the note, once the files are there; it may be done again.
    Raises:
        Busy: another process has been doing so for very long.
        UsageError: what was noted is nothing that this version can do.
        OSError: a file cannot be moved.
    """
    done = run / _DONE
    until = time.monotonic() + _MOST_WAIT
    while done.is_dir():
        try:
            with held(run):
                _settled(run, done, finish)
        except Busy:
            if time.monotonic() > until:
                raise
            time.sleep(0.02)


def _settled(run: Path, done: Path, finish: Callable[[Path, Mapping[str, Any]], None]) -> None:
    if not done.is_dir():
        return
    if (done / _ALONE).is_file():
        for folder, names in json.loads((done / _ALONE).read_bytes()).items():
            for old in (each for each in (run / folder).glob("*.png") if each.name not in names):
                old.unlink()
    for file in sorted(each for each in (done / "files").rglob("*") if each.is_file()):
        place = run / file.relative_to(done / "files")
        place.parent.mkdir(parents=True, exist_ok=True)
        file.replace(place)
    if (done / _NOTE).is_file():
        try:
            finish(run, json.loads((done / _NOTE).read_bytes()))
        except (ValueError, TypeError, AttributeError) as error:
            raise UsageError(f"{done / _NOTE} cannot be read ({error}). Delete {done}, and run the command that was "
                             "interrupted again.") from None  # fmt: skip
        (done / _NOTE).unlink()
    shutil.rmtree(done)
