"""One peer in a process of its own: `python -m benchmarks.peers.child NAME PROBLEM SOLVED`."""

from __future__ import annotations

import json
import pickle
import sys
from dataclasses import asdict
from importlib import import_module
from pathlib import Path


def main(name: str, problem: Path, solved: Path) -> None:
    """Read a problem (pickle), have it solved, write what came of it (JSON)."""
    peer = import_module(f"{__package__}.by_{name}")
    found = peer.solve(pickle.loads(problem.read_bytes()))
    solved.write_text(json.dumps(asdict(found)), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1], *map(Path, sys.argv[2:]))
