"""Scenes of several whole chairs: floors of corridors with rooms, and the goals of the demo."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TypeAlias

import numpy as np

from waychair.calibration.chair_body import CHAIR_A, CHAIR_B, ChairBody
from waychair.errors import TaskError
from waychair.maps.drawn.zones import Rule, Zone
from waychair.maps.traffic.corridors import NARROW, CorridorPlan, corridor_graph, lies_on, load_corridors, room_doors
from waychair.maps.traffic.traffic_graph import Refuge, TrafficGraph
from waychair.runtime.chair import Chair
from waychair.runtime.fleet.chain_geometry import goes_straight
from waychair.simulation.fleet import FleetSimulator
from waychair.simulation.plan.corridor_world import ROOM_SIDE, corridor_world
from waychair.simulation.scene.scene import Block, PersonBehaviour, PersonPlan
from waychair.simulation.scene.seeds import seed_from_names
from waychair.trials.fleet.bent_floor import BEND_WALK, bent_scene
from waychair.trials.fleet.fleet_drive import Events, FleetScene
from waychair.types import JoystickInput, Place, Pose2

SCENE_S = 150.0
"""s; longest time of a scene."""

DIES_AT_S, PUSHES_AT_S = 24.0, 22.0
"""s; when a chair dies, and when a rider takes the joystick: in a corridor."""

FIG8_WIDTH = 1.4
"""m; width of the corridors of figure 8, in which two chairs do not pass."""

LANES_FREE = 1.2
"""m; before a crossing or an end, where chairs come to their lanes."""

LANE_MARGIN = 0.05
"""m; a chair keeps so far from the middle of a corridor of two lanes."""

LANE_SPARE, MIDDLE_LINE = 0.25, 0.02
"""m; a lane has room to spare if it is wider than the chair by so much; and width of the line between two that have not."""

MIDDLE = 3.5
"""m; middle of the straight corridors."""

FINE = 0.025
"""m; cells of the map where two chairs pass with 10 cm on all sides: in cells of 5 cm, the halves of two cells and the noise of
the lidar take more than that."""

STEPS_OF_LINE = 3.0
"""m between two goals of a chair that stops on its way along a corridor, as in the paper."""

PACES = (0.5, 0.9)
"""m/s; the slowest and the fastest person who walks about: these are corridors of a ward."""

ERRAND_S = 20.0
"""s that a person who walks about stays at each end of their way."""

LEAST_ROOMS = 4
"""Rooms in which one chair has goals: for its start, for other goals, and for its last one."""

IN_ROOM = 0.12
"""m; a chair that stops so far before its place in a room has its rear out of the corridor, but for 2 cm. A chair that came in
askew and had to come nearer would have to back out into the corridor, where another one waits for it to get in."""

Path2: TypeAlias = tuple[tuple[float, float], ...]
"""Points x, y [m] of a person's way."""

FROM_ABOVE: Path2 = ((15.0, 28.0), (15.0, 19.6))
FROM_BELOW: Path2 = ((16.0, 9.0), (15.0, 9.0), (15.0, 13.4))
ABOVE_THE_STEM: Path2 = ((9.0, 28.0), (9.0, 27.0), (15.0, 27.0), (15.0, 25.6))
IN_THE_STEM: Path2 = ((16.0, 3.0), (15.0, 3.0), (15.0, 20.0))
"""m; ways of people on the T, to the chairs from behind and back: two chairs shut in nobody who walks between them."""

ROUND_FIG8: Path2 = ((6.0, 3.0), (3.0, 3.0), (3.0, 7.0), (9.0, 7.0), (9.0, 3.0))
"""m; a person's way round the corridors of figure 8, in the sense in which the chairs go, who leave nobody room to pass."""

BEFORE_WALL = 0.10
"""m; between a chair's front and the wall of its room."""


def _nothing_happens(simulator: FleetSimulator, chairs: Sequence[Chair], seconds: float) -> None:
    """Leave the scene alone."""


def places_in_rooms(plan: CorridorPlan, body: ChairBody = CHAIR_A) -> Mapping[str, Place]:
    """Return the pose of a chair in each room of a plan: facing away from its door, as deep inside as it can stand."""
    found = {}
    for name, (door, room) in room_doors(plan).items():
        heading = math.atan2(room[1] - door[1], room[0] - door[0])
        way = ROOM_SIDE / 2 - BEFORE_WALL - body.front
        pose = Pose2(room[0] + way * math.cos(heading), room[1] + way * math.sin(heading), heading)
        found[name] = Place(name, pose, tolerance_m=IN_ROOM)
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
    if most < 1:
        raise TaskError(
            f"{plan.name} has {len(names)} rooms, but chairs with goals need {LEAST_ROOMS}: make its corridors longer, with "
            "their centre lines on whole metres"
        )
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


