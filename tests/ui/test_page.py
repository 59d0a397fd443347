"""The page in a real browser with a chair at rest: accessibility, keyboard, small screens, connection."""

from __future__ import annotations

import math
import socket
from contextlib import ExitStack
from typing import TYPE_CHECKING

import pytest

from tests.ui.driving import page_at, pose_of, press_map, ready_page, until
from tests.ui.noted import Noted
from waychair.maps.drawn.zones import Rule
from waychair.types import DriveMode, Place, Pose2
from waychair.ui.server import page_server

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

TOKEN = "a token nobody guesses"
STATES = ("idle", "panel", "steer", "edit", "drawing", "options", "point", "asked", "stopped", "scanning")
LOOKS = {
    "desktop, light": {"viewport": {"width": 1360, "height": 860}, "color_scheme": "light"},
    "phone, dark": {"viewport": {"width": 390, "height": 844}, "color_scheme": "dark"},
}


def bring_to(page: Page, port: Noted, state: str) -> None:
    """Brings a page into a state, from the one before it."""
    if state in ("steer", "edit", "options"):
        page.click(f"#tab-{state}")
    elif state == "panel":
        page.click("#panel-open")
        page.wait_for_selector("#figures td")
    elif state == "drawing":
        page.click("#tab-edit")
        page.click("#draw-one_way")
        page.click("#draw-corner")
    elif state == "point":
        page.click("#tab-places")
        press_map(page, port, 2.0)
        page.wait_for_selector("#here:visible")
    elif state == "asked":
        page.click("#tab-places")
        page.click(".place")
        page.wait_for_selector("#ask:visible")
    elif state == "stopped":
        page.keyboard.press("Escape")
        page.wait_for_selector("#last:has-text('Stop')")
    elif state == "scanning":
        page.click("#tab-options")
        page.click("#option-scanning")


@pytest.mark.parametrize("look", [pytest.param("desktop, light", marks=pytest.mark.nightly), "phone, dark"])
def test_axe_finds_no_fault(browser: Browser, port: Noted, address: str, look: str) -> None:
    from axe_playwright_python.sync_playwright import Axe

    with ready_page(browser, address, reduced_motion="reduce", **LOOKS[look]) as page:
        for state in STATES:
            bring_to(page, port, state)
            found = Axe().run(page).response["violations"]
            assert [(each["id"], [node["target"] for node in each["nodes"]]) for each in found] == [], state


@pytest.mark.parametrize("width", [320, 640, pytest.param(1000, marks=pytest.mark.nightly)])
def test_a_narrow_page_shows_everything(browser: Browser, address: str, width: int) -> None:
    with ready_page(browser, address, viewport={"width": width, "height": 480}) as page:
        for tab in ("places", "steer", "edit", "options"):
            page.click(f"#tab-{tab}")
            assert page.evaluate("document.documentElement.scrollWidth") <= width
            cut = page.evaluate(
                """() => [...document.querySelectorAll("button, input, select, p, h2, h3")]
                .filter((e) => e.offsetParent && !e.closest(".leaflet-container, .hidden") && !e.matches(".hidden"))
                .filter((e) => { const b = e.getBoundingClientRect(); return b.left < 0 || b.right > innerWidth + 1; })
                .map((e) => e.id || e.textContent)"""
            )
            assert cut == []


def test_every_control_is_large_enough(browser: Browser, address: str) -> None:
    with ready_page(browser, address, viewport={"width": 390, "height": 844}) as page:
        page.click("#panel-open")
        for tab in ("places", "steer", "edit", "options"):
            page.click(f"#tab-{tab}")
            small = page.evaluate(
                """() => [...document.querySelectorAll("button, input, select")].filter((e) => e.offsetParent)
                .filter((e) => { const b = e.getBoundingClientRect(); return b.width < 44 || b.height < 44; })
                .map((e) => e.id || e.textContent)"""
            )
            assert small == []


def test_stop_is_first_and_always_visible(browser: Browser, port: Noted, address: str) -> None:
    for look in LOOKS.values():
        with ready_page(browser, address, **look) as page:
            page.keyboard.press("Tab")
            assert page.evaluate("document.activeElement.id") == "stop"
            for state in ("asked", "steer", "options", "panel", "drawing"):
                bring_to(page, port, state)
                box = page.locator("#stop").bounding_box()
                size = page.viewport_size
                assert box is not None
                assert size is not None
                assert 0 <= box["y"] <= size["height"] - box["height"]
                top = "([x, y]) => document.elementFromPoint(x, y).closest('button')?.id"
                middle = [box["x"] + box["width"] / 2, box["y"] + box["height"] / 2]
                assert page.evaluate(top, middle) == "stop", state
                assert page.is_enabled("#stop")


