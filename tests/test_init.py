"""The facade: cheap to import, and every public name is where it says."""

from __future__ import annotations

import ast
import importlib
import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest

import etcfit


@pytest.mark.parametrize("name", sorted(etcfit._MODULE_OF))
def test_public_name_is_its_modules_own(name: str) -> None:
    module = importlib.import_module(f"etcfit.{etcfit._MODULE_OF[name]}")
    assert getattr(etcfit, name) is getattr(module, name)


def test_type_checkers_see_the_same_names() -> None:
    tree = ast.parse(Path(etcfit.__file__).read_text(encoding="utf-8"))
    guarded = next(node for node in tree.body if isinstance(node, ast.If))
    imports = [node for node in guarded.body if isinstance(node, ast.ImportFrom)]
    assert {alias.asname: node.module for node in imports for alias in node.names} == etcfit._MODULE_OF


def test_no_public_name_hides_a_module() -> None:
    # importing etcfit.estimation.joint_fit would put the module where the name had been
    assert not [name for name in etcfit._MODULE_OF if importlib.util.find_spec(f"etcfit.{name}")]


def test_unknown_name() -> None:
    with pytest.raises(AttributeError, match="throtle"):
        _ = etcfit.throtle


def test_importing_the_package_asks_for_float64_and_leaves_jax_alone() -> None:
    program = "import etcfit, os, sys; print(os.environ['JAX_ENABLE_X64'], 'jax' in sys.modules)"
    environment = {name: value for name, value in os.environ.items() if name != "JAX_ENABLE_X64"}
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, env=environment)
    assert done.stdout.split() == ["1", "False"]
    assert done.stderr == ""
