"""Compiled programs on disk, so that the next process need not even trace them.

    asked/<digest of source, versions, machine and arguments>  ->  the name of a program
    programs/<digest of what was lowered, and of the machine>      that program

JAX's own cache of compilations saves the compiler, but each process still traces and lowers, which is most of a warm
start. Here a digest of everything that tracing reads finds the program at once. Where it finds none, as after any
change of the source, the lowered text is looked up: what the change did not touch is not compiled again.

An entry that cannot be read, of another build of XLA say, is made anew; whoever can write this folder can run code in
the process, as with JAX's own cache.
"""

from __future__ import annotations

import hashlib
import itertools
import os
import pickle
import platform
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jax.experimental import serialize_executable

from ..backend import compiled_folder, kept_bytes, say_once
from ..files import whole
from .spelling import UnspeakableError, constant, shape

MOST_BYTES = 1 << 30  # of all programs kept, or little more; those that were not used for longest go first
_TIDIED_AFTER = 50  # programs written
_WRITTEN = itertools.count()
_PACKAGES = ("jax", "jaxlib", "equinox", "lineax", "optimistix")


def digest_asked(fixed: Sequence[Any], given: Sequence[Any]) -> str | None:
    """Of a program and its arguments; None where no folder keeps programs, or they cannot be spelled.

    Args:
        fixed: what it is compiled for: function, options of the compiler, constant arguments.
        given: the other arguments.
    """
    if compiled_folder() is None or not _is_what_runs():
        return None
    try:
        text = (*map(constant, fixed), *map(shape, given))
    except UnspeakableError:
        return None
    return _digest(_SOURCE, _machine(), *text)


def find(asked: str, arguments: Sequence[Any]) -> Any | None:
    """The program that was once made for this digest, or None.

    Args:
        asked: see `digest_asked`.
        arguments: that it is given.
    """
    try:
        name = (_folder("asked") / asked).read_text(encoding="ascii")
        return _load(name, jax.tree.structure((tuple(arguments), {})))
    except (OSError, ValueError):  # not there, or torn
        return None


def compiled(asked: str, lowered: Any, arguments: Sequence[Any], options: Any) -> Any:
    """What was lowered, compiled or found by its text, and kept for whoever asks next."""
    name = _digest(_machine(), _text(lowered), str(lowered.in_tree), str(lowered.out_tree), constant(options))
    tree = jax.tree.structure((tuple(arguments), {}))
    program = _load(name, tree)
    if program is not None and program.out_tree == lowered.out_tree:
        _later(_note, asked, name)
        return program
    program = lowered.compile()
    _later(_keep, name, program, tree, asked)
    return program


def _later(work: Callable[..., None], *args: Any) -> None:
    with suppress(RuntimeError):  # the interpreter is about to end
        _writing().submit(work, *args)


def finish_writing() -> None:
    """Wait until all that was compiled so far is on disk."""
    _writing().submit(lambda: None).result()


def _text(lowered: Any) -> str:
    """Without the name of the function, which is no part of what it computes."""
    return lowered.as_text().partition("\n")[2]


def _digest(*parts: str) -> str:
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:40]


def _folder(name: str) -> Path:
    folder = compiled_folder()
    assert folder is not None, "no folder keeps programs"
    return folder / name


def _hashed() -> str:
    """Of every file of the package; "" where it has none, as in an archive."""
    files, out = sorted(_ROOT.rglob("*.py")), hashlib.sha256()
    for file in files:
        out.update(file.relative_to(_ROOT).as_posix().encode() + b"\0" + file.read_bytes())
    return out.hexdigest() if files else ""


_ROOT = Path(__file__).resolve().parents[1]
_SOURCE, _SINCE = _hashed(), time.time()  # when this is imported: what is changed later is not what runs


def _is_what_runs() -> bool:
    """Whether the package on disk still is what was imported."""
    return bool(_SOURCE) and all(file.stat().st_mtime < _SINCE for file in _ROOT.rglob("*.py"))


def _machine() -> str:
    """Compiler, its flags and JAX's, and the processor that is compiled for."""
    settings: dict[str, Any] = getattr(jax.config, "values", {})
    config = [f"{name}={value}" for name, value in sorted(settings.items()) if "cache" not in name]
    return "\n".join([_versions(), *config, os.environ.get("XLA_FLAGS", ""), os.environ.get("EQX_ON_ERROR", "")])


@cache
def _versions() -> str:
    devices = jax.devices()
    return "\n".join([sys.version, *(f"{name} {version(name)}" for name in _PACKAGES), devices[0].platform,
                      devices[0].device_kind, f"{len(devices)} devices", _processor()])  # fmt: skip


def _processor() -> str:
    """What this machine's processor is and can do: code compiled for another may end in an illegal instruction."""
    with suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        named = [line for line in lines if line.startswith(("model name", "flags", "Features", "CPU part"))]
        return "\n".join(dict.fromkeys(named))
    return f"{platform.machine()} {platform.processor()}"


def _load(name: str, tree: Any) -> Any | None:
    """The program of that name, of arguments of that structure; None where it is not there or is none."""
    path = _folder("programs") / name
    packed = kept_bytes(path)
    if packed is None:
        return None
    _begin_lapack()
    try:
        executable, out_tree = pickle.loads(packed)
        return serialize_executable.deserialize_and_load(
            executable, tree, out_tree, execution_devices=jax.devices()[:1]
        )
    except Exception as error:  # whatever is wrong with it, it is made anew
        with suppress(OSError):
            path.unlink()
        say_once(f"a compiled model in {path.parent} cannot be used and is compiled again: {error}")
        return None


@cache
def _begin_lapack() -> None:
    """JAX hands XLA its linear algebra when it first lowers a call of it; a program that was never lowered here would
    jump into the void."""
    jax.jit(jax.lax.linalg.cholesky).lower(np.eye(1))


@cache
def _writing() -> ThreadPoolExecutor:
    """One thread: nobody waits for what is written but the end of the process."""
    return ThreadPoolExecutor(1, "etcfit writing")


def _keep(name: str, program: Any, tree: Any, asked: str) -> None:
    """A full disk, or a tree that cannot be pickled, keep nothing and cost nothing else."""
    with suppress(OSError, pickle.PicklingError, TypeError, AttributeError, ValueError, NotImplementedError):
        executable, in_tree, out_tree = serialize_executable.serialize(program)
        if in_tree != tree:
            return
        with whole(_folder("programs") / name) as draft:
            draft.write_bytes(pickle.dumps((executable, out_tree)))
        _note(asked, name)
        if next(_WRITTEN) % _TIDIED_AFTER == 0:
            tidy()


def _note(asked: str, name: str) -> None:
    with suppress(OSError), whole(_folder("asked") / asked) as draft:
        draft.write_text(name, encoding="ascii")


def tidy(most: int = MOST_BYTES) -> None:
    """What was not used for longest goes, until the rest fits into so many bytes; then names that lead nowhere."""
    kept = sorted(_folder("programs").iterdir(), key=lambda path: path.stat().st_mtime, reverse=True)
    total = 0
    for path in kept:
        total += path.stat().st_size
        if total > most:
            path.unlink(missing_ok=True)
    there = {path.name for path in _folder("programs").iterdir()}
    for path in _folder("asked").iterdir():
        if path.read_text(encoding="ascii") not in there:
            path.unlink(missing_ok=True)
