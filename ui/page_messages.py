"""Messages to pages: a chair's view, layout and map as compact JSON, the map's picture as PNG."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np

from waychair.control.safety.stops import STOPS, Severity
from waychair.maps.drawn.zones import Zone
from waychair.runtime.pages.chair_port import ChairView, GoalView, LayoutView, OthersView
from waychair.runtime.pages.guide_view import GuideView
from waychair.runtime.pages.perception_view import CellView, PerceptionView
from waychair.runtime.rider.guard_view import GuardView
from waychair.runtime.rider.sentences import sentence
from waychair.types import Bytes, FloatArray, Json, OccupancyGrid, Place, Pose2

MOST_POINTS = 400
"""Greatest number of points of a scan or path in a view."""

# Occupied, free, unknown as blue, green, red: the contrast of walls against both others is 3:1 or more.
_PALETTES = {
    "light": ((74, 62, 44), (252, 253, 253), (226, 222, 217)),
    "dark": ((222, 212, 200), (58, 47, 38), (30, 24, 19)),
}
THEMES = tuple(_PALETTES)

_UNSEEN = sentence(STOPS["page_gone"].sentence).removesuffix(".")
"""The beginning of the last stop's sentence if all pages were hidden or gone."""


def encoded(message: Json) -> str:
    """Return JSON text; NaN and infinities become null."""
    return msgspec.json.encode(message).decode()


def view_message(view: ChairView, count: int) -> str:
    """Return a view as JSON text; points are x and y in turn, in centimetres in map; the page answers with `count`."""
    return encoded(
        {
            "type": "view",
            "n": count,
            "stamp": round(view.stamp_ns * 1e-9, 3),
            "pose": None if view.map_from_base is None else _rounded(view.map_from_base),
            "localisation": view.localisation.value,
            "health": round(float(view.health), 3),
            "mode": view.mode.value,
            "steered": view.steered,
            "paused": view.paused,
            "offers": view.offers,
            "storey": view.storey,
            "asks": view.asks,
            "guide": None if view.guide is None else _guide(view.guide),
            "guard": None if view.guard is None else _guard(view.guard),
            "others": None if view.others is None else _others(view.others),
            "twist": [round(float(view.twist.v), 3), round(float(view.twist.omega), 3)],
            "goal": view.goal,
            "waits": view.waits,
            "countdown": None if view.countdown_s is None else round(float(view.countdown_s), 2),
            "next": view.next_action,
            "last": view.last_stop,
            "unseen": view.last_stop.startswith(_UNSEEN),
            "obstacles": [
                {"id": each.stop_id, "text": each.sentence, "remedy": each.remedy, "reset": _takes_reset(each.stop_id)}
                for each in view.obstacles
            ],
            "scan": _centimetres(view.scan),
            "path": _centimetres(view.path),
            "people": _centimetres(view.people),
            "map": view.map_revision,
            "layout": view.layout_revision,
            "panel": {name: float(value) for name, value in view.panel.items()},
        }
    )


def _others(others: OthersView) -> Json:
    return {
        "waits": others.waits,
        "seconds": None if others.seconds is None else round(others.seconds),
        "chairs": [{"number": number, "told": told} for number, told in others.others],
        "tones": others.tones,
        "first": others.first,
        "lit": others.lit,
    }


def _guide(guide: GuideView) -> Json:
    return {
        "goal": guide.goal,
        "kind": guide.kind,
        "sentence": guide.sentence,
        "said": guide.said,
        "count": guide.count,
        "bearing": round(float(guide.bearing), 2),
        "level": guide.level,
        "arrived": guide.arrived,
        "offers": guide.offers,
    }


def _guard(guard: GuardView) -> Json:
    return {
        "level": guard.level.value,
        "told": guard.told,
        "offered": guard.offered.value,
        "waits": guard.waits,
        "caps": None if guard.caps is None else [round(float(cap), 2) for cap in guard.caps],
        "capped": guard.capped,
        "warns": guard.warns,
        "creeps": guard.creeps or guard.overridden,
        "lost": guard.lost,
    }


