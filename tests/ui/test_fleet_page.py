"""The page of several chairs in Chromium: it tells every chair's state, and axe finds no fault in it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import pytest

from waychair.types import Json
from waychair.ui.fleet_page import FleetPage, fleet_page

if TYPE_CHECKING:
    from playwright.sync_api import Browser, ViewportSize

PLAN: Json = {
    "corner": [0.0, 0.0],
    "size": [9.0, 3.0],
    "floor": [[0.5, 0.5, 8.0, 2.0]],
    "walls": [[0.4, 0.4, 8.2, 0.1], [0.4, 2.5, 8.2, 0.1]],
    "places": [["desk", 7.5, 1.5]],
}
VIEW: Json = {
    "seconds": 12.34,
    "chairs": [
        {
            "number": 1,
            "corners": [[1.0, 1.0], [2.0, 1.0], [2.0, 1.6], [1.0, 1.6]],
            "heading": 0.0,
            "goal": "desk",
            "told": "waits for chair 2 to leave the desk",
            "reached": 1,
            "goals": 2,
            "line": [[4.0, 0.4], [4.0, 2.6]],
        },
        {
            "number": 2,
            "corners": [[7.0, 1.0], [8.0, 1.0], [8.0, 1.6], [7.0, 1.6]],
            "heading": 3.1,
            "goal": "",
            "told": "arrived",
            "reached": 2,
            "goals": 2,
            "line": None,
        },
    ],
    "people": [[5.0, 1.5]],
}


@pytest.mark.parametrize("look", ["light", "dark"])
def test_the_page_tells_every_chairs_state_and_axe_finds_no_fault(browser: Browser, look: str) -> None:
    from axe_playwright_python.sync_playwright import Axe

    shown = FleetPage()
    shown.plan, shown.view = PLAN, VIEW
    said: list[str] = []
    scheme: Literal["dark", "light"] = "dark" if look == "dark" else "light"
    phone: ViewportSize = {"width": 390, "height": 700}
    with (
        fleet_page(shown) as address,
        browser.new_context(color_scheme=scheme, viewport=phone) as context,
    ):
        page = context.new_page()
        page.on("console", lambda message: said.append(message.text))
        page.goto(address)
        page.wait_for_selector("#chairs li")
        assert page.locator("#chairs li").all_inner_texts() == [
            "Chair 1: to desk, 1 of 2 goals reached\nWaits for chair 2 to leave the desk.",
            "Chair 2: all goals reached\nArrived.",
        ]
        assert page.inner_text("#time") == "After 12 s of the chairs' time"
        assert page.locator("#moving .person").count() == 1
        assert page.locator("#moving .line").count() == 1
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        found = Axe().run(page).response["violations"]
    assert [(each["id"], [node["target"] for node in each["nodes"]]) for each in found] == []
    assert said == []  # no error, and nothing that the page asks for is missing
