"""The page's server: static files, one socket per page, and commands by socket and by POST to a `ChairPort`.

    with page_server(port, http_port=8000) as address: ...  # this computer only
    with page_server(port, host="0.0.0.0", token=secrets.token_urlsafe(16)) as address: ...

On the socket (/api/live) a page first sends `{"token", "page"}`. It then receives the messages of `wire`, with ten views
a second, answers each view with `{"seen": n, "visible": bool}`, asks for the behaviour cells with `{"cells": bool}`, and
sends commands as `{"do": name, "with": {...}, "id": n}` (`commands`). All commands except the joystick's can also be
POSTed to /api/do/NAME, a second path for Stop.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import AsyncIterator, Iterator, Sequence
from contextlib import asynccontextmanager, contextmanager
from typing import TYPE_CHECKING

import msgspec

from waychair.errors import MissingExtra
from waychair.install_advice import install_command
from waychair.runtime.haptics.session_log import SessionLog
from waychair.runtime.pages.chair_port import ChairPort
from waychair.runtime.rider.habits import Habits
from waychair.ui.broadcaster import Broadcaster, CommandRunner, OpenPage
from waychair.ui.commands import COMMANDS, STICK
from waychair.ui.editor.server import editor_routes
from waychair.ui.editor.session import Session
from waychair.ui.guard import API, LIVE, RequestGuard, is_token
from waychair.ui.habits_routes import habits_routes, session_log_routes
from waychair.ui.page_messages import THEMES
from waychair.ui.serving import LARGEST_MESSAGE, STATIC, served

if TYPE_CHECKING:
    from fastapi import FastAPI, WebSocket
    from starlette.requests import Request
    from starlette.responses import Response

HELLO_S = 5.0
"""A socket without a valid token after this time is closed."""

UNAUTHORISED = 4401
"""Close code of a socket with a missing or wrong token."""

_NO_JSON = (msgspec.DecodeError, ValueError, RecursionError)
"""Errors of decoding a page's text that is not JSON, or is nested too deeply."""


def app(
    port: ChairPort,
    token: str = "",
    *,
    names: Sequence[str] = (),
    local: bool = True,
    session: Session | None = None,
    habits: Habits | None = None,
    session_log: SessionLog | None = None,
) -> FastAPI:
    """Return the page of a chair as an ASGI application.

    `token`: required of every page unless empty. `local`: only localhost and loopback addresses are valid hosts;
    otherwise every address and `names`, too. `session`: a building that the page's building mode edits. `habits`: the
    rider's record; `session_log`: that of drives led by touch.

    Raises:
        MissingExtra: the extra [ui] is not installed.
    """
    try:
        from fastapi import FastAPI
        from starlette.responses import FileResponse
        from starlette.routing import Mount, Route, WebSocketRoute
        from starlette.staticfiles import StaticFiles
        from xstatic.pkg import leaflet
    except ImportError as error:
        raise MissingExtra(f"the page needs the extra [ui]: {install_command('ui')}") from error

    broadcaster = Broadcaster(port, edits=session is not None)

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        telling = asyncio.create_task(broadcaster.run())
        telling.add_done_callback(_say_why)
        try:
            yield
        finally:
            telling.cancel()
            await asyncio.gather(telling, return_exceptions=True)
            await asyncio.to_thread(broadcaster.close)

    async def index(_: Request) -> Response:
        return FileResponse(STATIC / "index.html", headers={"cache-control": "no-cache"})

    async def live(page: WebSocket) -> None:
        await _live(page, broadcaster, token)

    routes = [
        Route("/", index),
        Route(API + "grid.png", _GridEndpoint(broadcaster).answer),
        Route(API + "picture.jpg", _CameraEndpoint(broadcaster).answer),
        Route(API + "network.svg", _NetworkEndpoint(broadcaster).answer),
        Route(API + "do/{name}", _CommandEndpoint(broadcaster).answer, methods=["POST"]),
        WebSocketRoute(LIVE, live),
        *habits_routes(habits),
        *session_log_routes(session_log),
        *(() if session is None else editor_routes(session, has_chair=True)),
        Mount("/static", StaticFiles(directory=STATIC)),
        Mount("/leaflet", StaticFiles(directory=leaflet.BASE_DIR)),
    ]
    pages = FastAPI(routes=routes, docs_url=None, redoc_url=None, openapi_url=None, lifespan=lifespan)
    pages.add_middleware(RequestGuard, token=token, names=names, local=local)
    return pages


@contextmanager
def page_server(
    port: ChairPort,
    *,
    host: str = "127.0.0.1",
    http_port: int = 0,
    token: str = "",
    names: Sequence[str] = (),
    session: Session | None = None,
    habits: Habits | None = None,
    session_log: SessionLog | None = None,
) -> Iterator[str]:
    """Serve the page in a thread while the block lasts; yield its address. `http_port` 0 takes a free port.

    `session`: a building that the page's building mode edits. `habits`: the rider's record; `session_log`: that of drives led
    by touch.

    Raises:
        ConfigError: the page would be open to the network without a token.
        OutputError: the port is in use, not allowed, or none.
        MissingExtra: the extra [ui] is not installed.
    """

    def pages(local: bool) -> FastAPI:
        return app(port, token, names=names, local=local, session=session, habits=habits, session_log=session_log)

    with served(pages, host, http_port, token) as address:
        yield address


