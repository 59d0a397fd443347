"""The cells of the paper's network, each by itself: packets, classes, way finder and range finder."""

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
)
from waychair.control.behaviours.free_space import (
    WayFinderConstants,
    WayFinderMemory,
    WayFound,
    edge_distance,
    find_way,
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
