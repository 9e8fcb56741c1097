"""JAX as etcfit needs it: float64, and loops compiled as loops.

XLA's CPU backend runs each operation of a `while` body as a task of its own unless the loop is "small"; for a stepper
of some hundred scalar operations that overhead is all. Calling every loop small makes a trace some ten times faster.
"""

from __future__ import annotations

import os
from pathlib import Path

_LOOPS = "xla_cpu_small_while_loop_byte_threshold=1000000000"

if "xla_backend_extra_options" not in os.environ.get("XLA_FLAGS", ""):
    os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} --xla_backend_extra_options={_LOOPS}".strip()

import jax  # noqa: E402  after the flags it reads

jax.config.update("jax_enable_x64", True)


def use_compilation_cache() -> Path:
    """Keep compiled models between runs of the command (folder from ETCFIT_CACHE, else the user's cache)."""
    default = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "etcfit"
    folder = Path(os.environ.get("ETCFIT_CACHE", default)) / "jax"
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.05)
    return folder
