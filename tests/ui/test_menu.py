"""The menu in a real browser, with a chair in the simulator: every way of pressing reaches goals and options."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import pytest

from tests.ui.driving import ready_page, until
from tests.ui.noted import Noted
from waychair.runtime.pages.chair_port import GoalView
from waychair.types import DriveMode
from waychair.ui.server import page_server

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

QUICK = {"sweep": 1.2, "first": 0.3, "acceptance": 0, "release": 0.0, "long": 0.4, "rounds": 9}
LABELS = "[...document.querySelectorAll('#menu-items b')].map((each) => each.textContent)"
FRAMED = "document.querySelector('#menu-items .scanned b')?.textContent ?? ''"
LONG_NAME = "The examination room beside the stairs of the northern wing 7"
ARABIC = "غرفة الأشعة"


class WithGoals(Noted):
    """A port whose building has goals on two storeys; those named like places of the map can be driven to."""

    def goals(self) -> Sequence[GoalView]:
        """See `ChairPort`."""
        return (
            GoalView("ward", ("Storey 1", "Ward"), 95.0, 0),
            GoalView("bath", ("Storey 1", "Bath"), 20.0, 0),
            GoalView("2/x", ("Storey 2", LONG_NAME), 400.0, 1),
            GoalView("2/y", ("Storey 2", ARABIC), None, None),
        )


@contextmanager
def menu_page(browser: Browser, port: Noted, method: str, **context: Any) -> Iterator[Page]:
    """A page with its menu open."""
    kept = json.dumps({"own": True, "access": {"method": method, **QUICK}})
    with page_server(port) as address, ready_page(browser, address, **context) as page:
        page.evaluate("(kept) => localStorage.setItem('menu', kept)", kept)
        page.reload()
        page.wait_for_selector("#menu-items .item")
        until(lambda: "Options" in page.evaluate(LABELS), "the menu does not begin")
        yield page


@pytest.fixture
def building(port: Noted) -> WithGoals:
    return WithGoals(port.port)


def choose(page: Page, method: str, label: str) -> None:
    """Takes an item of the open menu by the rider's way of pressing."""
    if method in ("auto", "inverse"):
        if method == "inverse":
            page.keyboard.down("Space")
        until(lambda: page.evaluate(FRAMED) == label, f"the frame does not come to {label}")
        if method == "auto":
            page.keyboard.press("Space", delay=60)
        else:
            page.keyboard.up("Space")
        return
    assert label in page.evaluate(LABELS)
    while page.evaluate(FRAMED) != label:
        page.keyboard.press("ArrowDown" if method == "direct" else "Space", delay=60)
        page.wait_for_timeout(60)  # longer than a bounce
    key, delay = {"direct": ("ArrowRight", 60), "step": ("Enter", 60), "single": ("Space", 700)}[method]
    page.keyboard.press(key, delay=delay)


def menu(page: Page, title: str) -> list[str]:
    """The items of the menu with this title, once it is open."""
    page.wait_for_selector(f"#menu-title:text-is('{title}')")
    return page.evaluate(LABELS)  # type: ignore[no-any-return]


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    "method",
    ["auto", "step", "inverse", *(pytest.param(each, marks=pytest.mark.nightly) for each in ("single", "direct"))],
)
def test_every_way_of_pressing_reaches_a_goal(browser: Browser, building: WithGoals, method: str) -> None:
    with menu_page(browser, building, method) as page:
        choose(page, method, "Storey 1")
        menu(page, "Storey 1")
        assert "2 min" in (page.text_content("#menu-items") or "")
        choose(page, method, "Ward")
        menu(page, "Drive to ward?")
        assert [call.asked for call in building.named("go")] == [("ward",)]
        choose(page, method, "Not now")
        menu(page, "Menu")


def test_back_is_last_before_stop_and_names_of_any_length_and_direction_are_shown(
    browser: Browser, building: WithGoals
) -> None:
    with menu_page(browser, building, "direct") as page:
        assert menu(page, "Menu") == ["Stop", "Storey 1", "Storey 2", "Who drives", "Help while I drive", "Options"]
        choose(page, "direct", "Storey 2")
        assert menu(page, "Storey 2") == [LONG_NAME, ARABIC, "Back", "Stop"]
        assert page.evaluate("getComputedStyle(document.querySelectorAll('#menu-items b')[1]).direction") == "rtl"
        page.keyboard.press("ArrowLeft")
        menu(page, "Menu")
        choose(page, "direct", "Storey 2")
        choose(page, "direct", "Back")
        menu(page, "Menu")


def test_leaving_the_menu_leads_to_the_options_of_the_page(browser: Browser, building: WithGoals) -> None:
    with menu_page(browser, building, "direct") as page:
        choose(page, "direct", "Options")
        menu(page, "Options")
        choose(page, "direct", "Leave the menu")
        page.wait_for_selector("#tab-options[aria-selected=true]")
        assert page.locator("#menu").is_hidden()
        assert page.evaluate("JSON.parse(localStorage.getItem('menu'))")["own"] is False


def test_the_first_press_of_a_moving_chair_is_stop_and_takes_nothing_else(
    browser: Browser, building: WithGoals
) -> None:
    with menu_page(browser, building, "step") as page:
        choose(page, "step", "Storey 1")
        menu(page, "Storey 1")
        choose(page, "step", "Bath")
        menu(page, "Drive to bath?")
        choose(page, "step", "Drive there")
        until(lambda: building.view().countdown_s is not None, "no countdown")
        menu(page, "The switch is Stop")
        until(lambda: building.view().mode is DriveMode.AUTONOMOUS, "the chair does not drive")
        page.keyboard.press("Enter", delay=60)
        until(lambda: len(building.named("stop")) == 2, "Stop is not heard")  # by socket and by fetch
        menu(page, "Menu")
        assert not building.named("cancel")


