"""In which portions units are handed out, and when one is given up; no worker needed."""

from __future__ import annotations

import pytest

from etcfit.fleets.engine.agenda import Agenda
from etcfit.fleets.engine.order import Lost, Order, Portion, Trouble
from etcfit.fleets.engine.settings import EngineSettings
from fleet_works import result_of

SETTINGS = EngineSettings(portion=0.4, largest_portion=50)


def orders(count: int) -> list[Order]:
    return [Order(f"u{k}", "") for k in range(count)]


def portion(seconds: float, done: int = 1, **more: object) -> Portion:
    held = {"trouble": (), "left": (), "unchanged": (), "worker": "tcp://a", **more}
    return Portion(seconds=seconds, done=tuple(result_of(f"d{k}") for k in range(done)), **held)  # type: ignore[arg-type]


def test_units_are_handed_out_in_order_first_one_by_one() -> None:
    agenda = Agenda(orders(5), SETTINGS)
    assert [agenda.next_portion(2)[0].unit for _ in range(5)] == ["u0", "u1", "u2", "u3", "u4"]
    assert not agenda


@pytest.mark.parametrize(("seconds", "least", "most"), [(1e-4, 50, 50), (0.1, 3, 4), (0.4, 1, 1), (60.0, 1, 1)])
def test_a_portion_is_as_large_as_its_time_allows(seconds: float, least: int, most: int) -> None:
    agenda = Agenda(orders(1000), SETTINGS)
    for _ in range(30):
        agenda.came_back(portion(seconds))
    assert least <= len(agenda.next_portion(2)) <= most


def test_the_last_units_are_shared_out_evenly() -> None:
    agenda = Agenda(orders(10), SETTINGS)
    for _ in range(30):
        agenda.came_back(portion(1e-5))
    assert len(agenda.next_portion(4)) == 3


def test_what_a_worker_did_not_begin_comes_next() -> None:
    agenda = Agenda(orders(3), SETTINGS)
    first = agenda.next_portion(1)
    agenda.came_back(portion(1.0, left=(Order("x", ""), Order("y", ""))))
    assert first[0].unit == "u0"
    assert [agenda.next_portion(1)[0].unit for _ in range(4)] == ["x", "y", "u1", "u2"]


def test_trouble_is_taken_elsewhere_once_and_then_told() -> None:
    agenda = Agenda([], SETTINGS)
    trouble = Trouble(Order("u", "k"), "u: no room.")
    assert agenda.came_back(portion(0.1, trouble=(trouble,))) == []
    again = agenda.next_portion(1)
    assert again == (Order("u", "k"),)
    assert agenda.refused(again) == "tcp://a"
    (failed,) = agenda.came_back(portion(0.1, trouble=(trouble,)))
    assert (failed.unit, failed.why, failed.digest) == ("u", "u: no room. It was tried 2 times.", "")
    assert not agenda


def test_units_of_a_portion_that_died_go_alone_without_blame() -> None:
    agenda = Agenda(orders(100), SETTINGS)
    for _ in range(30):
        agenda.came_back(portion(1e-5))
    dead = agenda.next_portion(2)
    assert len(dead) == 50
    assert agenda.lost(dead, Lost("died")) == []
    assert [agenda.next_portion(2) for _ in range(50)] == [(order,) for order in dead]
    assert len(agenda.next_portion(2)) > 1
    assert agenda.lost(dead[:1], Lost("died")) == []  # its first own
    assert [failed.unit for failed in agenda.lost(dead[:1], Lost("died"))] == ["u0"]


def test_a_scheduler_that_tried_four_workers_itself_needs_no_more() -> None:
    agenda = Agenda([], SETTINGS)
    (failed,) = agenda.lost(orders(1), Lost("died.", 4))
    assert failed.why == "died. It was tried 4 times."
