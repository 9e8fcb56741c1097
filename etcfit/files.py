"""Files of a run folder, each written whole or not at all; JSON as docs/formats.md has it."""

from __future__ import annotations

import hashlib
import json
import math
import os
import stat
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .errors import MeasurementError


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """A scratch file beside `path` that takes its place once the block ends well; until then the old file stands."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.stem}-", suffix=path.suffix)
    os.close(handle)
    draft = Path(name)
    try:
        yield draft
        draft.chmod(0o644)  # mkstemp makes it private
        os.replace(draft, path)
    finally:
        draft.unlink(missing_ok=True)


def require_writable(folder: Path) -> None:
    """A folder, there or not yet, can take files: checked before the work whose results go there. It makes none.

    Raises:
        OSError: it cannot, by its name.
    """
    nearest = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    try:
        with tempfile.TemporaryFile(dir=nearest):
            pass
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(folder)) from None


def read_regular(path: Path, where: str, most: int | None = None) -> bytes:
    """Content of a file, whose kind and size are looked at first: a pipe or a device may never end.

    Args:
        path: of the file.
        where: what messages call it.
        most: bytes it may have; None for any.
    Raises:
        MeasurementError: a pipe or a device, or too large.
        OSError: it cannot be read.
    """
    status = path.stat()
    if not (stat.S_ISREG(status.st_mode) or stat.S_ISDIR(status.st_mode)):
        raise MeasurementError(where, "it is a pipe or a device.", "A file is required.",
                               "Write its content to a file, and name that.")  # fmt: skip
    if most is not None and status.st_size > most:
        raise MeasurementError(where, f"it has {status.st_size:,} bytes.", f"At most {most:,} are read.",
                               "Check that it is the file you meant.")  # fmt: skip
    return path.read_bytes()


def digest(path: Path) -> str:
    """SHA-256 of a file's content."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def plain(value: Any) -> Any:
    """What JSON can hold: arrays become lists, dataclasses objects, and what is not finite null."""
    if isinstance(value, Mapping):
        return {str(key): plain(v) for key, v in value.items()}
    if is_dataclass(value) and not isinstance(value, type):
        return plain(asdict(value))
    if isinstance(value, (np.ndarray, np.generic)):
        return plain(value.tolist())
    if isinstance(value, (list, tuple, set, frozenset)):
        return [plain(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def write_json(path: Path, kind: str, content: Mapping[str, Any]) -> None:
    """Write one object of schema `etcfit.<kind>/1`: UTF-8, floats at full precision, null for what is not known."""
    stamped = {"schema": f"etcfit.{kind}/1", **plain(content)}
    text = json.dumps(stamped, indent=2, ensure_ascii=False, allow_nan=False)
    with whole(path) as draft:
        draft.write_text(text + "\n", encoding="utf-8")
