"""JSON files of a run folder read back: whole, of their kind, and with what their readers cannot do without."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..errors import UsageError


def object_in(path: Path, kind: str, needed: Sequence[str], cure: str, raw: bytes | None = None) -> Mapping[str, Any]:
    """The object of a file.

    Args:
        path: of the file.
        kind: of its schema, `etcfit.<kind>/1`.
        needed: keys that must be there.
        cure: a sentence, how to get a whole file.
        raw: its content, where it was read already.
    Raises:
        UsageError: it is no JSON, of another schema, or lacks a key.
        OSError: it cannot be read.
    """
    try:
        content = json.loads(path.read_bytes() if raw is None else raw)
    except (ValueError, RecursionError) as error:
        raise UsageError(f"{path} is no JSON ({error}). {cure}") from None
    schema = content.get("schema") if isinstance(content, dict) else None
    if schema != f"etcfit.{kind}/1":
        raise UsageError(f"{path} has schema {schema!r}, not 'etcfit.{kind}/1'. {cure}")
    if missing := [key for key in needed if key not in content]:
        raise UsageError(f"{path} lacks {', '.join(missing)}. {cure}")
    return content
