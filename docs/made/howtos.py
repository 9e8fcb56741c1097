"""The list of how-tos: the title of each page."""

from __future__ import annotations

from pathlib import Path

PAGES = Path(__file__).resolve().parents[1] / "howto"


def title(page: Path) -> str:
    """The first heading."""
    return page.read_text(encoding="utf-8").splitlines()[0].removeprefix("# ")


def table() -> str:
    """One line a page."""
    return "\n".join(f"- [{title(page)}]({page.name})" for page in sorted(PAGES.glob("*.md")) if page.stem != "index")
