"""Folders of the independent generator with a mistake of the rig in them that rig.toml knows nothing of."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import numpy as np

from independent import draw_truth, make_folder
from independent.protocols import PROTOCOLS, Series, Session, Trace
from independent.truth import Truth

COPPER = 0.0039  # 1/K
SERIES_OHM = '[tests.inductance]\nseries_ohm = "free"\n'


def truth_of(seed: int) -> Truth:
    return draw_truth(np.random.default_rng(seed))


def clean(path: Path, seed: int) -> Path:
    """No mistake."""
    make_folder(path, truth_of(seed), seed, size="small")
    return path


def undeclared_resistor(path: Path, seed: int) -> Path:
    """1.218 ohm in the circuit of the inductance test, which rig.toml does not say."""
    clean(path, seed)
    return _edited(path, SERIES_OHM, "")


def short_travel(path: Path, seed: int) -> Path:
    """Travel and sensor said to span 81 degrees where they span 90."""
    clean(path, seed)
    _edited(path, "travel_deg = [0.0, 90.0]", "travel_deg = [0.0, 81.0]")
    return _edited(path, "travel_deg = 90.0", "travel_deg = 81.0")


def hot_winding(path: Path, seed: int, test: str = "resistance", kelvin: float = 40.0) -> Path:
    """One test made with the winding so much hotter."""
    protocol = PROTOCOLS[test]

    def hot(session: Session, series: Series) -> Iterator[Trace]:
        warm = replace(session.truth, R_a=session.truth.R_a * (1.0 + COPPER * kelvin))
        yield from protocol(replace(session, truth=warm), series)

    with patch.dict(PROTOCOLS, {test: hot}):
        return clean(path, seed)


def _edited(path: Path, old: str, new: str) -> Path:
    toml = path / "rig.toml"
    text = toml.read_text(encoding="utf-8")
    assert old in text
    toml.write_text(text.replace(old, new), encoding="utf-8")
    return path
