"""The editor's server: its page, the building as JSON, and edits by POST to a `Session`.

    with editor_server(session, http_port=8001) as address: ...

Each POST to /api/building/NAME names the `revision` that its page has seen and is answered by what has changed since then;
an edit that cannot be done, by a sentence. Requests are guarded as the rider's page is (`guard`).
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import msgspec

from waychair.errors import BuildingError, MissingExtra, WaychairError
from waychair.install_advice import install_command
from waychair.maps.editing.addresses import node_ref
from waychair.maps.editing.building_edits import AddStorey
from waychair.maps.editing.lift_edits import SetLift
from waychair.maps.editing.map_edits import patch_between
from waychair.types import Json
from waychair.ui.editor import work
from waychair.ui.editor.session import Session
from waychair.ui.editor.view import changes, whole
from waychair.ui.guard import API, RequestGuard
from waychair.ui.page_messages import THEMES, grid_picture
from waychair.ui.serving import STATIC, served

if TYPE_CHECKING:
    from fastapi import FastAPI
    from starlette.requests import Request
    from starlette.responses import Response
    from starlette.routing import BaseRoute

ROOT = f"{API}building"

MOST_BYTES = 64 * 1024 * 1024
"""Largest body of a request: an imported file."""


def editor_routes(session: Session, *, has_chair: bool = False) -> list[BaseRoute]:
    """Return the routes of the editor: its page at /building, and its API. `has_chair`: the page has a Stop button."""
    from starlette.responses import FileResponse
    from starlette.routing import Route

    desk = _Desk(session, has_chair)

    async def page(_: Request) -> Response:
        return FileResponse(STATIC / "building.html", headers={"cache-control": "no-cache"})

    return [
        Route("/building", page),
        Route(ROOT, desk.whole),
        Route(f"{ROOT}/news", desk.news),
        Route(f"{ROOT}/maps", desk.maps),
        Route(f"{ROOT}/grid.png", desk.grid),
        Route(f"{ROOT}/export", desk.export),
        Route(f"{ROOT}/import", desk.take_file, methods=["POST"]),
        Route(f"{ROOT}/{{name}}", desk.post, methods=["POST"]),
    ]


def editor_app(session: Session, token: str = "", *, names: Sequence[str] = (), local: bool = True) -> FastAPI:
    """Return the editor's page as an ASGI application; the arguments are those of `server.app`.

    Raises:
        MissingExtra: the extra [ui] is not installed.
    """
    try:
        from fastapi import FastAPI
        from starlette.responses import RedirectResponse
        from starlette.routing import Mount, Route
        from starlette.staticfiles import StaticFiles
    except ImportError as error:
        raise MissingExtra(f"the page needs the extra [ui]: {install_command('ui')}") from error

    async def home(_: Request) -> Response:
        return RedirectResponse("building")

    routes = [Route("/", home), *editor_routes(session), Mount("/static", StaticFiles(directory=STATIC))]
    pages = FastAPI(routes=routes, docs_url=None, redoc_url=None, openapi_url=None)
    pages.add_middleware(RequestGuard, token=token, names=names, local=local)
    return pages


@contextmanager
def editor_server(
    session: Session, *, host: str = "127.0.0.1", http_port: int = 0, token: str = "", names: Sequence[str] = ()
) -> Iterator[str]:
    """Serve the editor in a thread while the block lasts; yield its address. Raises as `server.page_server`."""

    def pages(local: bool) -> FastAPI:
        return editor_app(session, token, names=names, local=local)

    with served(pages, host, http_port, token) as address:
        head, mark, rest = address.partition("#")
        yield f"{head}building{mark}{rest}"


class _Desk:
    """Answers the pages of one session. Work that takes long runs in threads, so that Stop and other requests do not wait."""

    def __init__(self, session: Session, has_chair: bool) -> None:
        self._session, self._has_chair = session, has_chair
        self._posts: dict[str, Callable[[dict[str, Any]], str | None]] = {
            "edit": lambda asked: session.do(asked["revision"], asked.get("op")),
            "undo": lambda asked: session.undo(asked["revision"]),
            "redo": lambda asked: session.redo(asked["revision"]),
            "save": lambda asked: session.save(asked["revision"], asked.get("over") is True),
            "take_files": self._take_files,
            "discard": lambda asked: session.discard(asked["revision"]),
            "storey": self._add_storey,
            "lift": self._add_lift,
            "generate": self._generate,
            "align": self._align,
            "cabin": self._cabin,
            "tables": self._tables,
            "drive": self._drive,
        }

    async def whole(self, _: Request) -> Response:
        return await self._answer(lambda: {"done": True, "chair": self._has_chair, **whole(self._session)})

    async def news(self, _: Request) -> Response:
        def look() -> Json:
            self._session.look()
            return {"done": True, "revision": self._session.revision, "foreign": list(self._session.foreign)}

        return await self._answer(look)

    async def maps(self, _: Request) -> Response:
        return await self._answer(lambda: {"done": True, "maps": work.map_folders(self._session.folder)})

    async def grid(self, request: Request) -> Response:
        """The picture of a storey's map; its geometry is in the header `x-geometry`: columns, rows, m, x, y, theta."""
        from starlette.responses import Response

        storey, theme = request.query_params.get("storey", ""), request.query_params.get("theme", THEMES[0])
        try:
            grid = await asyncio.to_thread(work.map_of, self._session, storey)
        except WaychairError:
            return Response(status_code=204)
        rows, columns = grid.cells.shape
        pose = grid.map_from_grid
        geometry = f"{columns} {rows} {grid.resolution!r} {pose.x!r} {pose.y!r} {pose.theta!r}"
        picture = await asyncio.to_thread(grid_picture, grid, theme if theme in THEMES else THEMES[0])
        headers = {"x-geometry": geometry, "cache-control": "no-store"}
        return Response(picture, media_type="image/png", headers=headers)

    async def export(self, request: Request) -> Response:
        from starlette.responses import JSONResponse, Response

        try:
            name, data = await asyncio.to_thread(work.exported, self._session, request.query_params.get("format", ""))
        except WaychairError as error:
            return JSONResponse({"done": False, "sentence": str(error)}, 400)
        headers = {"content-disposition": f'attachment; filename="{name}"', "cache-control": "no-store"}
        return Response(data, media_type="application/octet-stream", headers=headers)

    async def take_file(self, request: Request) -> Response:
        data = await _body(request)

        def take() -> str:
            session = self._session
            hgraph, grids, notes = work.imported(request.query_params.get("name", ""), data)
            if grids and session.draft.hgraph.storeys:
                raise BuildingError("a file with maps makes a new building: open the editor on an empty folder")
            return work.take_import(session, int(request.query_params.get("revision", "0")), hgraph, grids, notes)

        return await self._change(take)

    async def post(self, request: Request) -> Response:
        from starlette.responses import JSONResponse

        done = self._posts.get(request.path_params["name"])
        if done is None:
            return JSONResponse({"done": False, "sentence": "unknown command: reload this page"}, 404)
        try:
            asked = msgspec.json.decode(await _body(request), type=dict[str, Any])
            asked["revision"] = msgspec.convert(asked.get("revision"), int)
        except (ValueError, RecursionError):
            return JSONResponse({"done": False, "sentence": "the command is no JSON object with a revision"}, 400)
        return await self._change(lambda: done(asked))

    async def _change(self, doing: Callable[[], str | None]) -> Response:
        """Do something, and answer by what has changed."""

        def do() -> Json:
            before = self._session.draft
            sentence = doing() or ""
            return {"done": True, "sentence": sentence, **changes(self._session, before)}

        return await self._answer(do)

    async def _answer(self, asked: Callable[[], Json]) -> Response:
        from starlette.responses import Response

        try:
            answer = await asyncio.to_thread(asked)
        except WaychairError as error:
            answer = {"done": False, "sentence": str(error), "revision": self._session.revision}
        except Exception:  # every press of a button gets an answer
            logging.getLogger(__name__).exception("an edit failed")
            answer = {
                "done": False,
                "sentence": "the editor's program failed at this: see its log; nothing was changed",
            }
        return Response(
            msgspec.json.encode(answer), media_type="application/json", headers={"cache-control": "no-store"}
        )

    def _add_storey(self, asked: dict[str, Any]) -> str:
        try:
            storey = msgspec.convert(asked.get("op"), AddStorey)
        except msgspec.ValidationError as error:
            raise BuildingError(f"the storey is invalid: {error}") from error
        return work.add_storey(self._session, asked["revision"], storey)

    def _add_lift(self, asked: dict[str, Any]) -> str:
        try:
            lift, stops = msgspec.convert(asked.get("op"), SetLift), msgspec.convert(asked.get("stops"), list[str])
        except msgspec.ValidationError as error:
            raise BuildingError(f"the lift is invalid: {error}") from error
        return work.join_by_lift(self._session, asked["revision"], lift, stops)

    def _take_files(self, asked: dict[str, Any]) -> str:
        failed = self._session.take_files(asked["revision"])
        return (
            f"{len(failed)} edits could not be done again." if failed else "Your edits were done again on these files."
        )

    def _generate(self, asked: dict[str, Any]) -> str:
        session, storey = self._session, str(asked.get("storey", ""))
        before = session.draft
        after, said = work.generated(session, storey)
        session.do_operation(
            asked["revision"], patch_between(f"make the graph of '{storey}' from its map", before, after)
        )
        return said

    def _align(self, asked: dict[str, Any]) -> str:
        session, storey = self._session, str(asked.get("storey", ""))
        before, hgraph = session.draft, work.aligned(session, storey)
        if hgraph is before.hgraph:
            return "The lifts of this storey are in line already."
        after = replace(before, hgraph=hgraph)
        session.do_operation(asked["revision"], patch_between(f"lay '{storey}' on the other storeys", before, after))
        return f"The map of '{storey}' was laid on the others by its lifts."

    def _cabin(self, asked: dict[str, Any]) -> str:
        """Find the cabin before a stop on the map, and give it to the stop; the lift takes its sizes if it has none."""
        session = self._session
        ref = node_ref(str(asked.get("at", "")))
        return work.set_cabin(session, asked["revision"], str(asked.get("lift", "")), ref)

    def _tables(self, asked: dict[str, Any]) -> str:
        return self._session.make_tables(asked["revision"])

    def _drive(self, asked: dict[str, Any]) -> str:
        draft = self._session.draft
        storey, one, other = work.ends_of_arc(draft, str(asked.get("arc", "")))
        return work.drive_along(work.map_of(self._session, storey), draft.zones_of(storey), one, other)


async def _body(request: Request) -> bytes:
    body = b""
    async for part in request.stream():
        body += part
        if len(body) > MOST_BYTES:
            raise BuildingError(
                f"the file has more than {MOST_BYTES // 2**20} MB: import it with waychair building import"
            )
    return body
