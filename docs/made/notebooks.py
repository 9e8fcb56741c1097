"""The notebooks as pages with outputs and pictures: `python -m docs.made.notebooks [NAME ...]` runs all, or some.

Notebook 02 shows measured data where ETCFIT_DATA has a copy. A page holds every cell of its notebook;
`tests/test_docs.py` fails where one has changed since.
"""

from __future__ import annotations

import base64
import io
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
PAGES = ROOT / "docs" / "tutorials"
MOST_LINES, COLOURS = 60, 64  # of an output; of a picture


def cells(notebook: Any) -> Iterator[tuple[str, str]]:
    """Kind and text of each cell as its page has it."""
    for cell in notebook["cells"]:
        text = "".join(cell["source"]).strip()
        yield cell["cell_type"], text if cell["cell_type"] == "markdown" else f"```python\n{text}\n```"


def page_of(notebook: Path) -> Path:
    """Where a notebook's page lies."""
    return PAGES / f"notebook_{notebook.stem}.md"


def written(notebook: Any, name: str) -> tuple[str, dict[str, bytes]]:
    """The page of a notebook that was run, and its pictures by file name."""
    pictures: dict[str, bytes] = {}
    parts = []
    for cell, (kind, text) in zip(notebook["cells"], cells(notebook), strict=True):
        parts.append(text)
        if kind == "markdown" and len(parts) == 1:
            parts.append(f"*`notebooks/{name}.ipynb`, run by `python -m docs.made.notebooks {name}`.*")
        for output in cell.get("outputs", ()):
            data = output.get("data", {})
            if "image/png" in data:
                file = f"{name}_{len(pictures) + 1}.png"
                pictures[file] = smaller(base64.b64decode(data["image/png"]))
                parts.append(f"![Picture {len(pictures)} of notebook {name}](pictures/{file})")
            elif shown := text_of(data) or ("".join(output.get("text", "")) if output.get("name") == "stdout" else ""):
                lines = [line.rstrip() for line in shown.rstrip().splitlines()]
                parts.append(
                    "\n".join(["```text", *lines[:MOST_LINES], *(["..."] if len(lines) > MOST_LINES else []), "```"])
                )
    return "\n\n".join(parts) + "\n", pictures


def text_of(data: dict[str, Any]) -> str:
    """The plain text of an output; none of a progress bar, which is HTML."""
    text = "".join(data.get("text/plain", ""))
    return "" if text.startswith("<IPython") else text


def smaller(png: bytes) -> bytes:
    """A picture of few colours."""
    from PIL import Image

    out = io.BytesIO()
    Image.open(io.BytesIO(png)).convert("RGB").quantize(COLOURS).save(out, "PNG", optimize=True)
    return out.getvalue()


def write(notebook: Any, path: Path) -> None:
    """Write the page of a notebook that was run, and its pictures in place of the former ones."""
    text, pictures = written(notebook, path.stem)
    folder = PAGES / "pictures"
    folder.mkdir(exist_ok=True)
    for old in folder.glob(f"{path.stem}_*.png"):
        old.unlink()
    for file, png in pictures.items():
        (folder / file).write_bytes(png)
    page_of(path).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    import nbformat
    from nbclient import NotebookClient

    for path in sorted((ROOT / "notebooks").glob("*.ipynb")):
        if not sys.argv[1:] or path.stem in sys.argv[1:]:
            run = nbformat.read(path, as_version=4)
            NotebookClient(run, timeout=None, resources={"metadata": {"path": str(path.parent)}}).execute()
            write(run, path)
            print(page_of(path).relative_to(ROOT))
