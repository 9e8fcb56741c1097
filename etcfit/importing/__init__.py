"""Import: foreign files become a measurement folder, with one reader per format and guesses with reasons; a new rig
gets a rig.toml that explains every key.
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
    """The result of an import."""

    folder: Path  # the folder that was written
    traces: tuple[tuple[str, str, str], ...]  # file in it, its source, and why it is this test
    warnings: tuple[str, ...]  # missing parts of the recordings, and findings of the folder's reader


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
    """Write foreign files as a measurement folder, completely or not at all.

    Args:
        files: recordings of any known format; a DBC among them decodes the bus logs.
        to: the folder to write; it must not exist, or be empty.
        resolve: handles doubtful guesses: accepts them, asks, or refuses.
        rig: a rig.toml to copy; without it a short one is written.
        most: largest size of one recording's numbers in memory, bytes.
        motor: the motor to read from files that have several.
        servo: family whose registers the columns hold, see `formats.servo`.
        report: called with the current step and the share of the work that is done.
    Raises:
        UsageError: `to` is not empty, a file needs a library that is not installed, or an answer names a column that no
            file has.
        MeasurementError: a file cannot be read, is damaged or too large, a doubtful guess is not settled, or the
            folder's reader refuses the result of the guesses.
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
