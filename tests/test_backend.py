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


def test_a_fused_sum_over_a_long_batch_is_right() -> None:
    # https://github.com/jax-ml/jax/issues/39103: without the guard jaxlib 0.10.2 gives 267911424, or less
    last = 2.0**14
    x = jnp.stack((jnp.arange(last + 1), jnp.zeros(2**14 + 1), jnp.zeros(2**14 + 1)), axis=1)
    squares = jax.jit(jax.vmap(lambda row: jnp.sum((jnp.eye(3) @ row) ** 2)))(x)
    assert squares[-1] == last**2 == 268435456.0


GUARD = "xla_cpu_experimental_ynn_fusion_type"


@pytest.mark.parametrize(("jaxlib", "guarded"), [("0.10.1", False), ("0.10.2", True), ("0.12.0", False)])
def test_only_a_release_that_knows_the_flag_is_given_it(
    jaxlib: str, guarded: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("XLA_FLAGS")
    backend.tell_xla(jaxlib)
    assert (f"--{GUARD}=-reduce" in os.environ["XLA_FLAGS"].split()) is guarded


def test_what_the_user_told_xla_stands(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XLA_FLAGS", f"--{GUARD}=reduce")
    backend.tell_xla("0.10.2")
    assert os.environ["XLA_FLAGS"].count(GUARD) == 1


def test_compiled_models_are_kept_where_the_user_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = backend.compiled_folder()
    monkeypatch.setenv("ETCFIT_CACHE", str(tmp_path))
    try:
        backend.keep_compiled_in(None)
        assert backend.compiled_folder() is None
        assert backend.use_compilation_cache() == tmp_path / "compiled" == backend.compiled_folder()
    finally:
        backend.keep_compiled_in(before)


def test_where_the_user_has_jax_keep_them_jax_does(tmp_path: Path) -> None:
    before = getattr(jax.config, "jax_compilation_cache_dir", None)
    assert backend.compiled_folder() is not None
    try:
        jax.config.update("jax_compilation_cache_dir", str(tmp_path / "own"))
        assert backend.compiled_folder() is None
    finally:
        jax.config.update("jax_compilation_cache_dir", before)
