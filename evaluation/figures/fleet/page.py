"""The rider's page of chairs that wait for each other: the sentence is there soon after a wait begins, and gone soon after it ends.

Four chairs on the lines of a corridor go from room to room in real time; each has the real page in Chromium, beside one simulated chair
for all else that the page shows. `FLEET_PAGE_WAITS=20` takes fewer waits.
"""

from __future__ import annotations

import os
import re
import shutil
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from waychair.maps.traffic.corridors import CorridorPlan
from waychair.runtime.pages.chair_port import ChairView
from waychair.trials.fleet.fleet_on_lines import STEP_NS, ChairsOnLines
from waychair.trials.live.live_chair import LiveChair
from waychair.types import Json
from waychair.ui.server import page_server

if TYPE_CHECKING:
    from playwright.sync_api import Page

WAITS = int(os.environ.get("FLEET_PAGE_WAITS", "100"))
CHAIRS = 4
PLAN = CorridorPlan("straight", (30.0, 6.0), ((3.0, 3.0, 27.0, 3.0),))
"""One corridor with nine rooms, in which chairs often wait for each other."""

WITHIN_S = 0.5
OFF_S, OFF_SHARE = 5.0, 0.25
"""The time on the page is right if it is so near to the real one, in s or as a share."""

RIGHT_SHARE = 0.9
"""Share of waits whose time has to be right: people and other chairs can still hold up the one ahead."""

SHORTEST_S = 1.0
"""Waits that are shorter are not counted: the next sentence comes before this one has to be there."""

LONGEST_S = 3_600.0

WATCH = """
globalThis.seen = [];
const look = () => {
  const shown = document.getElementById("others-waits");
  if (!shown) return setTimeout(look, 20);
  const note = () => seen.push([Date.now() / 1000, shown.hidden ? "" : shown.textContent]);
  new MutationObserver(note).observe(shown, { attributes: true, childList: true, characterData: true, subtree: true });
  note();
};
look();
"""
"""Notes when the sentence comes, changes and goes, by the computer's clock [s]."""


@dataclass(slots=True)
class PageWait:
    """A wait with one reason: when it began and ended, and when the whole wait ended, by the computer's clock [s]."""

    why: str
    begun_s: float
    ended_s: float = 0.0
    over_s: float = 0.0


class _ChairAmongOthers:
    """The port of a chair that shares its building; all but the others is that of one simulated chair."""

    def __init__(self, chair: LiveChair) -> None:
        self._chair = chair
        self.outline = chair.outline
        self.others: Any = None

    def view(self) -> ChairView:
        """See `ChairPort`."""
        return replace(self._chair.view(), others=self.others)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._chair, name)


class _World(threading.Thread):
    """The chairs in real time, and their waits."""

    def __init__(self, ports: dict[int, _ChairAmongOthers]) -> None:
        super().__init__(daemon=True)
        self._ports = ports
        self._chairs = ChairsOnLines(PLAN, CHAIRS, seed=0)
        self._ends = threading.Event()
        self.waits: dict[int, list[PageWait]] = {number: [] for number in ports}

    def run(self) -> None:
        """Let time pass until the end."""
        due_s = time.monotonic()
        while not self._ends.is_set():
            now_ns = time.monotonic_ns()
            for number, step in self._chairs.step(now_ns).items():
                self._note(self.waits[number], "" if step.wait is None else step.wait.why)
                self._ports[number].others = self._chairs.chairs[number].member.others(now_ns)
            due_s = max(due_s + STEP_NS * 1e-9, time.monotonic())
            self._ends.wait(due_s - time.monotonic())

    def _note(self, waits: list[PageWait], why: str) -> None:
        """Take down the present wait of a chair."""
        now_s = time.time()
        last = waits[-1] if waits and not waits[-1].over_s else None
        if last is not None and last.why != why and not last.ended_s:
            last.ended_s = now_s
        if why and (last is None or last.why != why):
            waits.append(PageWait(why, now_s))
        elif not why:
            for wait in reversed(waits):
                if wait.over_s:
                    break
                wait.over_s = now_s

    def done(self) -> int:
        """Return how many waits are over that are long enough."""
        return sum(wait.over_s > 0.0 and _counts(wait) for waits in self.waits.values() for wait in list(waits))

    def end(self) -> None:
        """Stop."""
        self._ends.set()
        self.join()