def cells_message(seen: PerceptionView | None) -> str:
    """Return the behaviour cells as JSON text; null values without them. Ages are in tenths of a second, places in metres."""
    if seen is None:
        return encoded({"type": "cells", "there": False})
    sectors = seen.sectors
    return encoded(
        {
            "type": "cells",
            "there": True,
            "signal": seen.signal,
            "networks": seen.networks,
            "troubles": seen.troubles,
            "cells": [
                {
                    "name": each.name,
                    "network": each.is_network,
                    "depth": each.depth,
                    "state": _cell_state(each),
                    "words": each.words,
                    "age": None if each.age_s is None else round(each.age_s, 1),
                }
                for each in seen.cells
            ],
            "sectors": {
                "count": sectors.count,
                "free": [round(angle, 4) for angle in sectors.free],
                "looked": sectors.looked,
                "words": sectors.words,
            },
            "doorways": [
                {
                    "at": [round(each.x, 2), round(each.y, 2), round(each.theta, 3)],
                    "width": round(each.width, 2),
                    "state": each.state,
                    "enough": each.wide_enough,
                    "words": each.words,
                }
                for each in seen.doorways
            ],
            "aim": None
            if seen.aim is None
            else {"pan": round(seen.aim.pan, 3), "settled": seen.aim.settled, "words": seen.aim.words},
        }
    )


def _cell_state(cell: CellView) -> str:
    if cell.fault:
        return f"at fault: {cell.fault}"
    return "inhibited" if cell.inhibited else "active" if cell.active else "at rest"


def layout_message(layout: LayoutView) -> str:
    """Return places, zones and whether there is a change to undo, as JSON text."""
    return encoded(
        {
            "type": "layout",
            "places": [_place(name, place) for name, place in layout.places.items()],
            "zones": [_zone(zone) for zone in layout.zones],
            "undoable": layout.undoable,
        }
    )


def goals_message(goals: Sequence[GoalView]) -> str:
    """Return the goals of a building as JSON text; times in steps of 10 s, so that a chair at rest sends nothing new."""
    return encoded(
        {
            "type": "goals",
            "goals": [
                {
                    "name": goal.name,
                    "path": goal.path,
                    "seconds": None if goal.seconds is None else 10 * round(goal.seconds / 10),
                    "lifts": goal.lifts,
                }
                for goal in goals
            ],
        }
    )


def map_message(grid: OccupancyGrid, revision: int) -> str:
    """Return the map's size, resolution [m] and lower-left corner in map, as JSON text."""
    rows, columns = grid.cells.shape
    return encoded(
        {
            "type": "map",
            "revision": revision,
            "cells": [columns, rows],
            "resolution": grid.resolution,
            "origin": grid.map_from_grid.array().tolist(),
        }
    )


def grid_picture(grid: OccupancyGrid, theme: str) -> bytes:
    """Return the map as a PNG, larger y up, in the colours of a light or a dark page."""
    import cv2

    occupied, free, unknown = (np.array(colour, np.float64) for colour in _PALETTES[theme])
    share = np.clip(np.arange(256) / 100.0, 0.0, 1.0)[:, None]
    colours = np.rint(free + share * (occupied - free)).astype(np.uint8)
    colours[128:] = unknown.astype(np.uint8)  # negative cells, read as unsigned
    picture: Bytes = colours[grid.cells[::-1].view(np.uint8)]
    return bytes(cv2.imencode(".png", picture)[1])


def _takes_reset(stop_id: str) -> bool:
    stop = STOPS.get(stop_id)
    return stop is not None and stop.severity is Severity.LATCHES


def _centimetres(points: FloatArray) -> list[int]:
    """Return the finite points of (N, 2) [m] in centimetres, thinned to `MOST_POINTS`, always with the last one."""
    known = points[np.isfinite(points).all(axis=1)] if len(points) else np.empty((0, 2))
    if len(known) > MOST_POINTS:
        known = known[np.linspace(0, len(known) - 1, MOST_POINTS).astype(int)]
    numbers: list[int] = np.rint(100.0 * known[:, :2]).astype(np.int64).ravel().tolist()
    return numbers


def _rounded(pose: Pose2) -> list[float]:
    return [round(float(value), 4) for value in (pose.x, pose.y, pose.theta)]


def _place(name: str, place: Place) -> Json:
    return {
        "name": name,
        "pose": place.pose.array().tolist(),
        "tolerance_m": place.tolerance_m,
        "tolerance_rad": place.tolerance_rad,
    }


def _zone(zone: Zone) -> dict[str, Any]:
    return {
        "name": zone.name,
        "rule": zone.rule.value,
        "polygon": zone.polygon.tolist(),
        "value": float(zone.value),
    }
