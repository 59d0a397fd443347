"""Journeys over storeys by ROS: the action travel, the rider's word, lifts over Open-RMF's topics, and simulated ones behind."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.maps.building.buildings import two_storeys
from tests.maps.building.test_lift_cabins import CABIN, with_cabins
from waychair.calibration.chair_body import CHAIR_A
from waychair.config import Settings
from waychair.control.drive.navigation import Navigation, Stage
from waychair.errors import BuildingError, MessageError, UnknownPlace
from waychair.maps.building.building import Building, save_with_map
from waychair.maps.building.hgraph import Beacon
from waychair.maps.drawn.places import save_places
from waychair.maps.folders.map_files import save_map
from waychair.planning.building.beacon_places import storey_of_beacon
from waychair.ros import topics
from waychair.ros.messages.chair import DriveReport
from waychair.ros.messages.floor import Floor, StoreyGoal, read_journey_state, storey_goal
from waychair.ros.messages.lifts import (
    DoorState,
    LiftMode,
    LiftRequest,
    LiftState,
    MotionState,
    RequestType,
    lift_request,
    lift_state,
    read_lift_request,
    read_lift_state,
)
from waychair.ros.messages.motion import read_pose_with_covariance
from waychair.ros.messages.wire import deserialised, serialised
from waychair.ros.nodes.parts.simulated_lifts import SESSION_S, SimulatedLiftAdapter
from waychair.runtime.tag_watch import TagWord
from waychair.simulation.lifts.lifts import Lifts
from waychair.simulation.plan.world import load_levels
from waychair.types import DriveMode, Goal, OccupancyGrid, Place, Pose2, Scan, Twist

if TYPE_CHECKING:
    from tests.ros.harness import Harness

S = 1_000_000_000
ASK = LiftRequest(5 * S, "lift", "waychair", RequestType.AGV, "upper")


def test_requests_and_states_arrive_unchanged_and_wrong_ones_are_named() -> None:
    state = LiftState(7, "A", ("g", "1"), "g", "1", DoorState.MOVING, MotionState.UP, LiftMode.AGV, "waychair")
    for sent, made, read in ((ASK, lift_request, read_lift_request), (state, lift_state, read_lift_state)):
        message = made(sent)
        assert read(deserialised(serialised(message), message.__msgtype__)) == sent
    message = lift_state(state)
    message.door_state = 9
    with pytest.raises(MessageError, match="9 is no DoorState of a lift: check its adapter"):
        read_lift_state(message)


def test_a_simulated_lift_serves_one_session_and_keeps_its_door_open_until_the_end() -> None:
    said: list[str] = []
    lifts = Lifts(load_levels("two_floors"))
    adapter, now_ns = SimulatedLiftAdapter(lifts, said.append), 0

    def run(seconds: float, *requests: LiftRequest) -> LiftState:
        nonlocal now_ns
        for request in requests:
            adapter.hear(request)
        states: tuple[LiftState, ...] = ()
        for k in range(round(seconds * 10)):
            now_ns += S // 10
            lifts.step(now_ns)
            if requests and k % 10 == 9 and requests[-1].kind is not RequestType.END_SESSION:
                adapter.hear(requests[-1])
            states = adapter.step(now_ns) or states
        return next(state for state in states if state.lift == name)

    name = next(iter(lifts.lifts))
    bottom, top = lifts.lifts[name].stops
    up = replace(ASK, lift=name, floor=top)
    moving = run(3.0, up)
    assert (moving.motion, moving.floor, moving.session) == (MotionState.UP, bottom, "waychair")
    stands = run(25.0, up)
    assert (stands.motion, stands.floor, stands.door) == (MotionState.STOPPED, top, DoorState.OPEN)
    other = run(10.0, up, replace(up, session="robot", floor=bottom), up)
    assert (other.floor, other.session) == (top, "waychair")  # a second session waits
    ended = run(20.0, replace(up, kind=RequestType.END_SESSION))
    assert (ended.door, ended.session, ended.mode) == (DoorState.CLOSED, "", LiftMode.HUMAN)
    assert run(SESSION_S + 1.0, replace(up, session="robot")).session == "robot"
    assert run(SESSION_S + 1.0).session == ""  # its requester has died
    adapter.hear(replace(up, floor="attic"))
    run(0.5)
    assert said == [f"lift '{name}' does not stop at 'attic': see lift_states"]


@dataclass(frozen=True, slots=True)
class NoSettings(Settings):
    """None."""


@dataclass
class Driver:
    """A `LegDriver` whose drives arrive when the test says so."""

    folder: Path
    legs: list[Goal] = field(default_factory=list)
    goal_id: int = 0
    drives: bool = False
    stage: Stage = Stage.IDLE
    pose: Pose2 = field(default_factory=lambda: Pose2(4.0, 0.0))
    certain: bool = True
    stamp_ns: int = 10 * S

    def now(self) -> Any:
        from waychair.ros.nodes.navigator_parts.remote_chair import ChairNow

        mode = DriveMode.AUTONOMOUS if self.drives else DriveMode.MANUAL
        state = DriveReport(self.stamp_ns, self.goal_id, mode, ready=True)
        floor = Floor(0, str(self.folder.resolve()), 7, "Clinic", self.folder.name, certain=self.certain)
        navigation = Navigation(self.stage)
        return ChairNow(
            self.stamp_ns, self.pose, Pose2(), Pose2(), Twist(), None, navigation, self.goal_id, state, floor, 7
        )

    def begin_leg(self, goal: Goal, goal_id: int) -> None:
        self.legs.append(goal)
        self.goal_id, self.stage = goal_id, Stage.DRIVING

    def cancel_leg(self) -> None:
        self.drives, self.stage = False, Stage.IDLE

    def pause_leg(self) -> bool:
        return False

    def go_on_leg(self) -> bool:
        return False


class Site:
    """A node with journeys on the ground floor of a building, and what it says."""

    def __init__(self, ros: Harness, folder: Path) -> None:
        from waychair.ros.nodes.navigator_parts.journeys import Journeys
        from waychair.ros.nodes.node import ChairNode

        self.ros, self.driver = ros, Driver(folder / "maps" / "g")
        self.node: Any = ChairNode("journeys", NoSettings)
        self.told, self.requests = ros.heard(topics.JOURNEY), ros.heard(topics.LIFT_REQUESTS)
        self.journeys = Journeys(self.node, self.driver, CHAIR_A)

    @property
    def report(self) -> Any:
        return read_journey_state(self.told[-1])

    def ask(self, goal: StoreyGoal, condition: Any, what: str) -> None:
        """Send a goal until the condition holds: a node that was just made may not be connected yet."""
        send = self.ros.publisher(topics.STOREY_GOAL)
        sent_s = 0.0

        def again() -> bool:
            nonlocal sent_s
            if condition():
                return True
            if time.monotonic() - sent_s > 3.0:
                sent_s = time.monotonic()
                send(storey_goal(goal))
            return False

        self.until(again, what)

    def until(self, condition: Any, what: str) -> None:
        def tick() -> None:
            self.driver.stamp_ns = self.node.now_ns()
            self.journeys.step()

        self.ros.spin_until(condition, what, tick)


@pytest.fixture
def site(ros: Harness, tmp_path: Path) -> Iterator[Site]:
    save_map(tmp_path / "map", OccupancyGrid(np.zeros((120, 200), np.int8), 0.1, Pose2(0.0, -6.0)))
    building = Building(tmp_path / "clinic", with_cabins(two_storeys()))
    for storey in ("g", "1"):
        save_places(tmp_path / "map", {f"Bed {storey}": Place(f"Bed {storey}", Pose2(10.0, 3.25))})
        building = save_with_map(building, storey, tmp_path / "map")
    found = Site(ros, tmp_path / "clinic")
    with ros.serving(found.node):
        yield found
    found.told.close()
    found.requests.close()


def test_a_journey_to_another_storey_begins_by_one_yes_and_calls_the_lift(site: Site) -> None:
    site.ask(StoreyGoal("First/Ward/Bed 1", "First"), lambda: site.told and site.report.phase == "asked", "the plan")
    assert site.report.sentence.startswith("press Drive to go to First")
    assert site.driver.legs[-1].tolerance_m == 0.3  # to the lobby, which waits for the yes
    site.driver.drives = True
    site.until(lambda: site.report.phase == "drive", "the yes")
    site.driver.stage, site.driver.drives = Stage.ARRIVED, False
    site.until(lambda: site.report.phase == "call" and site.requests, "the call")
    called = read_lift_request(site.requests[-1])
    assert (called.lift, called.floor, called.kind) == ("A", "g", RequestType.AGV)
    site.journeys.cancel()
    site.until(lambda: read_lift_request(site.requests[-1]).kind is RequestType.END_SESSION, "the end of the session")
    assert site.report.phase == "failed"
    assert not site.journeys.active


def test_a_journey_ends_once_the_mapper_doubts_the_storey_outside_of_a_ride(site: Site) -> None:
    site.ask(StoreyGoal("First/Ward/Bed 1"), lambda: site.told and site.report.phase == "asked", "the plan")
    site.driver.drives = True
    site.until(lambda: site.report.phase == "drive", "the yes")
    site.driver.certain = False
    site.until(lambda: site.report.phase == "failed", "the end")
    assert (
        site.report.sentence == "the storey is not certain any more: say which one it is, then ask for the goal again"
    )
    assert not site.driver.drives


def test_what_cannot_be_travelled_to_is_refused_with_a_sentence(site: Site) -> None:
    for goal, certain, why in (
        (StoreyGoal("Bed 1", "Attic"), True, "there is no storey 'Attic': take one of Ground, First"),
        (StoreyGoal("Bed 9", "First"), True, "there is no goal 'Bed 9' on storey '1'"),
        (StoreyGoal("First/Ward/Bed 1"), False, "the storey is not certain: say which one it is"),
    ):
        site.driver.certain = certain
        site.ask(goal, lambda why=why: site.told and why in site.report.sentence, why)
        assert site.report.phase == "refused"
    assert site.driver.legs == []


def test_in_a_lift_no_other_goal_is_taken(site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    from waychair.runtime.journeys import Traveller

    site.ask(StoreyGoal("First/Ward/Bed 1"), lambda: site.journeys.active, "the plan")
    monkeypatch.setattr(Traveller, "aboard", property(lambda self: True))
    with pytest.raises(BuildingError, match="the chair is in a lift: cancel the journey, or wait"):
        site.journeys.make_way()


def test_a_storey_without_a_map_or_with_a_map_of_no_building_is_named(site: Site) -> None:
    from waychair.maps.building.building import load_building
    from waychair.maps.building.hgraph_files import write_hgraph
    from waychair.ros.nodes.parts.journey_plan import planned

    folder = site.driver.folder.parents[1]
    hgraph = load_building(folder).hgraph
    bare = tuple(replace(each, map="") if each.id == "1" else each for each in hgraph.storeys)
    write_hgraph(folder, replace(hgraph, storeys=bare))
    with pytest.raises(BuildingError, match=r"is no place of its storey's map|storey '1' has no map"):
        planned(folder / "maps" / "g", Pose2(4.0, 0.0), CHAIR_A, StoreyGoal("First/Ward/Bed 1"))
    with pytest.raises(BuildingError, match="the map belongs to no building"):
        planned(folder.parent / "map", Pose2(4.0, 0.0), CHAIR_A, StoreyGoal("First/Ward/Bed 1"))


def test_a_beacon_sets_the_storey_at_rest_and_ends_a_drive_on_another_storeys_map(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    from waychair.maps.building.building import load_building
    from waychair.maps.building.hgraph_files import write_hgraph

    folder = site.driver.folder.parents[1]
    hgraph = load_building(folder).hgraph
    for path, name in (("g", "7"), ("1", "8"), ("g", "both"), ("1", "both")):
        submap = hgraph.submaps[path]
        tagged = replace(submap, beacons=(*submap.beacons, Beacon(name, Pose2(1.0, 0.0))))
        hgraph = replace(hgraph, submaps={**hgraph.submaps, path: tagged})
    write_hgraph(folder, hgraph)
    assert storey_of_beacon(hgraph, " 8 ") == "1"
    with pytest.raises(BuildingError, match=r"beacon 'both' is on several storeys \(1, g\): give each its own id"):
        storey_of_beacon(hgraph, "both")
    said: list[str] = []
    monkeypatch.setattr(site.journeys, "_say_storey", lambda storey: said.append(storey) or "taken")
    monkeypatch.setattr(site.journeys, "_doubt", said.append)
    site.driver.stamp_ns = site.node.now_ns()
    for beacon in ("7", "9", "both"):  # where it is, unknown, and no use
        site.journeys._meet_beacon(beacon)
    assert said == []
    site.journeys._meet_beacon("8")
    assert said.pop() == "1"
    site.driver.certain = False
    site.journeys._meet_beacon("7")
    assert said.pop() == "g"
    site.driver.drives = True
    site.journeys._meet_beacon("8")
    assert "beacon '8' is on storey '1'" in said.pop()
    assert not site.driver.drives


def test_tags_tell_the_storey_first_and_then_set_the_place_of_a_lost_chair(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[str] = []
    monkeypatch.setattr(site.journeys, "_say_storey", lambda storey: said.append(storey) or "taken")
    given: list[Pose2] = []
    monkeypatch.setattr(
        site.journeys, "_send_pose", lambda message: given.append(read_pose_with_covariance(message)[0])
    )
    site.driver.stamp_ns = site.node.now_ns()
    here, odom = TagWord("7", "g", Pose2(4.0, 1.0)), site.driver.now().odom_from_base
    assert odom is not None
    site.journeys.meet_tags((TagWord("8", "1", Pose2(4.0, 1.0)),), odom)
    assert said == ["1"]
    assert given == []  # of another map than the present one
    for _ in range(2):
        site.journeys.meet_tags((here,), odom)
    (pose,) = given
    assert (pose.x, pose.y) == pytest.approx((4.0, 1.0))
    site.driver.certain = False
    for _ in range(2):
        site.journeys.meet_tags((here,), odom)
    assert len(given) == 1  # the storey comes first
    assert said == ["1", "g", "g"]


def test_the_start_is_chosen_like_a_goal_also_on_another_storey(site: Site) -> None:
    site.driver.stamp_ns = site.node.now_ns()
    assert "takes the map of 1, and localises itself at First/Ward/Bed 1" in site.journeys._say_storey(
        "", "First/Ward/Bed 1"
    )
    assert "takes the map of g" in site.journeys._say_storey("Ground", "Bed g")
    with pytest.raises(UnknownPlace, match="there is no place 'Bed 1'"):
        site.journeys._say_storey("g", "Bed 1")
    with pytest.raises(BuildingError, match="there is no goal 'First/Ward/Bed 9': see waychair building stats"):
        site.journeys._say_storey("", "First/Ward/Bed 9")


def test_the_riders_word_for_the_storey_is_taken_at_rest_and_a_wrong_name_is_told(site: Site) -> None:
    site.driver.stamp_ns = site.node.now_ns()
    assert "takes the map of 1" in site.journeys._say_storey("first")
    with pytest.raises(BuildingError, match="there is no storey 'Cellar': take one of Ground, First"):
        site.journeys._say_storey("Cellar")
    site.driver.drives = True
    with pytest.raises(BuildingError, match="the chair is on its way: cancel the drive first"):
        site.journeys._say_storey("First")


def test_in_a_lift_whose_door_is_not_seen_open_the_storey_is_doubted_and_no_word_is_taken(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[str] = []
    monkeypatch.setattr(site.journeys, "_doubt", said.append)
    blind = Scan(0, np.full(720, np.nan, np.float32), -2.356, 4.712 / 719)

    def look() -> bool:
        site.journeys.hear(blind)
        return bool(said)

    site.until(lambda: site.journeys._cabins._sites, "the lifts of the map")
    assert not look()
    site.driver.pose = Pose2(CABIN.x, CABIN.y, CABIN.theta)
    site.until(look, "the doubt")
    assert said == ["the chair is in a lift whose door is not open, so that its storey is not certain"]
    with pytest.raises(BuildingError, match="the door of the lift is not open: say the storey once it is"):
        site.journeys._say_storey("Ground")
    site.driver.certain, site.driver.pose = False, Pose2(4.0, 0.0)
    assert look()
    assert "takes the map of g" in site.journeys._say_storey("Ground")
    assert len(said) == 1
