"""Pages and chair stay informed of each other after errors: a drive ends within a second of the last page."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

from waychair.runtime.pages.chair_port import ChairView, GoalView, LayoutView
from waychair.runtime.pages.haptic_port import WithoutHaptics
from waychair.runtime.pages.page_watch import PageWatch
from waychair.slam.localising.localisation import LocalisationState
from waychair.types import DriveMode, FloatArray, OccupancyGrid, Twist
from waychair.ui.broadcaster import VIEW_S, WATCH_S, Broadcaster, OpenPage

TICK_S = 0.05
STEP_S = 0.01
HICCUP_S = 0.5


class Port(WithoutHaptics):
    """The part of a chair that pages use; `broken` names calls that fail."""

    outline: FloatArray = np.zeros((4, 2))

    def __init__(self) -> None:
        self.broken: set[str] = set()
        self.watchers: list[Sequence[str]] = []

    def _work(self, name: str) -> None:
        if name in self.broken:
            raise RuntimeError(f"{name} is broken")

    def view(self) -> ChairView:
        self._work("view")
        return ChairView(0, None, LocalisationState.OK, 1.0, DriveMode.MANUAL, Twist())

    def goals(self) -> Sequence[GoalView]:
        self._work("goals")
        return (GoalView("ward", ("Storey 1", "Ward")),)

    def grid(self) -> OccupancyGrid | None:
        self._work("grid")
        return OccupancyGrid(np.zeros((2, 2), np.int8), 0.05)

    def layout(self) -> LayoutView:
        self._work("layout")
        return LayoutView()

    def watched(self, pages: Sequence[str]) -> None:
        self._work("watched")
        self.watchers.append(pages)


async def heard(page: OpenPage, kind: str) -> Any:
    """The next message of a kind."""
    async with asyncio.timeout(20.0):
        while True:
            for text in await page.next_messages():
                if (message := json.loads(text))["type"] == kind:
                    return message


def broadcast(port: Port, test: Callable[[Broadcaster, OpenPage], Any]) -> None:
    """Runs a test beside a broadcaster with one page."""

    async def run() -> None:
        broadcaster, page = Broadcaster(port), OpenPage("one")  # type: ignore[arg-type]
        telling = asyncio.create_task(broadcaster.run())
        broadcaster.join(page)
        try:
            await test(broadcaster, page)
            assert not telling.done()
        finally:
            telling.cancel()
            await asyncio.gather(telling, return_exceptions=True)
            port.broken.clear()
            broadcaster.close()

    with ThreadPoolExecutor(1) as pool:  # browser tests of the same process have a loop in this thread
        pool.submit(asyncio.run, run()).result()


@pytest.mark.parametrize("name", ["view", "grid", "layout", "goals", "watched"])
def test_a_temporary_failure_of_a_call_delays_pages_no_longer_than_the_failure(
    name: str, caplog: pytest.LogCaptureFixture
) -> None:
    port = Port()
    port.broken.add(name)

    async def test(broadcaster: Broadcaster, page: OpenPage) -> None:
        if name != "view":
            for _ in range(3):
                await heard(page, "view")  # the failing call blocks no other message
        await asyncio.sleep(5 * VIEW_S)
        port.broken.clear()
        await heard(page, {"grid": "map", "watched": "view"}.get(name, name))
        broadcaster.answered(page)
        async with asyncio.timeout(20.0):
            while ("one",) not in port.watchers:
                await asyncio.sleep(0.01)

    broadcast(port, test)
    assert [name in str(record.exc_info) for record in caplog.records] == [True]  # once, not ten times a second


def test_a_hidden_page_does_not_count_for_another_of_the_same_id() -> None:
    broadcaster = Broadcaster(Port(), lambda: 0.0)  # type: ignore[arg-type]
    seen, duplicate = OpenPage("twin"), OpenPage("twin")
    broadcaster.answered(seen)
    broadcaster.answered(duplicate)
    broadcaster.hidden(duplicate)
    assert broadcaster.there() == ("twin",)
    broadcaster.hidden(seen)
    assert broadcaster.there() == ()
    broadcaster.close()


def watch_of(answers_s: Callable[[float], bool], phase_s: float, until_s: float) -> float | None:
    """Return when a drive ends whose page answers its views while `answers_s` of the time holds; None if it does not
    end.

    `phase_s`: the delay of the chair's message after the views.
    """
    now_s = 0.0
    port, watch = Port(), PageWatch()
    broadcaster, page = Broadcaster(port, lambda: now_s), OpenPage("one")  # type: ignore[arg-type]
    watch.began(0)
    view_s, tell_s, tick_s = 0.0, phase_s, 0.0
    ended = None
    while now_s < until_s and ended is None:
        if now_s >= view_s:
            view_s += VIEW_S
            if answers_s(now_s):
                broadcaster.answered(page)
        if now_s >= tell_s:
            tell_s += WATCH_S
            watch.seen(broadcaster.there(), round(1e9 * now_s))
        if now_s >= tick_s:
            tick_s += TICK_S
            ended = now_s if watch.halts(round(1e9 * now_s)) else None
        now_s += STEP_S
    broadcaster.close()
    return ended


PHASES_S = np.arange(0.0, max(VIEW_S, WATCH_S), STEP_S).tolist()


@pytest.mark.parametrize("phase_s", PHASES_S)
def test_a_drive_ends_within_a_second_of_the_last_answer_of_the_last_page(phase_s: float) -> None:
    last_s = 20 * VIEW_S
    ended_s = watch_of(lambda now_s: now_s <= last_s + STEP_S / 2, phase_s, 10.0)
    assert ended_s is not None
    assert HICCUP_S + VIEW_S < ended_s - last_s <= 1.0


@pytest.mark.parametrize("phase_s", PHASES_S)
def test_a_pause_of_half_a_second_ends_no_drive(phase_s: float) -> None:
    assert watch_of(lambda now_s: now_s < 2.0 or now_s > 2.0 + HICCUP_S, phase_s, 5.0) is None
