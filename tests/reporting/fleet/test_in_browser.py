"""The page of a fleet, driven as a person would: filter, click, zoom, keys, both dresses; ten thousand units."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

import browsing
import fleet_pages as made
from browsing import contrast
from etcfit.reporting.fleet.page import write_fleet_page

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytestmark = pytest.mark.slow
MANY = 10_000
SOON = 4.0  # times what a page of a few units takes
SMALLEST = 12.0  # px, of letters; subscripts may be a fifth smaller
SCATTER = "[...etcfit.Panel.every].find((each) => each.how.height === 340)"


class Visit(browsing.Visit):
    """What a person does with the page."""

    ready = "globalThis.etcfit.page?.sections?.length"

    def everything(self) -> None:
        """Scroll through it all, so that every chart is made."""
        tall = self.page.evaluate("document.documentElement.scrollHeight")
        for at in range(0, tall, 600):
            self.page.evaluate(f"scrollTo({{ top: {at}, behavior: 'instant' }})")
            self.settle()
            self.settle()
        assert self.page.evaluate("[...etcfit.Panel.every].every((each) => each.plot)")
        self.page.evaluate("scrollTo({ top: 0, behavior: 'instant' })")

    def tally(self) -> str:
        self.settle()
        return self.page.inner_text("#tally")

    def views(self) -> list[list[float]]:
        return self.page.evaluate("etcfit.page.sections[0].panels.map((each) => each.view.x)")

    def spot(self, panel: str, unit: str) -> Any:
        """Where a unit's point is on the screen."""
        return self.page.evaluate(
            f"""(name) => {{ const panel = {panel}, k = etcfit.page.store.place.get(name), at = panel.painter.spot(k),
                to = panel.map(true), box = panel.plot.over.getBoundingClientRect();
                return [box.left + to.x(at[0]), box.top + to.y(at[1])]; }}""",
            unit,
        )


@pytest.fixture(scope="module")
def fleet() -> made.Made:
    return made.fleet(200, 3)


