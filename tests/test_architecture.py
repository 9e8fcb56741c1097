"""Dependencies point one way, imports inside functions counted, and every class is registered."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "etcfit"
# a module may import those before it, and its own package
ORDER = [
    *("errors", "paper", "fetch", "backend", "parameters", "ecu", "effects", "unknown", "throttle", "linear"),
    *("simulate", "delay", "pid", "rig", "drive_log", "drive", "trace", "tape", "score", "whitening", "unknowns"),
    *("fitted", "reduce", "tangents", "grid", "reading", "correlation", "residual", "bench"),
    *("frequency", "chi2", "explore"),
    *("identifiability", "cure", "descent", "outcome", "fit", "intervals", "check", "advise", "diagnose", "design"),
    *("run_folder", "posterior", "report", "stages", "cli"),
]
ONLY_IN = {"optimistix": "descent", "emcee": "posterior", "matplotlib": "report", "pooch": "fetch", "typer": "cli"}
REGISTRIES = {"effects": "AbstractEffect", "rig": "AbstractRigTest"}
FILES = sorted(file for file in PACKAGE.rglob("*.py") if file != PACKAGE / "__init__.py")  # the facade is lazy


def layer(file: Path) -> str:
    return file.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imported(file: Path) -> set[str]:
    """Dotted names of all modules a file imports, relative ones made absolute."""
    names: set[str] = set()
    package = ["etcfit", *file.relative_to(PACKAGE).parent.parts]
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else []
            source = ".".join([*above, *([node.module] if node.module else [])])
            names |= {f"{source}.{alias.name}" for alias in node.names} if source == "etcfit" else {source}
    return names


def classes(file: Path) -> dict[str, set[str]]:
    tree = ast.parse(file.read_text(encoding="utf-8"))
    return {
        node.name: {ast.unparse(base) for base in node.bases} for node in tree.body if isinstance(node, ast.ClassDef)
    }


@pytest.mark.parametrize("file", FILES, ids=lambda file: str(file.relative_to(PACKAGE)))
def test_a_file_imports_only_what_lies_below_it(file: Path) -> None:
    here = layer(file)
    assert here in ORDER, f"{here} has no place in ORDER yet: decide what may import it"
    below = {*ORDER[: ORDER.index(here) + 1], "__version__"}
    ours = {name.split(".")[1] for name in imported(file) if name.startswith("etcfit.")}
    assert ours <= below
    foreign = {name.split(".")[0] for name in imported(file)}
    assert {name for name in foreign & set(ONLY_IN) if ONLY_IN[name] != here} == set()


@pytest.mark.parametrize(("package", "abstract"), REGISTRIES.items())
def test_every_effect_and_rig_test_is_registered(package: str, abstract: str) -> None:
    files = [file for file in FILES if layer(file) == package]
    defined = {name for file in files for name, bases in classes(file).items() if abstract in bases}
    registry = ast.parse((PACKAGE / package / "__init__.py").read_text(encoding="utf-8"))
    tuples = [node for node in ast.walk(registry) if isinstance(node, ast.Tuple)]
    assert defined, f"nothing in {package}/ derives from {abstract}: this test would see nothing"
    assert defined <= {name.id for entries in tuples for name in entries.elts if isinstance(name, ast.Name)}
