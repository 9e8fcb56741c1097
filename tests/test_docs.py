"""The pages can be read on a code host: what is made from the program is up to date, and links lead somewhere."""

from __future__ import annotations

import json
import re
from functools import cache
from pathlib import Path

import pytest

from docs.made import ROOT, made, pages, renewed
from docs.made.notebooks import cells, page_of

LINK = re.compile(r"\]\(([^)\s#]*)(?:#([^)\s]*))?\)")
HEADING = re.compile(r"^#+ +(.+?) *(?:\{ *#([\w-]+) *\})?$", re.MULTILINE)
FENCED = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)
PAGES = [*pages(), ROOT / "CHANGELOG.md", ROOT / "SECURITY.md"]


def place(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def test_what_is_made_from_the_program_is_up_to_date() -> None:
    texts = {place(page): page.read_text(encoding="utf-8") for page in PAGES}
    stale = [page for page, text in texts.items() if renewed(text) != text]
    assert stale == [], "run python -m docs.made and commit what it writes"


def test_a_place_for_a_part_is_filled_once_and_a_stale_part_is_replaced() -> None:
    first = renewed("# Page\n\n<!-- options: fit -->\n\nEnd\n")
    assert first.startswith("# Page\n\n<!-- options: fit: begin -->\n\n| argument or option |")
    assert first.endswith("<!-- options: fit: end -->\n\nEnd\n")
    assert renewed(first) == first
    assert renewed(first.replace("`--out RUN`", "`--into RUN`")) == first


def test_every_registry_has_its_page() -> None:
    names = {name for page in pages() for name, _ in made(page.read_text(encoding="utf-8"))}
    assert names >= {"verbs", "effects", "rig effects", "symbols", "ecus", "rooms", "options: fit", "schema: fit"}


def test_every_link_leads_to_a_file_and_to_a_heading_of_it() -> None:
    links = [(place(page), page.parent / file if file else page, anchor)
             for page in PAGES for file, anchor in LINK.findall(unfenced(page))
             if "://" not in file and not file.startswith("mailto:")]  # fmt: skip
    assert [(page, file) for page, file, _ in links if not file.exists()] == []
    assert [each for each in links if each[2] and each[2] not in anchors(each[1].resolve())] == []


def unfenced(page: Path) -> str:
    return FENCED.sub("", page.read_text(encoding="utf-8"))


@cache
def anchors(page: Path) -> set[str]:
    """What the site and the code host make of a page's headings."""
    text = unfenced(page)
    made = {name or re.sub(r"\s", "-", re.sub(r"[^\w\s-]", "", words).lower()) for words, name in HEADING.findall(text)}
    return made | set(re.findall(r'id="([^"]+)"', text))


@pytest.mark.parametrize("notebook", sorted((ROOT / "notebooks").glob("*.ipynb")), ids=lambda notebook: notebook.stem)
def test_a_notebook_has_its_page_with_every_cell_and_its_pictures(notebook: Path) -> None:
    page = page_of(notebook).read_text(encoding="utf-8")
    rest = page
    for _, text in cells(json.loads(notebook.read_text(encoding="utf-8"))):
        _, found, rest = rest.partition(text)
        assert found, f"run python -m docs.made.notebooks {notebook.stem} and commit what it writes"
    assert f"](pictures/{notebook.stem}_1.png)" in page


def test_pictures_of_notebooks_stay_small() -> None:
    pictures = [*(ROOT / "docs" / "tutorials" / "pictures").glob("*.png")]
    assert sum(file.stat().st_size for file in pictures) < 2e6
