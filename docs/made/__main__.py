"""Write every schema that is declared, and every part of a page that is stale, and name what was written."""

from __future__ import annotations

from . import ROOT, pages, renewed
from .schemas import DECLARED, FOLDER, text_of

if __name__ == "__main__":
    made = {FOLDER / f"{kind}.schema.json": text_of(kind) for kind in DECLARED}
    for path, now in made.items():
        if now != path.read_text(encoding="utf-8"):
            path.write_text(now, encoding="utf-8")
            print(path.relative_to(ROOT))
    for page in pages():
        text = page.read_text(encoding="utf-8")
        if (now := renewed(text)) != text:
            page.write_text(now, encoding="utf-8")
            print(page.relative_to(ROOT))
