"""Write every part that is stale, and name its page."""

from __future__ import annotations

from . import ROOT, pages, renewed

if __name__ == "__main__":
    for page in pages():
        text = page.read_text(encoding="utf-8")
        if (now := renewed(text)) != text:
            page.write_text(now, encoding="utf-8")
            print(page.relative_to(ROOT))
