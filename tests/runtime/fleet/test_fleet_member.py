"""A chair as a member of a fleet: it gets its turn, tells its rider and the staff's desk, and takes priorities from there only."""

from __future__ import annotations

import json
from pathlib import Path

from waychair.calibration.chair_body import CHAIR_A
from waychair.control.drive.navigation import Navigation, Stage
from waychair.maps.traffic.corridors import CorridorPlan, corridor_graph
from waychair.planning.fleet.peers.messages import building_of
from waychair.planning.fleet.peers.peer import Fleet, Own, Peer
from waychair.planning.fleet.waits import Reason
from waychair.planning.fleet.ways import ways_of
from waychair.runtime.fleet.audit_file import AuditFile
from waychair.runtime.fleet.chain_driving import ChainDriver
from waychair.runtime.fleet.chain_geometry import drivable
from waychair.runtime.fleet.desk.desk_messages import GIVEN_LAPSES_NS, Given, note_bytes
from waychair.runtime.fleet.desk.live_desk import LiveDesk
from waychair.runtime.fleet.desk.staff_desk import StaffDesk
from waychair.runtime.fleet.fleet_member import FleetMember, MemberStep
from waychair.runtime.fleet.shut_ways import NO_WAY_ROUND_MS
from waychair.runtime.pages.chair_port import OthersView
from waychair.trials.fleet.fleet_on_lines import CarriedEnd, CarriedMessages
from waychair.trials.fleet.fleet_scenes import places_in_rooms

PLAN = CorridorPlan("straight", (30.0, 6.0), ((3.0, 3.0, 27.0, 3.0),))
GRAPH = corridor_graph(PLAN, 1.2, rooms=True, bays=False)
WAYS = drivable(ways_of(GRAPH, 0.5), CHAIR_A)
PLACES = dict(places_in_rooms(PLAN))
ROOMS = [refuge.name for refuge in GRAPH.refuges]
STEP_NS = 100_000_000
DESK = 9
KEY = "open sesame"


GOALS = {1: ROOMS[-2], 2: ROOMS[1]}
"""Goals for which the two meet in a corridor in which they cannot pass."""


class Ward:
    """Two chairs that stand in the first and the last room, and a voter with the staff's desk.

    `log` is the first chair's; `navigation` what its navigator says.
    """

    def __init__(self, log: AuditFile | None = None, voters: tuple[int, ...] = (DESK,)) -> None:
        fleet = Fleet(building_of(GRAPH), WAYS, frozenset((1, 2)), frozenset(voters))
        self.air = CarriedMessages([1, 2, DESK])
        self.starts = {1: ROOMS[0], 2: ROOMS[-1]}
        self.members = {
            number: FleetMember(
                fleet,
                number,
                100 + number,
                ChainDriver(WAYS, number, CHAIR_A, PLACES),
                start,
                CarriedEnd(self.air, number),
                log if number == 1 else None,
            )
            for number, start in self.starts.items()
        }
        self.voter, self.end = Peer(fleet, DESK, 109), CarriedEnd(self.air, DESK)
        self.staff = StaffDesk(KEY)
        self.desk = LiveDesk(fleet, self.staff)
        self.now_ns = 10**10
        self.steps: dict[int, MemberStep] = {}
        self.navigation: Navigation | None = None

    def run(self, seconds: float) -> None:
        """Let time pass; no chair moves."""
        for _ in range(round(seconds * 10)):
            self.now_ns += STEP_NS
            for number, member in self.members.items():
                navigation = self.navigation if number == 1 else None
                pose = PLACES[self.starts[number]].pose
                self.steps[number] = member.step(self.now_ns, pose, 0, navigation=navigation)
            heard = self.end.received()
            step = self.voter.step(self.now_ns, Own(), heard)
            for to, kind, data in step.send:
                self.end.send(to, kind, data)
            own = [(DESK, data) for to, _, data in step.send if to is None]
            self.desk.hear([*heard, *own], self.end.received_aside(), self.now_ns)
            for kind, data in self.desk.due(self.now_ns):
                self.end.send(None, kind, data)


def test_a_chair_that_waits_says_for_whom_and_why_to_its_rider_and_to_the_desk() -> None:
    ward = Ward()
    ward.run(6)
    ward.members[2].want(ROOMS[0], ward.now_ns)
    ward.run(2)
    wait = ward.steps[2].wait
    assert wait is not None
    assert (wait.other, wait.reason, ward.steps[1].wait) == (1, Reason.TAKEN, None)
    assert ward.steps[2].told == wait.why == "Waits for chair 1 to leave room 1."
    assert ward.members[2].others(ward.now_ns) == OthersView(wait.why, None, ((1, "Stands by."),))
    assert ward.members[1].others(ward.now_ns) == OthersView("", None, ((2, wait.why),))
    rows = {row["chair"]: row for row in ward.desk.view(ward.now_ns)["chairs"]}
    assert (rows[2]["told"], rows[2]["goal"], rows[1]["told"]) == (wait.why, "room 1", "Stands by.")
    assert ward.desk.view(ward.now_ns)["waited"] == []
    ward.members[2].want(None, ward.now_ns)
    ward.run(1)
    ended = ward.desk.view(ward.now_ns)["waited"]
    assert [(each["waits"], each["first"], each["rule"]) for each in ended] == [(2, 1, "the place is taken")]


