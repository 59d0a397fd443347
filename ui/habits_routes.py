"""The rider's own records on the page: habits of guided ways, and drives led by touch for the trainer."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict
from typing import TYPE_CHECKING

from waychair.control.guidance.practice import RiderDecision
from waychair.runtime.haptics.session_log import SessionLog
from waychair.runtime.rider.habits import DecisionRow, DriveRow, Habits
from waychair.types import Json
from waychair.ui.record_routes import record_routes

if TYPE_CHECKING:
    from starlette.routing import Route


def habits_view(habits: Habits) -> Json:
    """Return the record for a page: its drives, and the decisions and the present level of each place."""
    rows, practice = habits.rows(), habits.practice()
    right: Counter[str] = Counter()
    other: Counter[str] = Counter()
    for row in rows:
        if isinstance(row, DecisionRow):
            (right if row.done == RiderDecision.FOLLOWED else other)[row.place] += 1
    return {
        "wanted": habits.wanted,
        "trouble": habits.trouble,
        "drives": [asdict(row) for row in rows if isinstance(row, DriveRow)],
        "places": [
            {"name": name, "right": right[name], "other": other[name], "level": known.level}
            for name, known in practice.items()
        ],
    }


def session_log_view(log: SessionLog) -> Json:
    """Return the record of drives led by touch for a page."""
    return {"wanted": log.wanted, "trouble": log.trouble, "drives": [asdict(row) for row in log.rows()]}


def habits_routes(habits: Habits | None) -> list[Route]:
    """Return the routes of the rider's habits; see `record_routes`."""
    yes = "your drives are remembered on this chair"
    return record_routes("habits", habits, lambda: None if habits is None else habits_view(habits), yes)


def session_log_routes(log: SessionLog | None) -> list[Route]:
    """Return the routes of the trainer's record; see `record_routes`."""
    yes = "your guided drives are recorded on this chair, for your trainer"
    return record_routes("session_log", log, lambda: None if log is None else session_log_view(log), yes)
