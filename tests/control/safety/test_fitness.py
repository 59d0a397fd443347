"""Whether the chair is fit to drive, row by row of the fault table, at the limits."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.control.safety.fitness import Fitness, FitnessSettings
from waychair.errors import ConfigError
from waychair.slam.localising.localiser import Localisation, LocalisationState
from waychair.types import ChairStatus, ImuSample, Pose2, RgbdFrame, Scan, Twist, WheelTicks

MS = 1_000_000
NOW = 10**10


def scan(stamp_ns: int) -> Scan:
    return Scan(stamp_ns, np.ones(3, np.float32), -0.1, 0.1)


def picture(stamp_ns: int) -> RgbdFrame:
    return RgbdFrame(stamp_ns, np.zeros((1, 1), np.uint8), np.zeros((1, 1), np.float32), np.eye(3))


def imu(stamp_ns: int, lean: float = 0.0) -> ImuSample:
    return ImuSample(stamp_ns, 9.81 * np.array([math.sin(lean), 0.0, math.cos(lean)]), np.zeros(3))


def well(settings: FitnessSettings | None = None, scan_age: int = 0, wheels_age: int = 0) -> Fitness:
    """Return a fitness that last heard lidar and wheels these times [ms] ago."""
    fitness = Fitness(CHAIR_A, settings)
    fitness.hear(scan(NOW - scan_age * MS), Twist())
    fitness.hear(WheelTicks(NOW - wheels_age * MS, 0, 0), Twist())
    return fitness


def ids(fitness: Fitness, now_ns: int = NOW) -> set[str]:
    return {halted.stop.id for halted in fitness.halts(now_ns)}


def test_a_chair_without_any_sensor_data_is_not_fit() -> None:
    assert ids(Fitness(CHAIR_A)) == {"lidar_stale", "wheels_stale"}


@pytest.mark.parametrize(
    ("scan_age", "wheels_age", "found"),
    [(500, 100, set()), (501, 0, {"lidar_stale"}), (0, 101, {"wheels_stale"}), (-501, 0, {"lidar_stale"})],
)
def test_f11_f13_a_lidar_may_be_half_a_second_old_and_the_wheels_a_tenth(
    scan_age: int, wheels_age: int, found: set[str]
) -> None:
    assert ids(well(scan_age=scan_age, wheels_age=wheels_age)) == found


@pytest.mark.parametrize(("age", "limit"), [(300, math.inf), (301, 0.3)])
def test_f13_a_silent_imu_or_camera_slows_a_drive(age: int, limit: float) -> None:
    for message in (imu(NOW - age * MS), picture(NOW - age * MS)):
        fitness = well()
        assert fitness.speed_limit(NOW) == math.inf  # a sensor that was never there is not missed
        fitness.hear(message, Twist())
        assert fitness.speed_limit(NOW) == limit
        assert ids(fitness) == set()


def test_f13_a_sensor_without_valid_data_counts_as_silent() -> None:
    nothing = ImuSample(NOW, np.array([math.nan, 0.0, 9.81]), np.zeros(3))
    spinning = ImuSample(NOW, np.array([0.0, 0.0, 9.81]), np.array([0.0, 0.0, math.inf]))
    dark = RgbdFrame(NOW, np.zeros((480, 640), np.uint8), np.full((480, 640), np.nan, np.float32), np.eye(3))
    for early, late in ((imu, nothing), (imu, spinning), (picture, dark)):
        fitness = well()
        fitness.hear(early(NOW - 301 * MS), Twist())
        fitness.hear(late, Twist())
        assert fitness.speed_limit(NOW) == 0.3
    dark.depth[200:300, 200:300] = 1.0
    fitness.hear(dark, Twist())
    assert fitness.speed_limit(NOW) == math.inf


def test_f13_a_silent_imu_or_camera_ends_a_drive_if_so_configured() -> None:
    fitness = well(FitnessSettings(imu_silent="stop", depth_silent="stop"))
    fitness.hear(imu(NOW - 301 * MS), Twist())
    fitness.hear(picture(NOW - 301 * MS), Twist())
    assert ids(fitness) == {"imu_stale", "depth_stale"}
    with pytest.raises(ConfigError, match="slow or stop"):
        FitnessSettings(imu_silent="ignore")


def localisation(
    x: float = 0.0, state: LocalisationState = LocalisationState.OK, remaining: float = 0.0
) -> Localisation:
    return Localisation(Pose2(x), Pose2(x), 1.0, state, 1.0, remaining=Pose2(remaining))


def test_f15_a_lost_chair_is_not_fit() -> None:
    fitness = well()
    fitness.locate(localisation(), Pose2())
    assert ids(fitness) == set()
    fitness.locate(localisation(state=LocalisationState.LOST), Pose2())
    assert ids(fitness) == {"lost"}


def test_f15_a_chair_in_doubt_drives_slowly() -> None:
    fitness = well()
    fitness.locate(localisation(state=LocalisationState.DEGRADED), Pose2())
    assert (fitness.speed_limit(NOW), ids(fitness)) == (0.3, set())
    fitness.locate(localisation(), Pose2())
    assert fitness.speed_limit(NOW) == math.inf


@pytest.mark.parametrize(("jump", "found"), [(0.49, set()), (0.51, {"pose_jump"}), (-0.51, {"pose_jump"})])
def test_f15_a_jump_of_the_pose_is_remembered_until_nothing_drives(jump: float, found: set[str]) -> None:
    for later in (localisation(jump), localisation(remaining=jump)):
        fitness = well()
        fitness.locate(localisation(), Pose2())
        fitness.locate(later, Pose2(1.0, 0.0, 0.5))
        fitness.locate(replace_remaining(later), Pose2(1.0, 0.0, 0.5))
        assert ids(fitness) == found
        fitness.settle()
        assert ids(fitness) == set()


def replace_remaining(found: Localisation) -> Localisation:
    """The same place a scan later, nothing left to correct."""
    return localisation(found.map_from_odom.x)


@pytest.mark.parametrize(
    ("degrees", "limit", "found"), [(4.8, math.inf, set()), (6.5, 0.3, set()), (9.0, 0.3, {"tilt"})]
)
def test_f23_a_ramp_of_1_in_12_is_driven_a_steeper_one_slowly_and_eight_degrees_not_at_all(
    degrees: float, limit: float, found: set[str]
) -> None:
    fitness = well()
    for ms in range(300, -1, -5):
        fitness.hear(imu(NOW - ms * MS, math.radians(degrees)), Twist())
    assert (fitness.speed_limit(NOW), ids(fitness)) == (limit, found)


def test_f23_a_jolt_is_no_slope() -> None:
    fitness = well()
    fitness.hear(imu(NOW - 100 * MS, 0.3), Twist())
    assert ids(fitness) == set()  # not for long enough


@pytest.mark.parametrize(
    ("status", "found"),
    [
        (ChairStatus(NOW), set()),
        (ChairStatus(NOW, charging=True), {"charging"}),
        (ChairStatus(NOW, seated=False), {"seat_empty"}),
        (ChairStatus(NOW, battery=0.15), set()),
        (ChairStatus(NOW, battery=0.149), {"battery_low"}),
        (ChairStatus(NOW, battery=math.nan), {"battery_low"}),
        (ChairStatus(NOW, seated=True, charging=False, battery=1.0), set()),
    ],
)
def test_f24_contacts_are_obeyed_even_where_none_are_configured(status: ChairStatus, found: set[str]) -> None:
    fitness = well()
    fitness.hear(status, Twist())
    assert ids(fitness) == found


def test_f24_seat_switch_and_battery_are_judged_separately() -> None:
    """They are two messages in ROS: a value unknown to one message stays as the other gave it."""
    fitness = well(FitnessSettings(seat_switch=True, power_monitor=True))
    fitness.hear(ChairStatus(NOW, seated=False), Twist())
    assert ids(fitness) == {"status_stale", "seat_empty"}
    fitness.hear(ChairStatus(NOW, charging=True, battery=0.5), Twist())
    assert ids(fitness) == {"seat_empty", "charging"}
    fitness.hear(ChairStatus(NOW, seated=True), Twist())
    assert ids(fitness) == {"charging"}
    fitness.hear(ChairStatus(NOW, battery=0.5), Twist())
    assert ids(fitness) == {"charging"}, "a message without the charger's state does not unplug it"
    fitness.hear(ChairStatus(NOW, charging=False), Twist())
    assert ids(fitness) == set()


def test_f24_silent_contacts_stop_the_drive_where_contacts_are_fitted() -> None:
    for settings in (FitnessSettings(seat_switch=True), FitnessSettings(power_monitor=True)):
        fitness = well(settings)
        assert ids(fitness) == {"status_stale"}
        fitness.hear(ChairStatus(NOW), Twist())
        assert ids(fitness) == {"status_stale"}
        fitness.hear(ChairStatus(NOW, True, False, 0.5), Twist())
        assert ids(fitness) == set()
        later = NOW + 1501 * MS
        fitness.hear(scan(later), Twist())
        fitness.hear(WheelTicks(later, 0, 0), Twist())
        assert ids(fitness, later) == {"status_stale"}
