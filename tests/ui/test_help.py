"""Levels of help on the page: chosen by a press or one switch, shown, and overridden; in a browser with a chair at rest."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest
from starlette.testclient import TestClient

from tests.ui.driving import ready_page, until
from tests.ui.noted import Noted
from waychair.control.safety.guard import SPOKEN
from waychair.runtime.pages.chair_port import ChairView, PortAnswer
from waychair.runtime.rider.guard_view import GuardView
from waychair.types import HelpLevel
from waychair.ui.server import app, page_server

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

HELD = GuardView(HelpLevel.GUARD, SPOKEN[HelpLevel.GUARD], HelpLevel.GUARD, (0.11, 0.25, 1.0, 1.0), capped=True)


class Guarded(Noted):
    """A port whose guard is as a test says; it takes every level and override."""

    guard: GuardView | None = GuardView()

    def view(self) -> ChairView:
        return replace(self.port.view(), guard=self.guard)

    def __getattr__(self, name: str) -> Any:
        if name in ("choose_level", "override_guard"):
            return lambda *asked: self._take(name, asked)
        return super().__getattr__(name)

    def _take(self, name: str, asked: tuple[Any, ...]) -> PortAnswer:
        if self.guard is None:
            return PortAnswer(False, "this chair has no levels of help")
        level = asked[0] if asked else self.guard.level
        self.guard = replace(self.guard, level=level, told=SPOKEN[level], creeps=name == "override_guard")
        return PortAnswer(True, SPOKEN[level])


@pytest.fixture
def guarded(port: Noted) -> Guarded:
    return Guarded(port.port)


def _pressed(page: Page) -> list[str]:
    return page.evaluate(  # type: ignore[no-any-return]
        "[...document.querySelectorAll('#help-levels [aria-pressed=true]')].map(({ id }) => id)"
    )


def test_a_level_is_chosen_by_one_press_and_told(browser: Browser, guarded: Guarded) -> None:
    with page_server(guarded) as address, ready_page(browser, address) as page:
        page.wait_for_selector("#help-levels:visible")
        assert _pressed(page) == ["help-inform"]
        assert page.locator("#help-now").is_hidden()
        page.click("#help-guard")
        page.wait_for_selector("#help-guard[aria-pressed=true]")
        assert _pressed(page) == ["help-guard"]
        page.wait_for_selector(f"#notes :text('{SPOKEN[HelpLevel.GUARD][:40]}')")
        assert "two seconds" in (page.text_content("#help-state") or "")
        guarded.guard = None  # a chair without levels shows none
        page.wait_for_selector("#help-levels", state="hidden")


def test_caps_and_override_show_while_the_guard_holds_and_axe_finds_no_fault(
    browser: Browser, guarded: Guarded
) -> None:
    from axe_playwright_python.sync_playwright import Axe

    look: dict[str, Any] = {"viewport": {"width": 320, "height": 640}, "color_scheme": "dark"}
    with page_server(guarded) as address, ready_page(browser, address, reduced_motion="reduce", **look) as page:
        guarded.guard = HELD
        page.wait_for_selector("#help-override:visible")
        caps = page.evaluate("[...document.querySelectorAll('#help-caps li')].map(({ textContent }) => textContent)")
        assert caps == ["Ahead 11 %", "Back 25 %", "Left 100 %", "Right 100 %"]
        found = Axe().run(page).response["violations"]
        assert [(each["id"], [node["target"] for node in each["nodes"]]) for each in found] == []
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
        page.click("#help-override")
        page.wait_for_selector("#help-override", state="hidden")
        assert "creep" in (page.text_content("#help-state") or "")


def test_one_switch_reaches_the_levels(browser: Browser, guarded: Guarded) -> None:
    with page_server(guarded) as address, ready_page(browser, address) as page:
        page.click("#tab-options")
        page.select_option("#option-interval", "500")
        page.click("#option-scanning")
        until(lambda: _pressed_by_switch(page, guarded), "no level is chosen")
        assert guarded.guard is not None
        assert guarded.guard.level is HelpLevel.GUIDE


def _pressed_by_switch(page: Page, guarded: Guarded) -> bool:
    """Press the switch when the frame is on the levels, or on guide among them; return whether it has been chosen."""
    framed = page.evaluate("[...document.querySelectorAll('#help-levels .scanned')].map(({ id }) => id)")
    if len(framed) == len(HelpLevel) or framed == ["help-guide"]:
        page.keyboard.press("Space")
    return guarded.guard is not None and guarded.guard.level is not HelpLevel.INFORM


def test_wrong_levels_are_refused_before_the_chair_is_asked(guarded: Guarded) -> None:
    with TestClient(app(guarded), base_url="http://127.0.0.1:8000") as page:
        wrong = page.post("/api/do/level", json={"level": "push"}).json()
        assert not wrong["done"]
        assert "invalid" in wrong["sentence"]
        assert page.post("/api/do/level", json={"level": "guide"}).json()["done"]
        assert guarded.guard is not None
        assert guarded.guard.level is HelpLevel.GUIDE
        assert page.post("/api/do/override", json={}).json()["done"]
