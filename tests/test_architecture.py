"""Dependencies point one way, imports inside functions counted, and every class is registered."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "etcfit"
# the rooms, from the ground up: a file may import from its own room and from those before it
ROOMS = [
    *("errors", "ranges", "backend", "files", "kernels", "model", "datasets", "rig", "importing", "problem", "car_log",
      "estimation"),
    *("experiment", "control", "diagnosis", "posterior", "fleets", "run_folder", "reporting", "exporting"),
    *("api", "stages", "cli"),
]  # fmt: skip
MOST_ROOMS = 23
ONLY_IN: dict[str, str | tuple[str, ...]] = {
    "optimistix": "estimation/damped_step.py",
    "emcee": "posterior/",
    "matplotlib": ("reporting/", "api/plots.py", "api/fleet_work.py"),
    "pooch": "datasets/",
    "dask": "fleets/engine/",
    "distributed": "fleets/engine/",
    "fsspec": "fleets/folder.py",
    "typer": "cli.py",
}
REGISTRIES = {"model/effects": "AbstractEffect", "model/rig_effects": "AbstractRigEffect", "rig": "AbstractRigTest"}
DOORS = ("__init__.py", "__main__.py")  # of the package itself: the facade, which is lazy, and `python -m etcfit`
FILES = sorted({*PACKAGE.rglob("*.py")} - {PACKAGE / door for door in DOORS})


def place(file: Path) -> str:
    return file.relative_to(PACKAGE).as_posix()


def room(file: Path) -> str:
    return file.relative_to(PACKAGE).parts[0].removesuffix(".py")


def module(file: Path) -> str:
    parts = ["etcfit", *file.relative_to(PACKAGE).with_suffix("").parts]
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module(file): file for file in FILES}


@cache
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
            inner = {f"{source}.{alias.name}" for alias in node.names}
            names |= {name if name in MODULES or source == "etcfit" else source for name in inner}
    return names


def classes(file: Path) -> dict[str, set[str]]:
    tree = ast.parse(file.read_text(encoding="utf-8"))
    return {
        node.name: {ast.unparse(base) for base in node.bases} for node in tree.body if isinstance(node, ast.ClassDef)
    }


def test_a_file_imports_only_from_its_own_room_and_those_below() -> None:
    wrong: set[tuple[str, str]] = set()
    for file in FILES:
        here = room(file)
        assert here in ROOMS, f"{here} has no place in ROOMS yet: decide what may import it"
        below = {*ROOMS[: ROOMS.index(here) + 1], "__version__", "IMPORTED_AT"}
        ours = {name.split(".")[1] for name in imported(file) if name.startswith("etcfit.")}
        foreign = {name.split(".")[0] for name in imported(file)} & set(ONLY_IN)
        bad = ours - below | {name for name in foreign if not place(file).startswith(ONLY_IN[name])}
        wrong |= {(place(file), name) for name in bad}
    assert wrong == set()


def test_there_are_no_more_rooms_than_one_can_keep_in_mind() -> None:
    assert {room(file) for file in FILES} == set(ROOMS)
    assert len(ROOMS) <= MOST_ROOMS


def test_no_modules_import_each_other_in_a_circle() -> None:
    # a package's __init__ is part of the import of any module in it, but re-exports from it: that is no circle
    arrows = {name: imported(file) & set(MODULES) - {name} for name, file in MODULES.items()}
    plain = {name: to for name, to in arrows.items() if MODULES[name].name != "__init__.py"}
    done: set[str] = set()

    def follow(name: str, path: tuple[str, ...]) -> None:
        assert name not in path, " -> ".join([*path[path.index(name) :], name])
        if name not in done:
            for other in sorted(plain.get(name, ())):
                follow(other, (*path, name))
            done.add(name)

    for name in plain:
        follow(name, ())


@pytest.mark.parametrize(("package", "abstract"), REGISTRIES.items())
def test_every_effect_rig_test_and_detector_is_registered(package: str, abstract: str) -> None:
    files = [file for file in FILES if place(file).startswith(f"{package}/")]
    every = {name: bases for file in files for name, bases in classes(file).items()}
    between = {name for name, bases in every.items() if abstract in bases and name.startswith("Abstract")}
    defined = {name for name, bases in every.items() if {abstract, *between} & {*bases}} - between
    tree = ast.parse((PACKAGE / package / "__init__.py").read_text(encoding="utf-8"))
    tuples = [node for node in ast.walk(tree) if isinstance(node, ast.Tuple)]
    assert defined, f"nothing in {package}/ derives from {abstract}: this test would see nothing"
    assert defined <= {name.id for entries in tuples for name in entries.elts if isinstance(name, ast.Name)}


# of tuples, of notebooks, and of a function that the test itself compiled
NOT_PRIVATE = {"_replace", "_asdict", "_fields", "_repr_html_", "_cache_size"}


def reached(node: ast.AST) -> Iterator[str]:
    """Private names of the package that an expression of a test imports, reads or patches."""
    if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in ("etcfit", "independent"):
        yield from (alias.name for alias in node.names if alias.name.startswith("_"))
    elif isinstance(node, ast.Attribute) and node.attr.startswith("_") and not node.attr.startswith("__"):
        yield from {node.attr} - NOT_PRIVATE
    elif isinstance(node, ast.Call) and getattr(node.func, "attr", "") == "setattr":
        names = [each.value for each in node.args[:2] if isinstance(each, ast.Constant) and isinstance(each.value, str)]
        yield from (name for name in names if name.rpartition(".")[2].startswith("_"))


def test_tests_reach_for_nothing_private() -> None:
    wrong = []
    for file in sorted(Path(__file__).parent.rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            wrong += [(file.name, name) for name in reached(node)]
            if isinstance(node, ast.ImportFrom) and "SimpleNamespace" in {alias.name for alias in node.names}:
                wrong.append((file.name, "SimpleNamespace"))
    assert wrong == []