def with_people_on(scene: FleetScene, *paths: Path2, pass_chairs: bool = False) -> FleetScene:
    """Return the scene with one more person for each path, who walks to and fro along it, at a pace that the seed gives, and
    stays for a while at each end.

    People stop before a chair, and turn back if it does not go: nobody passes a chair in a corridor of 1.2 m. With
    `pass_chairs` they step aside and go on, which takes a corridor of 1.8 m.
    """
    dice = np.random.default_rng(seed_from_names("walkers", scene.graph.name, scene.seed))
    behaviour = PersonBehaviour.SOCIAL if pass_chairs else PersonBehaviour.PATH
    people = [PersonPlan(behaviour, np.array(path), float(dice.uniform(*PACES)), rest=ERRAND_S) for path in paths]
    return replace(scene, world=replace(scene.world, people=(*scene.world.people, *people)))


def walk_between(plan: CorridorPlan, start: str, end: str) -> Path2:
    """Return a person's way from one room of a plan to another, along at most two corridors."""
    (door, room), (other_door, other_room) = (room_doors(plan)[name] for name in (start, end))
    corners = ((door[0], other_door[1]), (other_door[0], door[1]))
    corner = next(point for point in corners if all(_corridor_joins(plan, point, each) for each in (door, other_door)))
    return room, door, corner, other_door, other_room


def _corridor_joins(plan: CorridorPlan, a: tuple[float, float], b: tuple[float, float]) -> bool:
    """Return whether one corridor of a plan has both points on its centre line."""
    return any(lies_on(line, a) and lies_on(line, b) for line in plan.corridors)


@dataclass(frozen=True, slots=True)
class Scenario:
    """A scene with what happens in it. `may_fail`: chairs, by number, that need not reach their goals."""

    scene: FleetScene
    events: Events = _nothing_happens
    may_fail: frozenset[int] = frozenset()


def shared_run(seed: int) -> Scenario:
    """Two chairs meet in a single-file corridor with rooms beside it: one steps aside."""
    return Scenario(_rooms("T", {"room 1": "room 5", "room 6": "room 2"}, seed, FROM_ABOVE))


def swap_in_t(seed: int) -> Scenario:
    """Two chairs exchange their rooms on two arms of a T; somebody walks in the foot of its stem."""
    return Scenario(_rooms("T", {"room 11": "room 15", "room 15": "room 11"}, seed, IN_THE_STEM))


def crossing(seed: int) -> Scenario:
    """Two chairs cross each other's way at right angles."""
    plan = load_corridors("4cross")
    doors = room_doors(plan)

    def near(x: float, y: float) -> str:
        return min(doors, key=lambda name: math.dist(doors[name][0], (x, y)))

    ways = {near(9.0, 5.0): near(9.0, 14.0), near(5.0, 9.0): near(14.0, 9.0)}
    return Scenario(_rooms("4cross", ways, seed, walk_between(plan, "room 17", "room 7")))


def door_from_both_sides(seed: int) -> Scenario:
    """One chair leaves a room, and another one goes into the same room."""
    return Scenario(_rooms("T", {"room 5": "room 8", "room 6": "room 5"}, seed, FROM_BELOW))


def dies_in_the_run(seed: int) -> Scenario:
    """A chair's board fails in a corridor; the chair that wanted to pass there keeps its distance."""

    def events(simulator: FleetSimulator, chairs: Sequence[Chair], seconds: float) -> None:
        if seconds > DIES_AT_S:
            chair = simulator.chairs[0]
            chair.board_inputs = replace(chair.board_inputs, estop_released=False)

    scene = _rooms("T", {"room 1": "room 5", "room 6": "room 2"}, seed, FROM_ABOVE)
    return Scenario(replace(scene, time_limit_s=DIES_AT_S + 90.0), events, frozenset({0, 1}))


def rider_takes_the_joystick(seed: int) -> Scenario:
    """A rider pushes the stick for two seconds in a corridor, stops there, and asks for the goal again."""

    def events(simulator: FleetSimulator, chairs: Sequence[Chair], seconds: float) -> None:
        pushes = PUSHES_AT_S < seconds < PUSHES_AT_S + 2.0
        simulator.chairs[0].rider = JoystickInput(simulator.now_ns, 0.4 if pushes else 0.0)

    return Scenario(_rooms("T", {"room 1": "room 5", "room 8": "room 2"}, seed, ABOVE_THE_STEM), events)


def nodes_10_and_00(seed: int) -> Scenario:
    """Two chairs exchange nodes 10 and 00 of the paper's figure 8: two ways lead from one to the other."""
    return Scenario(with_people_on(_fig8({"10": "00", "00": "10"}, seed), ROUND_FIG8))