@pytest.fixture(scope="module")
def few(fleet: made.Made, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_fleet_page(tmp_path_factory.mktemp("few"), fleet.content, fleet.units)


@pytest.fixture(scope="module")
def many(tmp_path_factory: pytest.TempPathFactory) -> Path:
    fleet = made.fleet(MANY, 40)
    return write_fleet_page(tmp_path_factory.mktemp("many"), fleet.content, fleet.units)


FILTERED = """() => { const begun = performance.now(), frame = (call) => requestAnimationFrame(call);
    document.getElementById('odd-only').click();
    return new Promise((done) => frame(() => frame(() => done(performance.now() - begun)))); }"""


def test_ten_thousand_units_are_painted_and_filtered_soon(browser: Browser, few: Path, many: Path) -> None:
    little, visit = Visit(browser, few), Visit(browser, many)
    took = []
    for each in (little, visit):
        each.everything()
        took.append(each.page.evaluate(FILTERED))
    paint = [each.mark("first-contentful-paint") for each in (little, visit)]
    print(f"a few units, {MANY}: first paint {paint} ms, filter {took} ms")
    assert paint[1] < SOON * paint[0]
    assert took[1] < SOON * took[0]
    assert visit.tally() == "40 of 10,000 shown"
    assert (visit.said, visit.asked) == ([], [many.as_uri()])


def test_filters_hide_what_they_should(browser: Browser, few: Path, fleet: made.Made) -> None:
    visit = Visit(browser, few)
    page, members = visit.page, fleet.content["members"]

    def count(**wanted: str) -> int:
        return sum(all(m[key] == value for key, value in wanted.items()) for m in members.values())

    page.select_option("#by-batch", label="B1")
    assert visit.tally() == f"{count(batch='B1')} of 200 shown"
    page.select_option("#by-rig", label="rig 2")
    assert visit.tally() == f"{count(batch='B1', rig='rig 2')} of 200 shown"
    assert 0 < count(batch="B1", rig="rig 2") < count(batch="B1") < 200
    page.click("#all")
    assert visit.tally() == "200 of 200 shown"
    page.fill("#date-from", "2026-07-29")
    page.fill("#date-to", "2026-07-30")
    expected = sum("2026-07-29" <= m["date"] <= "2026-07-30" for m in members.values())
    assert visit.tally() == f"{expected} of 200 shown"
    page.click("#all")
    page.fill("#find", members["unit_00042"]["serial"])
    assert visit.tally() == "1 of 200 shown"
    page.press("#find", "Enter")
    assert page.inner_text("#card-title") == "unit_00042"
    assert page.locator("[data-row]:visible").count() == 0
    page.fill("#find", "no such unit")
    assert visit.tally().endswith("no unit is like this")
    assert visit.said == []


def test_a_click_on_a_point_marks_its_unit_everywhere(browser: Browser, few: Path, fleet: made.Made) -> None:
    visit = Visit(browser, few)
    page, unit = visit.page, fleet.content["odd"][0]["unit"]
    visit.everything()
    symbol = fleet.content["odd"][0]["symbols"][0]
    panel = f"etcfit.page.sections[0].panels.find((each) => each.how.describe.startsWith('{symbol} '))"
    page.evaluate(f"{panel}.box.scrollIntoView({{ block: 'center', behavior: 'instant' }})")
    visit.settle()
    x, y = visit.spot(panel, unit)
    page.mouse.move(x + 2, y + 1)
    assert page.inner_text(".tip").startswith(unit)
    page.mouse.click(x + 2, y + 1)
    assert page.inner_text("#card-title") == unit
    assert "Odd: " in page.inner_text("#card-body")
    assert page.get_attribute("#card-body a", "href") == f"units/{unit}/report.html"
    assert page.locator(f"tr.chosen[data-row={unit}]").count() == 1
    marked = page.evaluate(
        """[...etcfit.Panel.every].filter((each) => each.painter.spot(etcfit.page.store.chosen))
            .map((each) => !each.spots[1].hidden)"""
    )
    assert len(marked) > 12
    assert all(marked)
    page.click("#none")
    assert page.inner_text("#card-title") == "No unit chosen"
    page.locator("[data-unit]").last.scroll_into_view_if_needed()
    page.locator(".figures [data-unit]").first.click()
    assert page.inner_text("#card-title") == unit
    assert visit.said == []


def test_a_drag_zooms_the_charts_of_a_group_and_a_double_click_shows_all_again(browser: Browser, few: Path) -> None:
    visit = Visit(browser, few)
    page = visit.page
    begin = visit.views()
    over = page.locator("#population-panels .u-over").first
    visit.drag(over)
    zoomed = visit.views()
    assert all(each == zoomed[0] for each in zoomed)
    assert zoomed[0][1] - zoomed[0][0] == pytest.approx(0.25 * (begin[0][1] - begin[0][0]), rel=0.1)
    assert page.inner_text("#card-title") == "No unit chosen"  # a drag is no click
    over.dblclick()
    assert visit.views() == begin
    assert visit.said == []


def test_keys_alone_zoom_and_move_between_units(browser: Browser, few: Path) -> None:
    visit = Visit(browser, few)
    page = visit.page
    begin = visit.views()
    page.locator("#population-panels .chart").first.focus()
    page.keyboard.press("+")
    inside = visit.views()
    assert inside[3][1] - inside[3][0] == pytest.approx(0.6 * (begin[3][1] - begin[3][0]))
    page.keyboard.press("ArrowRight")
    assert visit.views()[2][0] > inside[2][0]
    page.keyboard.press("0")
    assert visit.views() == begin
    page.focus("#after")
    page.keyboard.press("Enter")
    assert page.inner_text("#card-title") == "unit_00001"
    page.focus("#before")
    page.keyboard.press("Enter")
    assert page.inner_text("#card-title") == "unit_00200"
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.matches(':focus-visible')")
    assert visit.said == []


def test_switches_change_what_is_drawn(browser: Browser, few: Path) -> None:
    visit = Visit(browser, few)
    page = visit.page
    first = "[...etcfit.page.sections[0].panels[0].painter.py.slice(0, 9)]"
    raw = page.evaluate(first)
    page.select_option("#kind", "shrunk")
    shrunk = page.evaluate(first)
    assert raw != shrunk
    page.select_option("#order", "sorted")
    assert sorted(page.evaluate("[...etcfit.page.sections[0].panels[0].painter.px]")) == list(range(1, 201))
    page.locator("[data-pair='0,3']").click()
    assert page.evaluate(f"{SCATTER}.how.describe").startswith("R_a over J_m")
    assert page.locator("[data-pair][aria-pressed=true]").count() == 1
    before = page.evaluate("etcfit.page.sections[2].panels[0].how.describe")
    assert before == "Control chart of K_s"  # the one that drifts comes first
    page.select_option("#chart", index=0)
    assert page.evaluate("etcfit.page.sections[2].panels[0].how.describe") == "Control chart of R_a"
    visit.everything()
    assert visit.said == []


@pytest.mark.parametrize("width", [380, 1300])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_nothing_is_wider_than_the_screen_or_too_small_to_read(
    browser: Browser, few: Path, width: int, scheme: str
) -> None:
    visit = Visit(browser, few, width, scheme)
    page = visit.page
    page.locator(".link").first.click()
    for wanted in (scheme, "dark" if scheme == "light" else "light"):
        visit.everything()
        assert page.evaluate("document.documentElement.dataset.theme") == wanted
        assert page.evaluate("document.documentElement.scrollWidth") == width
        page.click("#theme")
        visit.settle()
    small = page.evaluate(
        """(least) => [...document.querySelectorAll('body *')].filter((each) => each.tagName !== 'SUB'
            && each.offsetParent
            && [...each.childNodes].some((child) => child.nodeType === 3 && child.textContent.trim())
            && parseFloat(getComputedStyle(each).fontSize) < least).map((each) => each.outerHTML.slice(0, 80))""",
        SMALLEST,
    )
    assert small == []
    assert visit.said == []


def test_every_control_has_a_name_and_every_chart_words(browser: Browser, few: Path) -> None:
    assert Visit(browser, few).check_names("button", "combobox", "checkbox", "searchbox") > 15


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_letters_and_marks_stand_out_from_their_paper(browser: Browser, few: Path, scheme: str) -> None:
    """WCAG 2.2: 4.5 of letters (1.4.3), in the cells of the matrix too; 3 of what is drawn (1.4.11)."""
    visit = Visit(browser, few, 1300, scheme)
    visit.check_contrast("ink soft green red accent", "paper wash", 4.5)
    visit.check_contrast("plain odd chosen", "paper band", 3.0)
    cells = visit.page.eval_on_selector_all(
        ".matrix button",
        "(all) => all.map((each) => [getComputedStyle(each).color, getComputedStyle(each).backgroundColor])",
    )
    assert min(contrast(ink, paper) for ink, paper in cells) >= 4.5
