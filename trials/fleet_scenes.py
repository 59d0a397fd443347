"""Scenes of several whole chairs: floors of corridors with rooms, and the goals of the demo."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from waychair.calibration.chair_body import CHAIR_A, ChairBody
from waychair.errors import TaskError
from waychair.maps.traffic.corridors import NARROW, CorridorPlan, corridor_graph, room_doors
from waychair.simulation.plan.corridor_world import ROOM_SIDE, corridor_world
from waychair.simulation.scene.seeds import seed_from_names
from waychair.trials.fleet_drive import FleetScene
from waychair.types import Place, Pose2

BEFORE_WALL = 0.10
"""m; between a chair's front and the wall of its room."""


def places_in_rooms(plan: CorridorPlan, body: ChairBody = CHAIR_A) -> Mapping[str, Place]:
    """Return the pose of a chair in each room of a plan: facing away from its door, as deep inside as it can stand."""
    found = {}
    for name, (door, room) in room_doors(plan).items():
        heading = math.atan2(room[1] - door[1], room[0] - door[0])
        way = ROOM_SIDE / 2 - BEFORE_WALL - body.front
        pose = Pose2(room[0] + way * math.cos(heading), room[1] + way * math.sin(heading), heading)
        found[name] = Place(name, pose)
    return found


def rooms_scene(
    plan: CorridorPlan, chairs: int, goals: int, seed: int, *, width: float = NARROW, bays: bool = True
) -> FleetScene:
    """Return chairs in random rooms of a plan with random goals in others, one after the other.

    Goals of one round differ, and no chair's last goal is a goal of another one, so that nobody waits for a parked chair.

    Raises:
        TaskError: there are too few rooms for so many chairs.
    """
    graph = corridor_graph(plan, width, rooms=True, bays=bays)
    names = [refuge.name for refuge in graph.refuges]
    most = len(names) // 2 - 1
    if not 1 <= chairs <= most:
        raise TaskError(
            f"{plan.name} has {len(names)} rooms, not enough for {chairs} chairs with goals: give 1 to {most}"
        )
    random = np.random.default_rng(seed_from_names("fleet drive", plan.name, seed))
    starts = [names[k] for k in random.permutation(len(names))[:chairs].tolist()]
    last = [names[k] for k in random.permutation(len(names))[:chairs].tolist()]
    rounds = [starts]
    for _ in range(goals - 1):
        others = [name for name in names if name not in last]
        chosen = rounds[-1]
        while any(a == b for a, b in zip(chosen, rounds[-1], strict=True)):
            chosen = [others[k] for k in random.permutation(len(others))[:chairs].tolist()]
        rounds.append(chosen)
    wishes = [tuple(own) for own in zip(*rounds[1:], last, strict=True)]
    return FleetScene(
        world=corridor_world(plan, width, rooms=True),
        graph=graph,
        places=places_in_rooms(plan),
        starts=tuple(starts),
        goals=tuple(wishes),
        seed=seed,
    )
