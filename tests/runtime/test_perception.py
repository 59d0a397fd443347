"""Behaviour cells in a chair's tick: what they are told of, bad inputs named in one sentence, and their trace."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

from tests.runtime.boxes import LOGGED_CHAIR, Drive, driven
from tests.runtime.riding import FAR, Ride
from waychair.calibration.chair_body import CHAIR_A
from waychair.control.behaviours import default
from waychair.control.behaviours.commands import FreeKind
from waychair.control.behaviours.presets import preset_network
from waychair.control.behaviours.replay import replay
from waychair.control.behaviours.trace import Trace, read_trace
from waychair.control.drive.doors.doorway_tracker import DoorwayTracker
from waychair.errors import OutputError, TraceError
from waychair.planning.seen.doorways import DoorState, Doorway
from waychair.runtime.black_box.cell_traces import CellTraceFile, trace_at
from waychair.runtime.black_box.recorder import BlackBox, BlackBoxSettings
from waychair.runtime.chair import ChairSettings
from waychair.runtime.perception import CellInputs, Perceived, Perception
from waychair.slam.localising.localisation import Localisation, LocalisationState
from waychair.trials.drive import start_drive
from waychair.types import (
    JoystickInput,
    OccupancyGrid,
    Odometry,
    Pose2,
    RgbdFrame,
    Scan,
    SonarReadings,
    Twist,
)

TICK_NS = 50_000_000
EMPTY_MAP = OccupancyGrid(np.zeros((160, 160), np.int8), 0.05, Pose2(-4.0, -4.0))


class Rider:
    """The cells of chair A, ticked at 20 Hz; `at` is the odometry."""

    def __init__(self) -> None:
        self.cells, self.now_ns, self.at = Perception(CHAIR_A, timer=None), 0, Pose2()
        self.localisation: Localisation | None = None
        self.grid = EMPTY_MAP

    def tick(
        self, lidar: float | None = 3.0, sonars: list[float] | None = None, odometry: bool = True, **told: Any
    ) -> Perceived:
        self.now_ns += TICK_NS
        if lidar is not None:
            self.cells.see(circle(lidar, self.now_ns), self.at)
        if sonars is not None:
            self.cells.hear(SonarReadings(self.now_ns, np.array(sonars, np.float32)), self.at)
        moved = Odometry(self.now_ns, self.at, Twist()) if odometry else None
        stick = told.get("stick")
        people = told.get("people", np.empty((0, 2)))
        return self.cells.step(self.now_ns, CellInputs(moved, self.at, self.localisation, self.grid, people, stick))

    def ticks(self, count: int, **told: Any) -> Perceived:
        for _ in range(count):
            done = self.tick(**told)
        return done


def circle(metres: float, at_ns: int) -> Scan:
    """A scan all round at one range, from the chair's lidar."""
    return Scan(at_ns, np.full(720, metres, np.float32), -math.pi, math.tau / 720, range_max=20.0)


def free(perceived: Perceived) -> tuple[FreeKind, int]:
    command = perceived.done.ports["Free-space finding"].eo.command
    return command.kind, len(command.orientations)


def test_a_chair_among_free_ground_is_told_so_and_nothing_is_wrong() -> None:
    done = Rider().ticks(4)
    assert free(done) == (FreeKind.LIST, 16)
    assert done.troubles == ()
    assert done.signal == "nothing near"


def test_people_and_the_stick_reach_the_cells() -> None:
    rider = Rider()
    done = rider.ticks(4, people=np.array([[1.6, 0.0]]), stick=JoystickInput(0, 1.0, 0.0))
    assert 0 < free(done)[1] < 16
    assert 0.0 not in done.done.ports["Free-space finding"].eo.command.orientations
    assert done.heard["stick"].forward == 1.0


def test_an_extra_tick_at_one_stamp_loses_no_message() -> None:
    rider = Rider()
    rider.ticks(4)
    rider.cells.see(circle(2.0, rider.now_ns), rider.at)
    rider.now_ns -= TICK_NS  # `tick` goes on by one: the stamp of the last tick again
    assert "lidar" not in rider.tick(lidar=None).heard
    assert rider.tick(lidar=None).heard["lidar"].ranges[0] == 2.0


# Bad inputs --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("told", "sentence"),
    [
        ({"lidar": math.nan}, "the lidar is blind"),
        ({"lidar": math.inf}, "the lidar is blind"),
        ({"lidar": None}, "the lidar is silent"),
        ({"odometry": False}, "the odometry is silent"),
    ],
)
def test_a_sensor_that_fails_is_named_and_nothing_stays_free(told: dict[str, Any], sentence: str) -> None:
    rider = Rider()
    assert free(rider.ticks(4))[1] == 16
    done = rider.ticks(30, **told)
    assert free(done) == (FreeKind.NULL, 0)
    assert [each.startswith(sentence) for each in done.troubles] == [True]
    assert done.signal == f"stop the chair: {done.troubles[0]}"


