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
EXTENDS = re.compile(r'\{% extends "([^"]*)" %\}')
POLICY = re.compile(r"\{% block policy %\}(.*?)\{% endblock %\}")
EVERY = {file: file.read_text("utf-8") for file in sorted(PACKAGE.rglob("*.html"))}
SKELETONS = [file for file, text in EVERY.items() if BEGIN.search(text)]
PAGES = [
    file for file, text in EVERY.items() if EXTENDS.search(text) or (file in SKELETONS and not POLICY.search(text))
]


def whole(file: Path) -> str:
    """A template after those it extends, its policy in the place that they leave for it."""
    text = EVERY[file]
    if not (extended := EXTENDS.search(text)):
        return text
    (parent,) = (other for other in EVERY if other.name == extended[1])
    own = POLICY.search(text)
    return POLICY.sub(own[0], whole(parent), count=1) + text if own else whole(parent) + text


@pytest.mark.parametrize("file", PAGES, ids=lambda file: f"{file.parents[1].name}-{file.stem}")
def test_a_page_allows_itself_only_what_stands_in_it(file: Path) -> None:
    text = whole(file)
    (policy,) = HEAD.findall(POLICY.sub(r"\1", text, count=1))
    said = dict(each.strip().split(" ", 1) for each in policy.split(";"))
    assert said == ITS_OWN | {name: source for name, (mark, source) in IF_THERE.items() if mark in text}


def test_pages_are_made_from_templates_alone() -> None:
    assert len(PAGES) >= 6
    others = {file for suffix in ("py", "js", "txt") for file in PACKAGE.rglob(f"*.{suffix}")}
    assert [file for file in sorted(others) if BEGIN.search(file.read_text("utf-8"))] == []