@pytest.mark.parametrize(
    "focus",
    [
        "#map",
        "#search",
        *(pytest.param(other, marks=pytest.mark.nightly) for other in ("#tab-edit", ".place", "#save-name")),
    ],
)
def test_escape_and_space_stop_anywhere_except_in_a_text_field(
    browser: Browser, port: Noted, address: str, focus: str
) -> None:
    with ready_page(browser, address) as page:
        if focus == "#save-name":
            page.click("#tab-edit")
        is_text = focus in ("#save-name", "#search")
        page.focus(focus)
        page.keyboard.press("Space")
        page.keyboard.press("Escape")
        until(lambda: len(port.named("stop")) >= (2 if is_text else 4), "Stop is not heard")  # by socket and by fetch
        page.wait_for_timeout(200)
        assert len(port.named("stop")) == (2 if is_text else 4)
        assert not port.named("go")
        if is_text:
            assert page.input_value(focus) in (" ", "")


def test_stop_works_with_only_one_connection_left(browser: Browser, port: Noted, address: str) -> None:
    with ready_page(browser, address) as page:
        page.route("**/api/do/stop", lambda route: route.abort())
        page.keyboard.press("Escape")
        until(lambda: len(port.named("stop")) == 1, "Stop is not heard by socket")


def test_an_undelivered_stop_is_reported(browser: Browser, port: Noted, address: str) -> None:
    unanswered = ".note.bad:text-is('No answer to Stop: check that the chair stands.')"
    with ready_page(browser, address) as page:
        page.keyboard.press("Escape")
        until(lambda: len(port.named("stop")) == 2, "Stop is not heard")
        page.wait_for_timeout(300)
        assert page.locator(unanswered).count() == 0
        page.route("**/api/do/stop", lambda route: route.abort())
        page.evaluate("WebSocket.prototype.send = () => {}")
        page.keyboard.press("Escape")
        page.wait_for_selector(unanswered)


def test_a_zone_is_drawn_and_undone_by_keyboard_alone(browser: Browser, port: Noted, address: str) -> None:
    with ready_page(browser, address) as page:
        page.focus("#tab-places")
        for _ in range(2):
            page.keyboard.press("ArrowRight")
        page.focus("#draw-slow")
        page.keyboard.press("Enter")
        page.focus("#map")
        page.keyboard.press("Enter")
        for key in ("Shift+ArrowRight", "Shift+ArrowRight", "Shift+ArrowUp"):
            page.keyboard.press(key)
        page.keyboard.press("Enter")
        page.focus("#draw-done")
        page.keyboard.press("Enter")
        page.wait_for_selector("#drawn li:has-text('slow zone')")
        (zone,) = port.layout().zones
        assert zone.rule is Rule.SLOW
        assert len(zone.polygon) == 4
        (west, south), (east, north) = zone.polygon.min(axis=0), zone.polygon.max(axis=0)
        assert east - west == pytest.approx(2 * (north - south), rel=0.01)
        page.focus("#undo")
        page.keyboard.press("Enter")
        until(lambda: port.layout().zones == (), "it is not undone")
        page.wait_for_selector("#drawn li:has-text('slow zone')", state="detached")


@pytest.mark.nightly
def test_a_one_way_zone_and_a_ghost_are_drawn_by_pointer(browser: Browser, port: Noted, address: str) -> None:
    with ready_page(browser, address) as page:
        page.click("#tab-edit")
        page.click("#draw-one_way")
        page.select_option("#draw-heading", "90")
        for corner in ((2.0, -0.5), (4.0, -0.5), (4.0, 0.5)):
            press_map(page, port, *corner)
        page.click("#draw-done")
        page.wait_for_selector("#drawn li:has-text('one-way zone')")
        (zone,) = port.layout().zones
        assert (zone.rule, zone.value) == (Rule.ONE_WAY, pytest.approx(math.pi / 2, abs=1e-3))
        page.click("#draw-erase")
        for corner in ((3.0, 3.0), (4.0, 4.0)):
            press_map(page, port, *corner)
        page.click("#draw-done")
        until(lambda: bool(port.named("erase")), "nothing is erased")
        page.wait_for_selector("#draw-form", state="hidden")
        page.click("#undo")
        page.click("#drawn li:has-text('one-way zone') button")
        until(lambda: port.layout().zones == (), "it is not removed")


