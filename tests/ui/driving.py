"""Helpers of the browser tests: open a page, wait for conditions, begin a drive."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Self

from waychair.runtime.pages.chair_port import ChairPort, ChairView
from waychair.types import DriveMode, Place, Pose2

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

BROKEN_S = 60.0
"""A limit beyond the duration of any working step."""


_NAP_S = 0.005


@contextmanager
def page_at(browser: Browser, address: str, **context: object) -> Iterator[Page]:
    """A page in a separate browser; any error in it fails the test."""
    own = browser.new_context(**context)  # type: ignore[arg-type]
    page = own.new_page()
    page.set_default_timeout(1e3 * BROKEN_S)
    wrong: list[str] = []
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("console", lambda said: wrong.append(said.text) if said.type == "error" else None)
    page.goto(address)
    yield page
    own.close()
    found = [each for each in wrong if not any(network in each for network in ("net::ERR", "WebSocket"))]
    assert not found, found


@contextmanager
def ready_page(browser: Browser, address: str, **context: object) -> Iterator[Page]:
    """A page that shows the chair."""
    with page_at(browser, address, **context) as page:
        page.wait_for_selector("#link-fact[data-state=open]")
        page.wait_for_selector(".place")
        yield page


def until(condition: Callable[[], bool], what: str) -> None:
    """Waits for a condition; only a broken program reaches the limit."""
    end = time.monotonic() + BROKEN_S
    while not condition():
        assert time.monotonic() < end, what
        time.sleep(0.01)


class Lateness:
    """Measure how late this computer is: the longest excess of a short sleep during the block [ms]."""

    def __enter__(self) -> Self:
        self.ms = 0.0
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._watch)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ends.set()
        self._thread.join()

    def _watch(self) -> None:
        while not self._ends.is_set():
            began = time.monotonic()
            time.sleep(_NAP_S)
            self.ms = max(self.ms, 1e3 * (time.monotonic() - began - _NAP_S))


def rests(view: ChairView) -> bool:
    """The chair stands, and nothing drives it."""
    driven = view.mode in (DriveMode.AUTONOMOUS, DriveMode.ASSISTED)
    return not driven and not view.goal and abs(view.twist.v) < 0.02 and abs(view.twist.omega) < 0.03


def drives(view: ChairView) -> bool:
    """The computer drives, and the chair is in motion."""
    return view.mode is DriveMode.AUTONOMOUS and view.twist.v > 0.1


def pose_of(port: ChairPort) -> Pose2:
    """Return where the chair stands, once it knows."""
    until(lambda: port.view().map_from_base is not None, "the chair does not know where it is")
    pose = port.view().map_from_base
    assert pose is not None
    return pose


def press_map(page: Page, port: ChairPort, forward: float, left: float = 0.0) -> None:
    """Presses the map at this distance from the chair [m]."""
    at = pose_of(port) @ Pose2(forward, left)
    spot = page.evaluate(
        """([x, y]) => import("/static/js/map_view.js").then(({ map, toScreen }) =>
        map.latLngToContainerPoint(toScreen([x, y])))""",
        [at.x, at.y],
    )
    page.locator("#map").click(position=spot)


def put_place(port: ChairPort, metres: float) -> str:
    """Saves a place at this distance ahead of the chair; returns its name."""
    here = pose_of(port)
    name = f"{metres:g} m ahead"
    answer = port.set_place(Place(name, here @ Pose2(metres)), True)
    assert answer.done, answer.sentence
    return name


def set_off(page: Page, port: ChairPort, place: str) -> None:
    """Presses a place until the chair is in motion, again where a busy computer has ended the drive."""

    def sets_off() -> bool:
        if not port.view().goal:
            if port.view().obstacles:
                port.reset()
            page.click(f".place:text-is('{place}')")
            page.click("#ask-yes")
        return drives(port.view())

    until(sets_off, "the chair does not set off")
