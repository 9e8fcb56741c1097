"""Files of a run folder: each is written whole or not at all, by one process at a time; JSON as formats.md has
it.
"""

from __future__ import annotations

import errno
import hashlib
import json
import math
import os
import shutil
import stat
import tempfile
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np

from .errors import MeasurementError, UsageError

LOCK = ".lock"  # in a folder while a process writes there
SUPERSEDED = "superseded"  # in a run folder: what no longer holds, moved there so that nothing is lost
_DRAFT = ".draft-"  # how names of files begin that are not whole yet
_NO_LOCKS = {errno.ENOLCK, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS}  # of file systems that have none
_held: dict[Path, tuple[int, int]] = {}  # folder -> thread of this process that holds it, how many times
_holding = threading.Lock()


class Busy(UsageError):
    """Another process writes in the folder."""


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """A scratch file beside `path` that takes its place once the block ends well; until then the old file stands.

    Raises:
        OSError: it cannot be written; the error names `path`.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with named(path, path.parent):
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f"{_DRAFT}{path.stem}-", suffix=path.suffix)
        os.close(handle)
        draft = Path(name)
        try:
            yield draft
            draft.chmod(0o644)  # mkstemp makes it private
            os.replace(draft, path)
        finally:
            draft.unlink(missing_ok=True)


@contextmanager
def named(path: Path, scratch: Path) -> Iterator[None]:
    """An OSError about a file below `scratch` whose name nobody gave names `path` instead."""
    try:
        yield
    except OSError as error:
        given = str(error.filename or "")
        if error.errno is not None and (not given or (given.startswith(str(scratch)) and _DRAFT in given)):
            raise type(error)(error.errno, error.strerror, str(path)) from error
        raise


@contextmanager
def held(folder: Path, again: bool = True) -> Iterator[None]:
    """A folder in which no other process writes meanwhile; made where it is not there, and not left behind empty.

    The lock is the system's, which lets go however the process ends. What a writer that was killed left half-written is
    deleted.

    Args:
        again: whether the thread that holds it may hold it once more.
    Raises:
        Busy: another process or thread holds it.
        OSError: no file can be written there.
    """
    place, thread = folder.resolve(), threading.get_ident()
    with _holding:
        owner, times = _held.get(place, (thread, 0))
        if owner != thread or (times and not again):
            raise _busy(folder, f"thread {owner} of this process")
        try:
            made = [] if times else _made(place)
            file = None if times else _locked(place, folder)
        except OSError as error:
            raise type(error)(error.errno, error.strerror, str(folder)) from None
        _held[place] = (thread, times + 1)
    try:
        if file is not None:
            _delete_drafts(place)
        yield
    finally:
        with _holding:
            if times:
                _held[place] = (thread, times)
            else:
                del _held[place]
        if file is not None:
            with file, suppress(OSError):  # Windows deletes no open file
                (place / LOCK).unlink()
            for each in made:
                with suppress(OSError):  # it is not empty
                    each.rmdir()


def _made(folder: Path) -> list[Path]:
    """A folder and those above it, made; the ones that were not there, the innermost first."""
    missing = [place for place in (folder, *folder.parents) if not place.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    return missing


def _locked(place: Path, folder: Path) -> IO[bytes]:
    """The lock file of a folder, open, which no other process can hold."""
    while True:
        file = (place / LOCK).open("a+b")
        if not _lock(file):
            file.seek(0)
            holder = file.read(20).decode("ascii", "replace")
            file.close()
            raise _busy(folder, f"process {holder}" if holder else "")
        with suppress(OSError):  # deleted by whoever held it before
            if os.path.samestat(os.fstat(file.fileno()), os.stat(place / LOCK)):
                break
        file.close()
    file.truncate(0)
    file.write(str(os.getpid()).encode("ascii"))
    file.flush()
    return file


def _lock(file: IO[bytes]) -> bool:
    """Whether no other process has it; True too where the file system knows no locks: nobody is kept out."""
    try:
        if os.name == "nt":
            import msvcrt

            file.seek(1 << 30)  # far behind what is written there, which others may then read
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)  # pyright: ignore[reportAttributeAccessIssue]
        else:
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        return error.errno in _NO_LOCKS
    return True


def _busy(folder: Path, holder: str) -> Busy:
    return Busy(f"{folder}: another etcfit{f' ({holder})' if holder else ''} works on it. Wait for it, or end it.")


def _delete_drafts(folder: Path) -> None:
    """What a killed writer left; nobody else writes here while the folder is held."""
    for draft in (*folder.glob(f"{_DRAFT}*"), *(folder / "pictures").rglob(f"{_DRAFT}*")):
        if draft.is_dir() and not draft.is_symlink():
            shutil.rmtree(draft, ignore_errors=True)
        else:
            draft.unlink(missing_ok=True)


@contextmanager
def scratch_folder(folder: Path) -> Iterator[Path]:
    """A folder for drafts below a folder that is held; deleted at the end where it is still there."""
    draft = Path(tempfile.mkdtemp(dir=folder, prefix=_DRAFT))
    try:
        yield draft
    finally:
        shutil.rmtree(draft, ignore_errors=True)


def put_aside(path: Path) -> Path:
    """Move a file into the folder `superseded` beside it, under a name that is free there; where it lies now."""
    folder = path.parent / SUPERSEDED
    folder.mkdir(exist_ok=True)
    names = (path.name, *(f"{path.stem}_{k}{path.suffix}" for k in range(2, 10_000)))
    free = next(folder / name for name in names if not (folder / name).exists())
    path.replace(free)
    return free


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


def write_text(path: Path, text: str) -> None:
    """A file of UTF-8, written whole or not at all."""
    with whole(path) as draft:
        draft.write_text(text, encoding="utf-8")


def write_json(path: Path, kind: str, content: Mapping[str, Any]) -> None:
    """Write one object of schema `etcfit.<kind>/1`: UTF-8, floats at full precision, null for what is not known."""
    stamped = {"schema": f"etcfit.{kind}/1", **plain(content)}
    write_text(path, json.dumps(stamped, indent=2, ensure_ascii=False, allow_nan=False) + "\n")