@pytest.mark.nightly
def test_the_menu_sets_its_own_options_and_they_last(browser: Browser, building: WithGoals) -> None:
    kept = "JSON.parse(localStorage.getItem('menu'))"
    with menu_page(browser, building, "step") as page:
        for label, title in (("Options", "Options"), ("Times", "Options, Times")):
            choose(page, "step", label)
            menu(page, title)
        choose(page, "step", "Time per item")
        menu(page, "Options, Times, Time per item")
        choose(page, "step", "More")
        until(lambda: page.evaluate(kept)["access"]["sweep"] == 1.3, "the time does not change")
        for title in ("Options, Times", "Options"):
            choose(page, "step", "Back")
            menu(page, title)
        choose(page, "step", "Favourites")
        menu(page, "Options, Favourites")
        choose(page, "step", "Storey 2")
        menu(page, "Options, Favourites, Storey 2")
        choose(page, "step", ARABIC)
        until(lambda: page.evaluate("localStorage.getItem('favourites')") == '["2/y"]', "it is no favourite")
        page.reload()
        until(lambda: "Favourites" in page.evaluate(LABELS), "favourites are forgotten")
        choose(page, "step", "Favourites")
        assert menu(page, "Favourites") == [ARABIC, "Back", "Stop"]
        choose(page, "step", "Back")
        menu(page, "Menu")
        choose(page, "step", "Options")
        menu(page, "Options")
        choose(page, "step", "How I press")
        menu(page, "Options, How I press")
        choose(page, "step", "One switch: the frame moves, a press takes")
        until(lambda: page.evaluate(kept)["access"]["method"] == "auto", "the way of pressing does not change")
        menu(page, "Menu")
        first = page.evaluate(FRAMED)
        until(lambda: page.evaluate(FRAMED) not in (first, ""), "the frame does not move by itself")


@pytest.mark.nightly
def test_ten_presses_measure_the_time_per_item(browser: Browser, building: WithGoals) -> None:
    with menu_page(browser, building, "step") as page:
        for label, title in (("Options", "Options"), ("Times", "Options, Times")):
            choose(page, "step", label)
            menu(page, title)
        choose(page, "step", "Measure my presses")
        for _ in range(10):
            page.wait_for_selector("#menu-target.scanned")
            page.wait_for_timeout(250)
            page.keyboard.press("Space", delay=30)
        page.wait_for_selector("#menu-said:has-text('Time per item is now')")
        sweep = page.evaluate("JSON.parse(localStorage.getItem('menu')).access.sweep")
        assert 0.3 < sweep <= 5.0


def test_the_start_is_chosen_like_a_goal(browser: Browser, building: WithGoals) -> None:
    with menu_page(browser, building, "direct") as page:
        for label, title in (
            ("Who drives", "Who drives"),
            ("I am at a place", "Who drives, I am at a place"),
            ("Storey 1", "Who drives, I am at a place, Storey 1"),
        ):
            choose(page, "direct", label)
            menu(page, title)
        choose(page, "direct", "Bath")
        until(lambda: building.named("start_at"), "the place is not said")
        assert [call.asked for call in building.named("start_at")] == [("bath",)]
        assert not building.named("go")


def test_steering_lasts_as_long_as_the_switch_is_held(browser: Browser, building: WithGoals) -> None:
    with menu_page(browser, building, "step") as page:
        for label, title in (("Who drives", "Who drives"), ("I steer here", "Who drives, I steer here")):
            choose(page, "step", label)
            menu(page, title)
        while page.evaluate(FRAMED) != "Forward":
            page.keyboard.press("Space", delay=60)
        page.keyboard.down("Enter")
        until(lambda: len(building.named("steer")) >= 3, "it does not steer")
        page.keyboard.up("Enter")
        until(lambda: building.calls[-1].name == "release", "it does not let go")


@pytest.mark.parametrize(
    "look",
    [
        pytest.param({}, marks=pytest.mark.nightly, id="desktop, light"),
        pytest.param({"color_scheme": "dark", "viewport": {"width": 320, "height": 640}}, id="phone, dark"),
    ],
)
def test_axe_finds_no_fault_in_menus_and_nothing_is_cut(
    browser: Browser, building: WithGoals, look: dict[str, Any]
) -> None:
    from axe_playwright_python.sync_playwright import Axe

    with menu_page(browser, building, "direct", reduced_motion="reduce", **look) as page:
        for way in ([], ["Storey 2"], ["Options", "Times"]):
            for label in way:
                page.click(f"#menu-items b:text-is('{label}')")
            found = Axe().run(page).response["violations"]
            assert [(each["id"], [node["target"] for node in each["nodes"]]) for each in found] == []
            assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
            for _ in way:
                page.click("#menu-items b:text-is('Back')")


def test_stop_by_space_and_on_its_button_works_with_the_menu_open(browser: Browser, building: WithGoals) -> None:
    with menu_page(browser, building, "direct") as page:
        page.keyboard.press("Space")
        until(lambda: len(building.named("stop")) == 2, "Space is not Stop")
        page.focus("#stop")
        page.keyboard.press("Enter")
        until(lambda: len(building.named("stop")) == 4, "Enter on Stop is not Stop")
        page.click("#menu-items b:text-is('Stop')")
        until(lambda: len(building.named("stop")) == 6, "the menu's Stop is not Stop")
