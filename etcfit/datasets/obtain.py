"""A published file on this machine: a local copy if there is one, else a download; its content is always checked."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

from ..errors import MeasurementError
from .base import Source

VARIABLE = "ETCFIT_DATA"


def obtain(source: Source, data: Path | None = None) -> Path:
    """The file, checked against its SHA-256.

    Args:
        source: which file.
        data: folder of local copies; without it, the one that the environment variable ETCFIT_DATA names.

    Raises:
        MeasurementError: the local copy is not the published file, or the download failed.
    """
    copy = _local_copy(source, data)
    if copy is None:
        return _download(source)
    _check(copy, source)
    return copy


def _local_copy(source: Source, data: Path | None) -> Path | None:
    folder = data or (Path(named) if (named := os.environ.get(VARIABLE)) else None)
    copy = folder / source.local if folder else None
    return copy if copy and copy.is_file() else None


def _check(copy: Path, source: Source) -> None:
    found = hashlib.sha256(copy.read_bytes()).hexdigest()
    if found != source.sha256:
        raise MeasurementError(
            str(copy),
            f"its SHA-256 is {found}.",
            f"It must be {source.sha256}, that of the published file.",
            f"Delete the copy, or replace it with {source.url}.",
        )


def _download(source: Source) -> Path:
    import pooch

    pooch.get_logger().setLevel("WARNING")  # the command line shows its own progress
    try:
        return Path(pooch.retrieve(source.url, known_hash=f"sha256:{source.sha256}", path=pooch.os_cache("etcfit")))
    except (OSError, ValueError) as error:  # no network, no such page; a content that is not the published one
        raise MeasurementError(
            source.url,
            f"the download failed: {error}.",
            "The published file is required.",
            f"Try again, or put a copy at FOLDER/{source.local} and name FOLDER with --data or in {VARIABLE}.",
        ) from error
