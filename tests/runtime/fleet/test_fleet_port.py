"""A real chair in its fleet: it stands until its way is granted, and keeps no order while its rider steers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from tests.runtime.fleet.test_fleet_member import GRAPH, PLACES, PLAN, ROOMS, WAYS
from waychair.calibration.chair_body import CHAIR_A
from waychair.control.authority import FREE
from waychair.errors import FleetError
from waychair.maps.drawn.zones import Zone
from waychair.planning.fleet.peers.messages import IN_ORDER, MANUAL, Reader, State, building_of
from waychair.planning.fleet.peers.peer import Fleet
from waychair.planning.fleet.rules import Priority
from waychair.planning.fleet.ways import ways_of
from waychair.runtime.fleet.desk.desk_messages import GIVEN_LAPSES_NS, Given, note_bytes
from waychair.runtime.fleet.fleet_port import FleetPort
from waychair.runtime.fleet.spots_of_pose import SpotsOfPose
from waychair.runtime.pilot import Pilot
from waychair.simulation.plan.corridor_world import corridor_world
from waychair.trials.fleet.fleet_on_lines import CarriedEnd, CarriedMessages
from waychair.types import Goal, Pose2

GRID = corridor_world(PLAN, 1.2, rooms=True).grid
HOME, GOAL = PLACES[ROOMS[0]].pose, PLACES[ROOMS[3]]
STEP_NS = 100_000_000


class Alone:
    """The only chair of a building, with its pilot; `air` hears what it says."""

    def __init__(self, chairs: tuple[int, ...] = (1,), voters: tuple[int, ...] = ()) -> None:
        """`chairs`, `voters`: the fleet's; none but chair 1 is there."""
        self.fleet = Fleet(building_of(GRAPH), WAYS, frozenset(chairs), frozenset(voters))
        self.air = CarriedMessages([1, 2])
        self.port = FleetPort(self.fleet, 1, 101, CarriedEnd(self.air, 1), CHAIR_A, GRID, PLACES, self.redraw)
        self.pilot = Pilot(GRID, PLACES, CHAIR_A)
        self.now_ns = 10**10

    def redraw(self, bars: tuple[Zone, ...], then: Callable[[], None]) -> None:
        """Draw the bars at once."""
        self.pilot.redraw(self.pilot.drawn(GRID, bars), PLACES)
        then()

    def run(self, seconds: float, pose: Pose2 | None = HOME, by_rider: bool = False, stands: bool = False) -> None:
        """Let time pass."""
        for _ in range(round(seconds * 10)):
            self.now_ns += STEP_NS
            self.port.step(self.now_ns, pose, self.pilot, by_rider, stands=stands)

    def ask(self) -> None:
        """Ask for the goal, as the navigator's node does."""
        self.pilot.go(Goal(GOAL.pose))
        self.port.ask(GOAL.pose, self.now_ns)

    def state(self) -> State:
        """Return the last State that others heard since the last call."""
        reader = Reader(self.fleet.building)
        letters = [reader.read(data)[0] for _, data in self.air.emptied(2, aside=False)]
        return [each.body for each in letters if each is not None and isinstance(each.body, State)][-1]


def test_a_goal_waits_for_its_way_and_then_the_chain_is_driven() -> None:
    chair = Alone()
    with pytest.raises(FleetError, match="on no way of its traffic graph"):
        chair.port.ask(GOAL.pose, 0)
    chair.run(0.2, pose=None)
    chair.run(0.2)
    chair.ask()
    chair.port.step(chair.now_ns, HOME, chair.pilot, False)
    authority = chair.pilot.navigator.granted.authority
    assert authority.stands
    assert authority.reason == "the chair waits for its turn"
    chair.run(1.0)
    authority = chair.pilot.navigator.granted.authority
    assert not authority.stands
    assert chair.pilot.waits
    assert chair.state().entered[0] == WAYS.slots[ROOMS[0]][0]
    chair.run(0.3, pose=None)
    assert chair.pilot.navigator.granted.authority.stands
    chair.pilot.drop("the rider ended it")
    chair.run(0.3)
    assert chair.pilot.navigator.granted.authority == FREE
    assert chair.state().wish is None


def test_a_chair_that_its_rider_steers_says_so_and_where_it_is() -> None:
    chair = Alone()
    chair.run(4.0)
    section = max(GRAPH.sections, key=lambda each: each.length)
    ends = [GRAPH.node[each] for each in (section.start, section.end)]
    here = Pose2((ends[0].x + ends[1].x) / 2, (ends[0].y + ends[1].y) / 2, 0.0)
    chair.run(1.0, pose=here, by_rider=True)
    state = chair.state()
    assert state.mode == MANUAL
    assert section.name in [WAYS.names[spot] for spot in state.entered]


