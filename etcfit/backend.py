"""JAX as etcfit needs it: float64, loops compiled as loops, and sums that are right.

XLA's CPU backend runs each operation of a `while` body as a task of its own unless the loop is "small"; for a stepper
of some hundred scalar operations that overhead is all. Calling every loop small makes a trace some ten times faster.

jaxlib 0.10.2 hands fused reductions to a library that takes some samples of a long batch for others and says nothing
(https://github.com/jax-ml/jax/issues/39103); its reductions stay with XLA.
"""

from __future__ import annotations

import os
import time
import warnings
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from jaxlib.version import __version__ as _jaxlib

_LOOPS = "xla_cpu_small_while_loop_byte_threshold=1000000000"
# XLA ends the process over a flag that it does not know, so only the releases are named that are known to have it
_WRONG_SUMS = ("0.10.2", "0.11.0")


def tell_xla(jaxlib: str) -> None:
    """Put our flags into XLA_FLAGS, which JAX reads when it is first imported; what the user has set stands.

    Args:
        jaxlib: its release, "0.10.2" say.
    """
    given, flags = os.environ.get("XLA_FLAGS", ""), {"xla_backend_extra_options": _LOOPS}
    if jaxlib in _WRONG_SUMS:
        flags["xla_cpu_experimental_ynn_fusion_type"] = "-reduce"
    ours = [f"--{flag}={value}" for flag, value in flags.items() if flag not in given]
    os.environ["XLA_FLAGS"] = " ".join([given, *ours]).strip()


tell_xla(_jaxlib)

import jax  # noqa: E402  after what it reads

jax.config.update("jax_enable_x64", True)


def compiled_quickly(function: Callable[..., Any]) -> Any:
    """`jax.jit` of what runs a few times and briefly: without optimisation, in half the time."""
    return jax.jit(function, compiler_options={"xla_backend_optimization_level": 0})


QUICKEST = 0.1  # s; what is compiled sooner is not kept
# of a folder of compiled code: what was used last stays; looked at once a day, for a look at 90,000 files takes 2.5 s
MOST_BYTES, MOST_FILES, DAY = 1 << 28, 10_000, 86_400.0

_folder: Path | None = None


def keep_compiled_in(folder: Path | None) -> None:
    """Where this process keeps what it compiles from now on; None: nowhere. JAX's own programs are kept there by JAX,
    unless the user has it keep them elsewhere."""
    global _folder
    before, _folder = _programs(), folder
    if getattr(jax.config, "jax_compilation_cache_dir", None) == before:
        jax.config.update("jax_compilation_cache_dir", _programs())
        jax.config.update("jax_persistent_cache_min_compile_time_secs", QUICKEST)


def _programs() -> str | None:
    folder = own_folder("programs")
    return None if folder is None else str(folder)


def use_compilation_cache() -> Path:
    """Keep what is compiled between runs of the command (folder from ETCFIT_CACHE, else the user's cache)."""
    given = os.environ.get("ETCFIT_CACHE")
    root = Path(given) if given else Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "etcfit"
    keep_compiled_in(root / "compiled")
    return root / "compiled"


def compiled_folder() -> Path | None:
    """The folder that keeps compiled code; None where no folder was set."""
    return _folder


def own_folder(name: str) -> Path | None:
    """A folder of compiled code; None where nothing is kept, or somebody else could write it: what is loaded runs.

    Args:
        name: of its kind of code.
    """
    if _folder is None:
        return None
    folder = _folder / name
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        about = folder.stat()
    except OSError:
        return None
    if hasattr(os, "getuid") and (about.st_uid != os.getuid() or about.st_mode & 0o022):
        say_once(f"others can write {folder}: machine code kept there is not used. Make it yours alone (chmod go-w).")
        return None
    _tidied(folder)
    return folder


@cache
def _tidied(folder: Path) -> None:
    """What is oldest goes, until the rest is few and small enough; once a day."""
    looked = folder.with_suffix(".tidied")
    with suppress(OSError):
        if looked.exists() and time.time() - looked.stat().st_mtime < DAY:
            return
        looked.touch()
        found = sorted(((entry.stat(), entry.path) for entry in os.scandir(folder)), key=lambda each: -each[0].st_mtime)
        total = 0
        for place, (about, path) in enumerate(found):
            total += about.st_size
            if total > MOST_BYTES or place >= MOST_FILES:
                Path(path).unlink(missing_ok=True)


@cache
def say_once(text: str) -> None:
    """Warn, once a process for each text."""
    warnings.warn(text, stacklevel=2)