def fleet_page(out: Path) -> Json:
    """The sentence comes with a wait and goes with it within half a second, and its time is right."""
    came, gone, right = [], [], []
    with _pages() as (world, pages):
        end_s = time.monotonic() + LONGEST_S
        while world.done() < WAITS and time.monotonic() < end_s:
            next(iter(pages.values())).wait_for_timeout(1_000)
        for number, page in pages.items():
            page.wait_for_timeout(2e3 * WITHIN_S)
            seen = [(float(at_s), str(text)) for at_s, text in page.evaluate("seen")]
            for wait in world.waits[number]:
                if not (wait.over_s and _counts(wait)):
                    continue
                told = [(at_s, text) for at_s, text in seen if at_s >= wait.begun_s and _tells(text, wait.why)]
                came.append(min(told)[0] - wait.begun_s if told else float("inf"))
                others = [at_s for at_s, text in seen if at_s >= wait.ended_s and not _tells(text, wait.why)]
                gone.append(min(others) - wait.ended_s if others else float("inf"))
                foreseen_s = _seconds(min(told)[1]) if told else None
                if foreseen_s is not None:
                    real_s = wait.over_s - min(told)[0]
                    right.append(abs(foreseen_s - real_s) <= max(OFF_S, OFF_SHARE * real_s))
    share = right.count(True) / len(right) if right else 0.0
    return {
        "passed": len(came) >= WAITS and max((*came, *gone)) <= WITHIN_S and share >= RIGHT_SHARE,
        "waits": len(came),
        "came_s_median_max": _median_max(came),
        "gone_s_median_max": _median_max(gone),
        "late": sum(each > WITHIN_S for each in (*came, *gone)),
        "with_seconds": len(right),
        "seconds_right_share": round(share, 3),
    }


@contextmanager
def _pages() -> Iterator[tuple[_World, dict[int, Page]]]:
    """The world, and a page for each chair."""
    from playwright.sync_api import sync_playwright

    program = os.environ.get("WAYCHAIR_CHROMIUM") or shutil.which("chromium")
    with ExitStack() as stack:
        chair = stack.enter_context(LiveChair("small_clinic", people=False))
        ports = {number: _ChairAmongOthers(chair) for number in range(1, CHAIRS + 1)}
        world = _World(ports)
        playwright = stack.enter_context(sync_playwright())
        browser = stack.enter_context(playwright.chromium.launch(executable_path=program))
        pages = {}
        for number, port in ports.items():
            address = stack.enter_context(page_server(port))
            pages[number] = browser.new_page()
            pages[number].add_init_script(WATCH)
            pages[number].goto(address)
        world.start()
        stack.callback(world.end)
        for page in pages.values():
            page.wait_for_selector("#others:visible")
        yield world, pages


def _counts(wait: PageWait) -> bool:
    return wait.ended_s - wait.begun_s >= SHORTEST_S


def _tells(text: str, why: str) -> bool:
    return text.startswith(why.rstrip(".: "))


def _seconds(text: str) -> float | None:
    """Return the time [s] that a sentence tells; None if it tells none."""
    if text.endswith("a few seconds more."):
        return OFF_S / 2
    found = re.search(r"about (\d+) s more", text)
    return None if found is None else float(found[1])


def _median_max(values: list[float]) -> list[float]:
    ordered = sorted(values)
    return [round(ordered[len(ordered) // 2], 3), round(ordered[-1], 3)] if ordered else []
