"""Each real data set, converted once."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from etcfit.datasets import fetch


@dataclass(frozen=True)
class Fetched:
    """A measurement folder as a person would read it: without the package's own reader."""

    folder: Path

    @property
    def rig(self) -> dict[str, Any]:
        return tomllib.loads((self.folder / "rig.toml").read_text(encoding="utf-8"))

    @property
    def traces(self) -> set[str]:
        return {path.relative_to(self.folder).as_posix() for path in self.folder.rglob("*.csv")}

    def trace(self, path: str) -> pd.DataFrame:
        return pd.read_csv(self.folder / path, comment="#")


@pytest.fixture(scope="session")
def fetched(measured: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Fetched]:
    done: dict[str, Fetched] = {}

    def get(name: str) -> Fetched:
        if name not in done:
            done[name] = Fetched(fetch(name, tmp_path_factory.mktemp("fetched") / name, measured))
        return done[name]

    return get