def test_a_pose_that_leaps_is_named_and_what_was_seen_before_is_forgotten() -> None:
    rider = Rider()
    rider.ticks(4)
    rider.at = Pose2(2.0, 0.0, 0.0)
    done = rider.ticks(4, lidar=None)
    assert "the pose leapt by 2.0 m, so what was seen before no longer counts" in done.troubles
    assert free(done)[0] is not FreeKind.LIST
    assert not rider.ticks(110).troubles


def test_a_doorway_that_was_held_is_forgotten_when_the_pose_leaps() -> None:
    found = Doorway(4, Pose2(3.0, 0.0, 0.0), 0.9, 0.88, 0.02, DoorState.OPEN)
    rider = Rider()
    rider.cells.door_wanted = True
    with patch.object(DoorwayTracker, "doorways", (found,)):
        assert rider.ticks(4).done.ports["Object tracker"].eo is not None
    assert rider.ticks(4).done.ports["Object tracker"].eo is not None  # by its memory
    rider.at = Pose2(2.0, 0.0, 0.0)
    assert rider.ticks(5).done.ports["Object tracker"].eo is None


def test_odometry_that_is_not_a_number_is_named_and_frees_nothing() -> None:
    rider = Rider()
    rider.ticks(4)
    rider.at = Pose2(math.nan, 0.0, 0.0)
    done = rider.ticks(4)
    assert free(done) == (FreeKind.NULL, 0)
    assert any(each.startswith("the odometry gives no numbers") for each in done.troubles)


@pytest.mark.parametrize(
    ("readings", "moves", "sentence"),
    [
        (lambda k: [math.nan] + 7 * [2.0 + 0.001 * k], False, "the sonars 1 do not answer"),
        (lambda k: [1.234] + 7 * [2.0 + 0.001 * k], True, "the sonars 1 read the very same range"),
        (lambda k: [0.5 + k % 7] + 7 * [2.0 + 0.001 * k], False, "the sonars 1 give ranges that no second one"),
    ],
)
def test_a_sonar_that_is_silent_stuck_or_hears_others_is_named(readings: Any, moves: bool, sentence: str) -> None:
    rider = Rider()
    for k in range(24):
        rider.at = Pose2(0.02 * k if moves else 0.0, 0.0, 0.0)
        done = rider.tick(sonars=readings(k))
    assert [each.startswith(sentence) for each in done.troubles] == [True]


def test_sonars_alone_free_nothing_while_each_echo_comes_alone() -> None:
    rider = Rider()
    for k in range(24):
        done = rider.tick(lidar=None, sonars=[0.8 + (k + each) % 5 for each in range(8)])
    assert free(done)[0] is not FreeKind.LIST
    assert any("may hear other sonars" in each for each in done.troubles)


def test_a_picture_that_cannot_be_read_is_named_and_the_others_go_on() -> None:
    rider = Rider()
    rider.ticks(3)
    flat = RgbdFrame(rider.now_ns, np.zeros((48, 64), np.uint8), np.full((48, 64), 2.0, np.float32), np.zeros((3, 3)))
    rider.cells.look(flat, rider.at, None)
    done = rider.ticks(3)
    assert [each.startswith("the depth could not be read: LinAlgError") for each in done.troubles] == [True]
    assert free(done)[1] == 16


def test_a_clock_that_is_set_back_is_named_and_the_cells_begin_anew() -> None:
    rider = Rider()
    rider.ticks(4)
    rider.now_ns = 0
    done = rider.tick()
    assert done.troubles[-1] == "the clock was set back, so what was seen before no longer counts"
    assert done.count == 0
    assert free(rider.ticks(4))[1] == 16


def test_a_cell_that_raises_is_named_and_the_others_go_on(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: Any, **__: Any) -> Any:
        raise ZeroDivisionError("no way")

    rider = Rider()
    rider.ticks(4)
    monkeypatch.setattr(default, "free_orientations", fails)
    done = rider.ticks(4)
    assert done.troubles == ("Way finder is inactive: ZeroDivisionError: no way",)
    assert done.done.ports["Way finder"].eo is None
    assert done.signal == "nothing near"


def test_a_cell_that_takes_too_long_is_named_and_gives_nothing() -> None:
    clock = iter(range(0, 10**15, 30_000_000))  # 30 ms pass between two looks at it
    cells = Perception(CHAIR_A, timer=lambda: next(clock))
    cells.see(circle(3.0, TICK_NS), Pose2())
    moved = Odometry(TICK_NS, Pose2(), Twist())
    done = cells.step(TICK_NS, CellInputs(moved, Pose2(), None, EMPTY_MAP, np.empty((0, 2)), None))
    assert "Gathered view is inactive: took too long" in done.troubles
    assert free_or_none(done) is None


def free_or_none(perceived: Perceived) -> Any:
    return perceived.done.ports["Free-space finding"].eo


@pytest.mark.parametrize("state", list(LocalisationState))
def test_the_map_is_told_only_while_the_pose_in_it_is_sure(state: LocalisationState) -> None:
    rider = Rider()
    wall = EMPTY_MAP.cells.copy()
    wall[:, 104] = 100  # 1.2 m ahead, where the lidar looks through
    rider.grid = replace(EMPTY_MAP, cells=wall)
    rider.localisation = located(state)
    done = rider.ticks(4)
    assert (0.0 in done.done.ports["Free-space finding"].eo.command.orientations) == (state is not LocalisationState.OK)


