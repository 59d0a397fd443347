"""The menu by one switch: steps to a goal, presses of simulated riders, and how soon Stop is heard, on the real page.

The page runs in Chromium beside a chair in the simulator; the building's goals are those of seeded hospitals of several sizes.
"""

from __future__ import annotations

import json
import os
import shutil
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from waychair.runtime.pages.chair_port import GoalView, PortAnswer
from waychair.trials.live.live_chair import LiveChair
from waychair.types import Json, Pose2
from waychair.ui.server import page_server

if TYPE_CHECKING:
    from playwright.sync_api import Page

CHOICES = int(os.environ.get("MENU_CHOICES", "200"))
"""Choices of a goal for each size and use."""

SHAPES = {40: (4, 2, 5), 200: (4, 5, 10), 960: (4, 8, 30)}
"""Storeys, wings and rooms of the hospitals by their number of goals."""

MOST_UNIFORM = {40: 11.5, 200: 13.5, 960: 17.0}
MOST_ZIPF = {40: 7.5, 200: 10.0, 960: 13.0}
"""Greatest mean steps to a goal, all goals alike, and the k-th most used one 1/k as often as the first, with favourites."""

FAVOURITES = 6

RIDERS = {"quick": (0.4, 0.1), "slow": (0.9, 0.3), "very slow": (1.6, 0.6)}
"""Mean and deviation [s] of the time from the frame's coming to the press."""

PRESSES = int(os.environ.get("MENU_PRESSES", "40"))
"""Aimed presses of each rider after the calibration."""

STOPS = 20

_LABELS = "[...document.querySelectorAll('#menu-items b')].map((each) => each.textContent)"
_FRAMED = "document.querySelector('#menu-items .scanned b')?.textContent ?? ''"
_TITLE = "document.querySelector('#menu-title').textContent"


class _Hospital:
    """A chair's port with the goals of a hospital. Chosen goals are noted and refused, so that the next choice can begin."""

    def __init__(self, chair: LiveChair, count: int) -> None:
        storeys, wings, rooms = SHAPES[count]
        self._chair = chair
        self.outline = chair.outline
        self.chosen: list[str] = []
        self.stopped_ns: list[int] = []
        self._goals = tuple(
            GoalView(
                f"{s}/{w}/{r}", (f"Storey {s}", f"Wing {w}", f"Room {s}{w}{r:02d}"), 20.0 * r + 60.0 * s, int(s > 1)
            )
            for s in range(1, storeys + 1)
            for w in range(1, wings + 1)
            for r in range(1, rooms + 1)
        )

    def goals(self) -> Sequence[GoalView]:
        """See `ChairPort`."""
        return self._goals

    def go(self, goal: str | Pose2) -> PortAnswer:
        """See `ChairPort`."""
        self.chosen.append(str(goal))
        return PortAnswer(False, "noted")

    def stop(self) -> PortAnswer:
        """See `ChairPort`."""
        self.stopped_ns.append(time.monotonic_ns())
        return self._chair.stop()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._chair, name)


@contextmanager
def _page(port: _Hospital, access: Json, favourites: Sequence[str] = ()) -> Iterator[Page]:
    """The page with its menu open, for a rider with these options."""
    from playwright.sync_api import sync_playwright

    program = os.environ.get("WAYCHAIR_CHROMIUM") or shutil.which("chromium")
    with (
        page_server(port) as address,
        sync_playwright() as playwright,
        playwright.chromium.launch(executable_path=program) as browser,
    ):
        page = browser.new_page(viewport={"width": 1280, "height": 820})
        page.goto(address)
        kept = {"menu": json.dumps({"own": True, "access": access}), "favourites": json.dumps(list(favourites))}
        page.evaluate("(kept) => { for (const name in kept) localStorage.setItem(name, kept[name]); }", kept)
        page.reload()
        _until(lambda: any(label.startswith("Storey") for label in page.evaluate(_LABELS)), page)
        yield page


def _until(condition: Callable[[], bool], page: Page, limit_s: float = 60.0) -> None:
    end = time.monotonic() + limit_s
    while not condition():
        if time.monotonic() > end:
            raise RuntimeError(f"the page does not answer; its menu is {page.evaluate(_TITLE)!r}")
        page.wait_for_timeout(5)


def _way(page: Page, goal: GoalView, favourite: bool) -> int:
    """Choose a goal by a joystick's steps; return them: items that the frame has come to, in all menus together.

    A sweep frames the same items in the same order; switches as quick as this would be taken for chatter.
    """
    steps = 0
    wanted = "Favourites" if favourite else goal.path[0]
    for _ in range(9):
        labels = page.evaluate(_LABELS)
        index = _index_towards(labels, wanted, goal)
        title = page.evaluate(_TITLE)
        for label in labels[1 : index + 1]:
            page.keyboard.press("ArrowDown")
            _until(lambda: page.evaluate(_FRAMED) == label, page)  # noqa: B023
        steps += index + 1
        page.keyboard.press("ArrowRight")
        if labels[index] == goal.path[-1]:
            return steps
        _until(lambda: page.evaluate(_TITLE) != title, page)  # noqa: B023
        wanted = goal.path[-1] if favourite else goal.path[min(page.evaluate(_TITLE).count(",") + 1, 2)]
    raise RuntimeError("the goal is too deep")


