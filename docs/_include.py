"""Hook of MkDocs: `<!-- include: FILE -->` becomes that file of the root, no heading, its links those of the site."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
ROOT_PAGE = re.compile(r"\]\((?:SECURITY|CONTRIBUTING|CHANGELOG)\.md")
MARKER = re.compile(r"<!-- include: ([\w./-]+) -->")


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Fill in every marker."""
    return MARKER.sub(lambda match: included(match[1]), markdown)


def included(name: str) -> str:
    """The text of a file of the root as a page of the site's first level has it."""
    text = (ROOT / name).read_text(encoding="utf-8")
    text = re.sub(r"\A# .*\n", "", text).strip().replace("](docs/", "](")
    return ROOT_PAGE.sub(lambda match: match[0].lower(), text)
