"""JAX as etcfit needs it."""

from __future__ import annotations

import os
from pathlib import Path

import jax
import jax.numpy as jnp
import pytest

from etcfit import backend


def test_numbers_have_64_bits() -> None:
    assert jnp.zeros(1).dtype == jnp.float64


def test_loops_are_compiled_as_loops() -> None:
    assert "xla_cpu_small_while_loop_byte_threshold" in os.environ["XLA_FLAGS"]


def test_compiled_models_are_kept_where_the_user_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    said: dict[str, object] = {}
    monkeypatch.setenv("ETCFIT_CACHE", str(tmp_path))
    monkeypatch.setattr(jax.config, "update", said.__setitem__)
    assert backend.use_compilation_cache() == tmp_path / "jax"
    assert said["jax_compilation_cache_dir"] == str(tmp_path / "jax")
