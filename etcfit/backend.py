"""JAX as etcfit needs it: float64, loops compiled as loops, and sums that are right.

XLA's CPU backend runs each operation of a `while` body as a task of its own unless the loop is "small"; for a stepper
of some hundred scalar operations that overhead is all. Calling every loop small makes a trace some ten times faster.

jaxlib 0.10.2 hands fused reductions to a library that takes some samples of a long batch for others and says nothing
(https://github.com/jax-ml/jax/issues/39103); its reductions stay with XLA.
"""

from __future__ import annotations

import os
import warnings
from contextlib import suppress
from functools import cache
from pathlib import Path

from jaxlib.version import __version__ as _jaxlib

_LOOPS = "xla_cpu_small_while_loop_byte_threshold=1000000000"
# XLA ends the process over a flag that it does not know, so only the releases are named that are known to have it
_WRONG_SUMS = ("0.10.2", "0.11.0")


def _flags(jaxlib: str) -> dict[str, str]:
    """What to tell this release of XLA."""
    guard = {"xla_cpu_experimental_ynn_fusion_type": "-reduce"} if jaxlib in _WRONG_SUMS else {}
    return {"xla_backend_extra_options": _LOOPS, **guard}


def tell_xla(jaxlib: str) -> None:
    """Put our flags into XLA_FLAGS, which JAX reads when it is first imported; what the user has set stands.

    Args:
        jaxlib: its release, "0.10.2" say.
    """
    given = os.environ.get("XLA_FLAGS", "")
    ours = [f"--{flag}={value}" for flag, value in _flags(jaxlib).items() if flag not in given]
    os.environ["XLA_FLAGS"] = " ".join([given, *ours]).strip()


tell_xla(_jaxlib)

import jax  # noqa: E402  after what it reads

jax.config.update("jax_enable_x64", True)


_folder: Path | None = None


def keep_compiled_in(folder: Path | None) -> None:
    """Where this process keeps compiled programs from now on; None: nowhere."""
    global _folder
    _folder = folder


def use_compilation_cache() -> Path:
    """Keep compiled programs between runs of the command (folder from ETCFIT_CACHE, else the user's cache)."""
    given = os.environ.get("ETCFIT_CACHE")
    root = Path(given) if given else Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "etcfit"
    keep_compiled_in(root / "compiled")
    return root / "compiled"


def compiled_folder() -> Path | None:
    """Where compiled programs are kept; None where nobody asked for it, or the user has JAX keep them.

    What JAX's own cache hands out XLA cannot pack a second time, so it is one cache or the other.
    """
    return None if getattr(jax.config, "jax_compilation_cache_dir", None) else _folder


def kept_bytes(path: Path) -> bytes | None:
    """What a file of that folder holds, which then counts as used last; None where there is no such file."""
    try:
        packed = path.read_bytes()
    except OSError:
        return None
    with suppress(OSError):
        os.utime(path)
    return packed


@cache
def say_once(text: str) -> None:
    """Warn, once a process for each text."""
    warnings.warn(text, stacklevel=2)
