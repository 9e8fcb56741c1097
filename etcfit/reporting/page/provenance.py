"""From which files and by which versions the page was made."""

from __future__ import annotations

from .contents import Contents
from .table import Table


def files_table(contents: Contents) -> Table:
    """SHA-256 of every measurement file, as it was when it was fitted, and of the run's own files as they are."""
    fit = contents.files["fit"]
    role = {row["file"]: "held out" for row in fit["score"]["holdout"]}
    role |= {row["file"]: "fitted" for row in fit["score"]["fit"]}
    rows = [
        (file, role.get(file, "read"), digest or "no longer there") for file, digest in (fit.get("files") or {}).items()
    ]
    rows += [(name, "result", digest) for name, digest in contents.hashes.items()]
    return Table("Files", ["file", "", "SHA-256"], rows, 3)


def versions_table(contents: Contents) -> Table:
    """Versions of each step; steps by the same versions share a line each."""
    steps: dict[tuple[str, str], list[str]] = {}
    for kind, content in contents.files.items():
        for name, version in (content.get("versions") or {}).items():
            steps.setdefault((name, version), []).append(kind.replace("_", " "))
    rows = [(name, version, ", ".join(kinds)) for (name, version), kinds in steps.items()]
    return Table("Versions", ["", "version", "used by"], rows, 3)


def stale(contents: Contents) -> list[str]:
    """Results that were not made of the files that the fit was made of."""
    files = contents.files["fit"].get("files") or {}
    out = []
    for kind, content in contents.files.items():
        theirs = content.get("files")
        if isinstance(theirs, dict) and theirs and files and theirs != files:
            changed = sorted(f for f in {*files, *theirs} if files.get(f) != theirs.get(f))
            out.append(f"{kind}.json was made of other data than fit.json ({', '.join(changed[:4])}): run it again.")
    return out
