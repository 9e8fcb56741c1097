"""JAX as etcfit needs it."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
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


def test_what_is_compiled_quickly_computes_the_same() -> None:
    def function(x: jax.Array) -> jax.Array:
        return jnp.sin(x) * jnp.exp(-x) / (1.0 + x**2)

    x = jnp.linspace(0.1, 3.0, 50)
    assert jnp.allclose(backend.compiled_quickly(function)(x), jax.jit(function)(x), rtol=1e-14, atol=0.0)


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


@pytest.fixture
def nowhere() -> Iterator[None]:
    """A process that keeps nothing, as before its first command."""
    before = backend.compiled_folder()
    backend.keep_compiled_in(None)
    yield
    backend.keep_compiled_in(None)
    backend.keep_compiled_in(before)


def kept_by_jax() -> str | None:
    return getattr(jax.config, "jax_compilation_cache_dir", None)


@pytest.mark.usefixtures("nowhere")
def test_what_is_compiled_is_kept_where_the_user_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ETCFIT_CACHE", str(tmp_path))
    assert backend.compiled_folder() is kept_by_jax() is None
    assert backend.use_compilation_cache() == tmp_path / "compiled" == backend.compiled_folder()
    assert kept_by_jax() == str(tmp_path / "compiled" / "programs")


@pytest.mark.usefixtures("nowhere")
def test_where_the_user_has_jax_keep_its_programs_jax_does(tmp_path: Path) -> None:
    try:
        jax.config.update("jax_compilation_cache_dir", str(tmp_path / "own"))
        backend.keep_compiled_in(tmp_path / "ours")
        assert kept_by_jax() == str(tmp_path / "own")
        assert backend.own_folder("kernels") == tmp_path / "ours" / "kernels"
    finally:
        jax.config.update("jax_compilation_cache_dir", None)


@pytest.mark.usefixtures("nowhere")
@pytest.mark.skipif(not hasattr(os, "getuid"), reason="files have no owner here")
def test_a_folder_of_programs_that_others_can_write_is_not_used_and_said_so(tmp_path: Path) -> None:
    (tmp_path / "programs").mkdir()
    (tmp_path / "programs").chmod(0o777)
    with pytest.warns(UserWarning, match=r"others can write .*programs.*chmod go-w"):
        backend.keep_compiled_in(tmp_path)
    assert kept_by_jax() is None


@pytest.mark.usefixtures("nowhere")
@pytest.mark.parametrize(
    ("bound", "most", "days_ago", "stay"),
    [
        ("MOST_BYTES", 250, None, {"new", "old"}),
        ("MOST_FILES", 1, None, {"new"}),
        ("MOST_FILES", 1, 1.1, {"new"}),
        ("MOST_FILES", 1, 0.9, {"new", "old", "oldest"}),
    ],
)
def test_once_a_day_what_is_oldest_goes_where_there_is_too_much(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, bound: str, most: int, days_ago: float | None, stay: set[str]
) -> None:
    monkeypatch.setattr(backend, bound, most)
    (tmp_path / "programs").mkdir()
    for age, name in enumerate(("new", "old", "oldest")):
        (tmp_path / "programs" / name).write_bytes(b"x" * 100)
        os.utime(tmp_path / "programs" / name, (1e9 - age, 1e9 - age))
    if days_ago is not None:
        looked = tmp_path / "programs.tidied"
        looked.touch()
        when = time.time() - days_ago * 86_400
        os.utime(looked, (when, when))
    backend.keep_compiled_in(tmp_path)
    assert {file.name for file in (tmp_path / "programs").iterdir()} == stay


WORK = """
import sys
import jax.numpy as jnp
from etcfit import backend
import jax, jax.monitoring
found = []
jax.monitoring.register_event_listener(lambda event, **_: found.append(event.rpartition("/")[-1]))
backend.QUICKEST = 0.0
backend.use_compilation_cache()
print(jax.jit(lambda x: jnp.linalg.inv(x) @ x)(jnp.eye(3)).trace(), found.count("cache_hits") > 0)
"""


@pytest.mark.slow
def test_what_xla_compiled_the_next_process_finds(tmp_path: Path) -> None:
    environment = os.environ | {"ETCFIT_CACHE": str(tmp_path)}
    for there in ("False", "True"):
        done = subprocess.run([sys.executable, "-c", WORK], capture_output=True, text=True, env=environment, check=True)
        assert done.stdout.split() == ["3.0", there]
