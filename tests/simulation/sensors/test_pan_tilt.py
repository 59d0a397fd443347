"""Servos of a camera: rate, the long way round, limits, settling, play, and what they report."""

from __future__ import annotations

import math

import pytest

from waychair.calibration.servo_camera_mount import PAN_LIMITS, SERVO_CAMERA, TILT_LIMITS
from waychair.simulation.sensors.pan_tilt import BACKLASH, RATE, SETTLING_NS, PanTilt, ServoCameraFaults
from waychair.types import PanTiltAngles, PanTiltCommand

STEP_NS = 5_000_000
SOUND = ServoCameraFaults()


def _turned(servos: PanTilt, pan: float, tilt: float = 0.0, faults: ServoCameraFaults = SOUND) -> list[PanTiltAngles]:
    """The reports on the way to an aim, until the camera is at rest."""
    servos.order(PanTiltCommand(0, math.radians(pan), math.radians(tilt)))
    reports = []
    for step in range(1, 2000):
        servos.step(STEP_NS, faults)
        reports.append(servos.report(step * STEP_NS, faults))
        if reports[-1].settled:
            break
    return reports


def test_a_turn_of_60_degrees_takes_the_servos_time_and_then_the_camera_settles() -> None:
    reports = _turned(PanTilt(), 60.0)
    moving = [each for each in reports if each.pan < math.radians(60.0) - 1e-9]
    assert len(moving) * STEP_NS * 1e-9 == pytest.approx(math.radians(60.0) / RATE, abs=0.006)
    assert reports[-1].pan == pytest.approx(math.radians(60.0))
    assert not any(each.settled for each in reports[:-1])
    assert len(reports) - len(moving) - 1 == SETTLING_NS // STEP_NS


def test_from_350_to_10_degrees_the_pan_turns_back_through_all_directions_between() -> None:
    servos = PanTilt()
    _turned(servos, 350.0)
    passed = [math.degrees(each.pan) for each in _turned(servos, 10.0)]
    assert min(passed) >= 10.0 - 1e-9
    assert any(170.0 < angle < 190.0 for angle in passed)


@pytest.mark.parametrize(("pan", "tilt"), [(-30.0, -80.0), (400.0, 120.0)])
def test_the_servos_stop_at_their_limits_and_say_so(pan: float, tilt: float) -> None:
    report = _turned(PanTilt(), pan, tilt)[-1]
    assert report.pan == pytest.approx(min(max(math.radians(pan), PAN_LIMITS[0]), PAN_LIMITS[1]))
    assert report.tilt == pytest.approx(min(max(math.radians(tilt), TILT_LIMITS[0]), TILT_LIMITS[1]))


def test_the_camera_lags_behind_the_report_by_half_the_play_on_the_side_it_comes_from() -> None:
    servos = PanTilt()
    up = _turned(servos, 90.0)[-1].pan - servos.angles[0]
    down = _turned(servos, 40.0)[-1].pan - servos.angles[0]
    assert (up, down) == (pytest.approx(BACKLASH / 2), pytest.approx(-BACKLASH / 2))


def test_an_order_that_is_no_angle_is_refused_and_the_last_one_stays() -> None:
    servos = PanTilt()
    _turned(servos, 20.0)
    with pytest.raises(ValueError, match="finite angles"):
        servos.order(PanTiltCommand(0, math.nan, 0.0))
    servos.step(STEP_NS, SOUND)
    assert servos.report(0, SOUND).pan == pytest.approx(math.radians(20.0))


def test_a_stuck_pan_stays_and_says_so_and_one_that_echoes_its_order_lies() -> None:
    for echoes, told in ((False, 0.0), (True, 50.0)):
        servos = PanTilt()
        report = _turned(servos, 50.0, faults=ServoCameraFaults(pan_stuck=True, echoes=echoes))[-1]
        assert math.degrees(report.pan) == pytest.approx(told)
        assert servos.angles[0] == pytest.approx(0.0, abs=BACKLASH)
    servos = PanTilt()
    report = _turned(servos, 50.0, faults=ServoCameraFaults(pan_error=0.3))[-1]
    assert report.pan == pytest.approx(math.radians(50.0) + 0.3)


def test_the_mount_looks_where_the_angles_say_with_the_laser_below() -> None:
    pose = SERVO_CAMERA.base_from_camera(math.radians(90.0), math.radians(30.0))
    assert pose.rotation[:, 2] == pytest.approx([0.0, math.cos(math.radians(30.0)), 0.5])
    assert pose.rotation[:, 0] == pytest.approx([1.0, 0.0, 0.0])  # the picture's right side is ahead of the chair
    assert math.isclose(float(pose.rotation[:, 0] @ pose.rotation[:, 1]), 0.0, abs_tol=1e-12)
    laser = SERVO_CAMERA.base_from_camera(0.0, 0.0) @ SERVO_CAMERA.camera_from_laser
    assert laser.translation == pytest.approx(
        [SERVO_CAMERA.forward, SERVO_CAMERA.left, SERVO_CAMERA.height - SERVO_CAMERA.baseline]
    )