def l_way(seed: int) -> Scenario:
    """2 m ahead, a right turn and the way on to node 00: the paper's end error is 8.7 cm in the mean."""
    return Scenario(with_people_on(_fig8({"05": "00"}, seed), ROUND_FIG8))


def trash_bin(seed: int) -> Scenario:
    """A bin stands in a wide corridor: it is passed, as is a person who comes towards the chair."""
    scene = with_people_on(_straight(1.8, {"from west": "east"}, seed), ((18.0, 4.0), (3.5, 4.0)), pass_chairs=True)
    bin_there = Block(Pose2(12.0, 2.9, 0.0), 0.3, 0.3, 0.0, 0.7, "metal")
    return Scenario(replace(_with_hidden(scene, bin_there), zones=()))


def seated_persons(seed: int) -> Scenario:
    """Two persons sit in the shorter way from node 10 to node 00: the other way is taken."""
    scene = _fig8({"10": "00"}, seed)
    people = [PersonPlan(PersonBehaviour.SEATED, np.array([[x, 7.0], [x + 0.1, 7.0]]), 0.5) for x in (5.6, 6.3)]
    return Scenario(replace(scene, world=replace(scene.world, people=tuple(people))))


def three_metres_five_times(seed: int) -> Scenario:
    """3 m straight on, five times, each to a stop: the paper's chair drives them at 0.320 to 0.337 m/s."""
    points = {f"{k}": (3.0 + STEPS_OF_LINE * k, 3.5) for k in range(6)}
    plan = CorridorPlan("line", (24.0, 7.0), ((2.0, 3.5, 20.0, 3.5),), points)
    graph = corridor_graph(plan, FIG8_WIDTH)
    return Scenario(
        FleetScene(
            world=corridor_world(plan, FIG8_WIDTH),
            graph=replace(graph, refuges=tuple(Refuge(name, name) for name in points)),
            places={name: Place(name, Pose2(*point, 0.0), tolerance_m=0.06) for name, point in points.items()},
            starts=("0",),
            goals=(tuple(points)[1:],),
            seed=seed,
            time_limit_s=SCENE_S,
        )
    )


def two_pass(seed: int) -> Scenario:
    """Two chairs A pass each other in a corridor of 1.525 m, the passing width of the ADA."""
    return Scenario(_straight(1.525, {"from west": "east", "from east": "west"}, seed, CHAIR_A, FINE))


def two_wide_pass(seed: int) -> Scenario:
    """Two chairs B pass each other in a corridor of 1.8 m."""
    return Scenario(_straight(1.8, {"from west": "east", "from east": "west"}, seed, CHAIR_B, FINE))


def mapped_bend(seed: int) -> Scenario:
    """Two chairs meet in a corridor that bends, on a mapped floor: one waits in a niche, or in its hall."""
    return Scenario(with_people_on(bent_scene(seed, SCENE_S), BEND_WALK))


SCENARIOS: Mapping[str, Callable[[int], Scenario]] = MappingProxyType(
    {
        each.__name__: each
        for each in (
            l_way,
            three_metres_five_times,
            seated_persons,
            trash_bin,
            nodes_10_and_00,
            shared_run,
            crossing,
            swap_in_t,
            door_from_both_sides,
            dies_in_the_run,
            rider_takes_the_joystick,
            two_pass,
            two_wide_pass,
            mapped_bend,
        )
    }
)
"""All scenes by name."""


def _rooms(name: str, ways: Mapping[str, str], seed: int, walk: Path2) -> FleetScene:
    """Return chairs that each drive from one room of a plan to another, and a person who walks to and fro."""
    plan = load_corridors(name)
    scene = FleetScene(
        world=corridor_world(plan, NARROW, rooms=True),
        graph=corridor_graph(plan, NARROW, rooms=True, bays=True),
        places=places_in_rooms(plan),
        starts=tuple(ways),
        goals=tuple((goal,) for goal in ways.values()),
        seed=seed,
        time_limit_s=SCENE_S,
    )
    return with_people_on(scene, walk)


def _fig8(ways: Mapping[str, str], seed: int) -> FleetScene:
    """Return chairs that each drive from one node of figure 8 to another; those nodes are refuges."""
    plan = load_corridors("fig8")
    graph = corridor_graph(plan, FIG8_WIDTH)
    poses = {
        "10": Pose2(3.0, 4.0, math.pi / 2),
        "05": Pose2(3.0, 5.0, math.pi / 2),
        "00": Pose2(9.0 - CHAIR_A.front + CHAIR_A.rear, 7.0, 0.0),
    }
    used = dict.fromkeys((*ways, *ways.values()))
    return FleetScene(
        world=corridor_world(plan, FIG8_WIDTH),
        graph=replace(graph, refuges=tuple(Refuge(name, name) for name in used)),
        places={name: Place(name, poses[name], tolerance_m=0.06) for name in used},
        starts=tuple(ways),
        goals=tuple((goal,) for goal in ways.values()),
        seed=seed,
        time_limit_s=SCENE_S,
    )


