"""What all pictures share."""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np
import pytest
from matplotlib.image import imread

from etcfit.reporting import style


def test_thinning_keeps_every_peak_and_the_order() -> None:
    t = np.arange(100_000) * 1e-3
    y = np.sin(t)
    y[54_321], y[77_777], y[5] = 9.0, -9.0, np.nan
    few_t, few = style.thin(t, y)
    assert few.size < 5000
    assert (few.max(), few.min()) == (9.0, -9.0)
    assert (np.diff(few_t) > 0).all()


def test_short_traces_are_drawn_whole() -> None:
    t = np.arange(50.0)
    assert style.thin(t, t)[0].size == 50


def test_a_line_is_broken_at_gaps() -> None:
    x = np.concatenate((np.arange(20.0), np.arange(100.0, 120.0)))
    broken, _ = style.broken(x, x)
    assert np.flatnonzero(np.isnan(broken)).tolist() == [20]
    assert style.broken(np.array([0.0, 1.0]), np.array([0.0, 1.0]))[0].size == 2


def test_a_name_with_dollars_is_no_formula(tmp_path: Path) -> None:
    with style.drawing():
        fig = style.figure(3.0, 2.0, False)
        fig.suptitle(r"rig of $\frac{$")
        style.save(fig, tmp_path / "a.png")
    assert imread(tmp_path / "a.png").std() > 0


def test_drawing_leaves_the_callers_settings_alone() -> None:
    before = matplotlib.rcParams["font.size"]
    with style.drawing():
        assert matplotlib.rcParams["font.size"] == style.RC["font.size"]
    assert matplotlib.rcParams["font.size"] == before


@pytest.mark.parametrize("synthetic", [True, False])
def test_made_up_data_are_tagged(synthetic: bool, tmp_path: Path) -> None:
    fig = style.figure(3.0, 2.0, synthetic)
    assert ("SYNTHETIC DATA" in [text.get_text() for text in fig.texts]) is synthetic
    style.save(fig, tmp_path / "a.png")
    assert bool(imread(tmp_path / "a.png").std() > 0) is synthetic
