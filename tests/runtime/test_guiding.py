"""Step guidance beside a whole chair: it moves nothing, counts the drive, and records it only after the rider's yes."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import pytest

from tests.full_disk import content
from tests.runtime.riding import START, Ride
from waychair.firmware_bridge.protocol import Holder
from waychair.maps.building.hgraph import Arc, GraphDoorway, HGraph, Node, NodeKind, Storey, SubMap
from waychair.planning.building.guided_ways import GuidedWays
from waychair.runtime.pages.guide_view import GuideView
from waychair.runtime.pages.guiding import Guide, guided_chair
from waychair.runtime.rider.habits import DecisionRow, DriveRow, Habits
from waychair.types import DriveMode

BED = "Ground/Bay/Window bed"


def hall_graph() -> HGraph:
    """Three crosses along the hall, a bed at its end, and a way to the side in its middle."""
    nodes = (
        Node("a", NodeKind.CROSS, START.x, START.y),
        Node("b", NodeKind.CROSS, 5.0, 2.5),
        Node("c", NodeKind.CROSS, 7.0, 2.5),
        Node("s", NodeKind.CROSS, 5.0, 4.0),
    )
    arcs = (Arc("a", "b"), Arc("b", "c"), Arc("b", "s"))
    ground = SubMap("g", "Ground", storey="g", nodes={each.id: each for each in nodes}, arcs=arcs)
    ground = SubMap(**{**_fields(ground), "doorways": (GraphDoorway("c", "bay", "d"),)})
    bay = (Node("d", NodeKind.BRIDGE, 7.1, 2.5), Node("e", NodeKind.END, 8.5, 2.5, "Window bed"))
    child = SubMap("g/bay", "Bay", nodes={each.id: each for each in bay}, arcs=(Arc("d", "e"),))
    return HGraph("Hall", (Storey("g", "Ground"),), {"": SubMap(""), "g": ground, "g/bay": child})


def _fields(submap: SubMap) -> dict[str, object]:
    return {name: getattr(submap, name) for name in ("path", "name", "frame", "storey", "nodes", "arcs")}


@dataclass
class GuidedRide:
    """A ride with guidance."""

    ride: Ride
    guide: Guide

    def tick(self, ticks: int, forward: float = 0.0, turn: float = 0.0) -> GuideView:
        """Let ticks pass while a page steers, or does not."""
        for _ in range(ticks):
            if forward or turn:
                self.ride.chair.steer(forward, turn, self.ride.simulator.now_ns)
            self.ride.tick()
            self.guide.step(guided_chair(self.ride.states[-1]), "g")
        assert self.guide.view is not None
        return self.guide.view


@pytest.fixture
def guided(tmp_path: Path) -> object:
    """A ride to the bed, with a record that is off."""
    habits = Habits(tmp_path / "data" / "habits.jsonl", lambda: datetime(2026, 11, 26, 9, 0))
    with Ride() as ride, ThreadPoolExecutor(1) as worker:
        ride.tick(10)
        guide = Guide(lambda: ride.chair.odom_from_base, habits, worker)
        yield GuidedRide(ride, guide), habits, worker


def begins(guided: GuidedRide) -> None:
    guided.guide.go(BED, 2, guided.ride.simulator.now_ns, GuidedWays(hall_graph()))


def drives_there(guided: GuidedRide) -> GuideView:
    begins(guided)
    view = guided.tick(60)
    for _ in range(60):
        view = guided.tick(10, 1.0)
        if view.arrived:
            break
    return view


def test_a_guided_chair_in_manual_is_told_and_never_moved(guided: tuple[GuidedRide, Habits, object]) -> None:
    ride, _, _ = guided
    begins(ride)
    view = ride.tick(150)
    assert view.sentence == "Straight on, 4 m, to the door."
    assert view.count >= 1
    assert ride.ride.states[-1].verdict.mode is DriveMode.MANUAL
    assert all(not state.sent.active for state in ride.ride.states)
    assert ride.ride.simulator.lines is not None
    assert ride.ride.simulator.lines.holder == Holder.JOYSTICK
    assert ride.ride.stands


def test_a_guided_rider_who_steers_into_the_wall_is_kept_from_it(guided: tuple[GuidedRide, Habits, object]) -> None:
    ride, _, _ = guided
    begins(ride)
    ride.tick(400, 1.0, 0.25)
    assert ride.ride.simulator.contacts == 0


def test_nothing_is_on_disk_without_a_yes_and_all_of_it_after_one_and_none_after_erasing(
    guided: tuple[GuidedRide, Habits, ThreadPoolExecutor], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("HOME", "XDG_DATA_HOME", "XDG_STATE_HOME"):
        monkeypatch.setenv(name, str(tmp_path))
    ride, habits, worker = guided
    assert drives_there(ride).arrived
    worker.submit(lambda: None).result()
    assert not [name for name, data in content(tmp_path).items() if data is not None]  # no place, no time, no file

    habits.say_yes()
    begins(ride)
    ride.tick(20)
    worker.submit(lambda: None).result()
    rows = habits.rows()
    assert [row.goal for row in rows if isinstance(row, DriveRow)] == [BED]
    assert all(isinstance(row, DriveRow | DecisionRow) for row in rows)
    assert len(habits.csv().splitlines()) == 1 + len(rows)
    assert b"8.5" not in (tmp_path / "data" / "habits.jsonl").read_bytes()  # names, never coordinates

    habits.erase()
    assert not [name for name, data in content(tmp_path).items() if data is not None]


def test_a_guided_drive_counts_prompts_and_rests_and_knows_the_time_by_the_graph(
    guided: tuple[GuidedRide, Habits, ThreadPoolExecutor],
) -> None:
    ride, habits, worker = guided
    habits.say_yes()
    assert drives_there(ride).sentence == "You are at Window bed."
    worker.submit(lambda: None).result()
    (drive,) = (row for row in habits.rows() if isinstance(row, DriveRow))
    assert drive.arrived
    assert drive.prompts >= 2
    assert 5.0 < drive.expected_s < drive.seconds < 60.0
    done = [row.done for row in habits.rows() if isinstance(row, DecisionRow)]
    assert done == ["hesitated", *["followed"] * 3]  # the chair arms for more than four seconds; cross, door, bed
