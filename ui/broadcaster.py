"""Messages between the chair and its open pages: one loop sends views, another reports answering pages to the chair.
A slow page gets only the newest message of each kind. Blocking calls (the chair's own, pictures) run in threads, and
Stop has threads of its own, so that no other call can delay it.
"""

from __future__ import annotations

import asyncio
import logging
import secrets
import time
from collections import deque
from collections.abc import Awaitable, Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from typing import TypeVar

from waychair.runtime.pages.chair_port import ChairPort, PortAnswer
from waychair.types import Json, OccupancyGrid
from waychair.ui.commands import RELEASE, STICK, STOP, obey
from waychair.ui.haptic_messages import NO_HAPTICS, haptics_message
from waychair.ui.page_messages import (
    cells_message,
    encoded,
    goals_message,
    grid_picture,
    layout_message,
    map_message,
    view_message,
)

T = TypeVar("T")

VIEW_S = 0.1
"""Period of the views that pages get."""

WATCH_S = 0.1
"""Period of the reports of answering pages to the chair."""

CELLS_EVERY = 2
"""Views from one message about the behaviour cells to the next."""

GOALS_EVERY = 10
"""Views from one question for the building's goals to the next; their times change while the chair drives."""

ANSWERS_S = 0.2
"""A page counts as present for this time after its latest answer; the chair waits longer (`runtime.pages.page_watch`)."""

MOST_WAITING = 50
"""Greatest number of commands and answers that wait for one page; a working page never needs as many."""

_THREADS = 8
_STOP_THREADS = 2


class OpenPage:
    """The messages that wait to be sent to one page: of views, maps and layouts only the newest."""

    def __init__(self, page_id: str) -> None:
        self.page_id = page_id
        self.shows_cells = False
        """Whether the page shows the behaviour cells; nobody works for them otherwise."""
        self._newest: dict[str, str] = {}
        self._answers: deque[str] = deque(maxlen=MOST_WAITING)
        self._wake = asyncio.Event()

    def tell(self, kind: str, text: str) -> None:
        """Set the newest message of a kind."""
        self._newest[kind] = text
        self._wake.set()

    def answer(self, text: str) -> None:
        """Add an answer to a command."""
        self._answers.append(text)
        self._wake.set()

    async def next_messages(self) -> list[str]:
        """Wait for messages and return them all; the map comes before the view that is drawn on it."""
        await self._wake.wait()
        self._wake.clear()
        texts = [
            *self._answers,
            *(
                self._newest[kind]
                for kind in ("map", "layout", "goals", "cells", "haptics", "view")
                if kind in self._newest
            ),
        ]
        self._answers.clear()
        self._newest.clear()
        return texts


