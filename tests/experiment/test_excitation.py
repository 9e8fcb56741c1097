"""What every shape must be, and each its own formula."""

from __future__ import annotations

import numpy as np
import pytest

from etcfit.experiment.excitation import SHAPES, AbstractShape
from etcfit.experiment.excitation.chirp import Chirp
from etcfit.experiment.excitation.multisine import Multisine
from etcfit.experiment.excitation.ramps import Ramps
from etcfit.experiment.excitation.steps import Steps
from etcfit.rig import TEST_BY_NAME

TIME = np.arange(6000) / 1000.0


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape.name)
def test_a_shape_keeps_within_one_and_uses_it(shape: AbstractShape) -> None:
    assert shape.test in TEST_BY_NAME
    waves = {}
    for band in shape.bands:
        waves[band] = shape.wave(TIME, band)
        assert waves[band].shape == TIME.shape
        assert 0.95 < np.abs(waves[band]).max() <= 1.0
        assert waves[band].min() < -0.5
        assert waves[band].max() > 0.5
        assert (shape.wave(TIME, band) == waves[band]).all()  # planned twice it is the same plan
        assert f"{band:g}" in shape.says(band) or shape.says(band) != shape.says(2.0 * band)
    slow, fast = (np.abs(np.diff(waves[band])).sum() for band in (min(waves), max(waves)))
    assert fast > 1.5 * slow


def test_shapes_have_names_of_their_own() -> None:
    assert len({shape.name for shape in SHAPES}) == len(SHAPES)


def test_a_multisine_is_made_of_its_lines_alone() -> None:
    time = np.arange(200_000) / 1000.0  # lines resolved to 0.005 Hz
    power = np.abs(np.fft.rfft(Multisine().wave(time, 10.0) * np.hanning(time.size))) ** 2
    hertz = np.fft.rfftfreq(time.size, 1e-3)
    lines = np.geomspace(0.4, 10.0, 8)
    near = np.abs(hertz[:, None] - lines).min(axis=1) < 0.03
    assert power[near].sum() > 0.9999 * power.sum()
    each = [power[np.abs(hertz - line) < 0.03].sum() for line in lines]
    assert np.ptp(each) < 0.01 * max(each)


def test_a_chirp_ends_at_its_band() -> None:
    wave = Chirp().wave(TIME, 10.0)
    falls = TIME[1:][(wave[1:] < 0.0) & (wave[:-1] >= 0.0)]
    assert 1.0 / np.diff(falls)[-1] == pytest.approx(10.0, rel=0.1)
    assert 1.0 / np.diff(falls)[0] < 1.0


def test_steps_go_to_either_side_and_stay() -> None:
    wave = Steps().wave(TIME, 5.0)
    jumps = np.flatnonzero(np.diff(wave))
    assert np.diff(TIME[jumps]).min() > 0.099
    assert np.diff(TIME[jumps]).max() < 0.301
    assert (np.diff(np.sign(wave[np.append(jumps, -1)])) != 0.0).all()


def test_ramps_are_straight() -> None:
    slope = np.diff(Ramps().wave(TIME, 1.0)) / np.diff(TIME)
    assert np.median(np.abs(slope)) == pytest.approx(4.0, rel=1e-6)
    assert (np.abs(np.abs(slope) - 4.0) < 1e-6).mean() > 0.99
