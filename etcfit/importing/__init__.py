"""The way in: foreign files become a measurement folder, a reader a format, guesses with reasons; a new rig gets a
rig.toml that explains itself.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..datasets.base import refuse_to_overwrite, write_folder
from ..errors import UsageError
from ..files import digest
from ..rig.config import parse_config
from ..rig.toml import read_text
from ..rig.user_text import refuse_foreign_names
from .answers import Answers, Resolve
from .draft import drafted, read_back, texts
from .formats import read_sheets, require_file, require_readable
from .formats.base import MOST_BYTES, Source
from .sheet import merged, with_common_peaks

_BUS = ".dbc"


@dataclass(frozen=True)
class Imported:
    """What came of an import."""

    folder: Path  # that was written
    traces: tuple[tuple[str, str, str], ...]  # file in it -> where it came from, and why it is this test
    warnings: tuple[str, ...]  # what the recordings lack, and what the folder's reader found


def import_files(
    files: Sequence[Path],
    to: Path,
    answers: Answers,
    resolve: Resolve,
    *,
    rig: Path | None = None,
    most: int = MOST_BYTES,
    motor: str | None = None,
    servo: str | None = None,
    report: Callable[[str, float], None] = lambda stage, done: None,
) -> Imported:
    """Foreign files as a measurement folder, written whole or not at all.

    Args:
        files: recordings of any known format; a DBC among them decodes the bus logs.
        to: the folder to write; must not exist, or be empty.
        answers: what the user said.
        resolve: what to do about guesses in doubt: take them, ask, or refuse.
        rig: a rig.toml to take over; without it a short one is written.
        most: bytes that the numbers of one recording may take in memory.
        motor: the one to take of files that have several.
        servo: family whose registers the columns are, see `formats.servo`.
        report: is told what is being done, and the fraction of it that is.
    Raises:
        UsageError: `to` holds something already, a file needs a library that is not installed, or an answer names a
            column that no file has.
        MeasurementError: a file cannot be read, is damaged or too large, a guess is in doubt and nobody settles it,
            or the folder's reader refuses what the guesses make.
    """
    refuse_to_overwrite(to)
    refuse_foreign_names(str(to), *(str(file) for file in files))
    given = read_text(rig) if rig is not None else ""
    known = parse_config(given, str(rig)) if rig is not None else None
    buses = tuple(file for file in files if file.suffix.casefold() == _BUS)
    recordings = [file for file in files if file not in buses]
    if not recordings:
        raise UsageError("No recording among the files: a DBC alone says only what its frames mean.")
    for file in buses:
        require_file(file, str(file), "A DBC is required.")
    sources = [Source(file, str(file), buses, most, motor, servo) for file in recordings]
    for source in sources:
        require_readable(source)
    sheets = []
    for k, source in enumerate(sources):
        report(f"reading {source.path.name}", 0.8 * k / len(sources))
        sheets += read_sheets(source)
    sheets = with_common_peaks(merged(sheets))
    answers.refuse_unused(sheets)
    report("guessing what they show", 0.8)
    draft = drafted(sheets, answers, known)
    while draft.doubts:
        answers = resolve(draft.doubts, answers)
        draft = drafted(sheets, answers, known)
    report("reading it back", 0.9)
    digests = {str(file): digest(file) for file in files}
    written = texts(draft, to.absolute().name, digests, given)
    rig_read = read_back(draft, written, to)
    lost = (f"{sheet.where}: {each}" for sheet in sheets for each in (*sheet.losses, *sheet.missing))
    traces = tuple((trace.file, trace.record.sheet.where, trace.reason) for trace in draft.traces)
    return Imported(write_folder(to, written), traces, (*dict.fromkeys(lost), *rig_read.warnings))


__all__ = ["Answers", "Imported", "import_files"]
