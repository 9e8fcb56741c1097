"""The page to work with, driven as a person would: zoom, sliders, gains, the worst of 200 traces first."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

import browsing
import interactive_runs as made
from etcfit.reporting.interactive import write_interactive

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytestmark = pytest.mark.slow
COUNT, SAMPLES, WORST = 200, 2000, 137
LIMIT = 8_000_000
SOON = 4.0  # times what the page of a few traces takes


class Visit(browsing.Visit):
    """What a person does with the page."""

    ready = "globalThis.etcfit.page.loop.panels || !globalThis.etcfit.page.data.loop"

    def scales(self) -> list[list[float]]:
        """What each chart of the trace shows of the time axis."""
        return self.page.evaluate(
            "etcfit.page.view.stack.charts.map(({plot}) => [plot.scales.x.min, plot.scales.x.max])"
        )

    def now(self, chart: str = "etcfit.page.view.panels[0].entry") -> list[float | None]:
        """The curve of the sliders in a chart."""
        return self.page.evaluate(f"{chart}.series.find((each) => each.name === 'now').values")


@pytest.fixture(scope="module")
def few(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_interactive(made.run_folder(tmp_path_factory.mktemp("few"))).path


@pytest.fixture(scope="module")
def many(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("many")
    run = made.kept(folder / "run", made.many(folder / "rig", COUNT, SAMPLES, WORST))
    return write_interactive(run).path


def test_a_drag_over_one_chart_zooms_all_and_a_double_click_shows_all_again(browser: Browser, few: Path) -> None:
    visit = Visit(browser, few)
    page = visit.page
    begin = visit.scales()
    assert len(begin) >= 4
    over = page.locator("#charts .u-over").first
    visit.drag(over)
    zoomed = visit.scales()
    span = begin[0][1] - begin[0][0]
    assert all(each == zoomed[0] for each in zoomed)
    assert zoomed[0][1] - zoomed[0][0] == pytest.approx(0.25 * span, rel=0.1)
    over.dblclick()
    visit.settle()
    assert visit.scales()[-1] == pytest.approx(begin[-1])
    assert visit.said == []


def test_keys_alone_zoom_choose_and_move(browser: Browser, few: Path) -> None:
    visit = Visit(browser, few)
    page = visit.page
    page.locator("#charts .chart").first.focus()
    page.keyboard.press("+")
    visit.settle()
    inside = visit.scales()
    page.keyboard.press("ArrowRight")
    visit.settle()
    assert visit.scales()[2][0] > inside[2][0]
    page.keyboard.press("0")
    visit.settle()
    page.locator("#list button").first.focus()
    title = page.inner_text("#trace-title")
    page.keyboard.press("ArrowDown")
    assert page.inner_text("#trace-title") != title
    # nothing takes the focus that a person cannot see
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.matches(':focus-visible')")
    assert visit.said == []


def test_a_slider_moves_the_curve_and_going_back_takes_it_away(browser: Browser, few: Path) -> None:
    visit = Visit(browser, few)
    page = visit.page
    page.locator("#list button", has_text="response/1.csv").click()
    assert set(visit.now()) == {None}
    page.locator("#slider-R_a").focus()
    for _ in range(40):
        page.keyboard.press("ArrowRight")
    visit.settle()
    once = visit.now()
    assert None not in once
    page.keyboard.press("PageUp")
    visit.settle()
    assert visit.now() != once
    assert "→" in page.inner_text("#misfit")
    page.click("#fitted")
    visit.settle()
    assert set(visit.now()) == {None}
    assert visit.said == []


def test_a_slider_of_a_gain_moves_the_closed_loop(browser: Browser, few: Path) -> None:
    visit = Visit(browser, few)
    share = "etcfit.page.loop.panels.share"
    assert set(visit.now(share)) == {None}
    visit.page.locator("#slider-Kp").focus()
    visit.page.keyboard.press("PageUp")
    visit.settle()
    assert None not in visit.now(share)
    assert visit.page.locator("#loop-body tr", has_text="now").count() == 1
    assert visit.said == []


def test_the_page_opens_at_the_worst_of_200_traces_soon(browser: Browser, few: Path, many: Path) -> None:
    assert many.stat().st_size < LIMIT
    little = Visit(browser, few)
    visit = Visit(browser, many)
    page = visit.page
    assert page.locator("#list button").count() == COUNT
    paint = [each.mark("first-contentful-paint") for each in (little, visit)]
    print(f"a few traces, {COUNT}: first paint {paint} ms")
    assert paint[1] < SOON * paint[0]
    worst = f"response/log_{WORST:03d}.csv"
    assert page.inner_text("#trace-title").startswith(worst)  # where the page opens
    assert worst in page.locator("#list button").first.inner_text()
    page.click("#worst")  # the order of the files
    assert "response/log_000.csv" in page.locator("#list button").first.inner_text()
    assert page.inner_text("#trace-title").startswith(worst)
    assert "far off" in page.inner_text("#verdict")
    assert (visit.said, visit.asked) == ([], [many.as_uri()])


def test_what_drove_a_trace_stands_below_it(browser: Browser, few: Path) -> None:
    page = Visit(browser, few).page
    page.locator("#list button", has_text="response/1.csv").click()
    assert "voltage that drove it" in page.locator("#charts h3").all_inner_texts()
    page.locator("#list button", has_text="back_emf/1.csv").click()  # open terminals
    assert not [title for title in page.locator("#charts h3").all_inner_texts() if "drove" in title]


def test_traces_are_filtered_by_test(browser: Browser, few: Path) -> None:
    visit = Visit(browser, few)
    every = visit.page.locator("#list button").count()
    visit.page.select_option("#filter", "response")
    assert visit.page.locator("#list button").all_inner_texts()
    assert visit.page.locator("#list button").count() == 2 < every


@pytest.mark.parametrize("width", [380, 1300])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_nothing_is_wider_than_the_screen_in_either_dress(browser: Browser, few: Path, width: int, scheme: str) -> None:
    visit = Visit(browser, few, width, scheme)
    assert visit.page.evaluate("document.documentElement.scrollWidth") == width
    assert visit.page.evaluate("document.documentElement.dataset.theme") == scheme
    visit.page.click("#theme")
    visit.settle()
    assert visit.page.evaluate("document.documentElement.dataset.theme") != scheme
    assert visit.page.evaluate("document.documentElement.scrollWidth") == width
    assert visit.said == []


def test_every_control_has_a_name_and_every_chart_words(browser: Browser, few: Path) -> None:
    assert Visit(browser, few).check_names("button", "slider", "combobox", "checkbox") > 3


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_letters_stand_out_from_their_paper(browser: Browser, few: Path, scheme: str) -> None:
    """WCAG 2.2, 1.4.3: a contrast of 4.5 at least, in both dresses."""
    Visit(browser, few, 1300, scheme).check_contrast("ink soft green yellow red accent now", "paper wash", 4.5)