async def _live(page: WebSocket, broadcaster: Broadcaster, token: str) -> None:
    """Serve one page's socket, from its first message to its end."""
    from starlette.websockets import WebSocketDisconnect

    await page.accept()
    try:
        hello = msgspec.json.decode(await asyncio.wait_for(page.receive_text(), HELLO_S))
        page_id = str(hello.get("page", ""))[:64] if isinstance(hello, dict) else ""
        if not page_id or not is_token(str(hello.get("token", "")), token):
            await page.close(UNAUTHORISED, "the token is missing or wrong")
            return
    except (TimeoutError, *_NO_JSON, KeyError, WebSocketDisconnect):
        with contextlib.suppress(RuntimeError, WebSocketDisconnect):  # it may be gone already
            await page.close(UNAUTHORISED, "the first message has no page and token")
        return
    opened = OpenPage(page_id)
    desk = CommandRunner(broadcaster, opened)
    broadcaster.join(opened)
    tasks = [
        asyncio.create_task(work) for work in (_hear(page, broadcaster, opened, desk), _tell(page, opened), desk.run())
    ]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        broadcaster.leave(opened)
        for task in tasks:
            task.cancel()
        await asyncio.wait(tasks)
        no_news = (WebSocketDisconnect, *_NO_JSON, KeyError, type(None))  # it went away, or sent an invalid message
        for task in tasks:
            if not task.cancelled() and not isinstance(task.exception(), no_news):
                logging.getLogger(__name__).error("the connection to a page failed", exc_info=task.exception())


async def _hear(page: WebSocket, broadcaster: Broadcaster, opened: OpenPage, desk: CommandRunner) -> None:
    """Take a page's messages until its socket closes or an invalid message comes."""
    while True:
        said = msgspec.json.decode(await page.receive_text(), type=dict[str, object])
        if "seen" in said:
            (broadcaster.answered if said.get("visible") is True else broadcaster.hidden)(opened)
        elif "cells" in said:
            opened.shows_cells = said["cells"] is True
        elif isinstance(asked := said.get("with", {}), dict):
            desk.take(str(said.get("do", "")), asked, said.get("id"))


async def _tell(page: WebSocket, opened: OpenPage) -> None:
    """Send the waiting messages to a page, as fast as it takes them."""
    while True:
        for text in await opened.next_messages():
            await page.send_text(text)


class _GridEndpoint:
    """The map's picture, with an ETag so that a browser loads it only once."""

    def __init__(self, broadcaster: Broadcaster) -> None:
        self._broadcaster = broadcaster

    async def answer(self, request: Request) -> Response:
        from starlette.responses import Response

        theme = request.query_params.get("theme", THEMES[0])
        found = await self._broadcaster.picture(theme) if theme in THEMES else None
        if found is None:
            return Response(status_code=404)
        tag, picture = found
        headers = {"etag": tag, "cache-control": "private, no-cache"}
        if request.headers.get("if-none-match") == tag:
            return Response(status_code=304, headers=headers)
        return Response(picture, media_type="image/png", headers=headers)


class _CameraEndpoint:
    """The camera's latest picture, as JPEG."""

    def __init__(self, broadcaster: Broadcaster) -> None:
        self._broadcaster = broadcaster

    async def answer(self, _: Request) -> Response:
        from starlette.responses import Response

        picture = await self._broadcaster.call(self._broadcaster.port.picture)
        headers = {"cache-control": "no-store"}
        if picture is None:
            return Response(status_code=204, headers=headers)
        return Response(picture, media_type="image/jpeg", headers=headers)


class _NetworkEndpoint:
    """The picture of one network of behaviour cells, as SVG."""

    def __init__(self, broadcaster: Broadcaster) -> None:
        self._broadcaster = broadcaster

    async def answer(self, request: Request) -> Response:
        from starlette.responses import Response

        name = request.query_params.get("name", "")
        picture = await self._broadcaster.call(lambda: self._broadcaster.port.network(name))
        if picture is None:
            return Response(status_code=404)
        return Response(picture, media_type="image/svg+xml", headers={"cache-control": "private, no-cache"})


class _CommandEndpoint:
    """A command by POST."""

    def __init__(self, broadcaster: Broadcaster) -> None:
        self._broadcaster = broadcaster

    async def answer(self, request: Request) -> Response:
        from starlette.responses import JSONResponse

        name = request.path_params["name"]
        if name not in COMMANDS or name in STICK:  # the joystick needs a socket: the end of the socket lets it go
            return JSONResponse({"done": False, "sentence": "unknown command: reload this page"}, 404)
        body = b""
        async for part in request.stream():
            body += part
            if len(body) > LARGEST_MESSAGE:
                return JSONResponse(
                    {"done": False, "sentence": f"the command has more than {LARGEST_MESSAGE} bytes"}, 413
                )
        try:
            asked = msgspec.json.decode(body or b"{}", type=dict[str, object])
        except _NO_JSON:
            return JSONResponse({"done": False, "sentence": "the arguments are no JSON object"}, 400)
        answer = await self._broadcaster.obey(name, asked)
        return JSONResponse({"done": answer.done, "sentence": answer.sentence})


def _say_why(task: asyncio.Task[None]) -> None:
    """Log a failed broadcaster. Its pages notice the silence themselves, and the chair the missing pages."""
    if not task.cancelled() and (error := task.exception()) is not None:
        logging.getLogger(__name__).error("the page gets no more messages", exc_info=error)
