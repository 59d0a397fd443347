"""A chair on its chain: it enters spots in turn, leaves them behind its rear, waits where it may, and names its goals."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from tests.runtime.fleet.test_fleet_member import PLAN
from waychair.calibration.chair_body import CHAIR_A
from waychair.control.authority import FREE, crosses
from waychair.geometry import transform_points
from waychair.maps.traffic.corridors import corridor_graph
from waychair.maps.traffic.mapped_floor import mapped_floor_graph
from waychair.planning.fleet.order import Order, Request, entered, parked, stopped
from waychair.planning.fleet.warden import ChairReport, Heard, WardenState, decided
from waychair.planning.fleet.ways import Ways, ways_of
from waychair.runtime.fleet.chain_driving import PATIENCE_MS, ChainDriver, Steps
from waychair.runtime.fleet.chain_geometry import TURNING_ROOM, chain_of, drivable, node_rooms, spot_places
from waychair.runtime.fleet.peer_driving import seen_order
from waychair.trials.fleet.fleet_scenes import SCENARIOS, places_in_rooms
from waychair.types import OccupancyGrid, Place, Pose2

GRAPH = corridor_graph(PLAN, 1.2, rooms=True, bays=True)
WAYS = drivable(ways_of(GRAPH, 0.5), CHAIR_A)
PLACES = dict(places_in_rooms(PLAN))
ROOMS = [refuge.name for refuge in GRAPH.refuges]


class _Points:
    """Chairs without mass that drive along their chains at 0.5 m/s, and a warden; `now_ms` goes on by 100 a step."""

    def __init__(
        self,
        starts: dict[int, str],
        goals: dict[int, str],
        ways: Ways = WAYS,
        places: Mapping[str, Place] = PLACES,
    ) -> None:
        self.district = WardenState(parked(ways, starts), 3000)
        self.drivers = {k: ChainDriver(ways, k, CHAIR_A, dict(places)) for k in starts}
        self.poses = {k: places[room].pose for k, room in starts.items()}
        self.now_ms = 0
        self.goals_left: dict[int, int] = {}
        self.steps: dict[int, Steps] = {}
        self._asks = [Request(k + 1, k, goal, 0) for k, goal in goals.items()]

    @property
    def order(self) -> Order:
        return self.district.order

    def step(self, blocked: Mapping[str, int] = {}) -> None:
        for k, driver in self.drivers.items():
            self.steps[k] = driver.step(self.order, self.poses[k], self.now_ms, self.goals_left.get(k, 1))
        reports = tuple(each.report for each in self.steps.values())
        self.district, replies, _ = decided(self.district, Heard(reports, tuple(self._asks), blocked), self.now_ms)
        assert not [reply.sentence for reply in replies if reply.answer.value == "rejected"]
        self._asks = []
        self.now_ms += 100


def _rooms_apart(metres: float) -> tuple[str, str]:
    return next(
        (a, b)
        for a, b in itertools.combinations(ROOMS, 2)
        if abs(PLACES[a].pose.x - PLACES[b].pose.x) >= metres and PLACES[a].pose.theta == PLACES[b].pose.theta
    )


def test_a_chain_ends_each_spot_where_another_chair_still_has_room() -> None:
    start, goal = _rooms_apart(6.0)
    points = _Points({0: start}, {0: goal})
    points.step()
    chain = chain_of(WAYS, spot_places(WAYS), node_rooms(GRAPH), points.order.chains[0].spots)
    assert (chain.until[1:] >= chain.until[:-1]).all()
    assert chain.until[0] == pytest.approx(0.4)  # the corridor's edge, 0.6 m from its middle
    assert chain.until[2] == pytest.approx(1.0 + TURNING_ROOM)
    assert chain.until[-1] == math.inf


def test_the_stop_line_lies_across_the_corridor() -> None:
    start, goal = _rooms_apart(6.0)
    points = _Points({0: start}, {0: goal})
    points.step()
    chain = chain_of(WAYS, spot_places(WAYS), node_rooms(GRAPH), points.order.chains[0].spots)
    line = chain.stop_line(2)
    assert line[0, 0] == pytest.approx(line[1, 0])
    assert sorted(line[:, 1].tolist()) == pytest.approx([3.0 - 0.7, 3.0 + 0.7])


def _bend_of(width: float) -> OccupancyGrid:
    """Return the map of a corridor that bends to the left on a circle of 4 m, with 3 m of straight way before and behind."""
    y, x = np.mgrid[0:200, 0:200] * 0.05
    off = np.abs(np.hypot(x - 4.0, y - 6.0) - 4.0)
    off = np.where((x < 4.0) | (y > 6.0), np.inf, off)
    off = np.minimum(off, np.where((x > 1.0) & (x <= 4.0), np.abs(y - 2.0), np.inf))
    off = np.minimum(off, np.where((y > 6.0) & (y <= 9.0), np.abs(x - 8.0), np.inf))
    return OccupancyGrid(np.where(off < width / 2, 0, 100).astype(np.int8), 0.05)


@pytest.mark.parametrize("width", [1.2, 1.8])
def test_on_a_mapped_floor_that_bends_every_stop_line_lies_across_the_way_from_wall_to_wall(width: float) -> None:
    grid = _bend_of(width)
    places = {"one": Place("one", Pose2(1.8, 2.0)), "other": Place("other", Pose2(8.0, 8.2))}
    graph = mapped_floor_graph(grid, places.values())
    ways = drivable(ways_of(graph, 0.5), CHAIR_A)
    points = _Points({0: "one"}, {0: "other"}, ways, places)
    points.step()
    spots = points.order.chains[0].spots
    chain = chain_of(ways, spot_places(ways), node_rooms(graph), spots)
    assert not chain.folds
    in_bend = 0
    for k in range(len(spots) - 1):
        a, b = chain.stop_line(k)
        middle, half = (a + b) / 2, (b - a) / 2
        radius = float(np.hypot(*(middle - (4.0, 6.0))))
        if middle[0] < 4.3 or middle[1] > 5.7:
            continue
        in_bend += 1
        assert abs(radius - 4.0) < 0.2
        assert abs(math.sin(math.atan2(*half[::-1]) - math.atan2(*(middle - (4.0, 6.0))[::-1]))) < 0.35
        for end in (a, b):  # no chair has room between the line and the wall
            assert abs(abs(np.hypot(*(end - (4.0, 6.0))) - 4.0) - width / 2) < 0.25
    assert in_bend >= 1


def test_a_chair_has_arrived_at_the_refuge_where_it_is_and_at_no_other_one() -> None:
    points = _Points({0: ROOMS[0]}, {})
    points.step()
    assert points.drivers[0].arrived_at(ROOMS[0])
    assert not points.drivers[0].arrived_at(ROOMS[1])


def test_a_way_round_a_section_is_known_in_a_ring_and_in_no_dead_end() -> None:
    scene = SCENARIOS["seated_persons"](0).scene
    ring = ChainDriver(drivable(ways_of(scene.graph, 0.45), CHAIR_A), 0, CHAIR_A, dict(scene.places))
    assert ring.has_way_round("02-00")
    straight = ChainDriver(WAYS, 0, CHAIR_A, PLACES)
    assert not any(straight.has_way_round(section.name) for section in GRAPH.sections)


def test_a_parked_chair_without_a_chain_may_not_leave_its_room() -> None:
    points = _Points({0: ROOMS[0]}, {})
    points.step()
    steps = points.steps[0]
    assert steps.report == ChairReport(0, 0, 0, 0)
    assert steps.goals == ()


def test_a_chair_that_was_started_again_on_its_way_into_a_room_goes_on_into_it() -> None:
    start, goal = _rooms_apart(6.0)
    points = _Points({0: start}, {0: goal})
    points.step()
    order, spots = points.order, points.order.chains[0].spots
    for now_ms in range(100, 100 * len(spots), 100):
        order = entered(order, 0, now_ms)
    driver = ChainDriver(WAYS, 0, CHAIR_A, PLACES)
    driver.stand_in(spots[-3:], order.chains[0].visit)
    inside = spot_places(WAYS)[spots[-3]]
    steps = driver.step(order, Pose2(*inside.points[0].tolist(), PLACES[goal].pose.theta), 5000)
    assert [each.target for each in steps.goals or ()] == [goal]
    assert steps.report.ready_in_ms > 0


@pytest.mark.parametrize("count", [2, 3, 4, 5])
def test_a_chain_that_ends_on_the_way_ends_in_a_pose_within_its_last_spot(count: int) -> None:
    start, goal = _rooms_apart(6.0)
    points = _Points({0: start}, {0: goal})
    points.step()
    order = points.order
    spots = order.chains[0].spots[:count]
    last = spot_places(WAYS)[spots[-1]]
    assert WAYS.names[spots[-1]] not in PLACES
    driver = ChainDriver(WAYS, 0, CHAIR_A, PLACES)
    shorter = replace(order, chains={0: replace(order.chains[0], spots=spots)})
    (end,) = driver.step(shorter, PLACES[start].pose, 0).goals or ()
    assert isinstance(end.target, Pose2)
    at = np.array([end.target.x, end.target.y])
    assert np.hypot(*(at - last.points).T).min() <= last.length
    if last.section is not None:
        foremost = at + CHAIR_A.front * np.array([math.cos(end.target.theta), math.sin(end.target.theta)])
        assert np.hypot(*(foremost - last.points[0])) <= max(last.length, CHAIR_A.front) + 1e-9


def test_the_goal_is_the_room_at_the_end_of_the_chain() -> None:
    start, goal = _rooms_apart(6.0)
    points = _Points({0: start}, {0: goal})
    points.step()
    points.step()
    assert [each.target for each in points.steps[0].goals or ()] == [goal]


@pytest.mark.parametrize(("speed", "before"), [(0.2, 3), (1.0, 1)])
def test_a_chair_has_reached_all_spots_before_which_it_cannot_stop_any_more(speed: float, before: int) -> None:
    start, goal = _rooms_apart(9.0)
    points = _Points({0: start}, {0: goal})
    points.step()
    driver = points.drivers[0]
    way = driver.way
    while points.steps[0].report.visits < 7:
        way += speed * 0.1
        assert driver.chain is not None
        at, heading = driver.chain.place_at(way)
        points.poses[0] = Pose2(float(at[0]), float(at[1]), heading)
        points.step()
    assert driver.unreached == before


def test_a_chair_enters_near_spots_and_leaves_them_when_its_rear_is_out() -> None:
    start, goal = _rooms_apart(9.0)
    points = _Points({0: start}, {0: goal})
    points.step()
    points.step()
    assert points.steps[0].report.visits >= 1  # it stands at the edge of its room and nobody else is about
    away = 1.0 if PLACES[goal].pose.x > PLACES[start].pose.x else -1.0
    points.poses[0] = Pose2(PLACES[start].pose.x + away * 2.0, 3.0, 0.0 if away > 0 else math.pi)
    for _ in range(3):
        points.step()
    report = points.steps[0].report
    entered = points.order.chains[0]
    assert report.behind == len(entered.behind) <= 2
    assert all(WAYS.names[spot] != start for _, spot in entered.behind)
    assert not points.drivers[0].arrived


def test_a_chair_before_anothers_spot_gets_a_line_and_no_further() -> None:
    start, goal = _rooms_apart(9.0)
    other = next(name for name in ROOMS if name not in (start, goal))
    points = _Points({0: start, 1: goal, 2: other}, {0: goal, 1: start})
    for _ in range(3):
        points.step()
    lines = [points.steps[k].authority.line for k in (0, 1)]
    assert all(line is not None for line in lines)
    held = {(k, spot) for k in (0, 1) for spot in [points.order.chains[k].spots[0]]}
    assert len({WAYS.resource[spot] for _, spot in held}) == 2


def _head_on() -> tuple[_Points, str, str]:
    """Two chairs that exchange their rooms: one of them steps aside into a room on the way."""
    start, goal = _rooms_apart(12.0)
    points = _Points({0: start, 1: goal}, {0: goal, 1: start})
    for _ in range(2):
        points.step()
    return points, start, goal


def test_one_of_two_that_meet_in_a_corridor_gets_a_bay_as_its_first_goal() -> None:
    points, *_ = _head_on()
    goals = {k: [each.target for each in steps.goals or ()] for k, steps in points.steps.items()}
    assert sorted(map(len, goals.values())) == [1, 2]
    aside = next(each[0] for each in goals.values() if len(each) == 2)
    assert aside in ROOMS


def _from_room_to_room(pose: Pose2, room: str) -> list[Pose2]:
    """Return poses 5 cm apart: backwards out of a room, turned on the spot, along the corridor, and into another room."""
    goal = PLACES[room].pose
    way = 0.0 if goal.x > pose.x else math.pi
    inwards = math.sin(goal.theta)
    found = [Pose2(pose.x, y, pose.theta) for y in _steps(pose.y, 3.0)]
    found += [Pose2(x, 3.0, way) for x in _steps(pose.x, goal.x)]
    return found + [Pose2(goal.x, y, math.copysign(math.pi / 2, inwards)) for y in _steps(3.0, goal.y)]


def _steps(start: float, end: float) -> list[float]:
    count = max(round(abs(end - start) / 0.05), 1)
    return [start + (end - start) * k / count for k in range(count + 1)]


class _Drivers(_Points):
    """Chairs that drive to their goals, from room to room, as far as their authorities let them."""

    def __init__(self, starts: dict[int, str], goals: dict[int, str]) -> None:
        super().__init__(starts, goals)
        self.goals_left = dict.fromkeys(starts, 0)
        self.visited: dict[int, list[str]] = {k: [] for k in starts}
        self._rooms: dict[int, list[str]] = {k: [] for k in starts}
        self._path: dict[int, list[Pose2]] = {k: [] for k in starts}

    def drive(self) -> None:
        self.step()
        for k, steps in self.steps.items():
            if steps.goals is not None and [str(each.target) for each in steps.goals] != self._rooms[k]:
                self._rooms[k] = [str(each.target) for each in steps.goals]
                self._path[k] = _from_room_to_room(self.poses[k], self._rooms[k][0]) if self._rooms[k] else []
            self.goals_left[k] = len(self._rooms[k])
            self._move(k)

    def _move(self, k: int) -> None:
        path = np.array([pose.array() for pose in self._path[k]])
        if not len(path) or self.steps[k].authority.way_left(CHAIR_A, self.poses[k], path) < 0.1:
            return
        self.poses[k] = self._path[k].pop(0)
        line = self.steps[k].authority.line
        assert line is None or not crosses(line, CHAIR_A, self.poses[k].array()[None])[0]
        if not self._path[k]:
            self.visited[k].append(self._rooms[k].pop(0))
            self._path[k] = _from_room_to_room(self.poses[k], self._rooms[k][0]) if self._rooms[k] else []
            self.goals_left[k] = len(self._rooms[k])


def _touch(a: Pose2, b: Pose2) -> bool:
    corners = transform_points(a, CHAIR_A.outline())
    sides = zip(corners, np.roll(corners, -1, axis=0), strict=True)
    return any(crosses(np.array(side), CHAIR_A, b.array()[None])[0] for side in sides)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("second", [0, 1, 2])
def test_two_that_meet_pass_each_other_by_a_bay_which_no_line_bars_until_the_other_one_is_there(second: int) -> None:
    start = _rooms_apart(12.0)[0]
    far = [room for room in ROOMS if abs(PLACES[room].pose.x - PLACES[start].pose.x) >= 12.0]
    goal = far[second % len(far)]
    pair = _Drivers({0: start, 1: goal}, {0: goal, 1: start})
    waited_inside = 0
    for _ in range(2000):
        pair.drive()
        assert not _touch(pair.poses[0], pair.poses[1])
        for k, visited in pair.visited.items():
            inside = visited and pair.goals_left[k] > 0 and pair.poses[k] == PLACES[visited[-1]].pose
            waited_inside += bool(inside and pair.steps[k].authority.line is not None)
        if all(driver.arrived and not pair.goals_left[k] for k, driver in pair.drivers.items()) and pair.now_ms > 5000:
            break
    assert [pair.visited[0][-1], pair.visited[1][-1]] == [goal, start]
    assert sorted(map(len, pair.visited.values())) == [1, 2]
    assert waited_inside > 0  # the line across the bay's door held the chair until the other one had passed


@pytest.mark.parametrize("inside", [0.05, 0.35, 0.7])
def test_a_chair_before_a_shut_way_gives_it_back_and_turns_to_another_one_with_no_line_under_it(inside: float) -> None:
    scene = SCENARIOS["seated_persons"](0).scene
    ways = drivable(ways_of(scene.graph, 0.45), CHAIR_A)
    points = _Points({0: "10"}, {0: "00"}, ways, scene.places)
    points.step()
    for _ in range(20):  # it comes to the corner from below, its rear still before the corner
        y = min(points.poses[0].y + 0.2, 6.5)
        points.poses[0] = Pose2(3.0, y, math.pi / 2)
        points.step()
    points.poses[0] = Pose2(3.9 + inside - CHAIR_A.front * math.cos(0.6), 6.45, 0.6)
    points.step()
    driver = points.drivers[0]
    assert driver.section_ahead() is not None
    assert ways.names[points.order.chains[0].spots[0]] == "02-00"
    points.district = replace(points.district, order=driver.withdraw(points.order))
    points.steps[0] = Steps(driver.report(), FREE)
    points.district, _, _ = decided(points.district, Heard((driver.report(),), (), {"02-00": 120_000}), points.now_ms)
    for _ in range(3):
        points.step()
        chain = points.order.chains[0]
        assert "02-00" not in [ways.names[spot] for spot in chain.spots]
        line = points.steps[0].authority.line
        assert not points.steps[0].authority.stands
        assert line is None or not crosses(line, CHAIR_A, points.poses[0].array()[None])[0]
    assert chain.last > 0
    assert ways.names[chain.spots[-1]] == "00"


def test_a_chair_that_was_stopped_on_its_way_may_not_move() -> None:
    start, goal = _rooms_apart(9.0)
    points = _Points({0: start}, {0: goal})
    for _ in range(3):
        points.step()
    assert not points.steps[0].authority.stands
    assert points.order.chains[0].visit > 0  # it has entered its door
    points.district = replace(points.district, order=stopped(points.order, 0))
    points.step()
    assert points.steps[0].authority.stands
    assert points.steps[0].goals == ()


@pytest.mark.parametrize("seed", [0, 1])
def test_a_chair_waits_as_it_is_in_a_hall_where_it_could_drive_round_its_line(seed: int) -> None:
    scene = SCENARIOS["mapped_bend"](seed).scene
    ways = drivable(ways_of(scene.graph, 0.45), scene.body)
    points = _Points(
        dict(enumerate(scene.starts)),
        {k: own[0] for k, own in enumerate(scene.goals)},
        ways,
        scene.places,
    )
    for _ in range(2):
        points.step()
    waiting = [k for k, steps in points.steps.items() if steps.authority.stands]
    assert len(waiting) == 1
    for _ in range(PATIENCE_MS // 100 + 20):  # also where it may enter the way to the hall's middle, and no farther
        points.step()
        assert [k for k, steps in points.steps.items() if steps.authority.stands] == waiting
    assert points.steps[waiting[0]].report.visits == 1


def test_a_chair_stands_aside_with_its_face_to_the_node_by_which_it_leaves_again() -> None:
    scene = SCENARIOS["door_from_both_sides"](0).scene
    ways = ways_of(scene.graph, 0.45)  # as if a chair could turn in the corridor
    points = _Points(
        dict(enumerate(scene.starts)), {k: goals[0] for k, goals in enumerate(scene.goals)}, ways, scene.places
    )
    points.step()
    points.step()
    aside = [
        each.target for steps in points.steps.values() for each in steps.goals or () if isinstance(each.target, Pose2)
    ]
    assert len(aside) == 1
    room = scene.places["room 5"].pose  # which the one leaves and the other one wants
    door = min(
        (node for node in scene.graph.nodes if "room" not in node.name),
        key=lambda node: math.dist((node.x, node.y), (room.x, room.y)),
    )
    ahead = math.cos(aside[0].theta) * (door.x - aside[0].x) + math.sin(aside[0].theta) * (door.y - aside[0].y)
    assert ahead == pytest.approx(math.dist((door.x, door.y), (aside[0].x, aside[0].y)))
    assert ahead - CHAIR_A.front >= TURNING_ROOM


def test_a_chair_on_its_way_aside_keeps_that_goal_and_the_node_in_a_new_plan_and_goes_no_farther() -> None:
    scene = SCENARIOS["door_from_both_sides"](0).scene
    ways = ways_of(scene.graph, 0.45)  # as if a chair could turn in the corridor
    goals = {k: goals[0] for k, goals in enumerate(scene.goals)}
    points = _Points(dict(enumerate(scene.starts)), goals, ways, scene.places)
    for _ in range(2):
        points.step()
    k, steps = next((k, steps) for k, steps in points.steps.items() if len(steps.goals or ()) == 2)
    assert [zone.name for zone in steps.bars if "place to wait" in zone.name]
    aside = (steps.goals or ())[0].target
    assert isinstance(aside, Pose2)
    points.goals_left[k] = 2
    room = points.poses[k]
    for x in (room.x, room.x - 0.5):  # out of its room, as far as the section beside the door
        points.poses[k] = Pose2(x, room.y, room.theta)
        points.step()
    points.poses[k] = Pose2(aside.x, room.y, aside.theta)
    while not points.order.chains[k].behind or ways.names[points.order.chains[k].spots[0]].startswith("n5"):
        points.step()
    section = points.order.chains[k].spots[0]
    driver = points.drivers[k]
    driver._chain = None  # a new plan begins here
    points.step()
    assert [each.target for each in points.steps[k].goals or ()] == [aside, goals[k]]
    assert points.order.chains[k].spots[0] == section
    assert points.order.chains[k].behind
    line = points.steps[k].authority.line
    assert line is not None  # before the next node beyond
    assert (line.mean(axis=0) - (aside.x, aside.y)) @ (math.cos(aside.theta), math.sin(aside.theta)) < -CHAIR_A.rear


def test_no_chair_stands_aside_where_it_cannot_turn_about() -> None:
    scene = SCENARIOS["door_from_both_sides"](0).scene
    ways = drivable(ways_of(scene.graph, 0.45), CHAIR_A)
    goals = {k: goals[0] for k, goals in enumerate(scene.goals)}
    points = _Points(dict(enumerate(scene.starts)), goals, ways, scene.places)
    points.step()
    points.step()
    assert [[each.target for each in steps.goals or ()] for steps in points.steps.values()] == [
        [g] for g in goals.values()
    ]


def test_a_chair_that_lets_another_one_pass_in_a_side_way_gets_its_end_as_a_goal_and_faces_back() -> None:
    scene = SCENARIOS["swap_in_t"](0).scene
    ways = drivable(ways_of(scene.graph, 0.45), CHAIR_A)
    goals = {k: goals[0] for k, goals in enumerate(scene.goals)}
    points = _Points(dict(enumerate(scene.starts)), goals, ways, scene.places)
    points.step()
    points.step()
    asked = [[each.target for each in steps.goals or ()] for steps in points.steps.values()]
    assert sorted(map(len, asked)) == [1, 2]
    first = next(each[0] for each in asked if len(each) == 2)
    assert isinstance(first, str) or math.sin(first.theta) == pytest.approx(1.0)  # towards the crossing, in the stem
    for k, steps in points.steps.items():
        places = spot_places(ways)
        folds = chain_of(ways, places, node_rooms(scene.graph), points.order.chains[k].spots).folds
        assert len(folds) == len(steps.goals or ()) - 1


@pytest.mark.parametrize("free", [0, 1])
def test_a_chair_that_turns_about_at_a_node_waits_for_nothing_but_the_node(free: int) -> None:
    """The section behind the node is the one in which it is: nobody else can take it."""
    places, after = spot_places(WAYS), [WAYS.after[a:b].tolist() for a, b in itertools.pairwise(WAYS.first)]
    ways_back = (
        (spot, node, back, after[back][0])
        for spot, here in enumerate(places)
        if here.section is not None and here.length >= 3.0
        for node in after[spot]
        for back in after[node]
        if WAYS.resource[back] == WAYS.resource[spot]
    )
    spot, *chain = next(ways_back)
    driver = ChainDriver(WAYS, 1, CHAIR_A, dict(PLACES))
    driver.stand_in((spot,))
    (x0, y0), (x1, y1) = places[spot].points[-2:].tolist()
    heading = math.atan2(y1 - y0, x1 - x0)
    back_m = TURNING_ROOM + CHAIR_A.front
    pose = Pose2(x1 - back_m * math.cos(heading), y1 - back_m * math.sin(heading), heading)
    assert driver.wanted == 0
    steps = driver.step(seen_order(WAYS, 1, (spot,), 0, chain, free), pose, 0, 2)
    assert driver.wanted >= 1
    assert steps.report.visits == free
