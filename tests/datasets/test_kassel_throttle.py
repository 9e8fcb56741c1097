"""The Kassel throttle: nothing lost, the right way up, and inside its own calibration."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest


@pytest.fixture(scope="module")
def kassel(fetched):
    return fetched("kassel-throttle")


@pytest.fixture(scope="module")
def record(kassel) -> pd.DataFrame:
    return pd.concat([kassel.trace("response/fit.csv"), kassel.trace("response/holdout.csv")], ignore_index=True)


def test_split_at_60_percent_and_the_rest_held_out(kassel) -> None:
    assert kassel.traces == {"response/fit.csv", "response/holdout.csv"}
    assert kassel.rig["holdout"]["files"] == ["response/holdout.csv"]
    assert len(kassel.trace("response/fit.csv")) == int(0.6 * 2498)


def test_whole_record_at_10_ms(record) -> None:
    assert len(record) == 2498
    assert np.allclose(np.diff(record["time [s]"]), 0.010, atol=1e-9, rtol=0)
    assert record["duty [%]"].min() == -20.0
    assert record["duty [%]"].max() == 45.0


def test_duty_opens(kassel, record) -> None:
    tps = kassel.rig["tps"]
    opening = (record["tps [V]"] - tps["closed_V"]) / (tps["open_V"] - tps["closed_V"])
    assert np.corrcoef(record["duty [%]"], np.gradient(opening))[0, 1] > 0.5
    # no more than noise and the give of the stop outside the calibration: 0.1 % of the travel
    assert opening.min() > -0.001
    assert opening.max() < 1.001


def test_stated_noise_is_what_the_plate_shows_at_its_far_stop(kassel, record) -> None:
    # holds of one duty of at least 20 samples that end on the stop; the first half is the way there
    hold = (record["duty [%]"].diff() != 0).cumsum()
    ends = [group["tps [V]"].to_numpy()[len(group) // 2 :] for _, group in record.groupby(hold) if len(group) >= 20]
    at_rest = [np.std(end, ddof=1) for end in ends if abs(end.mean() - 0.7035) < 0.002]
    assert len(at_rest) >= 4
    assert np.median(at_rest) == pytest.approx(kassel.rig["noise"]["tps_V"], rel=0.15)


def test_licence_and_source_travel_along(kassel) -> None:
    assert "Redistribution and use" in (kassel.folder / "LICENSE").read_text(encoding="utf-8")
    readme = (kassel.folder / "README.md").read_text(encoding="utf-8")
    assert "50938d18ccf2b84959d90fe7a424c4e3ac998096" in readme
    assert "BSD-3-Clause" in readme
