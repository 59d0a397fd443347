"""The page in browsers that keep nothing, lack a part of it, turn their screen off, or are small."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from tests.ui.conftest import WORLD
from tests.ui.driving import page_at, ready_page, until
from tests.ui.noted import Noted
from waychair.control.safety.stops import halt
from waychair.runtime.pages.chair_port import ChairView
from waychair.runtime.rider.sentences import sentence
from waychair.trials.live.live_chair import LiveChair
from waychair.types import DriveMode
from waychair.ui.server import page_server

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

LONGEST_COUNTDOWN_S = 30.0

STORES = "['localStorage', 'sessionStorage', 'indexedDB', 'caches']"
STORAGE = {
    "blocked": f"for (const store of {STORES}) Object.defineProperty(window, store, "
    "{ get() { throw new DOMException('blocked', 'SecurityError'); } });",
    "absent": f"for (const store of {STORES}) Object.defineProperty(window, store, {{ value: null }});",
    "full": "Storage.prototype.setItem = () => { throw new DOMException('full', 'QuotaExceededError'); };",
    "unreadable": "Storage.prototype.getItem = () => { throw new DOMException('broken', 'UnknownError'); };",
    "damaged": "for (const [name, value] of [['latest', '[\"wa'], ['interval', 'soon'], ['sound', '{'], ['page', '']]) "
    "for (const store of [localStorage, sessionStorage]) store.setItem(name, value);",
    "of other kinds": "for (const [name, value] of [['latest', '{\"a\": [1]}'], ['interval', '-1'], ['scanning', 'null']]) "
    "for (const store of [localStorage, sessionStorage]) store.setItem(name, value);",
}
NO_SOCKET = "window.WebSocket = class { constructor() { throw new DOMException('blocked', 'SecurityError'); } };"

LOCKS = """
globalThis.locks = [];
const request = WakeLock.prototype.request;
WakeLock.prototype.request = async function (kind) {
  const lock = await request.call(this, kind);
  locks.push(lock);
  return lock;
};
"""
HELD = "locks.filter((lock) => !lock.released).length"

SCREENS = {
    "desktop at 200 %": (640, 360),
    "small phone, sideways": (667, 375),
    "phone, sideways": (844, 390),
    "phone": (390, 844),
    "narrowest phone": (320, 568),
    "desktop at 400 %": (320, 256),
}
IS_SEEN = """() => {
  const sentence = document.querySelector("#next"), box = sentence.getBoundingClientRect();
  const x = (box.left + box.right) / 2, y = (box.top + box.bottom) / 2;  // its corners are round
  const edges = [[box.left + 2, y], [box.right - 2, y], [x, box.top + 2], [x, box.bottom - 2]];
  return edges.every((point) => sentence.contains(document.elementFromPoint(...point)));
}"""


class Told(Noted):
    """A port whose view can be changed."""

    changes: dict[str, object] | None = None

    def view(self) -> ChairView:
        return replace(self.port.view(), **(self.changes or {}))


@pytest.fixture(scope="module")
def chair() -> Iterator[LiveChair]:
    """A chair whose countdown lasts until it is cancelled."""
    with LiveChair(WORLD, people=False, countdown_s=LONGEST_COUNTDOWN_S) as live:
        yield live


@pytest.fixture
def told(port: Noted) -> Told:
    return Told(port.port)


@pytest.fixture
def told_address(told: Told) -> Iterator[str]:
    with page_server(told) as served:
        yield served


def set_driving(page: Page, port: Told) -> None:
    port.changes = {"mode": DriveMode.AUTONOMOUS, "goal": "ward", "next_action": "Turning left in 4 m, 23 m to ward."}
    page.wait_for_selector("body.moves")


def hide(page: Page, hidden: bool) -> None:
    """Hides or shows a page, as a screen does that goes off or on."""
    page.evaluate(
        """(hidden) => {
          Object.defineProperty(document, "visibilityState", { configurable: true, get: () => (hidden ? "hidden" : "visible") });
          document.dispatchEvent(new Event("visibilitychange"));
        }""",
        hidden,
    )


def press_stop_in_each_way(page: Page, port: Noted, per_press: int) -> None:
    page.locator("#stop").click()
    until(lambda: len(port.named("stop")) == per_press, "Stop by pointer is not heard")
    page.locator("body").press("Escape")
    until(lambda: len(port.named("stop")) == 2 * per_press, "Stop by Esc is not heard")
    page.locator("body").press("Space")
    until(lambda: len(port.named("stop")) == 3 * per_press, "Stop by Space is not heard")


BY_DAY = ("blocked", "damaged")


@pytest.mark.parametrize(
    "storage", [*BY_DAY, *(pytest.param(name, marks=pytest.mark.nightly) for name in STORAGE if name not in BY_DAY)]
)
def test_the_page_works_whatever_the_browser_s_storage_does(
    browser: Browser, port: Noted, address: str, storage: str
) -> None:
    with page_at(browser, "about:blank") as page:
        page.add_init_script(STORAGE[storage])
        page.goto(address)
        page.wait_for_selector(".place")
        press_stop_in_each_way(page, port, per_press=2)  # by socket and by fetch
        page.click(".place")
        page.wait_for_selector("#ask:visible")
        page.click("#ask-no")
        page.click("#tab-options")
        page.click("#option-sound")
        page.wait_for_selector("#option-sound[aria-pressed=false]")
        assert page.is_visible("#options-forgotten") is (storage not in ("damaged", "of other kinds"))


@pytest.mark.parametrize("storage", ["blocked", pytest.param("full", marks=pytest.mark.nightly)])
def test_a_browser_that_keeps_nothing_still_keeps_the_token_of_its_address(
    browser: Browser, port: Noted, storage: str
) -> None:
    token = "a token nobody guesses"
    with page_server(port, token=token) as address, page_at(browser, "about:blank") as page:
        page.add_init_script(STORAGE[storage])
        page.goto(address.replace(" ", "%20"))
        page.wait_for_selector(".place")
        assert "token" not in page.url
        page.reload()
        page.wait_for_selector(".place")
        press_stop_in_each_way(page, port, per_press=2)


@pytest.mark.parametrize(
    "missing",
    ["main.js", "the socket", *(pytest.param(name, marks=pytest.mark.nightly) for name in ("link.js", "leaflet.js"))],
)
def test_stop_works_where_another_part_of_the_page_fails(
    browser: Browser, port: Noted, address: str, missing: str
) -> None:
    own = browser.new_context()
    page = own.new_page()
    if missing == "the socket":
        page.add_init_script(NO_SOCKET)
    else:
        page.route(f"**/{missing}", lambda route: route.abort())
    page.goto(address)
    by_socket_too = missing == "leaflet.js"
    press_stop_in_each_way(page, port, per_press=2 if by_socket_too else 1)
    if missing == "the socket":
        page.wait_for_selector("#lost:has-text('Connection lost')")
    else:
        page.evaluate("document.getAnimations().forEach((each) => each.finish())")
        assert page.is_visible("#not-started")
        page.wait_for_selector(".note:has-text('The chair has obeyed Stop')")
    own.close()


def test_the_screen_stays_on_during_a_drive_and_no_longer(browser: Browser, told: Told, told_address: str) -> None:
    with page_at(browser, "about:blank") as page:
        page.add_init_script(LOCKS)
        page.goto(told_address)
        page.wait_for_selector(".place")
        assert page.evaluate("locks.length") == 0
        set_driving(page, told)
        until(lambda: page.evaluate(HELD) == 1, "the screen may go off in a drive")
        assert page.is_hidden("#awake")
        page.evaluate("locks[0].release()")  # as the browser does when the page is hidden
        hide(page, True)
        hide(page, False)
        until(lambda: page.evaluate(HELD) == 1, "the screen may go off once the page was hidden")
        told.changes = None
        until(lambda: page.evaluate(HELD) == 0, "the screen stays on after the drive")


def test_a_browser_that_cannot_keep_the_screen_on_says_so_in_a_drive(
    browser: Browser, told: Told, told_address: str
) -> None:
    with page_at(browser, "about:blank") as page:
        page.add_init_script("delete Navigator.prototype.wakeLock;")
        page.goto(told_address)
        page.wait_for_selector(".place")
        assert page.is_hidden("#awake")
        set_driving(page, told)
        page.wait_for_selector("#awake:has-text('does not keep the screen on')")
        told.changes = None
        page.wait_for_selector("#awake", state="hidden")


def test_a_drive_that_ended_with_the_screen_is_explained_until_the_next_one(
    browser: Browser, told: Told, told_address: str
) -> None:
    ended = {"last_stop": sentence(halt("page_gone").text)}
    with ready_page(browser, told_address) as page:
        set_driving(page, told)
        hide(page, True)
        told.changes = ended
        page.wait_for_selector("body:not(.moves)")
        hide(page, False)
        page.wait_for_selector("#slept:has-text('the screen went off')")
        set_driving(page, told)
        page.wait_for_selector("#slept", state="hidden")
        told.changes = {"last_stop": "Arrived at ward."}
        page.wait_for_selector("#last:has-text('Arrived')")
        assert page.is_hidden("#slept")


def test_the_sentence_about_the_chair_is_in_view_on_every_screen(
    browser: Browser, told: Told, told_address: str
) -> None:
    with ready_page(browser, told_address, reduced_motion="reduce") as page:
        for drives in (False, True):
            told.changes = None
            if drives:
                set_driving(page, told)
            for screen, (width, height) in SCREENS.items():
                page.set_viewport_size({"width": width, "height": height})
                page.evaluate("scrollTo(0, 0)")
                assert page.evaluate(IS_SEEN), (screen, drives)
                assert page.evaluate("document.documentElement.scrollWidth") <= width, screen


@pytest.mark.parametrize(
    "screen", ["small phone, sideways", pytest.param("narrowest phone", marks=pytest.mark.nightly)]
)
def test_a_question_leaves_the_sentence_about_the_chair_in_view(
    browser: Browser, port: Noted, address: str, screen: str
) -> None:
    width, height = SCREENS[screen]
    with ready_page(browser, address, viewport={"width": width, "height": height}) as page:
        page.click(".place")
        page.wait_for_selector("#ask:visible")
        assert page.evaluate(IS_SEEN)
        page.click("#ask-yes")
        page.wait_for_selector("#count:visible")
        assert page.evaluate(IS_SEEN)
        page.click("#count-no")


def test_letters_of_twice_the_size_leave_the_sentence_in_view(browser: Browser, told: Told, told_address: str) -> None:
    with ready_page(browser, told_address) as page:
        page.evaluate("document.documentElement.style.fontSize = '34px'")
        for width, height in ((390, 844), (667, 375), (1280, 720)):
            page.set_viewport_size({"width": width, "height": height})
            assert page.evaluate(IS_SEEN), (width, height)
            assert page.evaluate("document.documentElement.scrollWidth") <= width


def test_after_cancel_by_keyboard_the_focus_is_where_the_drive_was_asked_for(
    browser: Browser, port: Noted, address: str
) -> None:
    with ready_page(browser, address) as page:
        page.focus(".place:text-is('ward')")
        for answer in ("#ask-no", "#count-no"):
            page.keyboard.press("Enter")
            page.wait_for_selector("#ask:visible")
            if answer == "#count-no":
                page.focus("#ask-yes")
                page.keyboard.press("Enter")
                page.wait_for_selector("#count:visible")
            page.focus(answer)
            page.keyboard.press("Enter")
            page.wait_for_selector(answer, state="hidden")
            until(lambda: page.evaluate("document.activeElement.textContent") == "ward", "the focus is lost")


def test_after_a_removal_by_keyboard_the_focus_is_on_undo(browser: Browser, port: Noted, address: str) -> None:
    with ready_page(browser, address) as page:
        page.click("#tab-edit")
        page.focus("[aria-label='Remove ward']")
        page.keyboard.press("Enter")
        until(lambda: page.evaluate("document.activeElement.id") == "undo", "the focus is lost")
        page.keyboard.press("Enter")
        page.wait_for_selector("[aria-label='Remove ward']")


def test_the_last_stop_is_told_also_where_nothing_drove(browser: Browser, port: Noted, address: str) -> None:
    with ready_page(browser, address) as page:
        page.click(".place:text-is('ward')")
        page.click("#ask-no")
        page.wait_for_selector("#last:has-text('The drive was cancelled')")
        page.keyboard.press("Escape")
        page.wait_for_selector("#last:has-text('Stop was pressed')")
