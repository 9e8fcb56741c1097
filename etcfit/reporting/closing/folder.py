"""How the commands end that make a measurement folder: new, import, fetch."""

from __future__ import annotations

from pathlib import Path

from ...errors import command
from ...importing import Imported
from .base import Closing, number_of

_TOML = "rig.toml"


def of_new(folder: Path) -> Closing:
    """A folder to be filled in."""
    answer = "A rig.toml with every key explained, and a folder for each rig test that says what to record."
    further = command("import", "RECORDING", "--to", "FOLDER", "--rig", folder / _TOML)
    return Closing(answer, f"{further}, once you have filled in each ... of that file", (folder / _TOML,))


def of_imported(done: Imported) -> Closing:
    """Foreign recordings as traces."""
    tests = len({file.partition("/")[0] for file, _, _ in done.traces})
    warned = f", with {number_of(len(done.warnings), 'warning')}" if done.warnings else ""
    answer = f"{number_of(len(done.traces), 'trace')} of {number_of(tests, 'rig test')}{warned}: check units and signs."
    return Closing(answer, command("check", done.folder), (done.folder / _TOML,))


def of_fetched(name: str, folder: Path) -> Closing:
    """A public data set."""
    return Closing(f"{name} is a measurement folder now; its README says what was converted and assumed.",
                   command("check", folder), (folder / "README.md",))  # fmt: skip
