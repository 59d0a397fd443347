"""One loop looks at the chair and tells every open page; another tells the chair which pages still answer.

A page that cannot keep up is told the newest only. What blocks (the chair's own calls, pictures) runs in threads, and
Stop has threads of its own, so that nothing can stand before it.
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

from waychair.runtime.chair_port import Answer, ChairPort
from waychair.types import Json, OccupancyGrid
from waychair.ui.commands import RELEASE, STICK, STOP, obey
from waychair.ui.wire import encoded, grid_picture, layout_message, map_message, view_message

T = TypeVar("T")

VIEW_S = 0.1
"""Pages are told how the chair is this often."""

WATCH_S = 0.1
"""The chair is told of the pages that answer this often."""

ANSWERS_S = 0.2
"""A page counts as there for so long after its latest answer; the chair waits longer (`runtime.page_watch`)."""

MOST_WAITING = 50
"""A page has no more commands under way than these: more would be a broken page."""

_THREADS = 8
_STOP_THREADS = 2


class OpenPage:
    """What waits to be sent to one page: of views, maps and layouts only the newest."""

    def __init__(self, page_id: str) -> None:
        self.page_id = page_id
        self._newest: dict[str, str] = {}
        self._answers: deque[str] = deque(maxlen=MOST_WAITING)
        self._wake = asyncio.Event()

    def tell(self, kind: str, text: str) -> None:
        """The newest message of its kind."""
        self._newest[kind] = text
        self._wake.set()

    def answer(self, text: str) -> None:
        """An answer to a command."""
        self._answers.append(text)
        self._wake.set()

    async def next_messages(self) -> list[str]:
        """Whatever there is to send, once there is something; the map comes before the view that is drawn on it."""
        await self._wake.wait()
        self._wake.clear()
        texts = [*self._answers, *(self._newest[kind] for kind in ("map", "layout", "view") if kind in self._newest)]
        self._answers.clear()
        self._newest.clear()
        return texts


class Broadcaster:
    """The chair's pages, and the threads in which the chair is asked and told. `run` keeps them informed."""

    def __init__(self, port: ChairPort, clock: Callable[[], float] = time.monotonic) -> None:
        self.port = port
        self.boot = secrets.token_hex(4)  # so that a browser's copy of an earlier run's map is no longer good
        self.grid: tuple[int, OccupancyGrid] | None = None
        self._clock = clock
        self._calls = ThreadPoolExecutor(_THREADS, "page-call")
        self._stops = ThreadPoolExecutor(_STOP_THREADS, "page-stop")
        self._watches = ThreadPoolExecutor(1, "page-watch")  # no call that takes its time ends a drive
        self._pages: set[OpenPage] = set()
        self._answered: dict[OpenPage, float] = {}  # not by their ids: a duplicated tab has that of its twin
        self._failing: set[str] = set()
        self._told: dict[str, str] = {}
        self._layout_revision: int | None = None
        self._pictures: dict[tuple[int, str], bytes] = {}
        self._count = 0

    async def run(self) -> None:
        """Until cancelled. What fails in a turn is logged, and tried again in the next one."""
        async with asyncio.TaskGroup() as group:
            group.create_task(self._again(VIEW_S, self._look))
            group.create_task(self._again(WATCH_S, self._watch))

    def close(self) -> None:
        """No page is left."""
        with self._logged("the last word of the pages"):
            self._watches.submit(self.port.watched, ()).result()
        for threads in (self._calls, self._stops, self._watches):
            threads.shutdown(cancel_futures=True)

    def join(self, page: OpenPage) -> None:
        """A page is open: it is told all there is."""
        self._pages.add(page)
        outline = self.port.outline.tolist()
        page.answer(encoded({"type": "chair", "boot": self.boot, "outline": outline}))
        for kind, text in self._told.items():
            page.tell(kind, text)
        self.answered(page)

    def leave(self, page: OpenPage) -> None:
        """A page's socket is closed; it still counts as there until its latest answer is too old."""
        self._pages.discard(page)

    def answered(self, page: OpenPage) -> None:
        """A page has answered, with somebody before it."""
        self._answered[page] = self._clock()

    def hidden(self, page: OpenPage) -> None:
        """A page lies behind others: nobody can press its Stop."""
        self._answered.pop(page, None)

    def there(self) -> tuple[str, ...]:
        """The ids of the pages that have answered lately."""
        since = self._clock() - ANSWERS_S
        self._answered = {page: at for page, at in self._answered.items() if at > since}
        return tuple(dict.fromkeys(page.page_id for page in self._answered))

    async def call(self, work: Callable[[], T]) -> T:
        """Something that may block, in a thread."""
        return await asyncio.get_running_loop().run_in_executor(self._calls, work)

    async def obey(self, name: str, asked: Json) -> Answer:
        """A page's command."""
        threads = self._stops if name == STOP else self._calls
        return await asyncio.get_running_loop().run_in_executor(threads, partial(obey, self.port, name, asked))

    async def picture(self, theme: str) -> tuple[str, bytes] | None:
        """The map's picture and its tag; None while there is no map."""
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
        """What fails in the block is logged, once until it works again."""
        try:
            yield
        except Exception:
            if what not in self._failing:
                logging.getLogger(__name__).exception("pages are told less: '%s' failed", what)
            self._failing.add(what)
        else:
            self._failing.discard(what)

    async def _look(self) -> None:
        self._count += 1
        for kind, text in (await self.call(self._messages)).items():
            self._told[kind] = text
            for page in self._pages:
                page.tell(kind, text)

    def _messages(self) -> dict[str, str]:
        """What is new, by kind."""
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


class Desk:
    """Takes one page's commands: in turn, but for Stop, and for the stick, of which only the newest wish counts."""

    def __init__(self, broadcaster: Broadcaster, page: OpenPage) -> None:
        self._broadcaster = broadcaster
        self._page = page
        self._wishes: deque[tuple[str, Json, object]] = deque()
        self._wished = asyncio.Event()
        self._held = False
        self._others: asyncio.Queue[tuple[str, Json, object]] = asyncio.Queue(MOST_WAITING)
        self._stopping: set[asyncio.Task[None]] = set()

    async def run(self) -> None:
        """Until cancelled; a stick that was still held is let go."""
        try:
            async with asyncio.TaskGroup() as group:
                group.create_task(self._obey_stick())
                group.create_task(self._obey_others())
        finally:
            if self._held:
                await asyncio.shield(self._broadcaster.obey(RELEASE, {}))

    def take(self, name: str, asked: Json, number: object) -> None:
        """A command as it comes in; `number` comes back with its answer."""
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
            self._say(number, Answer(False, "the chair is still busy with what it was asked: wait a moment"))
        else:
            self._others.put_nowait((name, asked, number))

    def _forget_stick(self) -> None:
        """Drops what is not done yet, but for a letting go: the next hold is another one."""
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

    def _say(self, number: object, answer: Answer) -> None:
        self._page.answer(encoded({"type": "answer", "id": number, "done": answer.done, "sentence": answer.sentence}))
