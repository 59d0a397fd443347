"""A whole chair without a warden: what it sees taken, how far it goes, and when it backs out."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.runtime.fleet.test_fleet_member import PLAN
from waychair.calibration.chair_body import CHAIR_A
from waychair.geometry import transform_points
from waychair.maps.traffic.corridors import corridor_graph
from waychair.planning.fleet.peers.alone import ALONE_SPEED, SEEN_AHEAD
from waychair.planning.fleet.ways import ways_of
from waychair.runtime.fleet.alone_driving import FACES_MS, LETS_PASS_MS, AloneDriver, Seen, speed_by_eye
from waychair.runtime.fleet.chain_geometry import drivable
from waychair.runtime.fleet.spot_sight import SpotSight
from waychair.simulation.plan.corridor_world import corridor_world
from waychair.trials.fleet.fleet_scenes import places_in_rooms
from waychair.types import FloatArray, Pose2

GRAPH = corridor_graph(PLAN, 1.2, rooms=True)
WAYS = drivable(ways_of(GRAPH, 0.45), CHAIR_A)
WORLD = corridor_world(PLAN, 1.2, rooms=True)
SIGHT = SpotSight(WAYS, WORLD.grid, CHAIR_A)
ROOMS = [refuge.name for refuge in GRAPH.refuges]
AT_HOME = Pose2(3.0, 1.0, 0.0)


def _thing(x: float, y: float = 3.0) -> FloatArray:
    """Return points of a chair's front at a place."""
    return np.stack([np.full(9, x), y + np.linspace(-0.3, 0.3, 9)], axis=1)


def _seen(things: FloatArray, pose: Pose2 = AT_HOME) -> Seen:
    return Seen(pose, SIGHT.taken_by(things), things)


SHARES = np.linspace(0.0, 1.0, 9)
PLACES = places_in_rooms(PLAN)
NOTHING = np.empty((0, 2))
NOSE = 0.8
START, GOAL = ROOMS[0], ROOMS[-1]
HOME = WAYS.slots[START][0]


def _section_at(chain: tuple[int, ...], x: float) -> int:
    """Return the spot of a chain at a place in the corridor."""
    for spot in chain:
        section = GRAPH.section.get(WAYS.names[spot])
        if section is not None:
            a, b = sorted((GRAPH.node[section.start].x, GRAPH.node[section.end].x))
            if a <= x < b:
                return spot
    raise AssertionError(f"the chain does not lead by {x}")


def _way() -> tuple[int, ...]:
    return AloneDriver(WAYS).step(0, HOME, GOAL, _seen(NOTHING)).chain


def test_a_thing_takes_the_section_in_which_it_stands() -> None:
    taken = SIGHT.taken_by(_thing(15.3))
    names = {WAYS.names[spot] for spot in range(len(WAYS.names)) if int(WAYS.resource[spot]) in taken}
    assert names
    for name in names & set(GRAPH.section):
        section = GRAPH.section[name]
        assert min(GRAPH.node[section.start].x, GRAPH.node[section.end].x) <= 15.4


def test_a_chair_alone_enters_only_where_it_sees_ten_metres_free() -> None:
    driver = AloneDriver(WAYS)
    way = driver.step(0, HOME, GOAL, _seen(NOTHING))
    assert way.free == len(way.chain) > 3
    assert way.tone
    places = WAYS.graph.section
    for x in (8.0, 12.0, 20.0, 25.0):
        way = driver.step(0, HOME, GOAL, _seen(_thing(x)))
        entered = [places[WAYS.names[spot]] for spot in way.chain[: way.free] if WAYS.names[spot] in places]
        begins = [min(GRAPH.node[each.start].x, GRAPH.node[each.end].x) for each in entered]
        assert all(x - begin > SEEN_AHEAD - 2.5 for begin in begins)


def test_in_single_file_it_drives_slowly() -> None:
    wide = drivable(ways_of(corridor_graph(PLAN, 1.8, rooms=True), 0.45), CHAIR_A)
    assert speed_by_eye(WAYS, _way()) == ALONE_SPEED
    assert speed_by_eye(WAYS, (HOME,)) == math.inf
    corridor = [
        spot for spot in range(len(wide.names)) if (s := wide.graph.section.get(wide.names[spot])) and s.lanes == 2
    ]
    assert corridor
    assert speed_by_eye(wide, corridor) == math.inf