def located(state: LocalisationState) -> Localisation:
    return Localisation(state=state, map_from_odom=Pose2(), map_from_base=Pose2(), health=1.0, inliers=1.0)


# In the chair ------------------------------------------------------------------------------------------------------


def perceiving(seconds: float) -> tuple[Drive, Ride]:
    ride = Ride(settings=replace(ChairSettings(), perceive=True))

    def script(each: Ride) -> None:
        start_drive(each.simulator, each.chair, FAR)
        each.tick(round(20 * seconds))

    return driven(script, ride), ride


@pytest.fixture(scope="module")
def drive() -> Drive:
    """Four seconds of a drive with cells."""
    return perceiving(4.0)[0]


def test_the_cells_of_a_driving_chair_offer_its_way_and_one_without_the_switch_has_none(drive: Drive) -> None:
    last = drive.notes[-1][1]
    assert last.perceived is not None
    kind, count = free(last.perceived)
    assert kind is FreeKind.LIST
    assert count >= 5
    assert last.perceived.troubles == ()
    assert last.command is not None
    assert last.command.v > 0.3
    with Ride() as ride:
        assert ride.tick().perceived is None


def test_the_trace_of_a_drive_is_replayed_with_the_same_bytes(drive: Drive, tmp_path: Path) -> None:
    path = tmp_path / "a.trace"
    with CellTraceFile(path) as trace:
        for heard, state, board in drive.notes:
            trace.note_tick(heard, state, board)
    again = replay(read_trace(path), network(read_trace(path)))
    assert again.difference is None
    assert again.data == path.read_bytes()


def test_a_trace_that_cannot_be_written_lets_the_chair_drive_on_and_says_so_at_the_end(
    drive: Drive, tmp_path: Path
) -> None:
    trace = CellTraceFile(tmp_path)  # a folder
    for heard, state, board in drive.notes[:5]:
        trace.note_tick(heard, state, board)
    with pytest.raises(OutputError, match="cannot write"):
        trace.__exit__(None, None, None)


def test_a_trace_that_began_late_is_shown_and_its_replay_refused(drive: Drive, tmp_path: Path) -> None:
    with CellTraceFile(tmp_path / "a.trace") as file:
        for heard, state, board in drive.notes[10:20]:
            file.note_tick(heard, state, board)
    trace = read_trace(tmp_path / "a.trace")
    assert len(trace.innervations) == 10
    with pytest.raises(TraceError, match="records are missing before innervation 0"):
        replay(trace, network(trace))


def network(trace: Trace) -> Any:
    return preset_network(trace.header.preset, trace.header.settings)


def test_the_black_box_carries_the_trace_and_a_replay_of_it_has_the_same_bytes(drive: Drive, tmp_path: Path) -> None:
    with BlackBox(tmp_path, LOGGED_CHAIR) as box:
        drive.tell(box)
    trace = trace_at(tmp_path)
    assert len(trace.innervations) == sum(state.perceived is not None for _, state, _ in drive.notes)
    assert trace.gaps == ()
    assert replay(trace, network(trace)).difference is None


def test_a_black_box_whose_ring_dropped_the_beginning_shows_the_rest_and_refuses_a_replay(
    drive: Drive, tmp_path: Path
) -> None:
    with BlackBox(tmp_path, LOGGED_CHAIR, BlackBoxSettings(ring_mb=1)) as box:  # small segments
        drive.tell(box)
    files = sorted((tmp_path / "ring").glob("*.log"))
    assert len(files) > 1
    files[0].unlink()
    trace = trace_at(tmp_path)
    assert trace.innervations
    assert trace.gaps == (0,)
    with pytest.raises(TraceError, match="records are missing before innervation 0"):
        replay(trace, network(trace))


def test_a_black_box_without_cells_and_an_empty_folder_say_so(tmp_path: Path) -> None:
    with BlackBox(tmp_path / "box", LOGGED_CHAIR):
        pass
    with pytest.raises(TraceError, match="holds no trace of behaviour cells"):
        trace_at(tmp_path / "box")
    with pytest.raises(TraceError, match="is no black box"):
        trace_at(tmp_path)


def test_doorways_of_the_tracker_are_told_in_base() -> None:
    found = Doorway(4, Pose2(3.0, 1.0, math.pi / 2), 0.9, 0.88, 0.02, DoorState.OPEN)
    rider = Rider()
    rider.at = Pose2(3.0, -1.0, math.pi / 2)
    with patch.object(DoorwayTracker, "doorways", (found,)):
        (seen,) = rider.tick().heard["doorways"].doors
    assert (seen.number, seen.is_open) == (4, True)
    assert seen.clear == pytest.approx(0.86)
    assert seen.door.middle == pytest.approx((2.0, 0.0))
    assert (seen.door.left_y, seen.door.right_y) == pytest.approx((0.45, -0.45))
