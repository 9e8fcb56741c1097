"""A version of etcfit that is measured: where its files lie, and what its commands took."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from ..runs import ROOT, Failed, Run, Skipped, run

INSIDE = Path(__file__).with_name("inside.py")
CONVERGED_OR_NOT = (0, 3)  # exit statuses of a command that did its work


@dataclass(frozen=True)
class Version:
    """A tree, and folders for what is made with it.

    Args:
        name: "old" or "new".
        tree: its files.
        commit: short, "-dirty" where files were changed since.
        scratch: for its run folders and caches.
        shared: for measurement folders, the same for all versions.
        limit: s that a process may take.
    """

    name: str
    tree: Path
    commit: str
    scratch: Path
    shared: Path
    limit: float = field(default=1200.0, kw_only=True)

    @classmethod
    def of(cls, name: str, wanted: str, scratch: Path, limit: float) -> Version:
        """That of a folder, or of a commit, whose files are taken from git; its byte code is made."""
        tree, commit = (_folder if Path(wanted).is_dir() else partial(_archived, scratch / f"{name} tree"))(wanted)
        subprocess.run([sys.executable, "-m", "compileall", "-q", "etcfit", "benchmarks"], cwd=tree, check=True)
        own, shared = scratch / name, scratch / "shared"
        own.mkdir()
        shared.mkdir(exist_ok=True)
        return cls(name, tree, commit, own, shared, limit=limit)

    def __str__(self) -> str:
        text = (self.tree / "etcfit" / "__init__.py").read_text(encoding="utf-8")
        found = re.search(r'__version__ = "(.*)"', text)
        return f"{self.name}: etcfit {found[1] if found else '?'}, commit {self.commit}"

    @property
    def cache(self) -> Path:
        """Compiled models of what is not measured cold."""
        return self.scratch / "cache"

    def python(self, *arguments: Any, cache: Path | None = None, **how: Any) -> Run:
        """`python arguments` with this version's packages; see `run`."""
        return run(arguments, cache or self.cache, self.tree, self.limit, **how)

    def etcfit(self, *arguments: Any, **how: Any) -> Run:
        """`etcfit arguments`."""
        return self.python("-m", "etcfit.cli", *arguments, **how)

    def inside(self, job: str, *arguments: Any) -> dict[str, float]:
        """What a job of `inside.py` says of this version."""
        told = self.python("-P", INSIDE, job, *arguments)
        return json.loads(told.stdout.splitlines()[-1])

    @contextmanager
    def room(self) -> Iterator[Path]:
        """An empty folder, gone afterwards."""
        with tempfile.TemporaryDirectory(dir=self.scratch) as name:
            yield Path(name)

    def fitted(self, folder: Path) -> Path:
        """A run folder with this version's fit of a measurement folder; it is never written to again."""

        def make(into: Path) -> None:
            self.etcfit("fit", folder, "--out", into / "run", "--quiet", accepted=CONVERGED_OR_NOT)

        return once(self.scratch / f"fit of {folder.name}", make) / "run"

    def warmed(self, name: str, work: Callable[[Path], object]) -> Path:
        """A cache in which that work was done before."""
        return once(self.scratch / f"cache of {name}", work)

    def folder(self, name: str) -> Path:
        """A measurement folder of `folders.py`."""
        return once(self.shared / name, lambda into: _made(name, into, self.limit))


def once(path: Path, make: Callable[[Path], object]) -> Path:
    """The folder at `path`, made where it is not there yet; one that could not be made whole is none."""
    if not path.exists():
        part = path.with_name(f"part of {path.name}")
        shutil.rmtree(part, ignore_errors=True)
        make(part)
        part.rename(path)
    return path


def _made(name: str, into: Path, limit: float) -> None:
    run(("-m", "benchmarks.speed.folders", name, into), into.parent / "cache", ROOT, limit)


def _folder(wanted: str) -> tuple[Path, str]:
    tree = Path(wanted).resolve()
    return tree, _git(tree, "describe", "--always", "--dirty", "--exclude", "*")


def _archived(into: Path, wanted: str) -> tuple[Path, str]:
    try:
        commit = _git(ROOT, "rev-parse", "--short", f"{wanted}^{{commit}}")
    except Failed:
        raise SystemExit(f"{wanted} is neither a folder nor a commit.") from None
    into.mkdir()
    tar = into.with_suffix(".tar")
    _git(ROOT, "archive", "--output", str(tar), commit)
    shutil.unpack_archive(tar, into, filter="data")
    tar.unlink()
    return into, commit


def _git(tree: Path, *arguments: str) -> str:
    done = subprocess.run(["git", "-C", str(tree), *arguments], capture_output=True, text=True)
    if done.returncode:
        raise Failed(f"git {arguments[0]}: {done.stderr.strip()}")
    return done.stdout.strip()


def core() -> int:
    """One that this process may run on.

    Raises:
        Skipped: there is no other beside it.
    """
    cores = sorted(os.sched_getaffinity(0))
    if len(cores) < 2:
        raise Skipped("this machine has one core")
    return cores[0]