class Broadcaster:
    """The open pages of a chair, and the threads that call the chair. `run` keeps the pages informed."""

    def __init__(self, port: ChairPort, clock: Callable[[], float] = time.monotonic, *, edits: bool = False) -> None:
        self.port = port
        self.edits = edits  # whether the page has a building mode
        self.boot = secrets.token_hex(4)  # makes browsers drop their copy of an earlier run's map
        self.grid: tuple[int, OccupancyGrid] | None = None
        self._clock = clock
        self._calls = ThreadPoolExecutor(_THREADS, "page-call")
        self._stops = ThreadPoolExecutor(_STOP_THREADS, "page-stop")
        self._watches = ThreadPoolExecutor(1, "page-watch")  # its own thread, so that a slow call ends no drive
        self._pages: set[OpenPage] = set()
        self._answered: dict[OpenPage, float] = {}  # not by page id, which a page chooses itself
        self._failing: set[str] = set()
        self._told: dict[str, str] = {}
        self._layout_revision: int | None = None
        self._pictures: dict[tuple[int, str], bytes] = {}
        self._count = 0

    async def run(self) -> None:
        """Run until cancelled. An error in one turn is logged, and the next turn tries again."""
        async with asyncio.TaskGroup() as group:
            group.create_task(self._again(VIEW_S, self._look))
            group.create_task(self._again(WATCH_S, self._watch))

    def close(self) -> None:
        """Report to the chair that no page is left, and end the threads."""
        with self._logged("the last word of the pages"):
            self._watches.submit(self.port.watched, ()).result()
        for threads in (self._calls, self._stops, self._watches):
            threads.shutdown(cancel_futures=True)

    def join(self, page: OpenPage) -> None:
        """Add an open page, and send it everything."""
        self._pages.add(page)
        outline = self.port.outline.tolist()
        page.answer(encoded({"type": "chair", "boot": self.boot, "outline": outline, "edits": self.edits}))
        for kind, text in self._told.items():
            page.tell(kind, text)
        self.answered(page)

    def leave(self, page: OpenPage) -> None:
        """Remove a page after its socket was closed; it counts as present until its latest answer is too old."""
        self._pages.discard(page)

    def answered(self, page: OpenPage) -> None:
        """Note that a visible page has answered."""
        self._answered[page] = self._clock()

    def hidden(self, page: OpenPage) -> None:
        """Note that a page is hidden: nobody can press its Stop."""
        self._answered.pop(page, None)

    def there(self) -> tuple[str, ...]:
        """Return the ids of the pages that are present."""
        since = self._clock() - ANSWERS_S
        self._answered = {page: at for page, at in self._answered.items() if at > since}
        return tuple(dict.fromkeys(page.page_id for page in self._answered))

    async def call(self, work: Callable[[], T]) -> T:
        """Run a blocking call in a thread."""
        return await asyncio.get_running_loop().run_in_executor(self._calls, work)

    async def obey(self, name: str, asked: Json) -> PortAnswer:
        """Run a page's command in a thread."""
        threads = self._stops if name == STOP else self._calls
        return await asyncio.get_running_loop().run_in_executor(threads, partial(obey, self.port, name, asked))

    async def picture(self, theme: str) -> tuple[str, bytes] | None:
        """Return the map's picture with its ETag; None while there is no map."""
        if self.grid is None:
            return None
        revision, grid = self.grid
        if (revision, theme) not in self._pictures:
            picture = await self.call(lambda: grid_picture(grid, theme))
            self._pictures = {key: value for key, value in self._pictures.items() if key[0] == revision}
            self._pictures[revision, theme] = picture
        return f'"{self.boot}-{revision}-{theme}"', self._pictures[revision, theme]

    async def _again(self, every_s: float, turn: Callable[[], Awaitable[None]]) -> None:
        while True:
            began = self._clock()
            with self._logged(turn.__name__):
                await turn()
            await asyncio.sleep(max(0.0, every_s - (self._clock() - began)))

    @contextmanager
    def _logged(self, what: str) -> Iterator[None]:
        """Log an error in the block, once until it works again."""
        try:
            yield
        except Exception:
            if what not in self._failing:
                logging.getLogger(__name__).exception(
                    "'%s' failed: pages get no such messages until it works again", what
                )
            self._failing.add(what)
        else:
            self._failing.discard(what)

    async def _look(self) -> None:
        self._count += 1
        for kind, text in (await self.call(self._messages)).items():
            self._told[kind] = text
            for page in self._pages:
                page.tell(kind, text)
        if self._count % GOALS_EVERY == 1:
            with self._logged("goals"):
                await self._tell_goals()
        if self._count % CELLS_EVERY == 0:
            with self._logged("haptics"):
                await self._tell_haptics()
        watching = [page for page in self._pages if page.shows_cells] if self._count % CELLS_EVERY == 0 else []
        if watching:
            text = await self.call(lambda: cells_message(self.port.perception()))
            for page in watching:
                page.tell("cells", text)

    async def _tell_goals(self) -> None:
        text = await self.call(lambda: goals_message(self.port.goals()))
        if text != self._told.get("goals", goals_message(())):
            self._told["goals"] = text
            for page in self._pages:
                page.tell("goals", text)

    async def _tell_haptics(self) -> None:
        text = await self.call(lambda: haptics_message(self.port.haptics()))
        if text != self._told.get("haptics", NO_HAPTICS):
            self._told["haptics"] = text
            for page in self._pages:
                page.tell("haptics", text)

    def _messages(self) -> dict[str, str]:
        """Return the new messages by kind."""
        view, texts = self.port.view(), {}
        with self._logged("map"):
            if (self.grid is None or self.grid[0] != view.map_revision) and (grid := self.port.grid()) is not None:
                texts["map"] = map_message(grid, view.map_revision)
                self.grid = view.map_revision, grid
        with self._logged("layout"):
            if self._layout_revision != view.layout_revision:
                texts["layout"] = layout_message(self.port.layout())
                self._layout_revision = view.layout_revision
        texts["view"] = view_message(view, self._count)
        return texts

    async def _watch(self) -> None:
        await asyncio.get_running_loop().run_in_executor(self._watches, self.port.watched, self.there())


class CommandRunner:
    """Runs one page's commands in order; Stop runs at once, and of joystick positions only the newest counts."""

    def __init__(self, broadcaster: Broadcaster, page: OpenPage) -> None:
        self._broadcaster = broadcaster
        self._page = page
        self._wishes: deque[tuple[str, Json, object]] = deque()
        self._wished = asyncio.Event()
        self._held = False
        self._others: asyncio.Queue[tuple[str, Json, object]] = asyncio.Queue(MOST_WAITING)
        self._stopping: set[asyncio.Task[None]] = set()

    async def run(self) -> None:
        """Run until cancelled; a joystick that is still held is then let go."""
        try:
            async with asyncio.TaskGroup() as group:
                group.create_task(self._obey_stick())
                group.create_task(self._obey_others())
        finally:
            if self._held:
                await asyncio.shield(self._broadcaster.obey(RELEASE, {}))

    def take(self, name: str, asked: Json, number: object) -> None:
        """Take a command; its answer carries `number`."""
        if name == STOP:
            self._forget_stick()
            task = asyncio.create_task(self._obey(name, asked, number))
            self._stopping.add(task)
            task.add_done_callback(self._stopping.discard)
        elif name in STICK:
            self._forget_stick()
            self._held = name != RELEASE
            self._wishes.append((name, asked, number))
            self._wished.set()
        elif self._others.full():
            self._say(number, PortAnswer(False, "the chair is still busy with earlier commands: wait a moment"))
        else:
            self._others.put_nowait((name, asked, number))

    def _forget_stick(self) -> None:
        """Drop waiting joystick positions, but keep a release: without it two holds would be one."""
        self._wishes = deque(wish for wish in self._wishes if wish[0] == RELEASE)

    async def _obey_stick(self) -> None:
        while True:
            await self._wished.wait()
            self._wished.clear()
            while self._wishes:
                await self._obey(*self._wishes.popleft())

    async def _obey_others(self) -> None:
        while True:
            await self._obey(*await self._others.get())

    async def _obey(self, name: str, asked: Json, number: object) -> None:
        self._say(number, await self._broadcaster.obey(name, asked))

    def _say(self, number: object, answer: PortAnswer) -> None:
        self._page.answer(encoded({"type": "answer", "id": number, "done": answer.done, "sentence": answer.sentence}))
