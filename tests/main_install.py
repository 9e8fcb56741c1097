"""A process that sees what a plain `pip install .` brings: whatever else is installed here cannot be imported."""

from __future__ import annotations

import re
import sys
import tomllib
from collections.abc import Iterable, Iterator
from importlib import metadata
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement

PROJECT = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def plain(name: str) -> str:
    """Name of a distribution as indexes compare it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def with_dependencies(requirements: Iterable[str]) -> set[str]:
    """Names of the distributions that these requirements install, by what is installed here."""
    waiting, seen = [("", text) for text in requirements], set[tuple[str, str]]()
    while waiting:
        extra, text = waiting.pop()
        need = Requirement(text)
        if (extra, text) in seen or not (need.marker is None or need.marker.evaluate({"extra": extra})):
            continue
        seen.add((extra, text))
        try:
            requires = metadata.requires(need.name) or []
        except metadata.PackageNotFoundError:  # of another platform
            continue
        waiting += [(wanted, each) for each in requires for wanted in ("", *need.extras)]
    return {plain(Requirement(text).name) for _, text in seen}


class MainInstall(PathFinder):
    """Finds what PathFinder finds, without the modules and the distributions that are hidden."""

    modules: frozenset[str] = frozenset()
    distributions: frozenset[str] = frozenset()

    @classmethod
    def find_spec(cls, fullname: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        return None if fullname.partition(".")[0] in cls.modules else PathFinder.find_spec(fullname, path, target)

    @classmethod
    def find_distributions(cls, *context: Any) -> Iterator[metadata.Distribution]:  # pyright: ignore
        found = PathFinder.find_distributions(*context)
        return (each for each in found if plain(each.name) not in cls.distributions)


def hide_the_rest(*more: str) -> None:
    """Before anything of etcfit is imported.

    Args:
        more: distributions to hide although the main install brings them.
    """
    kept = with_dependencies(PROJECT["dependencies"]) - set(more) | {"etcfit"}
    providers = metadata.packages_distributions()
    hidden = {plain(each) for names in providers.values() for each in names} - kept
    MainInstall.modules = frozenset(module for module, names in providers.items() if {*map(plain, names)} <= hidden)
    MainInstall.distributions = frozenset(hidden)
    sys.meta_path[:] = [MainInstall if finder is PathFinder else finder for finder in sys.meta_path]


def invoke(commands: Iterable[list[str]]) -> list[dict[str, Any]]:
    """Commands of the command line in this process: exit status, stdout and stderr of each."""
    from typer.testing import CliRunner

    from etcfit.cli import app

    return [_ended(CliRunner().invoke(app, words)) for words in commands]


def _ended(done: Any) -> dict[str, Any]:
    raised = "" if isinstance(done.exception, SystemExit | None) else repr(done.exception)
    return {"status": done.exit_code, "out": done.stdout, "err": done.stderr, "raised": raised}
