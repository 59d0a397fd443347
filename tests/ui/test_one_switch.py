"""The page in a real browser, for a rider with one switch: the switch and its Stop work after every choice."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from tests.ui.driving import pose_of, ready_page, until
from tests.ui.noted import Noted
from waychair.runtime.pages.chair_port import ChairView
from waychair.types import DriveMode, Place, Pose2
from waychair.ui.server import page_server

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

SLOW = "4000"
WALK = "500"
FOCUS = "document.activeElement.id"
IS_WRITING = "document.activeElement.matches('input, select, textarea')"


class Told(Noted):
    """A port that can claim that the chair drives."""

    drives = False

    def view(self) -> ChairView:
        view = self.port.view()
        return replace(view, mode=DriveMode.AUTONOMOUS, goal="ward") if self.drives else view


@pytest.fixture
def told(port: Noted) -> Told:
    return Told(port.port)


@contextmanager
def scanned(browser: Browser, port: Noted, interval: str = WALK) -> Iterator[Page]:
    """A page with its frame walking."""
    with page_server(port) as address, ready_page(browser, address) as page:
        page.click("#tab-options")
        page.select_option("#option-interval", interval)
        page.click("#option-scanning")
        yield page


def take(page: Page, on: str, until_there: str) -> None:
    """Presses the switch when the frame is on a control, until the control has acted."""
    while not page.evaluate(until_there):  # a busy computer may press after the frame has moved on
        page.wait_for_selector(f"{on}.scanned")
        page.keyboard.press("Space")
        page.wait_for_timeout(300)


def set_driving(page: Page, port: Told) -> None:
    port.drives = True
    page.wait_for_selector("body.moves")


@pytest.mark.parametrize("key", ["Space", "Enter"])
@pytest.mark.parametrize(
    "field",
    ["#search", *(pytest.param(other, marks=pytest.mark.nightly) for other in ("#save-name", "#option-interval"))],
)
def test_while_the_chair_moves_the_switch_is_stop_at_any_focus(
    browser: Browser, told: Told, key: str, field: str
) -> None:
    with scanned(browser, told) as page:
        page.click({"#search": "#tab-places", "#save-name": "#tab-edit"}.get(field, "#tab-options"))
        page.focus(field)
        set_driving(page, told)
        assert page.evaluate(FOCUS) == field[1:]
        page.keyboard.press(key)
        until(lambda: len(told.named("stop")) == 2, "Stop is not heard")  # by socket and by fetch


def test_after_choosing_a_place_the_switch_still_works(browser: Browser, told: Told) -> None:
    with scanned(browser, told) as page:
        page.click("#tab-steer")
        take(page, "#mode-manual", "document.querySelectorAll('.scanned').length === 1")
        take(page, "#mode-autonomous", "!document.querySelector('#places').hidden")
        assert not page.evaluate(IS_WRITING)
        set_driving(page, told)
        page.keyboard.press("Space")
        until(lambda: bool(told.named("stop")), "Stop is not heard")


@pytest.mark.nightly
def test_after_saving_a_place_the_switch_still_works_and_the_place_has_a_name(browser: Browser, told: Told) -> None:
    pose_of(told)
    with scanned(browser, told) as page:
        page.click("#tab-edit")
        take(page, "#save-place", "document.querySelector('#drawn').textContent.includes('place 1')")
        assert not page.evaluate(IS_WRITING)
        assert "place 1" in told.layout().places
    told.remove_place("place 1")


@pytest.mark.nightly
def test_an_unused_field_loses_the_focus(browser: Browser, told: Told) -> None:
    with scanned(browser, told) as page:
        page.click("#tab-places")
        page.click("#search")
        page.keyboard.type("wa")
        page.wait_for_timeout(1500)
        assert page.evaluate(FOCUS) == "search"
        until(lambda: not page.evaluate(IS_WRITING), "the field is not left")
        assert page.input_value("#search") == "wa"


def test_stop_works_right_after_another_press(browser: Browser, told: Told) -> None:
    with scanned(browser, told, SLOW) as page:
        page.click("#tab-places")
        page.wait_for_selector("#stop.scanned")
        page.keyboard.press("Space")
        page.keyboard.press("Space")  # the same press, of a switch that bounces
        until(lambda: len(told.named("stop")) == 2, "Stop is not heard")
        set_driving(page, told)
        page.evaluate("performance.now = () => 0")  # as if no time passed
        for presses in (2, 3):
            page.keyboard.press("Space")
            until(lambda: len(told.named("stop")) == 2 * presses, "Stop is not heard")  # noqa: B023


@pytest.mark.nightly
def test_one_switch_removes_a_place(browser: Browser, told: Told) -> None:
    here = pose_of(told)
    for name in ("bed", "desk"):
        told.set_place(Place(name, here @ Pose2(1.0)), True)
    with scanned(browser, told) as page:
        page.click("#tab-edit")
        take(page, "#drawn li:has-text('bed') button", "document.querySelectorAll('.scanned').length === 1")
        take(
            page,
            "#drawn li:has-text('bed') button:text-is('Remove')",
            "![...document.querySelectorAll('#drawn li')].some((line) => line.textContent.includes('bed'))",
        )
        assert "bed" not in told.layout().places
        assert page.locator("[data-scan]:text-is('Rename')").count() == 0
    told.remove_place("desk")
