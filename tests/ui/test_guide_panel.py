"""Step guidance on the page in a real browser: the panel, its arrow, its voice, its items in the menu, by one switch."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from tests.ui.driving import page_at, pose_of, ready_page, until
from tests.ui.noted import Noted
from tests.ui.test_menu import FRAMED, LABELS, choose, menu, menu_page
from tests.ui.test_one_switch import scanned, take
from waychair.runtime.pages.chair_port import ChairView
from waychair.runtime.pages.guide_view import GuideView
from waychair.trials.live.live_building import live_building
from waychair.trials.live.live_chair import LiveChair
from waychair.ui.server import page_server

if TYPE_CHECKING:
    from playwright.sync_api import Browser

GOAL = "Upper/office/office"
VOICE = """
globalThis.heard = { phrases: [], cut: 0, said: [] };
speechSynthesis.getVoices = () => [{}];
speechSynthesis.speak = (phrase) => { heard.phrases.push(phrase.text); heard.said.push(phrase); };
speechSynthesis.cancel = () => { heard.cut += 1; };
"""
"""A voice that speaks until the test ends its phrase: Chromium without a window has none."""


@pytest.fixture(scope="module")
def chair() -> Iterator[LiveChair]:
    """A chair on the ground floor of a building."""
    with (
        live_building("two_floors", people=False) as building,
        LiveChair(building.levels[0] if building else "", people=False, building=building, countdown_s=1.0) as live,
    ):
        yield live


class Guided(Noted):
    """A port that claims what guidance shows."""

    shown = GuideView(GOAL, "left", "Turn left.", "Turn left.", 1, 1.57, 0.4, 2)

    def view(self) -> ChairView:
        return replace(self.port.view(), guide=self.shown)


@pytest.fixture
def guided(port: Noted) -> Guided:
    return Guided(port.port)


@pytest.mark.nightly
def test_one_switch_begins_and_ends_guidance_and_chooses_its_level(browser: Browser, port: Noted) -> None:
    from axe_playwright_python.sync_playwright import Axe

    pose_of(port)
    assert port.go(GOAL).done
    with scanned(browser, port) as page:
        page.wait_for_selector("#ask-guide:visible")
        take(page, "#ask-guide", "document.querySelectorAll('.scanned').length === 1")
        take(page, "#ask-guide", "!document.querySelector('#guide').hidden")
        until(lambda: "." in page.inner_text("#guide-text"), "no movement is shown")
        guide = port.view().guide
        assert guide is not None
        assert page.inner_text("#guide-text") == guide.sentence
        assert "told the way" in page.inner_text("#next")
        assert not page.is_visible("#last")  # the drive that did not begin is no stop
        found = Axe().run(page)
        assert found.violations_count == 0, found.generate_report()
        levels = []
        for _ in range(2):
            before = page.inner_text("#guide-level")
            take(page, "#guide-level", "document.querySelectorAll('.scanned').length === 1")
            take(page, "#guide-level", f"document.querySelector('#guide-level').textContent !== '{before}'")
            levels.append(page.inner_text("#guide-level"))
        assert levels == ["Prompts: the chair drives on request", "Prompts: no prompts"]
        assert not page.is_visible("#guide-arrow")
        assert page.inner_text("#guide-text").startswith("Drive as you like")
        take(page, "#guide-end", "document.querySelectorAll('.scanned').length === 1")
        take(page, "#guide-end", "document.querySelector('#guide').hidden")
        assert port.view().guide is None


def test_the_arrow_points_where_the_turn_leads_and_the_panel_fits_a_narrow_page(
    browser: Browser, guided: Guided
) -> None:
    with (
        page_server(guided) as address,
        ready_page(browser, address, viewport={"width": 320, "height": 700}) as page,
    ):
        page.wait_for_selector("#guide-arrow:visible")
        assert page.evaluate("document.querySelector('#guide-arrow').style.transform") == "rotate(-90deg)"
        assert page.evaluate("document.documentElement.scrollWidth") <= 320
        assert page.locator("#guide-text").evaluate("(each) => each.getBoundingClientRect().top < innerHeight")
        guided.shown = replace(guided.shown, kind="press", sentence="Press Upper.", bearing=0.0)
        page.wait_for_selector("#guide-arrow", state="hidden")


def test_an_item_of_the_menu_does_not_cut_off_the_voice_of_guidance(browser: Browser, guided: Guided) -> None:
    with page_server(guided) as address, page_at(browser, "about:blank") as page:
        page.add_init_script(VOICE)
        page.goto(address)
        until(lambda: page.evaluate("heard.phrases") == ["Turn left."], "the movement is not spoken")
        cut = page.evaluate("heard.cut")
        page.evaluate(
            "import('/static/js/sound.js').then(({ speakOnly }) => { for (const item of ['Ward', 'Bath']) speakOnly(item, () => {}); })"
        )
        assert page.evaluate("heard.phrases") == ["Turn left."]
        assert page.evaluate("heard.cut") == cut
        page.evaluate("heard.said[0].onend()")
        assert page.evaluate("heard.phrases") == ["Turn left.", "Bath"]  # the latest item
        guided.shown = replace(guided.shown, said="Through the door.", count=2)
        until(
            lambda: page.evaluate("heard.phrases.at(-1)") == "Through the door.", "the next movement waits for an item"
        )


def test_the_menu_says_again_chooses_the_level_and_ends_guidance(browser: Browser, guided: Guided) -> None:
    with menu_page(browser, guided, "direct") as page:
        assert menu(page, "Menu")[1:4] == ["Say it again", "Prompts", "End guidance"]
        assert page.is_visible("#guide-text")
        assert not page.is_visible("#guide-again")  # the menu has it
        guided.shown = replace(guided.shown, level=3, offers=True)
        until(lambda: "Let the chair drive" in page.evaluate(LABELS), "the offer does not appear")
        choose(page, "direct", "Prompts")
        until(lambda: bool(guided.named("guide")), "the level is not asked for")
        assert guided.named("guide")[0].asked == (GOAL, 0)
        assert page.evaluate(FRAMED)
