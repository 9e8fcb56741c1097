"""The map of the package: each room with the first paragraph of its docstring, from the ground up."""

from __future__ import annotations

import ast
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def order() -> list[str]:
    """The rooms as `tests/test_architecture.py` has them: a file imports from its own room and those before it."""
    tree = ast.parse((ROOT / "tests" / "test_architecture.py").read_text(encoding="utf-8"))
    (rooms,) = (
        node.value for node in tree.body if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "ROOMS"
    )
    return [str(each.value) for each in ast.walk(rooms) if isinstance(each, ast.Constant)]


def place(room: str) -> Path:
    """The file whose docstring explains a room."""
    package = ROOT / "etcfit" / room
    return package / "__init__.py" if package.is_dir() else package.with_suffix(".py")


def table() -> str:
    """One row a room."""
    rows = ["| room | what is in it |", "| --- | --- |"]
    for room in order():
        file = place(room)
        words = ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""
        name = f"{room}/" if file.stem == "__init__" else file.name
        rows.append(f"| `{name}` | {' '.join(words.partition(chr(10) * 2)[0].split())} |")
    return "\n".join(rows)
