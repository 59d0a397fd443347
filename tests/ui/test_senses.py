"""Sound and camera of a page: a tone and a phrase before the chair moves, and the camera's picture."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import pytest

from tests.ui.conftest import WORLD
from tests.ui.driving import page_at, put_place, ready_page, until
from tests.ui.noted import Noted
from waychair.simulation.sensors.renderer import renderer_problem
from waychair.trials.live.live_chair import LiveChair
from waychair.ui.server import page_server

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

COUNTDOWN_S = 30.0
"""The longest countdown there is, so that a busy computer presses Cancel before its end."""

LISTEN = """
globalThis.heard = { loudest: 0, notes: [], phrases: [], silenced: 0 };
const connect = AudioNode.prototype.connect;
AudioNode.prototype.connect = function (to, ...more) {
  if (to instanceof AudioDestinationNode) {
    const ear = to.context.createAnalyser(), wave = new Float32Array(ear.fftSize);
    connect.call(this, ear);
    setInterval(() => {
      ear.getFloatTimeDomainData(wave);
      heard.loudest = Math.max(heard.loudest, ...wave.map(Math.abs));
    }, 10);
  }
  return connect.call(this, to, ...more);
};
const start = OscillatorNode.prototype.start;
OscillatorNode.prototype.start = function (...at) {
  heard.notes.push(this.frequency.value);
  return start.apply(this, at);
};
speechSynthesis.speak = (said) => heard.phrases.push(said.text);
speechSynthesis.cancel = () => { heard.silenced += 1; };
"""
"""Records the loudspeaker, and replaces the voice, which Chromium without a window does not have."""


@pytest.fixture(scope="module")
def chair() -> Iterator[LiveChair]:
    """A chair whose countdown lasts until it is cancelled."""
    with LiveChair(WORLD, people=False, countdown_s=COUNTDOWN_S) as live:
        yield live


@contextmanager
def heard_page(browser: Browser, address: str) -> Iterator[Page]:
    """A page that shows the chair, with recorded sound."""
    with page_at(browser, "about:blank") as page:
        page.add_init_script(LISTEN)
        page.goto(address)
        page.wait_for_selector("#link-fact[data-state=open]")
        yield page


def set_off_heard(page: Page, place: str) -> None:
    """Asks for a place and confirms it, and waits for the countdown's second number; the announcement is over then."""
    page.click(f".place:text-is('{place}')")
    page.click("#ask-yes")
    page.wait_for_selector("#count:visible")
    until(lambda: page.text_content("#count-number") != f"{COUNTDOWN_S:g}", "the page does not count")


def test_a_tone_and_a_phrase_sound_before_the_chair_moves(browser: Browser, port: Noted, address: str) -> None:
    place = put_place(port, 1.2)
    with heard_page(browser, address) as page:
        set_off_heard(page, place)
        assert port.view().twist.v < 0.02
        heard = page.evaluate("heard")
        assert heard["notes"] == [660, 880]
        assert len(heard["phrases"]) == 1
        assert place in heard["phrases"][0]
        until(lambda: page.evaluate("heard.loudest") > 0.05, "the notes do not sound")
        page.click("#count-no")
        until(lambda: not port.view().goal, "the drive is not given up")
        assert port.view().twist.v < 0.02


def test_a_muted_page_is_quiet(browser: Browser, port: Noted, address: str) -> None:
    place = put_place(port, 1.2)
    with heard_page(browser, address) as page:
        page.click("#tab-options")
        page.click("#option-sound")
        page.click("#tab-places")
        set_off_heard(page, place)
        heard = page.evaluate("heard")
        assert heard["notes"] == heard["phrases"] == []
        assert heard["silenced"] > 0
        page.click("#count-no")
        until(lambda: not port.view().goal, "the drive is not given up")


@pytest.mark.skipif(renderer_problem() is not None, reason="this machine cannot render pictures")
@pytest.mark.nightly
def test_the_panel_shows_the_picture_of_the_camera(browser: Browser) -> None:
    with (
        LiveChair(WORLD, people=False, camera=True) as chair,
        page_server(chair) as address,
        ready_page(browser, address) as page,
    ):
        assert not page.is_visible("#picture")
        page.click("#panel-open")
        until(lambda: page.evaluate("document.querySelector('#picture').naturalWidth > 0"), "no picture comes")
        assert page.is_visible("#picture")
        grey = page.evaluate(
            """async () => {
              const picture = document.querySelector("#picture"), canvas = document.createElement("canvas");
              [canvas.width, canvas.height] = [picture.naturalWidth, picture.naturalHeight];
              const paper = canvas.getContext("2d");
              paper.drawImage(picture, 0, 0);
              const dots = paper.getImageData(0, 0, canvas.width, canvas.height).data;
              return [...Array(dots.length / 4).keys()].map((k) => dots[4 * k + 1]);
            }"""
        )
        assert max(grey) - min(grey) > 60  # walls, floor and things, not an empty picture
        page.click("#panel-open")
        assert not page.is_visible("#picture")