def test_the_way_is_granted_soon_after_the_wish_and_the_time_is_measured() -> None:
    ward = Ward()
    ward.run(6)
    for number in (1, 2):
        ward.members[number].want(GOALS[number], ward.now_ns)
    ward.run(1)
    assert all(member.driver.authority.chain for member in ward.members.values())
    first, second = (ward.members[number].measured() for number in (1, 2))
    assert max([*first.answers_ms, *second.answers_ms]) <= 300.0
    assert max(first.ages_ms[-20:]) <= 350.0
    assert ward.members[1].measured().ages_ms == []


def test_a_request_is_answered_between_two_steps_and_the_asker_knows() -> None:
    ward = Ward(voters=())
    ward.run(6)
    term = ward.members[1].driver.peer.allegiance.term
    assert term is not None
    warden, asker = ward.members[term.warden], ward.members[3 - term.warden]
    number = 3 - term.warden
    asker.want(GOALS[number], ward.now_ns)
    asker.step(ward.now_ns, PLACES[ward.starts[number]].pose, 0)
    assert not asker.has_news
    warden.answer(ward.now_ns + 2_000_000)
    asker.answer(ward.now_ns + 4_000_000)
    assert asker.has_news
    assert asker.driver.authority.chain
    assert asker.measured().answers_ms == [4.0]
    ward.run(0.1)
    assert not asker.has_news


def test_f34_a_clock_that_ran_back_ends_all_leases_but_a_step_that_waited_for_an_answer_ends_none() -> None:
    ward = Ward(voters=())
    ward.run(6)
    ward.members[1].want(GOALS[1], ward.now_ns)
    ward.run(1)
    member, pose = ward.members[1], PLACES[ward.starts[1]].pose
    member.answer(ward.now_ns + 50_000_000)
    member.step(ward.now_ns + 20_000_000, pose, 0)
    assert member.driver.authority.chain
    member.step(ward.now_ns - 10**9, pose, 0)
    assert not member.driver.authority.chain


def test_a_chair_that_was_pushed_answers_only_once_it_has_said_where_it_is() -> None:
    ward = Ward(voters=())
    ward.run(6)
    member = ward.members[1]
    assert member.driver.can_answer
    member.stand_in(ward.members[1].entered)
    assert not member.driver.can_answer
    member.answer(ward.now_ns)
    ward.run(0.1)
    assert member.driver.can_answer


def test_a_chair_takes_a_priority_from_the_desk_and_has_its_own_again_when_the_desk_is_gone() -> None:
    ward = Ward()
    ward.run(6)
    for number in (1, 2):
        ward.members[number].want(GOALS[number], ward.now_ns)
    ward.air.carry(1, 2, "given", note_bytes(Given(2, 3)))
    ward.run(1)
    assert {row["chair"]: row["priority"] for row in ward.desk.view(ward.now_ns)["chairs"]} == {
        1: "routine",
        2: "routine",
    }
    assert ward.staff.give(2, "top", KEY, ward.now_ns // 1_000_000, 5.0) == "Chair 2 has TOP for 5 min."
    ward.run(1.5)
    rows = {row["chair"]: row for row in ward.desk.view(ward.now_ns)["chairs"]}
    assert (rows[2]["priority"], rows[2]["minutes_left"]) == ("top", 5.0)
    seen = {number: ward.members[number].others(ward.now_ns) for number in (1, 2)}
    assert (seen[2].first, seen[2].lit) == ("Goes before all others: staff said so.", True)
    assert (seen[1].first, seen[1].lit) == ("", False)
    ward.staff.give(2, "routine", KEY, ward.now_ns // 1_000_000)
    ward.run(GIVEN_LAPSES_NS * 1e-9 + 1.5)
    assert not ward.members[2].others(ward.now_ns).lit
    assert {row["chair"]: row["priority"] for row in ward.desk.view(ward.now_ns)["chairs"]}[2] == "routine"


def test_a_chair_that_finds_its_way_shut_tells_all_others() -> None:
    ward = Ward()
    ward.run(6)
    ward.members[1].want(GOALS[1], ward.now_ns)
    ward.run(1)
    assert ward.steps[1].wait is None
    ward.navigation = Navigation(Stage.WAITING, plans=1)
    ward.run(NO_WAY_ROUND_MS * 1e-3 - 1.0)
    assert ward.desk.view(ward.now_ns)["closed"] == []
    section = ward.members[1].driver.driver.section_ahead()
    ward.run(2)
    assert ward.desk.view(ward.now_ns)["closed"] == [section]


def test_the_warden_keeps_the_waits_under_its_order(tmp_path: Path) -> None:
    log = AuditFile(tmp_path / "waits.jsonl")
    ward = Ward(log)
    ward.run(6)
    ward.members[2].want(ROOMS[0], ward.now_ns)
    ward.run(2)
    assert ward.members[1].driver.peer.grants
    ward.members[2].want(None, ward.now_ns)
    ward.members[1].want(GOALS[1], ward.now_ns)  # the warden looks at all waits anew
    ward.run(1)
    records = [json.loads(line) for line in log.path.read_text(encoding="utf-8").splitlines()]
    assert records
    assert {(each["event"], each["waits"], each["first"]) for each in records} == {("waited", 2, 1)}
    log.close()