def _straight(
    width: float, ways: Mapping[str, str], seed: int, body: ChairBody = CHAIR_A, cell: float = 0.05
) -> FleetScene:
    """Return chairs in one corridor of 18 m, with goals at both ends and starts 2 m before them, where the chairs face the way.

    In two lanes they keep right; nobody has to turn where there is no room for it.
    """
    points = {"west": (3.0, MIDDLE), "from west": (5.0, MIDDLE), "from east": (19.0, MIDDLE), "east": (21.0, MIDDLE)}
    plan = CorridorPlan("straight", (24.0, 7.0), ((3.0, MIDDLE, 21.0, MIDDLE),), points)
    graph = two_abreast(corridor_graph(plan, width, chair_width=body.width, cell=cell))
    aside = width / 4
    poses = {
        "west": Pose2(3.6, MIDDLE + aside, math.pi),
        "from west": Pose2(5.0, MIDDLE - aside, 0.0),
        "from east": Pose2(19.0, MIDDLE + aside, math.pi),
        "east": Pose2(20.4, MIDDLE - aside, 0.0),
    }
    return FleetScene(
        world=corridor_world(plan, width, cell=cell),
        graph=replace(graph, refuges=tuple(Refuge(name, name, slots=2) for name in points)),
        places={name: Place(name, pose) for name, pose in poses.items()},
        starts=tuple(ways),
        goals=tuple((goal,) for goal in ways.values()),
        body=body,
        seed=seed,
        time_limit_s=SCENE_S,
        zones=lane_zones(graph),
    )


def two_abreast(graph: TrafficGraph) -> TrafficGraph:
    """Return the graph with room for two chairs at each node that only divides a straight corridor of two lanes."""
    wide = {section.name for section in graph.sections if section.lanes == 2}
    nodes = [
        replace(node, capacity=2)
        if goes_straight(graph, node.name) and {move.section for move in graph.moves[node.name]} <= wide
        else node
        for node in graph.nodes
    ]
    return replace(graph, nodes=tuple(nodes))


def lane_zones(graph: TrafficGraph) -> tuple[Zone, ...]:
    """Return the zones that make chairs keep right on sections of two lanes, but for their ends at crossings.

    These are one-way lanes; where they have no room to spare, a line along the middle that no chair drives over.
    """
    zones = []
    for section in graph.sections:
        if section.lanes < 2:
            continue
        a, b = graph.node[section.start], graph.node[section.end]
        heading = math.atan2(b.y - a.y, b.x - a.x)
        along, left = (np.array([math.cos(heading + turn), math.sin(heading + turn)]) for turn in (0.0, math.pi / 2))
        narrow = section.width < 2 * (graph.chair_width + LANE_SPARE)
        free_at_a, free_at_b = (_free_before(graph, end.name, narrow) for end in (a, b))
        begin, end = np.array([a.x, a.y]) + free_at_a * along, np.array([b.x, b.y]) - free_at_b * along
        if (end - begin) @ along < LANES_FREE:
            continue
        if narrow:
            aside = MIDDLE_LINE / 2 * left
            corners = np.array([begin - aside, end - aside, end + aside, begin + aside])
            zones.append(Zone(f"middle of {section.name}", Rule.KEEP_OUT, corners))
            continue
        for side, way in ((1.0, heading + math.pi), (-1.0, heading)):
            inner, outer = -side * (graph.chair_width / 2 + LANE_MARGIN) * left, side * section.width / 2 * left
            corners = np.array([begin + inner, end + inner, end + outer, begin + outer])
            zones.append(Zone(f"lane {section.name} {way:.1f}", Rule.ONE_WAY, corners, math.remainder(way, math.tau)))
    return tuple(zones)


def _free_before(graph: TrafficGraph, node: str, narrow: bool) -> float:
    """Return how far [m] before a node the lanes of a section end: where chairs turn, but not in a narrow dead end."""
    return 0.0 if goes_straight(graph, node) or (narrow and len(graph.moves[node]) == 1) else LANES_FREE


def _with_hidden(scene: FleetScene, *blocks: Block) -> FleetScene:
    """Return the scene with things that are on no map."""
    world = replace(scene.world, blocks=(*scene.world.blocks, *blocks))
    return replace(scene, world=world, hidden=scene.world)
