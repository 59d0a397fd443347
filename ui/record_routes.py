"""The routes of a rider's own record: its content, yes, no, erase, and the table to take away."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from waychair.errors import WaychairError
from waychair.runtime.rider.consented_rows import ConsentedRows
from waychair.types import Json
from waychair.ui.guard import API

if TYPE_CHECKING:
    from starlette.requests import Request
    from starlette.responses import Response
    from starlette.routing import Route

_NO_STORE = {"cache-control": "no-store"}


def record_routes(
    name: str, record: ConsentedRows[Any] | None, view: Callable[[], Json | None], yes: str
) -> list[Route]:
    """Return the routes of the record under /api/NAME; only pages that the server's guard lets in reach them.

    Where no record is kept, a look finds null. `view` returns the record for a page; `yes` is the answer to the rider's yes.
    """
    from starlette.concurrency import run_in_threadpool
    from starlette.responses import JSONResponse, PlainTextResponse
    from starlette.routing import Route

    async def look(_: Request) -> Response:
        if record is not None:
            await run_in_threadpool(record.look_again)
        return JSONResponse(None if record is None else view(), headers=_NO_STORE)

    if record is None:
        return [Route(f"{API}{name}", look)]
    changes: dict[str, tuple[Callable[[], None], str]] = {
        "yes": (record.say_yes, yes),
        "no": (record.say_no, "nothing more is remembered"),
        "erase": (record.erase, "everything was erased"),
    }

    async def table(_: Request) -> Response:
        await run_in_threadpool(record.look_again)
        headers = {**_NO_STORE, "content-disposition": f'attachment; filename="{name}.csv"'}
        return PlainTextResponse(record.csv(), headers=headers, media_type="text/csv")

    async def change(request: Request) -> Response:
        known = changes.get(request.path_params["what"])
        if known is None:
            return JSONResponse({"done": False, "sentence": "unknown command: reload this page"}, 404)
        act, sentence = known
        try:
            await run_in_threadpool(act)
        except WaychairError as error:
            return JSONResponse({"done": False, "sentence": str(error)})
        except Exception:  # the rider's press gets an answer
            logging.getLogger(__name__).exception("a change of the record failed")
            return JSONResponse({"done": False, "sentence": "the record could not be changed: see the chair's log"})
        return JSONResponse({"done": True, "sentence": sentence})

    return [
        Route(f"{API}{name}", look),
        Route(f"{API}{name}.csv", table),
        Route(f"{API}{name}/{{what}}", change, methods=["POST"]),
    ]