def test_the_present_place_is_saved_renamed_and_removed(browser: Browser, port: Noted, address: str) -> None:
    with ready_page(browser, address) as page:
        page.click("#tab-edit")
        page.fill("#save-name", "my bed")
        page.select_option("#save-tolerance", "1")
        page.click("#save-here button")
        page.wait_for_selector("#drawn li:has-text('my bed')")
        place = port.layout().places["my bed"]
        assert (place.tolerance_m, place.tolerance_rad) == (0.05, pytest.approx(math.radians(2)))
        page.click("#drawn li:has-text('my bed') button:text-is('Rename')")
        page.fill(".rename input", "our bed")
        page.keyboard.press("Enter")
        page.wait_for_selector("#drawn li:has-text('our bed')")
        until(lambda: "my bed" not in port.layout().places, "the old name stays")
        assert port.layout().places["our bed"].pose == place.pose
        page.click("#drawn li:has-text('our bed') button:text-is('Remove')")
        until(lambda: "our bed" not in port.layout().places, "it is not removed")


@pytest.mark.nightly
def test_a_known_name_is_replaced_only_after_a_second_press(browser: Browser, port: Noted, address: str) -> None:
    here = pose_of(port)
    for name in ("bed", "desk"):
        port.set_place(Place(name, here @ Pose2(1.0)), True)
    known = dict(port.layout().places)
    with ready_page(browser, address) as page:
        page.click("#tab-edit")
        page.click("#drawn li:has-text('desk') button:text-is('Rename')")
        page.fill(".rename input", "bed")
        page.keyboard.press("Enter")
        page.wait_for_selector(".note.bad:has-text('There is a place')")
        assert dict(port.layout().places) == known
        page.fill("#save-name", "bed")
        page.click("#save-place")
        page.wait_for_selector("#save-place:text-is('Replace bed')")
        assert dict(port.layout().places) == known
        page.click("#save-place")
        page.wait_for_selector("#save-place:text-is('Save this place')")
        assert port.layout().places["bed"].pose.x == pytest.approx(here.x, abs=0.1)
    for name in ("bed", "desk"):
        port.remove_place(name)


@pytest.mark.nightly
def test_a_requested_drive_is_cancelled(browser: Browser, port: Noted, address: str) -> None:
    with ready_page(browser, address) as page:
        page.fill("#search", "WARD")
        page.keyboard.press("Enter")  # the only one
        page.wait_for_selector("#ask-title:text-is('Drive to ward?')")
        assert page.evaluate("document.activeElement.id") == "ask-title"
        page.click("#ask-no")
        page.wait_for_selector("#ask", state="hidden")
        press_map(page, port, 2.0)
        page.click("#here-drive")
        page.wait_for_selector("#ask:visible")
        page.click("#ask-yes")
        page.wait_for_selector("#count:visible")
        page.click("#count-no")
        page.wait_for_selector("#count", state="hidden")
    assert port.view().mode is DriveMode.MANUAL
    assert not port.view().goal


def test_a_page_without_the_token_asks_for_it_and_shows_nothing(browser: Browser, port: Noted) -> None:
    with page_server(port, token=TOKEN) as address:
        with page_at(browser, address.partition("#")[0]) as page:
            page.wait_for_selector("#door:visible")
            assert page.locator(".place").count() == 0
            page.fill("#door-token", "wrong")
            page.keyboard.press("Enter")
            page.wait_for_selector("#door:visible")
            page.fill("#door-token", TOKEN)
            page.keyboard.press("Enter")
            page.wait_for_selector(".place")
            page.wait_for_selector(".grid")
            page.reload()
            page.wait_for_selector(".place")
        with ready_page(browser, address) as page:
            assert "token" not in page.url


@pytest.mark.nightly
def test_an_unanswered_connection_is_given_up_for_another_one(browser: Browser, port: Noted) -> None:
    with ExitStack() as first, ExitStack() as pages:
        address = first.enter_context(page_server(port))
        page = pages.enter_context(ready_page(browser, address))
        first.close()
        number = int(address.rstrip("/").rpartition(":")[2])
        with socket.create_server(("127.0.0.1", number)) as deaf, ExitStack() as tries:
            deaf.settimeout(20.0)
            for _ in range(3):
                tries.enter_context(deaf.accept()[0])
        with page_server(port, http_port=number):
            page.wait_for_selector("#link-fact[data-state=open]")
            pages.close()


def test_a_lost_connection_is_reported_at_once_and_restored(browser: Browser, port: Noted) -> None:
    with ExitStack() as first, ExitStack() as pages:
        address = first.enter_context(page_server(port))
        page = pages.enter_context(ready_page(browser, address))
        first.close()
        page.wait_for_selector("#lost:has-text('Connection lost')")
        assert page.is_enabled("#stop")
        with page_server(port, http_port=int(address.rstrip("/").rpartition(":")[2])):
            page.wait_for_selector("#link-fact[data-state=open]")
            assert page.is_hidden("#lost")
            pages.close()
