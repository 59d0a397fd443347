"""The cells of the paper's network, each by itself: doorway, managers and glove."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A, paper_sonar_mounts
from waychair.control.behaviours.cell import Reading
from waychair.control.behaviours.commands import (
    NULL,
    STOP,
    DoorCommand,
    FreeCommand,
    FreeKind,
    Move,
    Signal,
    SignalKind,
    move_words,
    sector_middles,
    signal_words,
)
from waychair.control.behaviours.doorway import (
    CandidateVerdict,
    DoorCheck,
    DoorwayJambs,
    FrameCandidate,
    FramesSeen,
    OdometryPose,
    PathMemory,
    TrackedDoor,
    TrackerMemory,
    ZonePhase,
    detect_doorway,
    plan_path,
    track_door,
    validate_door,
)
from waychair.control.behaviours.free_space import (
    WayFound,
)
from waychair.control.behaviours.glove import GloveLayout, encode_signal
from waychair.control.behaviours.managers import (
    GatedSignals,
    GrantMemory,
    StickDirection,
    aim_servos,
    choose_signal,
    gate_signals,
    grant,
    merge_commands,
    nearest_orientation,
    select_signal,
)
from waychair.control.behaviours.paper_settings import CameraLimits, DoorLimits, NavigationLimits
from waychair.control.behaviours.range_finder import (
    CameraAim,
    Depth,
    LookRequest,
)
from waychair.control.behaviours.sonar import (
    Obstacle,
    ObstacleClasses,
)

S = 1_000_000_000
IMMEDIATE, FAR = Obstacle.IMMEDIATE, Obstacle.FAR


# Doorway -----------------------------------------------------------------------------------------------------------


def test_the_surest_frame_is_the_candidate_and_unsure_ones_are_none() -> None:
    limits = DoorLimits()
    frames = FramesSeen((FrameCandidate(0.3, 0.1, 0.6), FrameCandidate(0.5, 0.2, 0.9), FrameCandidate(0.1, 0.3, 1.0)))
    assert detect_doorway(frames, limits) == frames.candidates[1]
    assert detect_doorway(FramesSeen((FrameCandidate(0.3, 0.1, 0.4),)), limits) is None


CANDIDATE = FrameCandidate(math.atan2(0.45, 2.0), -math.atan2(0.45, 2.0), 0.9)


def depth_of_wall(opening: float) -> Depth:
    """Return what a line shows of a wall 2 m ahead with a door of 0.9 m, behind which it is `opening` m deep."""
    bearings = np.radians(np.arange(-25.0, 25.0, 0.5))
    aside = 2.0 * np.tan(bearings)
    return Depth(bearings, np.where(np.abs(aside) > 0.45, 2.0, 2.0 + opening) / np.cos(bearings))


def test_a_candidate_with_depth_behind_its_jambs_is_a_doorway() -> None:
    check = validate_door(CANDIDATE, depth_of_wall(1.5), DoorLimits())
    assert check.valid
    assert check.door is not None
    assert check.door.width == pytest.approx(0.9, abs=0.06)
    assert check.door.middle == pytest.approx((2.0, 0.0), abs=0.05)
    assert check.door.through == pytest.approx(0.0, abs=0.05)


def test_a_picture_of_a_door_on_a_wall_is_refuted_and_one_without_ranges_is_looked_at() -> None:
    assert validate_door(CANDIDATE, depth_of_wall(0.0), DoorLimits()).state is CandidateVerdict.REFUTED
    assert validate_door(CANDIDATE, None, DoorLimits()).state is CandidateVerdict.LOOKING
    one_side = Depth(np.array([0.1, 0.2, 0.3]), np.array([2.0, 2.0, 2.0]))
    check = validate_door(CANDIDATE, one_side, DoorLimits())
    assert check == DoorCheck(CandidateVerdict.LOOKING, request=LookRequest(0.0))


def door_at(x: float, y: float, through: float, width: float = 0.9) -> DoorwayJambs:
    aside = through + math.pi / 2
    dx, dy = width / 2 * math.cos(aside), width / 2 * math.sin(aside)
    return DoorwayJambs(x + dx, y + dy, x - dx, y - dy)


TRACKING = DoorLimits(), CameraLimits()


def test_a_door_is_held_in_place_while_the_chair_moves_and_forgotten_when_it_is_old() -> None:
    check = DoorCheck(CandidateVerdict.VALID, door_at(3.0, 0.0, 0.0))
    tracked, memory = track_door(check, OdometryPose(1.0, 0.0, 0.0), TRACKING, TrackerMemory(), 0)
    assert tracked is not None
    moved, memory = track_door(None, OdometryPose(2.0, 0.0, math.pi / 2), TRACKING, memory, S)
    assert moved is not None
    assert moved.door.middle == pytest.approx((0.0, -2.0))
    assert moved.request.pan == pytest.approx(-math.pi / 2)
    gone, memory = track_door(None, OdometryPose(2.0, 0.0, 0.0), TRACKING, memory, 6 * S)
    assert gone is None
    assert memory == TrackerMemory()


def test_a_door_is_forgotten_after_three_refutations_in_a_row_and_without_odometry() -> None:
    at = OdometryPose(0.0, 0.0, 0.0)
    _, memory = track_door(DoorCheck(CandidateVerdict.VALID, door_at(3.0, 0.0, 0.0)), at, TRACKING, TrackerMemory(), 0)
    refuted = DoorCheck(CandidateVerdict.REFUTED)
    held = []
    for _ in range(3):
        tracked, memory = track_door(refuted, at, TRACKING, memory, 1)
        held.append(tracked is not None)
    assert held == [True, True, False]
    _, memory = track_door(
        DoorCheck(CandidateVerdict.VALID, door_at(3.0, 0.0, 0.0)), None, TRACKING, TrackerMemory(), 0
    )
    assert track_door(None, None, TRACKING, memory, 1)[0] is None


def command(door: DoorwayJambs, phase: ZonePhase = ZonePhase.APPROACH) -> tuple[str, ZonePhase]:
    tracked = TrackedDoor(door, 0.0, LookRequest(0.0))
    found, memory = plan_path(tracked, (DoorLimits(), CHAIR_A), PathMemory(phase))
    return move_words(found.move, found.orientation), memory.phase


def test_the_path_goes_to_the_pivotal_zone_swivels_and_goes_forward_through_the_door() -> None:
    back = 0.75 + CHAIR_A.front
    assert command(door_at(2.0 + back, 2.0, 0.0)) == ("go front-left", ZonePhase.APPROACH)
    assert command(door_at(0.0, -back, -math.pi / 2)) == ("swivel clockwise", ZonePhase.SWIVEL)
    assert command(door_at(0.0, back, math.pi / 2)) == ("swivel counter-clockwise", ZonePhase.SWIVEL)
    assert command(door_at(back, 0.0, 0.0), ZonePhase.SWIVEL) == ("go forward", ZonePhase.FORWARD)
    assert command(door_at(0.3, 0.0, math.radians(10)), ZonePhase.FORWARD) == ("go forward", ZonePhase.FORWARD)
    assert command(door_at(-0.5, 0.0, 0.0), ZonePhase.FORWARD) == ("through the door", ZonePhase.APPROACH)


def test_a_chair_that_has_turned_away_swivels_again() -> None:
    back = 0.75 + CHAIR_A.front
    turned = math.radians(30.0)
    door = door_at(back * math.cos(turned), back * math.sin(turned), turned)
    assert command(door, ZonePhase.FORWARD) == ("swivel counter-clockwise", ZonePhase.SWIVEL)


# Sensor command manager --------------------------------------------------------------------------------------------

CHECK = DoorCheck(CandidateVerdict.LOOKING, request=LookRequest(0.2))
TRACKED = TrackedDoor(door_at(2.0, 0.0, 0.0), 0.0, LookRequest(0.1))
WAY = WayFound(NULL, LookRequest(-1.0))


@pytest.mark.parametrize(
    ("active", "client"),
    [
        ((True, True, True), "Object tracker"),
        ((False, True, True), "Range finder"),
        ((False, False, True), "Way finder"),
        ((False, False, False), None),
    ],
)
def test_the_camera_belongs_to_the_most_important_active_client(active: tuple[bool, ...], client: str | None) -> None:
    requests = [Reading(value, 0, each) for value, each in zip((TRACKED, CHECK, WAY), active, strict=True)]
    order, _ = grant(requests[0], requests[1], requests[2], None, CameraLimits(), GrantMemory(), 0)  # type: ignore[arg-type]
    assert (order.client if order else None) == client


def test_a_grant_settles_when_the_servos_report_its_angle_and_a_pan_that_is_stuck_is_named() -> None:
    reading = Reading(WAY, 0)
    wanted = math.tau - 1.0
    there, memory = grant(None, None, reading, CameraAim(wanted, 0.0, True), CameraLimits(), GrantMemory(), 0)
    assert there is not None
    assert there.settled
    assert aim_servos(there) == (pytest.approx(wanted), 0.0)  # the pan servo does not wrap
    stuck = CameraAim(1.0, 0.0, True)
    early, memory = grant(None, None, reading, stuck, CameraLimits(), GrantMemory(), 0)
    assert early is not None
    assert (early.settled, early.fault) == (False, "")
    late, memory = grant(None, None, reading, stuck, CameraLimits(), memory, 3 * S)
    assert late is not None
    assert late.fault == "the camera stands at 57 degrees and does not reach 303 degrees: see its servos"
    silent, _ = grant(None, None, reading, None, CameraLimits(), memory, 3 * S)
    assert silent is not None
    assert "do not report their angles" in silent.fault


# Navigation command manager ----------------------------------------------------------------------------------------

LIST = FreeCommand(FreeKind.LIST, tuple(map(math.radians, (45.0, 180.0, -90.0))))
LIMITS = NavigationLimits()


def test_the_gate_sends_a_stop_to_the_selection_a_null_code_to_the_merging_and_a_list_to_both() -> None:
    assert gate_signals(WayFound(STOP)) == GatedSignals(STOP, None)
    assert gate_signals(WayFound(NULL)) == GatedSignals(None, NULL)
    assert gate_signals(WayFound(LIST)) == GatedSignals(LIST, LIST)


def obstacles(immediate: int) -> ObstacleClasses:
    return ObstacleClasses((IMMEDIATE,) * immediate + (FAR,) * (8 - immediate))


@pytest.mark.parametrize(("immediate", "chosen"), [(2, None), (3, 45), (8, 45)])
def test_a_direction_is_selected_with_more_than_two_immediate_obstacles(immediate: int, chosen: int | None) -> None:
    signal = select_signal(GatedSignals(LIST, LIST), obstacles(immediate), None, LIMITS)
    assert (None if signal is None else round(math.degrees(signal.orientation))) == chosen


@pytest.mark.parametrize(
    ("forward", "turn", "chosen"), [(1.0, 0.0, 45), (0.0, -1.0, -90), (-1.0, 0.0, 180), (0.05, 0.0, 45)]
)
def test_the_selected_direction_is_nearest_to_where_the_stick_points(forward: float, turn: float, chosen: int) -> None:
    signal = select_signal(GatedSignals(LIST, LIST), obstacles(3), StickDirection(forward, turn), LIMITS)
    assert signal is not None
    assert round(math.degrees(signal.orientation)) == chosen


def test_of_two_equally_near_orientations_the_wider_part_is_taken() -> None:
    middles = sector_middles()
    assert nearest_orientation((middles[1], middles[6], middles[7]), 0.0) == middles[7]
    assert nearest_orientation((middles[1], middles[2], middles[7]), 0.0) == middles[1]
    assert nearest_orientation((middles[1], middles[7]), 0.0) == middles[1]


def test_a_door_command_takes_the_nearest_free_orientation_or_is_blocked() -> None:
    gated = GatedSignals(LIST, LIST)
    ahead = merge_commands(gated, DoorCommand(Move.GO, 0.0), LIMITS)
    assert ahead is not None
    assert (ahead.kind, round(math.degrees(ahead.orientation))) == (SignalKind.DIRECTION, 45)
    blocked = merge_commands(gated, DoorCommand(Move.GO, math.radians(-44.0)), LIMITS)
    assert blocked is not None
    assert signal_words(blocked) == "stop the chair: door blocked"
    alone = merge_commands(GatedSignals(None, NULL), DoorCommand(Move.SWIVEL, -1.0), LIMITS)
    assert alone is not None
    assert signal_words(alone) == "swivel clockwise"
    assert merge_commands(GatedSignals(STOP, None), DoorCommand(Move.GO, 0.0), LIMITS) is None


def test_the_merged_command_is_the_only_one_taken_while_it_is_fresh() -> None:
    merged = Signal(SignalKind.DIRECTION, "door", Move.GO, 0.0)
    selected = Signal(SignalKind.DIRECTION, "surrounded", Move.GO, 1.0)

    def chosen(stamp_ns: int, active: bool = True) -> Signal:
        return choose_signal(obstacles(3), selected, Reading(merged, stamp_ns, active), LIMITS, 2 * S)

    assert chosen(S) == merged
    assert chosen(S - 1) == selected
    assert chosen(S, active=False) == selected


def test_a_stop_goes_above_all_and_silence_of_all_sonars_is_a_stop() -> None:
    warning = Signal(SignalKind.WARNING, "no way is free")
    merged = Reading(Signal(SignalKind.DIRECTION), S)
    assert choose_signal(obstacles(0), warning, merged, LIMITS, S) == warning
    assert choose_signal(None, None, None, LIMITS, S).kind is SignalKind.WARNING
    unknown = ObstacleClasses((Obstacle.UNKNOWN,) * 8)
    assert choose_signal(unknown, None, None, LIMITS, S).reason == "no sonar is heard"
    assert choose_signal(obstacles(1), None, None, LIMITS, S).kind is SignalKind.SPACE


def test_the_glove_plays_sequences_for_directions_circuits_for_swivels_and_points_for_obstacles() -> None:
    layout = GloveLayout(tuple(mount.theta for mount in paper_sonar_mounts(CHAIR_A)))

    def tactors(signal: Signal) -> list[tuple[int, ...]]:
        return [stimulus.tactors for stimulus in encode_signal(signal, layout).stimuli]

    assert tactors(Signal(SignalKind.DIRECTION)) == [(7,), (4,), (1,)]
    assert tactors(Signal(SignalKind.DIRECTION, orientation=math.pi / 4)) == [(8,), (4,), (0,)]
    assert tactors(Signal(SignalKind.DIRECTION, move=Move.SWIVEL, orientation=-0.1)) == [(1,), (5,), (7,), (3,)]
    assert tactors(Signal(SignalKind.WARNING)) == [tuple(range(9))]
    near = (FAR, FAR, FAR, IMMEDIATE, FAR, Obstacle.NEAR, FAR, FAR)
    assert tactors(Signal(SignalKind.SPACE, classes=tuple(map(int, near)))) == [(1,), (0,)]
    assert tactors(Signal(SignalKind.SPACE, classes=(1,) * 8)) == []
