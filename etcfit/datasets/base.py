"""What a public data set is: where its files lie, and how they become a measurement folder."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np


@dataclass(frozen=True)
class Source:
    """One published file, pinned to a commit and to its content.

    Args:
        local: path below a folder of local copies.
        url: public address.
        sha256: of the content, hexadecimal.
    """

    local: str
    url: str
    sha256: str


@dataclass(frozen=True)
class Dataset:
    """A public data set.

    Args:
        name: what `etcfit fetch` calls it.
        title: one line.
        sources: every published file it is made from.
        convert: local path -> file, to path in the measurement folder -> text; writes nothing itself.
    """

    name: str
    title: str
    sources: tuple[Source, ...]
    convert: Callable[[Mapping[str, Path]], Mapping[str, str]]


def on_github(repo: str, commit: str, path: str) -> str:
    """The public address of a file of a GitHub repository at one commit."""
    return f"https://raw.githubusercontent.com/{repo}/{commit}/{path}"


def csv_text(remark: str, columns: Mapping[str, np.ndarray]) -> str:
    """A trace as CSV: a comment, the header, and 12 significant digits a cell (more than any sensor here has)."""
    rows = np.column_stack(list(columns.values()))
    lines = [",".join(f"{cell:.12g}" for cell in row) for row in rows]
    return "\n".join([f"# {remark}", ",".join(columns), *lines, ""])


def licence_text(dataset: str) -> str:
    """The licence that came with a data set, word for word."""
    return (Path(__file__).parent / "licences" / f"{dataset}.txt").read_text(encoding="utf-8")
