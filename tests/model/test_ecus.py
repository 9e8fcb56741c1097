"""Every registered engine computer, whoever wrote it: what it fixes, how it writes gains, what it says of itself."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

import etcfit
from etcfit.errors import UsageError
from etcfit.model.ecu import Ecu
from etcfit.model.ecus import ECUS, PROFILES, EcuProfile, closed, named, open_source

TRAVEL = math.pi / 2
LEFT_TO_THE_USER = {"period", "filter", "delay", "supply"}  # what the options and [ecu] of rig.toml tell
every_make = pytest.mark.parametrize("make", PROFILES, ids=lambda make: make.name)


def completed(make: EcuProfile) -> Ecu:
    return Ecu(supply=13.5)._replace(**make.completed({}))


def test_the_makes_of_the_docs_are_there() -> None:
    assert set(ECUS) >= {"rusefi", "fome", "dbwx2", "link", "emtron", "arduino", "generic"}
    assert etcfit.ECUS is ECUS


def test_every_profile_beside_the_registry_is_registered() -> None:
    defined = [each for file in (open_source, closed) for each in vars(file).values() if isinstance(each, EcuProfile)]
    assert sorted(each.name for each in defined) == sorted(ECUS)


@every_make
def test_it_fixes_and_assumes_fields_of_an_ecu(make: EcuProfile) -> None:
    assert set(make.fixes) | set(make.assumes) <= set(Ecu._fields)
    assert not set(make.fixes) & set(make.assumes)
    assert not set(make.assumes) & LEFT_TO_THE_USER
    assert all(math.isfinite(value) and value >= 0.0 for value in (*make.fixes.values(), *make.assumes.values()))


@every_make
def test_it_says_where_it_is_from_and_what_is_assumed(make: EcuProfile) -> None:
    assert len(make.source) > 20
    assert make.title
    assert make.name == make.name.lower()
    # a clock that no source fixes is left to the user, and said to be
    assert "period" in make.fixes or any("clock" in each or "sample time" in each for each in make.assumed)
    assert not make.assumes or make.assumed


@every_make
def test_gains_written_and_read_are_the_same(make: EcuProfile) -> None:
    ecu, gains = completed(make), (130.0, 2302.0, 0.73)
    assert len(set(make.gains)) == 3
    if make.notation is None:  # a unit that is not published is not made up
        return
    written = make.notation.written(gains, ecu, TRAVEL)
    assert tuple(w * u for w, u in zip(written, make.notation.units(ecu, TRAVEL), strict=True)) == pytest.approx(gains)
    # an error of 1 % alone gives as many % of duty as P
    if make.notation.unit == "%/%":
        assert 100.0 * gains[0] * 0.01 * TRAVEL / ecu.supply == pytest.approx(written.P)


CLOSED = ("maxxecu", "ecumaster", "haltech", "motec", "syvecs")


@pytest.mark.parametrize("name", CLOSED)
def test_a_closed_make_has_no_unit_of_its_gains_and_says_what_is_assumed_of_each_field(name: str) -> None:
    make = named(name)
    assert make.notation is None
    assert not make.fixes
    told = " ".join(make.assumed)
    for word in ("clock", "derivative filter", "derivative of the error", "100 %", "battery", "feed-forward"):
        assert word in told or (word == "feed-forward" and make.bias is not None), word
    assert name == "syvecs" or "https://" in make.source


def test_an_ecu_that_divides_by_the_battery_is_one_where_the_user_says_so() -> None:
    assert named("maxxecu").completed({})["compensated"] == 0.0
    assert named("maxxecu").completed({"compensated": 1.0})["compensated"] == 1.0
    assert named("rusefi").clashes({"compensated": 1.0}) == ("compensated",)


@every_make
def test_its_settings_are_numbers_with_names_of_their_own(make: EcuProfile) -> None:
    ecu = completed(make)
    names = [
        *make.gains,
        *(limit.name for limit in make.limits),
        *((make.bias.bins, make.bias.values) if make.bias else ()),
    ]
    assert len(set(names)) == len(names)
    values = [limit.value(ecu, TRAVEL) for limit in make.limits]
    assert np.all(np.isfinite(values))
    json.dumps(values)


@every_make
def test_its_table_of_feed_forward_can_be_made(make: EcuProfile) -> None:
    if make.bias is not None:
        assert make.bias.points >= 2
        assert make.bias.positions >= make.bias.points
        assert 0 <= make.bias.decimals <= 3


def test_what_a_source_fixes_cannot_be_given_otherwise() -> None:
    rusefi, link = named("rusefi"), named("link")
    assert rusefi.clashes({"period": 1e-3, "delay": 1e-3}) == ("period",)
    assert rusefi.clashes({"period": 2e-3}) == ()
    assert link.clashes({"period": 5e-3, "duty": 0.8}) == ()
    assert link.completed({"duty": 0.8, "period": 5e-3}) == {"duty": 0.8, "period": 5e-3}
    assert rusefi.completed({"delay": 1e-3}) == {**rusefi.fixes, "delay": 1e-3}


def test_a_dead_band_is_written_in_percent_of_the_travel() -> None:
    make = named("dbwx2")
    ecu = completed(make)._replace(dead_band=0.002 * TRAVEL)
    settings = {limit.name: limit.value(ecu, TRAVEL) for limit in make.limits}
    assert settings["PID I MIN"] == pytest.approx(0.2)
    assert (settings["I MAX"], settings["PID clamp"]) == (100.0, 100.0)


def test_an_unknown_make_is_told_the_known_ones() -> None:
    with pytest.raises(UsageError, match=r"motronic: no such engine computer\. Known: rusefi, fome, dbwx2, link"):
        named("motronic")