def test_a_chair_whose_drive_ends_on_its_way_gives_back_the_spots_in_which_it_is_not() -> None:
    chair = Alone()
    chair.run(0.4)
    chair.ask()
    chair.run(1.0)
    assert len(chair.state().entered) > 1  # up to the next place where it may wait
    chair.pilot.drop("the rider ended it")
    chair.run(1.0)
    assert len(chair.state().entered) > 1  # it may still roll
    chair.run(1.0, stands=True)
    state = chair.state()
    assert state.entered == (WAYS.slots[ROOMS[0]][0],)
    assert state.mode == IN_ORDER
    chair.ask()
    chair.run(1.0, stands=True)
    assert len(chair.state().entered) > 1


def test_a_chair_in_a_refuge_is_in_the_slot_that_it_has_entered() -> None:
    refuges = tuple(replace(each, slots=2) for each in GRAPH.refuges)
    ways = ways_of(replace(GRAPH, refuges=refuges), 0.5)
    two, spots = ways.slots[ROOMS[0]], SpotsOfPose(ways, CHAIR_A, PLACES)
    assert [spots.at(HOME, entered) for entered in ((), two[:1], two[1:])] == [two[:1], two[:1], two[1:]]


def test_a_chair_that_leaves_its_room_by_its_own_eyes_sounds_its_tone() -> None:
    chair = Alone((1, 2, 3))
    chair.run(4.0)
    chair.ask()
    chair.run(4.4)
    assert chair.port.others.tones == 0
    chair.run(5.0)
    assert chair.port.others.tones == 1


def test_a_chair_that_goes_before_all_others_sounds_its_tone_again_and_again_while_it_drives() -> None:
    chair = Alone(voters=(9,))
    chair.run(1.0)
    chair.ask()

    def tones(seconds: float, stands: bool = False, given: bool = True) -> int:
        before = chair.port.others.tones
        for _ in range(round(2 * seconds)):
            if given:
                chair.air.carry(9, 1, "given", note_bytes(Given(1, int(Priority.TOP))))
            chair.run(0.5, stands=stands)
        return chair.port.others.tones - before

    tones(12.0, stands=True)  # it hears no warden, and sets off by its own eyes, which has a tone of its own
    assert chair.port.others.lit
    assert [tones(3.0, stands=True), tones(0.5), tones(4.5), tones(0.5)] == [0, 1, 0, 1]
    tones(GIVEN_LAPSES_NS * 1e-9 + 1.0, given=False)
    assert (chair.port.others.lit, tones(10.0, given=False)) == (False, 0)


def test_goals_off_the_graph_and_maps_without_its_places_are_refused() -> None:
    chair = Alone()
    chair.run(0.2)
    with pytest.raises(FleetError, match="drive to its places only: choose one, such as room 1"):
        chair.port.ask(Pose2(8.0, 3.0, 0.0), 0)
    some = {name: place for name, place in PLACES.items() if name != ROOMS[2]}
    with pytest.raises(FleetError, match=f"the map has no place '{ROOMS[2]}'"):
        FleetPort(chair.fleet, 1, 101, CarriedEnd(chair.air, 1), CHAIR_A, GRID, some, chair.redraw)


def test_a_pose_between_two_spots_is_in_both() -> None:
    spots = SpotsOfPose(WAYS, CHAIR_A, PLACES)
    assert spots.at(HOME) == (WAYS.slots[ROOMS[0]][0],)
    assert spots.at(Pose2(15.0, 60.0, 0.0)) == ()
    section = max(GRAPH.sections, key=lambda each: each.length)
    node = GRAPH.node[section.end]
    found = spots.at(Pose2(node.x - 0.5, node.y, 0.0))
    assert section.name in [WAYS.names[spot] for spot in found]
    assert section.end in [WAYS.names[spot] for spot in found]


def asks_and_drives(chair: Alone, pose: Pose2) -> bool:
    """Ask for the goal from a pose; return whether the chair may drive two seconds later."""
    chair.ask()
    chair.run(2.0, pose=pose, stands=True)
    return not chair.pilot.navigator.granted.authority.stands


def test_a_goal_that_is_asked_for_again_is_driven_to() -> None:
    chair = Alone()
    chair.run(0.4)
    assert asks_and_drives(chair, HOME)
    assert asks_and_drives(chair, HOME)


def test_a_chair_that_is_asked_for_the_room_in_whose_door_it_is_drives_in() -> None:
    chair = Alone()
    door = Pose2(GOAL.pose.x, GOAL.pose.y - 0.7, GOAL.pose.theta)
    chair.run(0.4, pose=door)
    assert asks_and_drives(chair, door)
    chair.pilot.drop("the rider ended it")
    chair.run(1.0, pose=door, stands=True)
    section = next(spot for spot, name in enumerate(WAYS.names) if name == f"n4-{ROOMS[3]}")
    member = chair.port._member
    assert member is not None
    member.stand_in((section, WAYS.slots[ROOMS[3]][0]))
    assert asks_and_drives(chair, door)
