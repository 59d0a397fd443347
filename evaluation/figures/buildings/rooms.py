"""Rooms of floor plans against rooms drawn by hand, and doors and places of the simulated worlds against their plans."""

from __future__ import annotations

import os
import time
from pathlib import Path

import cv2
import numpy as np

from evaluation.scenes.buildings.room_plans import FURNISHED, TRUTH, agreement, plan_grid, plan_names, true_rooms
from waychair.maps.grid.cells import cells_from_points
from waychair.maps.rooms.floor_rooms import FloorRooms, RoomKind, rooms_of_grid
from waychair.simulation.plan.world import World, levels_of, load_world, shipped_worlds
from waychair.types import Bytes, Json, OccupancyGrid

BARS = {"empty": (0.94, 0.97), "furnished": (0.93, 0.93)}
"""Least mean precision and recall."""

ROOMS_PER_TRUE_ROOM = (340 / 367, 395 / 367)
WIDTH_ERROR, PLACES_RIGHT, SLOWEST = 0.10, 0.95, 1.0


def rooms(out: Path) -> Json:
    """Precision and recall on the plans in `ROOM_PLANS`, or room_maps of `WAYCHAIR_DATA`, all with one setting.

    Pictures of the rooms are written beside `out`, to the folder rooms.
    """
    folder = Path(os.environ.get("ROOM_PLANS") or Path(os.environ["WAYCHAIR_DATA"]) / "room_maps")
    pictures = out.with_name("rooms")
    pictures.mkdir(parents=True, exist_ok=True)
    names = plan_names(folder)
    rooms_of_grid(plan_grid(folder / f"{names[0]}.png"))  # compiles the flood
    figures: Json = {"plans": len(names)}
    passed = True
    for kind, suffix in (("empty", ".png"), ("furnished", FURNISHED)):
        scored, seconds = [], []
        for name in names:
            grid, true = plan_grid(folder / (name + suffix)), true_rooms(folder / (name + TRUTH))
            begin = time.process_time()
            found = rooms_of_grid(grid)
            seconds.append(time.process_time() - begin)
            scored.append(agreement(found.labels.astype(np.int64), true))
            cv2.imwrite(str(pictures / f"{name}_{kind}.png"), picture(found, grid))
        precision, recall = (np.array([score[k] for score in scored]) for k in (0, 1))
        count, wanted = sum(score.rooms for score in scored), sum(_count(folder, name) for name in names)
        low, high = ROOMS_PER_TRUE_ROOM
        passed &= bool(precision.mean() >= BARS[kind][0] and recall.mean() >= BARS[kind][1])
        passed &= low <= count / wanted <= high and max(seconds) <= SLOWEST
        figures |= {
            f"{kind}_precision": round(float(precision.mean()), 4),
            f"{kind}_precision_sd": round(float(precision.std()), 4),
            f"{kind}_recall": round(float(recall.mean()), 4),
            f"{kind}_recall_sd": round(float(recall.std()), 4),
            f"{kind}_rooms": count,
            "true_rooms": wanted,
            f"{kind}_slowest_s": round(max(seconds), 3),
            f"{kind}_each": {
                name: [round(score.precision, 3), round(score.recall, 3), score.rooms]
                for name, score in zip(names, scored, strict=True)
            },
        }
    worlds = world_rooms(pictures)
    passed &= worlds["doors_found"] + worlds["doors_behind_furniture"] == worlds["doors"]
    passed &= worlds["places_right"] >= PLACES_RIGHT * worlds["places"]
    return {"passed": passed, **figures, **worlds}


def _count(folder: Path, name: str) -> int:
    return int(true_rooms(folder / (name + TRUTH)).max())


def world_rooms(pictures: Path) -> Json:
    """Return how many doors and places of the simulated worlds are found, from the worlds' own grids.

    A door with furniture before it is measured as wide as the furniture leaves it; it is counted apart.
    """
    doors = found_doors = blocked = places = right = 0
    missed: list[str] = []
    for name in shipped_worlds():
        for level in levels_of(name):
            world = load_world(name, level)
            found = rooms_of_grid(world.grid)
            cv2.imwrite(str(pictures / f"world_{name}_{level}.png"), picture(found, world.grid))
            for door in world.doors:
                doors += 1
                middle = np.array([door.middle.x, door.middle.y])
                near = [o for o in found.openings if np.hypot(*(o.middle - middle)) < max(0.3, door.width / 2)]
                if any(abs(opening.width - door.width) <= WIDTH_ERROR for opening in near):
                    found_doors += 1
                elif any(opening.width < door.width for opening in near):
                    blocked += 1
                else:
                    missed.append(f"{name}/{level} {door.name}")
            for wrong in _misplaced(world, found):
                missed.append(f"{name}/{level} {wrong}")
                right -= 1
            places += len(world.places)
            right += len(world.places)
    return {
        "doors": doors,
        "doors_found": found_doors,
        "doors_behind_furniture": blocked,
        "places": places,
        "places_right": right,
        "missed": missed,
    }


def _misplaced(world: World, found: FloorRooms) -> list[str]:
    """Return the places that lie in no room, or share a room that is no corridor with a place behind another door."""
    if not world.places:
        return []
    points = np.array([[place.pose.x, place.pose.y] for place in world.places])
    numbers = [int(found.labels[row, column]) for row, column in cells_from_points(world.grid, points)]
    named = {door.name for door in world.doors}
    wrong = []
    for place, number in zip(world.places, numbers, strict=True):
        if number == 0 or found.rooms[number - 1].kind is RoomKind.SEEN:
            wrong.append(place.name)
            continue
        own = place.name in named and found.rooms[number - 1].kind is RoomKind.ROOM
        shared = [p.name for p, n in zip(world.places, numbers, strict=True) if n == number and p.name in named]
        if own and shared != [place.name]:
            wrong.append(place.name)
    return wrong


def picture(found: FloorRooms, grid: OccupancyGrid) -> Bytes:
    """Return a picture (H, W, 3): a colour for each room, grey corridors, white doors, red wider openings."""
    colours = np.random.default_rng(1).integers(60, 230, (len(found.rooms) + 1, 3)).astype(np.uint8)
    colours[0] = 0
    for room in found.rooms:
        if room.kind is RoomKind.CORRIDOR:
            colours[room.number] = 170
        elif room.kind is RoomKind.SEEN:
            colours[room.number] = (90, 60, 60)
    image = colours[found.labels]
    image[(found.labels == 0) & (grid.cells < 0)] = 40
    for opening in found.openings:
        (y0, x0), (y1, x1) = cells_from_points(grid, opening.jambs).tolist()
        cv2.line(image, (x0, y0), (x1, y1), (255, 255, 255) if opening.is_door else (0, 0, 255), 1)
    result: Bytes = image[::-1]
    return result
