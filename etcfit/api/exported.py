"""From a fit to the files of another program: what verb and command do alike."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from ..estimation.result import FitResult
    from ..exporting import ExportSettings, Format


class Exported(NamedTuple):
    """An export on the disk.

    Args:
        files: where they are.
        cannot_hold: what the format leaves out, a sentence each; the files say so too.
    """

    files: tuple[Path, ...]
    cannot_hold: tuple[str, ...]


def exported(
    result: FitResult,
    to: Format,
    folder: Path,
    settings: ExportSettings,
    pid: Mapping[str, Any] | None,
    run: Path | None,
    into: Path | None = None,
    anyway: bool = False,
) -> Exported:
    """Write a model in a format.

    Args:
        result: the fit.
        to: the format.
        folder: that takes the files; made if absent.
        settings: step and operating point.
        pid: the object of pid.json; None where no gains were designed.
        run: the run folder, for messages; None where there is none.
        into: the user's own file of that format, of which a copy is changed; None for a new file.
        anyway: see `Source`.
    """
    from ..errors import command
    from ..exporting import Source, write

    source = Source(result.fitted(), settings, pid, command("design", run or "RUN"), into, anyway)
    made = to.export(source)
    return Exported(write(made, folder), made.cannot_hold)
