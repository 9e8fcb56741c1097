"""Every data set that is fetched is a measurement folder: the package's own reader takes it, and finds nothing odd."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from etcfit.datasets import DATASETS
from etcfit.problem.free_parameters import free_parameters
from etcfit.rig.base import Fixed
from etcfit.rig.reader import read_folder


@pytest.mark.parametrize("name", DATASETS)
def test_a_fit_takes_what_its_rig_toml_says_of_the_parameters(fetched: Callable[[str], Any], name: str) -> None:
    assert free_parameters(read_folder(fetched(name).folder).config).layout.free


@pytest.mark.parametrize("name", DATASETS)
def test_reader_takes_it(fetched: Callable[[str], Any], name: str) -> None:
    rig = read_folder(fetched(name).folder)
    assert rig.warnings == ()
    assert not rig.config.synthetic
    assert {m.file for m in rig.measurements if m.held_out} == set(rig.config.holdout) != set()
    assert all(not m.channels["position"].sigma_estimated for m in rig.measurements)


def test_duty_opens_and_travel_is_the_stops(fetched: Callable[[str], Any]) -> None:
    rig = read_folder(fetched("kassel-throttle").folder)
    span = rig.config.travel[1] - rig.config.travel[0]
    for trace in rig.measurements:
        angle = trace.channels["position"].value
        assert -0.001 * span < angle.min() < angle.max() < 1.001 * span


def test_emps_leaves_only_the_sled_to_find(fetched: Callable[[str], Any]) -> None:
    known = read_folder(fetched("emps").folder).config.parameters
    assert {symbol for symbol in known if isinstance(known[symbol], Fixed)} == {"K_s", "J_m", "B_m"}
