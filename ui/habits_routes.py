"""The routes of the rider's own record: what there is, yes, no, erase, and the table to take away."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict
from typing import TYPE_CHECKING

from waychair.control.guidance.practice import Decision
from waychair.errors import WaychairError
from waychair.runtime.habits import DecisionRow, DriveRow, Habits
from waychair.types import Json
from waychair.ui.guard import API

if TYPE_CHECKING:
    from starlette.requests import Request
    from starlette.responses import Response
    from starlette.routing import Route

_NO_STORE = {"cache-control": "no-store"}


def habits_view(habits: Habits) -> Json:
    """Return the record for a page: its drives, and the decisions and the present level of each place."""
    rows, practice = habits.rows(), habits.practice()
    right: Counter[str] = Counter()
    other: Counter[str] = Counter()
    for row in rows:
        if isinstance(row, DecisionRow):
            (right if row.done == Decision.FOLLOWED else other)[row.place] += 1
    return {
        "wanted": habits.wanted,
        "trouble": habits.trouble,
        "drives": [asdict(row) for row in rows if isinstance(row, DriveRow)],
        "places": [
            {"name": name, "right": right[name], "other": other[name], "level": known.level}
            for name, known in practice.items()
        ],
    }


def habits_routes(habits: Habits | None) -> list[Route]:
    """Return the routes; only pages that the server's guard lets in reach them. Where no record is kept, a look finds null."""
    from starlette.concurrency import run_in_threadpool
    from starlette.responses import JSONResponse, PlainTextResponse
    from starlette.routing import Route

    async def look(_: Request) -> Response:
        return JSONResponse(None if habits is None else habits_view(habits), headers=_NO_STORE)

    if habits is None:
        return [Route(API + "habits", look)]
    changes: dict[str, tuple[Callable[[], None], str]] = {
        "yes": (habits.say_yes, "your drives are remembered on this chair"),
        "no": (habits.say_no, "nothing more is remembered"),
        "erase": (habits.erase, "everything was erased"),
    }

    async def table(_: Request) -> Response:
        headers = {**_NO_STORE, "content-disposition": 'attachment; filename="habits.csv"'}
        return PlainTextResponse(habits.csv(), headers=headers, media_type="text/csv")

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
        Route(API + "habits", look),
        Route(API + "habits.csv", table),
        Route(API + "habits/{what}", change, methods=["POST"]),
    ]