def _index_towards(labels: Sequence[str], wanted: str, goal: GoalView) -> int:
    """Return the item that is the wanted one, or the group of consecutive ones that holds it or the goal."""
    for name in (wanted, *goal.path):
        for index, label in enumerate(labels):
            first, to, last = label.partition(" to ")
            if label == name or (to and first <= name <= last and len(first) == len(name)):
                return index
    raise RuntimeError(f"no item of {labels} leads to {goal.path}")


def _steps(chair: LiveChair, count: int, zipf: bool, rng: np.random.Generator) -> list[int]:
    port = _Hospital(chair, count)
    goals = list(port.goals())
    order = rng.permutation(count)  # the goals by how often they are used
    shares = 1.0 / np.arange(1, count + 1) if zipf else np.ones(count)
    favourites = [goals[k].name for k in order[:FAVOURITES]] if zipf else []
    access = {"method": "direct"}
    steps = []
    with _page(port, access, favourites) as page:
        for k in rng.choice(order, CHOICES, p=shares / shares.sum()):
            goal = goals[int(k)]
            steps.append(_way(page, goal, goal.name in favourites))
            _until(lambda: bool(port.chosen) and page.evaluate(_TITLE) == "Menu", page)
            if port.chosen.pop() != goal.name:
                raise RuntimeError("another goal was chosen")
    return steps


def _presses(chair: LiveChair, mean: float, deviation: float, rng: np.random.Generator) -> tuple[float, int]:
    """Return the sweep [s] after the calibration by a rider, and the number of presses that took another item, or none."""

    def late() -> float:
        return float(max(rng.normal(mean, deviation), 0.15))

    port = _Hospital(chair, 40)
    with _page(port, {"method": "auto", "sweep": 1.5, "first": 0.5, "rounds": 9}) as page:
        for label in ("Options", "Times", "Measure my presses"):
            page.click(f"#menu-items b:text-is('{label}')")
        for _ in range(10):
            _until(lambda: page.locator("#menu-target.scanned").count() == 1, page)
            page.wait_for_timeout(1e3 * late())
            page.keyboard.press("Space", delay=30)
        for title in ("Options, Times", "Options"):  # the calibration ends in the menu that it began in
            _until(lambda: page.evaluate(_TITLE) == title, page)  # noqa: B023
            page.click("#menu-items b:text-is('Back')")
        _until(lambda: page.evaluate(_TITLE) == "Menu", page)
        sweep = page.evaluate("JSON.parse(localStorage.getItem('menu')).access.sweep")
        wrong = 0
        for k in range(PRESSES):
            label = f"Storey {1 + k % 4}"
            _until(lambda: page.evaluate(_FRAMED) == label, page)  # noqa: B023
            page.wait_for_timeout(1e3 * late())
            page.keyboard.press("Space", delay=30)
            page.wait_for_timeout(60)
            wrong += page.evaluate(_TITLE) != label
            if page.evaluate(_TITLE) != "Menu":
                page.click("#menu-items b:text-is('Back')")
    return float(sweep), wrong


def _stops(chair: LiveChair) -> list[float]:
    """Return the times [ms] from a press of Esc to the chair's Stop, in menus of every depth."""
    port = _Hospital(chair, 40)
    late = []
    with _page(port, {"method": "auto"}) as page:
        for k in range(STOPS):
            for label in ("Storey 1", "Wing 1")[: k % 3]:
                page.click(f"#menu-items b:text-is('{label}')")
            heard = len(port.stopped_ns)
            pressed_ns = time.monotonic_ns()
            page.keyboard.press("Escape")
            _until(lambda: len(port.stopped_ns) > heard, page)  # noqa: B023
            late.append((port.stopped_ns[heard] - pressed_ns) * 1e-6)
    return late


def menus(out: Path) -> Json:
    """Mean steps by size and use, wrong presses of three riders [%], and the time from Esc to Stop [ms]."""
    rng = np.random.default_rng(5)
    with LiveChair("small_clinic", people=False) as chair:
        uniform = {count: float(np.mean(_steps(chair, count, False, rng))) for count in SHAPES}
        zipf = {count: float(np.mean(_steps(chair, count, True, rng))) for count in SHAPES}
        riders = {name: _presses(chair, *times, rng) for name, times in RIDERS.items()}
        stops = _stops(chair)
    wrong = {name: missed / PRESSES for name, (_, missed) in riders.items()}
    return {
        "passed": all(uniform[count] <= most for count, most in MOST_UNIFORM.items())
        and all(zipf[count] <= most for count, most in MOST_ZIPF.items())
        and max(wrong.values()) <= 0.1
        and max(stops) <= 100.0,
        "choices": CHOICES,
        "steps_uniform": {str(count): round(mean, 2) for count, mean in uniform.items()},
        "steps_zipf": {str(count): round(mean, 2) for count, mean in zipf.items()},
        "sweep_s": {name: sweep for name, (sweep, _) in riders.items()},
        "wrong_presses": wrong,
        "presses": PRESSES,
        "stop_ms_max": round(max(stops), 1),
    }
