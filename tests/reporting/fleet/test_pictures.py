"""Pictures of a fleet: one for each thing that is known, legible, made-up data called so."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text

import fleet_pages as made
from etcfit.reporting import style
from etcfit.reporting.fleet import pictures
from etcfit.reporting.fleet.page import Columns
from etcfit.reporting.fleet.pictures import draw_fleet, power_of


@pytest.fixture(scope="module")
def fleet() -> made.Made:
    return made.fleet()


def few(fleet: made.Made) -> dict[str, Any]:
    """Two symbols of it, for drawing takes its time."""
    kept = {name: fleet.content["population"][name] for name in ("K_s", "K_b")}
    return fleet.content | {"population": kept, "charts": {"K_s": fleet.content["charts"]["K_s"]}}


def words(fig: Figure) -> list[Text]:
    return [
        text for text in fig.findobj(Text) if isinstance(text, Text) and text.get_text().strip() and text.get_visible()
    ]


def test_there_is_a_picture_of_each_and_old_ones_go(fleet: made.Made, tmp_path: Path) -> None:
    (tmp_path / "chart_old.png").write_bytes(b"")
    drawn = draw_fleet(few(fleet), fleet.units, tmp_path)
    assert [path.name for path in drawn] == ["population.png", "correlation.png", "chart_K_s.png", "odd.png"]
    assert sorted(tmp_path.iterdir()) == sorted(drawn)
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in drawn)


def test_a_fleet_of_which_nothing_is_known_has_no_picture(fleet: made.Made, tmp_path: Path) -> None:
    assert draw_fleet({"units": [], "gauge": None}, fleet.units.iloc[:0], tmp_path) == ()


@pytest.mark.slow
@pytest.mark.parametrize("synthetic", [True, False])
def test_every_picture_says_what_is_made_up_in_letters_that_can_be_read(fleet: made.Made, synthetic: bool) -> None:
    content = few(fleet) | {"synthetic": synthetic}
    with style.drawing():
        columns = Columns.of_units(fleet.content["units"], fleet.units)
        figures = [pictures.draw_population(content, columns), pictures.draw_correlation(content),
                   pictures.draw_chart(content, "K_s"), pictures.draw_odd(content)]  # fmt: skip
    for fig in figures:
        fig.canvas.draw()
        assert any(text.get_text() == "SYNTHETIC DATA" for text in words(fig)) == synthetic
        assert min(float(text.get_fontsize()) for text in words(fig)) >= 9.0


def test_the_control_chart_has_every_unit_its_limits_and_the_change(fleet: made.Made) -> None:
    content, chart = few(fleet), fleet.content["charts"]["K_s"]
    with style.drawing():
        top, below = pictures.draw_chart(content, "K_s").axes
    lines = {str(line.get_label()): line for line in top.get_lines()}
    assert np.allclose(np.asarray(lines["unit"].get_ydata()), chart["value"])
    levels = [float(np.asarray(line.get_ydata())[0]) for line in top.get_lines() if line.get_label() == "control limit"]
    assert sorted(levels) == sorted([chart["lower"], chart["upper"]])
    change = chart["order"].index(content["drift"][0]["since"]) + 0.5
    assert float(np.asarray(lines["change"].get_xdata())[0]) == change
    sums = {str(line.get_label()): line for line in below.get_lines()}
    assert np.allclose(np.asarray(sums["sum above"].get_ydata()), chart["cusum_high"])


def test_columns_follow_the_order_of_the_fleet_and_leave_gaps(fleet: made.Made) -> None:
    names = [*reversed(fleet.content["units"]), "unit_of_nobody"]
    columns = Columns.of_units(names, fleet.units)
    spring = fleet.units[fleet.units["symbol"] == "K_s"]["value"]
    assert np.array_equal(
        columns.symbols["K_s"]["value"], [*np.asarray(spring, dtype=float)[::-1], np.nan], equal_nan=True
    )
    lost = columns.symbols["B_m"]
    assert [lost.statuses[k] for k in lost.status[:-1][::-1][:2]] == ["not identifiable", "estimated"]
    assert lost.status[-1] == -1


@pytest.mark.parametrize(
    ("size", "power"), [(0.13, 0), (4e-6, -6), (1.5e-3, -3), (2e-4, -6), (3e5, 3), (0.0, 0), (1e-3, -3)]
)
def test_a_power_of_a_thousand_is_split_off_small_and_large_numbers(size: float, power: int) -> None:
    assert power_of([size, 0.1 * size, np.nan]) == power
