"""An export on the disk: all of its files, or none."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

from ..files import whole
from .base import Export


def write(export: Export, folder: Path) -> tuple[Path, ...]:
    """Write every file of an export; the old ones stand until all new ones are written.

    Returns:
        Where they are, in their order.
    """
    paths = tuple(folder / name for name in export.files)
    with ExitStack() as drafts:
        for path, content in zip(paths, export.files.values(), strict=True):
            draft = drafts.enter_context(whole(path))
            draft.write_bytes(content.encode("utf-8") if isinstance(content, str) else content)
    return paths
