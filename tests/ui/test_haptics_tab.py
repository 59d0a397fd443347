"""The tab of touch in a real browser: motors, step, said and felt, each thing announced once, and the rider's requests."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.runtime.haptics.guided_rider import room
from tests.ui.driving import ready_page, until
from tests.ui.test_guide_panel import VOICE
from tests.ui.test_menu import LABELS, choose, menu_page
from waychair.control.haptics.next_door import DoorSide, door_words
from waychair.firmware_bridge.glove.bridge import GloveReport
from waychair.runtime.haptics.haptic_state import HapticState
from waychair.runtime.haptics.session_log import SessionLog
from waychair.runtime.pages.chair_port import LayoutView, PortAnswer
from waychair.trials.demo.demo_page import DemoPage
from waychair.types import Place, Pose2
from waychair.ui.haptic_messages import NO_HAPTICS, haptics_message
from waychair.ui.server import page_server

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

GLOVE = GloveReport("", layout="glove_3x3", motors=9, broken=(2,), worn=True, temperature_c=25)
STATE = HapticState(0, goal="reception", step="straight 4.0 m", reason="straight, 3.1 m more", glove=GLOVE, count=3)
FORWARD = replace(
    STATE,
    symbol="forward",
    text="drive straight ahead",
    count=4,
    play=(((7,), 400, 0), ((4,), 400, 0), ((1,), 400, 400)),
)


class Telling(DemoPage):
    """The port of a chair that stands in a room with a reception: it tells of a rider, and notes the requests."""

    def __init__(self) -> None:
        super().__init__()
        self._show(room(), LayoutView({"reception": Place("reception", Pose2(4.0, 2.0), 0.3, 0.3)}))
        self._view = replace(self._view, map_revision=self._revision, layout_revision=self._revision)
        self.state: HapticState | None = None
        self.asked: list[str] = []

    def haptics(self) -> HapticState | None:
        return self.state

    def lead(self, goal: str) -> PortAnswer:
        self.asked.append(f"lead {goal}")
        return PortAnswer(True, f"You are led to {goal}.")

    def lead_through(self, side: DoorSide) -> PortAnswer:
        self.asked.append(f"through {side.value}")
        return PortAnswer(True, f"You are led through {door_words(side)}.")

    def say_again(self) -> PortAnswer:
        self.asked.append("again")
        return PortAnswer(True, "")

    def say_where(self) -> PortAnswer:
        self.asked.append("where")
        return PortAnswer(True, "")

    def end_lead(self) -> PortAnswer:
        self.asked.append("end")
        return PortAnswer(True, "you are no longer led")


@pytest.fixture
def telling() -> Telling:
    return Telling()


@pytest.fixture
def page(browser: Browser, telling: Telling, tmp_path: Path) -> Iterator[Page]:
    log = SessionLog(tmp_path / "drives.jsonl")
    with page_server(telling, session_log=log) as address, ready_page(browser, address) as ready:
        yield ready


def test_a_message_names_the_motors_by_their_places_on_the_skin() -> None:
    text = haptics_message(FORWARD)
    assert '"at":[[25.0,25.0,"hand"],[0.0,25.0,"hand"],' in text
    assert '"play":[[[7],400,0],[[4],400,0],[[1],400,400]]' in text
    assert haptics_message(None) == NO_HAPTICS


def test_a_chair_without_glove_and_voice_says_so(page: Page) -> None:
    page.click("#tab-haptics")
    page.wait_for_selector("#haptics-none:visible")
    assert "--haptics" in page.inner_text("#haptics-none")


def test_what_is_said_is_shown_announced_once_and_lit_on_the_glove(page: Page, telling: Telling) -> None:
    telling.state = STATE
    page.click("#tab-haptics")
    page.wait_for_selector("#haptics-there:visible")
    until(lambda: page.inner_text("#haptics-goal") == "On the way to reception", "the goal is not shown")
    assert page.inner_text("#haptics-step") == "Now: straight 4.0 m. Straight, 3.1 m more."
    assert page.locator("#haptics-glove .motor").count() == 9
    assert page.locator("#haptics-glove .motor.broken").count() == 1
    assert page.inner_text("#haptics-announced") == ""  # said before the page came
    page.evaluate(
        "window.announced = []; new MutationObserver(() => announced.push(document.getElementById('haptics-announced')"
        ".textContent)).observe(document.getElementById('haptics-announced'), {childList: true})"
    )
    telling.state = FORWARD
    page.wait_for_selector("#haptics-glove .motor.on", state="attached")
    until(
        lambda: page.inner_text("#haptics-said").startswith("forward: drive straight ahead (felt)"), "it is not listed"
    )
    page.wait_for_timeout(600)
    assert [text for text in page.evaluate("announced") if text] == ["drive straight ahead"]
    telling.state = replace(FORWARD, count=5, unfelt="motor 4 of the glove is open", play=())
    until(lambda: page.locator("#haptics-said li").count() == 2, "the repeated symbol is not listed")
    page.wait_for_timeout(200)
    assert [text for text in page.evaluate("announced") if text] == ["drive straight ahead"] * 2
    assert "not felt: motor 4 of the glove is open" in page.inner_text("#haptics-said li >> nth=0")


def test_the_page_does_not_speak_while_the_chair_does_and_goes_on_afterwards(page: Page, telling: Telling) -> None:
    def say(phrase: str) -> None:
        page.evaluate(
            "(phrase) => import('./static/js/sound.js').then((voice) => voice.speakOnly(phrase, () => {}))", phrase
        )

    telling.state = STATE
    page.evaluate(VOICE)
    say("first item")
    assert page.evaluate("heard.phrases") == ["first item"]
    cut = page.evaluate("heard.cut")
    telling.state = replace(STATE, speaks=True)
    until(lambda: page.evaluate("heard.cut") == cut + 1, "the page speaks on beside the chair")
    telling.state = STATE
    until(lambda: page.evaluate("heard.phrases") == ["first item"] * 2, "what was cut off is not said anew")
    telling.state = replace(STATE, speaks=True)
    until(lambda: page.evaluate("heard.cut") > cut + 1, "the page speaks on beside the chair")
    say("second item")
    assert page.evaluate("heard.phrases") == ["first item"] * 2
    telling.state = STATE
    until(lambda: page.evaluate("heard.phrases")[2:] == ["second item"], "the latest is not said")


def test_steps_that_are_withheld_and_faults_are_named(page: Page, telling: Telling) -> None:
    gone = GloveReport("the glove is silent: check its cable", layout="glove_3x3", motors=9)
    telling.state = replace(STATE, withheld=gone.problem, glove=gone, notices=(gone.problem,))
    page.click("#tab-haptics")
    until(lambda: "withheld" in page.inner_text("#haptics-step"), "the silence is not told")
    assert page.inner_text("#haptics-notices") == gone.problem
    assert page.inner_text("#haptics-glove-text") == "The glove: the glove is silent: check its cable."


def test_again_where_lead_and_end_are_one_press_each(page: Page, telling: Telling) -> None:
    telling.state = STATE
    page.click("#tab-haptics")
    page.click("#haptics-again")
    page.click("#haptics-where")
    page.click("#haptics-places button:text-is('reception')")
    page.click("#haptics-doors button:text-is('On the left')")
    page.click("#haptics-end")
    until(lambda: telling.asked == ["again", "where", "lead reception", "through left", "end"], f"{telling.asked}")


def test_the_trainers_record_is_off_until_a_press(page: Page, telling: Telling) -> None:
    telling.state = STATE
    page.click("#tab-haptics")
    until(lambda: page.inner_text("#session-log-state") == "Nothing is recorded.", "the record is not shown")
    page.click("#session-log-yes")
    until(lambda: page.inner_text("#session-log-state") == "Your guided drives are recorded.", "the yes has no effect")
    page.click("#session-log-erase")
    until(lambda: page.inner_text("#session-log-state") == "Nothing is recorded.", "it is not erased")


def test_the_tab_fits_the_narrowest_phone(page: Page, telling: Telling) -> None:
    telling.state = replace(FORWARD, notices=("the glove is too warm: it plays again when it has cooled down",))
    page.set_viewport_size({"width": 320, "height": 568})
    page.click("#tab-haptics")
    page.wait_for_selector("#haptics-glove .motor")
    assert page.evaluate("document.documentElement.scrollWidth") <= 320


def test_the_menu_of_one_switch_reaches_again_where_and_the_places(browser: Browser, telling: Telling) -> None:
    telling.state = replace(STATE, goal="")
    with menu_page(browser, telling, "direct") as page:
        until(lambda: "Where am I?" in page.evaluate(LABELS), "the menu does not know of touch")
        choose(page, "direct", "Where am I?")
        until(lambda: telling.asked == ["where"], f"{telling.asked}")
        choose(page, "direct", "Say it again")
        until(lambda: telling.asked == ["where", "again"], f"{telling.asked}")
        choose(page, "direct", "Lead me")
        until(lambda: "reception" in page.evaluate(LABELS), "the places are not in the menu")
        choose(page, "direct", "reception")
        until(lambda: telling.asked[-1] == "lead reception", f"{telling.asked}")


def test_the_menu_of_one_switch_leads_through_the_next_door(browser: Browser, telling: Telling) -> None:
    telling.state = replace(STATE, goal="")
    with menu_page(browser, telling, "direct") as page:
        until(lambda: "Through the next door" in page.evaluate(LABELS), "the menu does not know of doors")
        choose(page, "direct", "Through the next door")
        until(lambda: "Ahead" in page.evaluate(LABELS), "the sides are not in the menu")
        choose(page, "direct", "Ahead")
        until(lambda: telling.asked == ["through ahead"], f"{telling.asked}")
