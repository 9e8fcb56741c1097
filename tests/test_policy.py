"""Every page says to the browser itself that it loads nothing, whatever comes into it: SECURITY.md promises that."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "etcfit"
BEGIN = re.compile(r"<!doctype html", re.IGNORECASE)
# before the policy only what no text of a user can be in: a browser obeys it for what comes after
HEAD = re.compile(
    r'<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
    r'<meta http-equiv="Content-Security-Policy" content="([^"]*)">\n'
)
# what a page may use of itself; any address, 'self' among them, would be a load
ITS_OWN = {"default-src": "'none'", "base-uri": "'none'", "form-action": "'none'"}
IF_THERE = {"style-src": ("<style", "'unsafe-inline'"), "script-src": ("<script", "'unsafe-inline'"),
            "img-src": ("data:,", "data:")}  # fmt: skip
TEMPLATES = sorted(file for file in PACKAGE.rglob("*.html") if BEGIN.search(file.read_text("utf-8")))


@pytest.mark.parametrize("file", TEMPLATES, ids=lambda file: file.stem)
def test_a_page_allows_itself_only_what_stands_in_it(file: Path) -> None:
    text = file.read_text("utf-8")
    (policy,) = HEAD.findall(text)
    said = dict(each.strip().split(" ", 1) for each in policy.split(";"))
    assert said == ITS_OWN | {name: source for name, (mark, source) in IF_THERE.items() if mark in text}


def test_pages_are_made_from_templates_alone() -> None:
    assert len(TEMPLATES) >= 5
    others = {file for suffix in ("py", "js", "txt") for file in PACKAGE.rglob(f"*.{suffix}")}
    assert [file for file in sorted(others) if BEGIN.search(file.read_text("utf-8"))] == []
