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
import os
import pickle
import platform
import sys
import warnings
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jax.experimental import serialize_executable

from ..backend import compiled_folder
from ..files import whole
from .spelling import UnspeakableError, constant, shape

MOST_BYTES = 1 << 30  # of all programs kept; those that were not used for longest go first
_PACKAGES = ("jax", "jaxlib", "equinox", "lineax", "optimistix")
_CONFIG = ("jax_enable_x64", "jax_default_matmul_precision", "jax_numpy_dtype_promotion", "jax_debug_nans")


def digest_asked(fixed: Sequence[Any], given: Sequence[Any]) -> str | None:
    """Of a program and its arguments; None where no folder keeps programs, or they cannot be spelled.

    Args:
        fixed: what it is compiled for: function, options of the compiler, constant arguments.
        given: the other arguments.
    """
    if compiled_folder() is None:
        return None
    try:
        text = (*map(constant, fixed), *map(shape, given))
    except UnspeakableError:
        return None
    return _digest(_source(), *text)


def find(asked: str, arguments: Sequence[Any]) -> Any | None:
    """The program that was once made for this digest, or None.

    Args:
        asked: see `digest_asked`.
        arguments: that it is given.
    """
    try:
        name = (_folder("asked") / asked).read_text(encoding="ascii")
    except OSError:
        return None
    return _load(name, arguments)


def compiled(asked: str, lowered: Any, arguments: Sequence[Any], options: Any) -> Any:
    """What was lowered, compiled or found by its text, and kept for whoever asks next."""
    name = _digest(_machine(), _text(lowered), str(lowered.in_tree), str(lowered.out_tree), constant(options))
    program = _load(name, arguments)
    if program is None:
        program = lowered.compile()
        _writing().submit(_keep, name, program, arguments, asked)
    else:
        _writing().submit(_note, asked, name)
    return program


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


@cache
def _source() -> str:
    """Of every file of the package, and of all that the machine's programs depend on."""
    root, out = Path(__file__).resolve().parents[1], hashlib.sha256()
    for file in sorted(root.rglob("*.py")):
        out.update(file.relative_to(root).as_posix().encode() + b"\0" + file.read_bytes())
    return out.hexdigest() + _machine()


@cache
def _machine() -> str:
    """Compiler, its flags, and the processor that it compiles for."""
    config = [f"{name}={getattr(jax.config, name, None)}" for name in _CONFIG]
    device = jax.devices()[0]
    return "\n".join([sys.version, *(f"{name} {version(name)}" for name in _PACKAGES), *config,
                      os.environ.get("XLA_FLAGS", ""), device.platform, device.device_kind, _processor()])  # fmt: skip


def _processor() -> str:
    """What this machine's processor is and can do: code compiled for another may end in an illegal instruction."""
    with suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        named = [line for line in lines if line.startswith(("model name", "flags", "Features", "CPU part"))]
        return "\n".join(dict.fromkeys(named))
    return f"{platform.machine()} {platform.processor()}"


def _load(name: str, arguments: Sequence[Any]) -> Any | None:
    path = _folder("programs") / name
    try:
        packed = path.read_bytes()
        os.utime(path)  # used: the last to go
    except OSError:
        return None
    _begin_lapack()
    try:
        executable, out_tree = pickle.loads(packed)
        tree = jax.tree.structure((tuple(arguments), {}))
        return serialize_executable.deserialize_and_load(executable, tree, out_tree)
    except Exception as error:  # whatever is wrong with it, it is made anew
        _say_once(f"a compiled model in {path.parent} cannot be used and is compiled again: {error}")
        path.unlink(missing_ok=True)
        return None


@cache
def _begin_lapack() -> None:
    """JAX hands XLA its linear algebra when it first lowers a call of it; a program that was never lowered here would
    jump into the void."""
    jax.jit(jax.lax.linalg.cholesky).lower(np.eye(1))


@cache
def _say_once(text: str) -> None:
    warnings.warn(text, stacklevel=2)


@cache
def _writing() -> ThreadPoolExecutor:
    """One thread: nobody waits for what is written but the end of the process."""
    return ThreadPoolExecutor(1, "etcfit writing")


def _keep(name: str, program: Any, arguments: Sequence[Any], asked: str) -> None:
    """A full disk, or a tree that cannot be pickled, keep nothing and cost nothing else."""
    with suppress(OSError, pickle.PicklingError, TypeError, AttributeError, ValueError, NotImplementedError):
        executable, in_tree, out_tree = serialize_executable.serialize(program)
        if in_tree != jax.tree.structure((tuple(arguments), {})):
            return
        with whole(_folder("programs") / name) as draft:
            draft.write_bytes(pickle.dumps((executable, out_tree)))
        _note(asked, name)
        _tidy_once()


def _note(asked: str, name: str) -> None:
    with suppress(OSError), whole(_folder("asked") / asked) as draft:
        draft.write_text(name, encoding="ascii")


@cache
def _tidy_once() -> None:
    tidy()


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
