"""Errors that carry their own cure."""

from __future__ import annotations

import importlib


class MeasurementError(Exception):
    """The data (or the rig.toml) are wrong: where, what was found, what is required, how to mend it.

    Args:
        where: file, with a line or a column when there is one (`response/3.csv:118`).
        found: what stands there.
        required: what must stand there.
        mend: what the user can do about it.
    """

    def __init__(self, where: str, found: str, required: str, mend: str) -> None:
        self.where, self.found, self.required, self.mend = where, found, required, mend
        super().__init__(f"{where}: {found} {required} {mend}".strip())


class UsageError(Exception):
    """The command line asks for something that cannot be done; exit status 2."""


def require_extra(extra: str, purpose: str, *libraries: str) -> None:
    """Libraries that only an extra installs, checked before the work that needs them in the end.

    Args:
        extra: of this package, "fleet" or "import".
        purpose: what needs them, the subject of the message.
        libraries: names to import.
    Raises:
        UsageError: one cannot be imported.
    """
    for library in libraries:
        try:
            importlib.import_module(library)
        except ImportError as error:
            raise UsageError(f"{purpose} needs the library {library}, which is not installed. "
                             f"Run: pip install 'etcfit[{extra}]'.") from error  # fmt: skip