def test_of_two_chairs_that_see_each_other_in_a_run_exactly_one_backs_out_and_once() -> None:
    """One comes from either end; both stand ten metres apart."""
    at = {"west": Pose2(9.0, 3.0, 0.0), "east": Pose2(19.5, 3.0, math.pi)}
    back = AloneDriver(WAYS).step(0, WAYS.slots[GOAL][0], START, _seen(NOTHING)).chain
    fronts = {"west": _section_at(_way(), 9.5), "east": _section_at(back, 19.0)}
    goals = {"west": GOAL, "east": START}
    drivers = {"west": AloneDriver(WAYS), "east": AloneDriver(WAYS)}
    for now_ms in range(0, 6 * FACES_MS, 100):
        for side, other in (("west", "east"), ("east", "west")):
            nose = at[other].x + (NOSE if other == "west" else -NOSE)
            seen = replace(_seen(_thing(nose), at[side]), nose=NOSE)
            drivers[side].step(now_ms, fronts[side], goals[side], seen)
    assert sorted(driver.retreats for driver in drivers.values()) == [0, 1]
    one = next(driver for driver in drivers.values() if driver.retreats)
    assert WAYS.at_home[one._chain[-1]]
    assert one._waits_until_ms >= LETS_PASS_MS


@pytest.mark.nightly
def test_a_chair_that_still_drives_faces_nobody() -> None:
    driver = AloneDriver(WAYS)
    front = _section_at(_way(), 9.5)
    for now_ms in range(0, 4 * FACES_MS, 100):
        pose = Pose2(8.0 + 5e-5 * now_ms, 3.0, 0.0)
        driver.step(now_ms, front, GOAL, replace(_seen(_thing(18.0), pose), nose=NOSE))
    assert driver.retreats == 0


@pytest.mark.parametrize(("x", "heading", "goal"), [(9.0, 0.0, GOAL), (19.5, math.pi, START)], ids=["west", "east"])
def test_a_chair_whose_goal_is_taken_backs_out_on_either_side(x: float, heading: float, goal: str) -> None:
    """Whoever stands in its goal leaves it only past this chair."""
    driver = AloneDriver(WAYS)
    way = AloneDriver(WAYS).step(0, WAYS.slots[START if goal == GOAL else GOAL][0], goal, _seen(NOTHING)).chain
    front = _section_at(way, x)
    place = GRAPH.node[GRAPH.refuge[goal].node]
    things = np.concatenate([_thing(x + math.copysign(5.0, math.cos(heading))), _thing(place.x, place.y)])
    for now_ms in range(0, 2 * FACES_MS, 100):
        driver.step(now_ms, front, goal, replace(_seen(things, Pose2(x, 3.0, heading)), nose=NOSE))
    assert driver.retreats == 1
    assert WAYS.names[driver._chain[-1]] != goal


def test_a_chair_that_comes_out_of_a_door_beside_another_one_goes_back_in_and_twice_at_most() -> None:
    room = ROOMS[1]
    x = PLACES[room].pose.x
    node = next(spot for spot in _way() if WAYS.names[spot].startswith("n") and _is_at(spot, x))
    heading = PLACES[room].pose.theta + math.pi  # out of the room, across the corridor
    pose = Pose2(x, 3.0 - 0.6 * math.sin(heading), heading)
    driver = AloneDriver(WAYS)
    seen = replace(_seen(_thing(x + 2.0), pose), nose=0.5)
    assert not ((seen.things - (x, 3.0)) @ (math.cos(heading), math.sin(heading)) > 0.5).any()
    inside, nothing = WAYS.slots[room][0], _seen(NOTHING, PLACES[room].pose)
    phase_ms = 2 * FACES_MS + 2 * LETS_PASS_MS
    for phase, backed_out in enumerate((1, 2, 2)):
        for time_ms in range(0, phase_ms, 100):
            at_door = time_ms < 2 * FACES_MS
            driver.step(phase * phase_ms + time_ms, *((node, GOAL, seen) if at_door else (inside, GOAL, nothing)))
        assert driver.retreats == backed_out


def _is_at(spot: int, x: float) -> bool:
    node = GRAPH.node.get(WAYS.names[spot])
    return node is not None and abs(node.x - x) < 1e-6


def test_a_chair_aside_in_a_room_leaves_the_corridor_free() -> None:
    place = PLACES[ROOMS[1]].pose
    taken = {WAYS.names[spot] for spot in range(len(WAYS.names)) if int(WAYS.resource[spot]) in _aside(place)}
    assert ROOMS[1] in taken
    assert taken.isdisjoint(section.name for section in GRAPH.sections if section.length > 2.0)
    assert not any(math.dist((node.x, node.y), (place.x, 3.0)) < 0.1 for node in GRAPH.nodes if node.name in taken)


def _aside(pose: Pose2) -> frozenset[int]:
    """Return what is taken by a chair's outline, seen from the corridor."""
    corners = transform_points(pose, CHAIR_A.outline())
    sides = [
        a + share * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True) for share in SHARES
    ]
    return SIGHT.taken_by(np.array(sides))
