"""Figures of the README, a module each: `python -m benchmarks.NAME --help`. They see the tests' independent generator."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
