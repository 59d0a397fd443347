"""The other chairs on the rider's page: the wait is there in words, and spoken, within half a second, and goes as soon."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest

from tests.ui.driving import page_at
from tests.ui.noted import Noted
from waychair.runtime.pages.chair_port import ChairView, OthersView
from waychair.ui.server import page_server

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

WAITS = 5
WITHIN_MS = 500.0
OTHERS = ((2, "On the way to room 4."), (3, ""))

WATCH = """
globalThis.seen = [];
globalThis.phrases = [];
speechSynthesis.getVoices = () => [{}];
speechSynthesis.speak = (said) => phrases.push(said.text);
speechSynthesis.cancel = () => {};
globalThis.notes = [];
globalThis.AudioContext = new Proxy(AudioContext, { construct: (kind) => {
  const context = new kind();
  const make = context.createOscillator.bind(context);
  context.createOscillator = () => {
    const note = make();
    const start = note.start.bind(note);
    note.start = (at) => { notes.push(note.frequency.value); start(at); };
    return note;
  };
  return context;
} });
const look = () => {
  const shown = document.getElementById("others-waits");
  if (!shown) return setTimeout(look, 20);
  const note = () => seen.push([Date.now(), shown.hidden ? "" : shown.textContent]);
  new MutationObserver(note).observe(shown, { attributes: true, childList: true, characterData: true, subtree: true });
  note();
};
look();
"""
"""Notes when the sentence comes and goes, and the tones; replaces the voice, which Chromium without a window does not have."""


class Shared:
    """A chair that shares its building; `others` is what it says of the others."""

    def __init__(self, port: Noted) -> None:
        self._port = port
        self.others = OthersView(others=OTHERS)

    def view(self) -> ChairView:
        """Return the chair's view with the others."""
        return replace(self._port.view(), others=self.others)

    def __getattr__(self, name: str) -> Callable[..., Any]:
        found: Callable[..., Any] = getattr(self._port, name)
        return found


@pytest.fixture
def shared(port: Noted) -> Shared:
    """The chair of this folder among others."""
    return Shared(port)


@pytest.fixture
def page(browser: Browser, shared: Shared) -> Iterator[Page]:
    """A page that shows it."""
    with page_server(shared, http_port=0) as address, page_at(browser, "about:blank") as found:  # type: ignore[arg-type]
        found.add_init_script(WATCH)
        found.goto(address)
        found.wait_for_selector("#link-fact[data-state=open]")
        found.wait_for_selector("#others:visible")
        yield found


def came_after(page: Page, since_s: float, is_told: Callable[[str], bool]) -> float:
    """Return the time [ms] from a moment until the page showed such a sentence."""
    end_s = time.monotonic() + 20
    while time.monotonic() < end_s:
        for at_ms, text in page.evaluate("seen"):
            if at_ms >= 1e3 * since_s and is_told(text):
                return float(at_ms - 1e3 * since_s)
        page.wait_for_timeout(20)
    raise AssertionError(page.evaluate("seen"))


def test_the_sentence_comes_and_goes_within_half_a_second_and_is_spoken(page: Page, shared: Shared) -> None:
    times = []
    for k in range(WAITS):
        sentence = f"Waits for chair {k + 2} to leave the corridor."
        began_s = time.time()
        shared.others = OthersView(sentence, 20.0, OTHERS)
        times.append(came_after(page, began_s, lambda text, k=k: f"chair {k + 2}" in text))  # type: ignore[misc]
        assert page.inner_text("#others-waits") == f"Waits for chair {k + 2} to leave the corridor: about 20 s more."
        shared.others = OthersView(sentence, 3.0, OTHERS)
        page.wait_for_selector("#others-waits:has-text('a few seconds more')")
        ended_s = time.time()
        shared.others = OthersView(others=OTHERS)
        times.append(came_after(page, ended_s, lambda text: not text))
    assert max(times) <= WITHIN_MS, times
    spoken = page.evaluate("phrases")
    assert spoken[:2] == ["Waits for chair 2 to leave the corridor: about 20 s more.", "Goes on."]
    assert len(spoken) == 2 * WAITS
    assert page.inner_text("#others-list").splitlines() == ["Chair 2: On the way to room 4.", "Chair 3: Stands by."]


def test_a_tone_is_sounded_once_for_each_way_out_by_its_own_eyes(page: Page, shared: Shared) -> None:
    for count in (1, 2):
        shared.others = OthersView(others=OTHERS, tones=count)
        page.wait_for_timeout(800)  # several views
        assert page.evaluate("notes") == count * [880, 660]


def test_a_chair_that_goes_first_says_so_once_and_shows_its_light_while_staff_gave_it_way(
    page: Page, shared: Shared
) -> None:
    top = "Goes before all others: staff said so."
    shared.others = OthersView("Waits for chair 2 to leave the corridor.", 20.0, OTHERS, first=top, lit=True)
    page.wait_for_selector("#others-first[data-lit=true]")
    page.wait_for_timeout(800)  # several views
    assert page.inner_text("#others-first") == top
    lamp = "getComputedStyle(document.getElementById('others-first'), '::before')"
    assert page.evaluate(f"{lamp}.borderRadius") == "50%"
    shared.others = OthersView(others=OTHERS)
    page.wait_for_selector("#others-first", state="hidden")
    assert page.evaluate("phrases") == [top, "Goes on."]


def test_axe_finds_no_fault_while_the_chair_waits(page: Page, shared: Shared) -> None:
    from axe_playwright_python.sync_playwright import Axe

    first = "Goes before all others: staff said so."
    shared.others = OthersView("Lets chair 3 go first: it has waited longest.", None, OTHERS, first=first, lit=True)
    page.wait_for_selector("#others-waits:has-text('it has waited longest')")
    assert Axe().run(page).response["violations"] == []
