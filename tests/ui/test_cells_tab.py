"""The tab of the behaviour cells in a real browser: it shows them live, says the same as text, and costs nothing closed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from tests.ui.driving import ready_page, until
from tests.ui.noted import Noted
from waychair.runtime.chair import ChairSettings
from waychair.runtime.pages.chair_port import ChairPort
from waychair.runtime.pages.perception_view import AimView, DoorwayView, PerceptionView
from waychair.trials.live.live_chair import LiveChair
from waychair.ui.server import page_server

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

DOORS = (
    DoorwayView(2, 1.5, 0.2, 0.1, 0.92, 0.9, "open", True, "Doorway 2: open, wide enough."),
    DoorwayView(5, 0.0, -2.0, -1.6, 0.70, 0.0, "closed", False, "Doorway 5: closed."),
)
AIM = AimView(0.8, 0.0, True, "The camera looks 46 degrees left, level.")


class Perceiving(Noted):
    """A chair's port that counts how often somebody asks for the cells, and adds to what they perceive."""

    def __init__(self, port: ChairPort) -> None:
        super().__init__(port)
        self.asked = 0
        self.adds = False

    def perception(self) -> PerceptionView | None:
        """See `ChairPort`; with two doorways, a camera and an inhibited cell if it `adds`."""
        self.asked += 1
        seen = self.port.perception()
        if seen is None or not self.adds:
            return seen
        cells = tuple(replace(each, inhibited=each.name == "Way finder") for each in seen.cells)
        return replace(seen, doorways=DOORS, aim=AIM, cells=cells, troubles=("the lidar is blind",))


@pytest.fixture(scope="module")
def chair() -> Iterator[LiveChair]:
    """A chair with its behaviour cells switched on."""
    with LiveChair("small_clinic", people=False, settings=ChairSettings(perceive=True)) as live:
        yield live


@pytest.fixture
def perceiving(port: Noted) -> Perceiving:
    return Perceiving(port.port)


@pytest.fixture
def page(browser: Browser, perceiving: Perceiving) -> Iterator[Page]:
    with page_server(perceiving) as address, ready_page(browser, address) as ready:
        yield ready


def _row(page: Page, name: str) -> list[str]:
    """State, effect and age of a cell in the table."""
    row = page.locator(f"#cells-table tr:has(th:text-is('{name}'))")
    return [row.locator("td").nth(k).inner_text() for k in range(3)]


def test_the_cells_of_a_live_chair_are_lit_and_told_with_their_effects_and_ages(page: Page) -> None:
    page.click("#tab-cells")
    page.wait_for_selector("#cells-there:visible")
    until(lambda: _row(page, "Lidar view")[0] == "active", "the lidar's cell does not become active")
    until(lambda: page.inner_text("#cells-said").startswith("Free"), "no way is told as free")
    free = page.locator("#cells-round .sector.free").count()
    assert 0 < free <= page.locator("#cells-round .sector").count() == 16
    state, words, age = _row(page, "Way finder")
    assert (state, words[:5], age[-2:]) == ("active", "free ", " s")
    assert _row(page, "Path planner")[0] == "at rest"
    assert page.inner_text("#cells-signal") != ""
    page.click("#cells-networks button:text-is('Free-space finding')")
    page.wait_for_selector("#cells-drawn svg[aria-label='Free-space finding'] rect.active")
    page.wait_for_selector("#cells-drawn text.told:has-text('free ')")


def test_doorways_camera_inhibition_and_troubles_are_drawn_and_said(page: Page, perceiving: Perceiving) -> None:
    perceiving.adds = True
    page.click("#tab-cells")
    page.wait_for_selector("#cells-round line.door.open.enough")
    page.wait_for_selector("#cells-round line.door.closed:not(.enough)", state="attached")
    page.wait_for_selector("#cells-round line.aim", state="attached")
    said = page.locator("#cells-said li").all_inner_texts()
    assert said[1:] == [DOORS[0].words, DOORS[1].words, AIM.words]
    assert page.inner_text("#cells-troubles") == "the lidar is blind"
    assert _row(page, "Way finder")[0] == "inhibited"
    page.click("#cells-networks button:text-is('Free-space finding')")
    page.wait_for_selector("#cells-drawn svg[aria-label='Free-space finding'] line.struck", state="attached")


def test_the_tab_fits_the_narrowest_phone(page: Page, perceiving: Perceiving) -> None:
    perceiving.adds = True
    page.set_viewport_size({"width": 320, "height": 568})
    page.click("#tab-cells")
    page.wait_for_selector("#cells-drawn svg")
    page.wait_for_selector("#cells-table tr")
    assert page.evaluate("document.documentElement.scrollWidth") <= 320


def test_nobody_works_for_the_cells_while_their_tab_is_closed(page: Page, perceiving: Perceiving) -> None:
    page.wait_for_timeout(500)
    assert perceiving.asked == 0
    page.click("#tab-cells")
    until(lambda: perceiving.asked >= 2, "the cells are not asked for")
    page.click("#tab-places")
    page.wait_for_timeout(300)
    asked = perceiving.asked
    page.wait_for_timeout(600)
    assert perceiving.asked == asked


def test_keyboard_and_one_switch_reach_the_tab_and_its_networks(page: Page) -> None:
    page.focus("#tab-places")
    for _ in range(3):
        page.keyboard.press("ArrowRight")
    page.wait_for_selector("#cells-there:visible")
    page.wait_for_selector("#cells-networks button[aria-pressed=true]")
    other = page.locator("#cells-networks button[aria-pressed=false]").first
    name = other.inner_text()
    other.focus()
    page.keyboard.press("Enter")
    page.wait_for_selector(f"#cells-drawn svg[aria-label='{name}']")
    page.click("#tab-options")
    page.select_option("#option-interval", "500")
    page.click("#option-scanning")
    page.click("#tab-cells")
    page.wait_for_selector("#cells-networks.scanned, #cells-networks .scanned")
