"""The cells of the paper's network, each by itself: packets, classes, way finder, doorway, managers, glove."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A, CHAIR_B, paper_sonar_mounts
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
    DoorCheck,
    DoorState,
    Doorway,
    FrameCandidate,
    FramesSeen,
    OdometryPose,
    PathMemory,
    Phase,
    TrackedDoor,
    TrackerMemory,
    detect_doorway,
    plan_path,
    track_door,
    validate_door,
)
from waychair.control.behaviours.free_space import (
    WayFinderConstants,
    WayFinderMemory,
    WayFound,
    edge_distance,
    find_way,
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
from waychair.control.behaviours.paper_settings import CameraLimits, DoorLimits, NavigationLimits, ObstacleLimits
from waychair.control.behaviours.range_finder import (
    CameraAim,
    CameraMemory,
    Depth,
    LaserLine,
    LookRequest,
    SensorCommand,
    find_range,
    triangulated,
)
from waychair.control.behaviours.sonar import (
    LastClasses,
    Obstacle,
    ObstacleClasses,
    PacketDamaged,
    SonarPacket,
    SonarRanges,
    decode_packet,
    packet_from_ranges,
    translate_data,
)
from waychair.errors import ConfigError

INF, S = math.inf, 1_000_000_000
IMMEDIATE, FAR = Obstacle.IMMEDIATE, Obstacle.FAR


def test_a_packet_keeps_its_ranges_to_the_centimetre_and_tells_silence_from_no_echo() -> None:
    ranges = (0.5, 5.994, INF, -INF, math.nan, 0.03)
    metres = decode_packet(packet_from_ranges(ranges)).metres
    assert metres[:4] == (0.5, 5.99, INF, -INF)
    assert math.isnan(metres[4])
    assert metres[5] == 0.03


@pytest.mark.parametrize("cut", range(19))
def test_a_packet_that_is_cut_short_is_refused(cut: int) -> None:
    whole = packet_from_ranges([1.0] * 8).data
    assert len(whole) == 19
    with pytest.raises(PacketDamaged):
        decode_packet(SonarPacket(whole[:cut]))


def test_a_packet_with_any_one_byte_altered_is_refused_or_differs_in_no_range() -> None:
    whole = packet_from_ranges([1.0, 2.0, 3.0]).data
    for place in range(len(whole)):
        altered = bytearray(whole)
        altered[place] ^= 0x21
        with pytest.raises(PacketDamaged):
            decode_packet(SonarPacket(bytes(altered)))


def classes(*metres: float, before: tuple[Obstacle, ...] = ()) -> tuple[Obstacle, ...]:
    found, _ = translate_data(SonarRanges(metres), ObstacleLimits(), LastClasses(before))
    return found.classes


def test_ranges_have_the_classes_of_the_limits_and_silence_is_unknown() -> None:
    given = (INF, 1.5, 1.49, 0.9, 0.89, 0.5, 0.49, -INF, math.nan)
    names = ["FAR", "FAR", "NEAR", "NEAR", "CLOSE", "CLOSE", "IMMEDIATE", "IMMEDIATE", "UNKNOWN"]
    assert [each.name for each in classes(*given)] == names


def test_a_nearer_class_ends_a_hysteresis_beyond_its_limit() -> None:
    assert classes(0.59, before=(IMMEDIATE,)) == (IMMEDIATE,)
    assert classes(0.61, before=(IMMEDIATE,)) == (Obstacle.CLOSE,)
    assert classes(0.59, before=(Obstacle.CLOSE,)) == (Obstacle.CLOSE,)
    assert classes(1.55, before=(IMMEDIATE,)) == (Obstacle.NEAR,)
    assert classes(0.59, before=(Obstacle.UNKNOWN,)) == (Obstacle.CLOSE,)


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ({"near": 0.8}, "contradict each other"),
        ({"immediate": 0.9}, "contradict each other"),
        ({"hysteresis": 0.4}, "hysteresis = 0.4"),
    ],
)
def test_limits_that_contradict_each_other_are_refused(values: dict[str, float], named: str) -> None:
    with pytest.raises(ConfigError, match=named):
        ObstacleLimits(**values)
    with pytest.raises(ConfigError, match=r"narrowest = 1\.8"):
        DoorLimits(narrowest=1.8)
    with pytest.raises(ConfigError, match="a swivel would never end"):
        DoorLimits(straight=0.4)


def test_the_papers_sonars_look_six_to_the_front_and_two_to_the_rear_and_stand_on_the_outline() -> None:
    for body in (CHAIR_A, CHAIR_B):
        mounts = paper_sonar_mounts(body)
        degrees = [round(math.degrees(mount.theta)) for mount in mounts]
        assert degrees == [-165, -75, -40, -10, 10, 40, 75, 165]
        for mount in mounts:
            edge = max(mount.x - body.front, -body.rear - mount.x, abs(mount.y) - body.width / 2)
            assert edge == pytest.approx(0.0, abs=1e-12)


# Way finder --------------------------------------------------------------------------------------------------------

CONSTANTS = WayFinderConstants(
    tuple(mount.theta for mount in paper_sonar_mounts(CHAIR_A)),
    CHAIR_A,
    ObstacleLimits(),
    CameraLimits(),
    NavigationLimits(),
)
FAR_AWAY = (INF,) * 8


def way(
    metres: tuple[float, ...] | None,
    memory: WayFinderMemory | None = None,
    depth: Reading[Depth] | None = None,
    granted: SensorCommand | None = None,
    now_ns: int = S,
) -> tuple[WayFound, WayFinderMemory]:
    ranges = None if metres is None else SonarRanges(metres)
    return find_way(ranges, depth, granted, CONSTANTS, memory or WayFinderMemory(ranges=metres or ()), now_ns)


def degrees_of(found: WayFound) -> list[int]:
    return [round(math.degrees(angle)) for angle in found.command.orientations]


def test_sectors_that_no_sonar_looks_into_are_not_free_and_are_asked_for_by_the_camera() -> None:
    found, _ = way(FAR_AWAY)
    assert degrees_of(found) == [0, 45, 90, 180, -90, -45]
    assert found.request == LookRequest(math.radians(135.0))


def test_a_sector_with_an_immediate_echo_is_blocked_and_an_echo_of_one_of_two_sonars_is_enough() -> None:
    found, _ = way((INF, INF, 0.4, INF, 0.45, INF, INF, INF))
    assert degrees_of(found) == [45, 90, 180, -90]


@pytest.mark.parametrize("value", [math.nan, 2.0])
def test_a_silent_sonar_and_an_echo_that_is_not_borne_out_leave_their_sector_unknown(value: float) -> None:
    metres = (*FAR_AWAY[:5], value, INF, INF)
    found, memory = way(metres, WayFinderMemory(ranges=FAR_AWAY))
    assert 45 not in degrees_of(found)
    again, _ = way(metres, memory)
    assert (45 in degrees_of(again)) == (value == 2.0)


def test_all_known_sectors_blocked_is_a_stop_and_nothing_known_is_a_null_code() -> None:
    assert way((0.3,) * 8)[0].command == STOP
    assert way((math.nan,) * 8)[0].command == NULL
    assert way(None)[0].command == NULL


def look(metres: float, pan: float, step: float = 2.0, span: float = 24.0) -> tuple[Reading[Depth], SensorCommand]:
    bearings = pan + np.radians(np.arange(-span, span, step))
    return Reading(Depth(bearings, np.full(len(bearings), metres)), S), SensorCommand("Way finder", pan, settled=True)


@pytest.mark.parametrize(("metres", "free"), [(3.0, True), (0.5, False)])
def test_a_look_by_the_camera_tells_of_its_sector_and_counts_for_a_while(metres: float, free: bool) -> None:
    depth, granted = look(metres, math.radians(135.0))
    found, memory = way(FAR_AWAY, None, depth, granted)
    assert (135 in degrees_of(found)) == free
    assert found.request == LookRequest(math.radians(-135.0))
    later, _ = way(FAR_AWAY, memory, now_ns=S + S)
    assert (135 in degrees_of(later)) == free
    forgotten, _ = way(FAR_AWAY, memory, now_ns=3 * S)
    assert 135 not in degrees_of(forgotten)


def test_a_look_that_saw_only_a_part_of_a_sector_does_not_make_it_free() -> None:
    depth, granted = look(3.0, math.radians(135.0), span=15.0)
    assert 135 not in degrees_of(way(FAR_AWAY, None, depth, granted)[0])
    moving = replace(granted, settled=False)
    whole, _ = look(3.0, math.radians(135.0))
    assert 135 not in degrees_of(way(FAR_AWAY, None, whole, moving)[0])
    other = replace(granted, client="Object tracker")
    assert 135 not in degrees_of(way(FAR_AWAY, None, whole, other)[0])


def test_a_sector_that_the_camera_does_not_reach_is_not_asked_for_again_at_once() -> None:
    stuck = SensorCommand("Way finder", math.radians(135.0), fault="stuck")
    found, memory = way(FAR_AWAY, None, None, stuck)
    assert found.request == LookRequest(math.radians(-135.0))
    assert way(FAR_AWAY, memory, now_ns=4 * S)[0].request == LookRequest(math.radians(-135.0))  # kept while it is open


def test_the_edge_of_the_chair_is_at_its_outline() -> None:
    assert edge_distance(CHAIR_A, 0.0) == CHAIR_A.front
    assert edge_distance(CHAIR_A, math.pi) == CHAIR_A.rear
    assert edge_distance(CHAIR_A, math.pi / 2) == CHAIR_A.width / 2


# Range finder ------------------------------------------------------------------------------------------------------


def line_at(metres: float, limits: CameraLimits, pan: float = 0.0) -> LaserLine:
    columns = np.array([220.0, 320.0, 420.0])
    rows = np.full(3, limits.middle_row + limits.focal * limits.baseline / metres)
    return LaserLine(columns, rows, CameraAim(pan, 0.0, True))


def test_triangulation_gives_the_range_and_an_error_that_grows_with_its_square() -> None:
    limits = CameraLimits()
    for metres, sigma in ((2.0, 0.02), (4.0, 0.08)):
        points, errors = triangulated(line_at(metres, limits), limits)
        assert points[:, 0] == pytest.approx([metres] * 3)
        assert points[:, 1] == pytest.approx([metres / 6, 0.0, -metres / 6])
        assert errors == pytest.approx([sigma] * 3)


def test_a_line_at_the_horizon_has_no_range() -> None:
    limits = CameraLimits()
    line = LaserLine(np.array([1.0, 2.0, 3.0]), np.array([240.0, math.nan, 100.0]), CameraAim(0.0, 0.0, True))
    assert len(triangulated(line, limits)[0]) == 0


def test_no_range_is_given_while_the_camera_moves_or_its_angle_leaps() -> None:
    limits, still = CameraLimits(), CameraAim(0.0, 0.0, True)

    def ranged(aim: CameraAim, memory: CameraMemory, line_pan: float = 0.0) -> tuple[Depth | None, CameraMemory]:
        return find_range(Reading(line_at(2.0, limits, line_pan), S), aim, limits, memory, S)

    depth, memory = ranged(still, CameraMemory())
    assert depth is not None
    assert depth.metres[1] == pytest.approx(2.0 + limits.forward)
    assert ranged(replace(still, settled=False), memory)[0] is None
    assert ranged(still, memory, line_pan=0.5)[0] is None
    assert ranged(CameraAim(3.0, 0.0, True), memory, line_pan=3.0)[0] is None
    assert ranged(CameraAim(math.nan, 0.0, True), memory)[0] is None


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
    assert validate_door(CANDIDATE, depth_of_wall(0.0), DoorLimits()).state is DoorState.REFUTED
    assert validate_door(CANDIDATE, None, DoorLimits()).state is DoorState.LOOKING
    one_side = Depth(np.array([0.1, 0.2, 0.3]), np.array([2.0, 2.0, 2.0]))
    check = validate_door(CANDIDATE, one_side, DoorLimits())
    assert check == DoorCheck(DoorState.LOOKING, request=LookRequest(0.0))


def door_at(x: float, y: float, through: float, width: float = 0.9) -> Doorway:
    aside = through + math.pi / 2
    dx, dy = width / 2 * math.cos(aside), width / 2 * math.sin(aside)
    return Doorway(x + dx, y + dy, x - dx, y - dy)


TRACKING = DoorLimits(), CameraLimits()


def test_a_door_is_held_in_place_while_the_chair_moves_and_forgotten_when_it_is_old() -> None:
    check = DoorCheck(DoorState.VALID, door_at(3.0, 0.0, 0.0))
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
    _, memory = track_door(DoorCheck(DoorState.VALID, door_at(3.0, 0.0, 0.0)), at, TRACKING, TrackerMemory(), 0)
    refuted = DoorCheck(DoorState.REFUTED)
    held = []
    for _ in range(3):
        tracked, memory = track_door(refuted, at, TRACKING, memory, 1)
        held.append(tracked is not None)
    assert held == [True, True, False]
    _, memory = track_door(DoorCheck(DoorState.VALID, door_at(3.0, 0.0, 0.0)), None, TRACKING, TrackerMemory(), 0)
    assert track_door(None, None, TRACKING, memory, 1)[0] is None


def command(door: Doorway, phase: Phase = Phase.APPROACH) -> tuple[str, Phase]:
    tracked = TrackedDoor(door, 0.0, LookRequest(0.0))
    found, memory = plan_path(tracked, (DoorLimits(), CHAIR_A), PathMemory(phase))
    return move_words(found.move, found.orientation), memory.phase


def test_the_path_goes_to_the_pivotal_zone_swivels_and_goes_forward_through_the_door() -> None:
    back = 0.75 + CHAIR_A.front
    assert command(door_at(2.0 + back, 2.0, 0.0)) == ("go front-left", Phase.APPROACH)
    assert command(door_at(0.0, -back, -math.pi / 2)) == ("swivel clockwise", Phase.SWIVEL)
    assert command(door_at(0.0, back, math.pi / 2)) == ("swivel counter-clockwise", Phase.SWIVEL)
    assert command(door_at(back, 0.0, 0.0), Phase.SWIVEL) == ("go forward", Phase.FORWARD)
    assert command(door_at(0.3, 0.0, math.radians(10)), Phase.FORWARD) == ("go forward", Phase.FORWARD)
    assert command(door_at(-0.5, 0.0, 0.0), Phase.FORWARD) == ("through the door", Phase.APPROACH)


def test_a_chair_that_has_turned_away_swivels_again() -> None:
    back = 0.75 + CHAIR_A.front
    turned = math.radians(30.0)
    door = door_at(back * math.cos(turned), back * math.sin(turned), turned)
    assert command(door, Phase.FORWARD) == ("swivel counter-clockwise", Phase.SWIVEL)


# Sensor command manager --------------------------------------------------------------------------------------------

CHECK = DoorCheck(DoorState.LOOKING, request=LookRequest(0.2))
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
    layout = GloveLayout(CONSTANTS.sonars)

    def tactors(signal: Signal) -> list[tuple[int, ...]]:
        return [stimulus.tactors for stimulus in encode_signal(signal, layout).stimuli]

    assert tactors(Signal(SignalKind.DIRECTION)) == [(7,), (4,), (1,)]
    assert tactors(Signal(SignalKind.DIRECTION, orientation=math.pi / 4)) == [(8,), (4,), (0,)]
    assert tactors(Signal(SignalKind.DIRECTION, move=Move.SWIVEL, orientation=-0.1)) == [(1,), (5,), (7,), (3,)]
    assert tactors(Signal(SignalKind.WARNING)) == [tuple(range(9))]
    near = (FAR, FAR, FAR, IMMEDIATE, FAR, Obstacle.NEAR, FAR, FAR)
    assert tactors(Signal(SignalKind.SPACE, classes=tuple(map(int, near)))) == [(1,), (0,)]
    assert tactors(Signal(SignalKind.SPACE, classes=(1,) * 8)) == []
