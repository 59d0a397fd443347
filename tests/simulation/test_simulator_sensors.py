"""All sensors in the simulator: rates, determinism, people, closing doors, riding lifts, contacts."""

from __future__ import annotations

import hashlib
import math
import subprocess
import sys
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.errors import WorldError
from waychair.simulation import sensor_suite as module
from waychair.simulation.plan.world import World, load_world, world_from_grid
from waychair.simulation.scene.contact import ContactKind
from waychair.simulation.scene.scene import PersonBehaviour, PersonPlan
from waychair.simulation.sensors.camera import CameraSettings
from waychair.simulation.sensors.imu import ImuSettings
from waychair.simulation.sensors.renderer import renderer_problem
from waychair.simulation.simulator import Simulator, SimulatorSettings, with_all_sensors
from waychair.types import ImuSample, OccupancyGrid, Pose2, RgbdFrame, Scan, SensorMessage, SonarReadings, WheelTicks

SECOND = 1_000_000_000
SMALL = with_all_sensors(SimulatorSettings(camera=CameraSettings(width=160, height=120)))
needs_pictures = pytest.mark.skipif(renderer_problem() is not None, reason=str(renderer_problem()))


def hall(*people: PersonPlan) -> World:
    """A closed hall of 10 x 6 m, the chair at (2, 3) looking along it."""
    cells = np.zeros((120, 200), np.int8)
    cells[:2], cells[-2:], cells[:, :2], cells[:, -2:] = 100, 100, 100, 100
    return replace(world_from_grid(OccupancyGrid(cells, 0.05), Pose2(2.0, 3.0, 0.0)), people=people)


def fingerprint(messages: tuple[SensorMessage, ...]) -> str:
    """Hash of all bytes of all sensors."""
    digest = hashlib.sha256()
    for message in messages:
        digest.update(f"{type(message).__name__} {message.stamp_ns}".encode())
        if isinstance(message, Scan | SonarReadings):
            digest.update(message.ranges.tobytes())
        elif isinstance(message, ImuSample):
            digest.update(message.accel.tobytes() + message.gyro.tobytes())
        elif isinstance(message, RgbdFrame):
            digest.update(message.image.tobytes() + message.depth.tobytes())
        else:
            digest.update(f"{message.left} {message.right}".encode())
    return digest.hexdigest()


def drive(seed: int, settings: SimulatorSettings = SMALL, world: str = "second_floor") -> tuple[SensorMessage, ...]:
    simulator = Simulator(load_world(world), CHAIR_A, settings, seed)
    simulator.drive(2.2, 1.75)
    return simulator.advance(2 * SECOND)


@needs_pictures
def test_every_sensor_sends_at_its_rate_with_its_own_stamps() -> None:
    messages = Simulator(hall(), CHAIR_A, SMALL).advance(2 * SECOND)
    assert Counter(type(message).__name__ for message in messages) == {
        "ImuSample": 400, "WheelTicks": 100, "SonarReadings": 40, "RgbdFrame": 30, "Scan": 19,
    }  # fmt: skip
    for kind, period in ((ImuSample, 5e6), (WheelTicks, 20e6), (SonarReadings, 50e6), (Scan, 100e6)):
        stamps = [message.stamp_ns for message in messages if isinstance(message, kind)]
        assert set(np.diff(stamps)) == {period}
    frames = [message.stamp_ns for message in messages if isinstance(message, RgbdFrame)]
    assert set(np.diff(frames)) == {65_000_000, 70_000_000}


def test_a_sweep_arrives_after_its_last_beam_with_the_stamp_of_its_first() -> None:
    simulator = Simulator(hall(), CHAIR_A)
    seen = [
        (simulator.now_ns - message.stamp_ns)
        for _ in range(200)
        for message in simulator.advance(SECOND // 200)
        if isinstance(message, Scan)
    ]
    assert set(seen) == {75_000_000}


@needs_pictures
@pytest.mark.nightly
def test_the_same_seed_gives_identical_bytes_of_all_sensors_in_two_processes() -> None:
    code = (
        "from tests.simulation.test_simulator_sensors import drive, fingerprint; print(fingerprint(drive(3)), end='')"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout == fingerprint(drive(3))
    assert run.stdout != fingerprint(drive(4))


@needs_pictures
def test_switching_the_camera_off_does_not_change_the_bytes_of_other_sensors() -> None:
    blind = replace(SMALL, camera=replace(SMALL.camera, rate_hz=0.0))
    with_camera = tuple(message for message in drive(1) if not isinstance(message, RgbdFrame))
    assert fingerprint(with_camera) == fingerprint(drive(1, blind))


def test_a_machine_without_a_renderer_simulates_without_pictures_and_warns(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "renderer_problem", lambda: "there is no EGL: install libegl1")
    simulator = Simulator(hall(), CHAIR_A, SMALL)
    assert simulator.camera_problem == "there is no EGL: install libegl1"
    assert not any(isinstance(message, RgbdFrame) for message in simulator.advance(SECOND))
    assert Simulator(hall(), CHAIR_A).camera_problem is None


@pytest.mark.parametrize("plant_model", ["kinematic", "mujoco"])
def test_a_turn_is_measured_by_gyro_and_encoders_alike_and_gravity_points_up(plant_model: str) -> None:
    settings = SimulatorSettings(plant_model=plant_model, imu=ImuSettings(rate_hz=200.0))
    simulator = Simulator(hall(), CHAIR_A, settings)
    simulator.drive(1.65, 1.45)
    simulator.advance(SECOND)
    began = simulator.truth().theta
    messages = simulator.advance(SECOND)
    samples = [message for message in messages if isinstance(message, ImuSample)]
    turned = math.remainder(simulator.truth().theta - began, math.tau)
    assert np.mean([sample.gyro[2] for sample in samples]) == pytest.approx(turned, abs=0.02)
    assert np.mean([sample.accel[2] for sample in samples]) == pytest.approx(9.81, abs=0.2)
    ticks = [message for message in messages if isinstance(message, WheelTicks)]
    rolled = (ticks[-1].right - ticks[0].right - ticks[-1].left + ticks[0].left) * math.tau / CHAIR_A.ticks_per_turn
    assert rolled * CHAIR_A.wheel_radius / CHAIR_A.track / 0.98 == pytest.approx(turned, rel=0.05)


def test_the_lidar_sees_a_person_in_the_way_and_a_chair_that_does_not_stop_hits_the_person_once() -> None:
    someone = PersonPlan(PersonBehaviour.SEATED, np.array([[5.0, 3.0]]))
    simulator = Simulator(hall(someone), CHAIR_A)
    scans = [message for message in simulator.advance(SECOND) if isinstance(message, Scan)]
    assert np.nanmin(scans[-1].ranges[300:420]) == pytest.approx(2.2, abs=0.35)
    assert simulator.person_distance() == pytest.approx(5.0 - 2.0 - CHAIR_A.front - 0.25, abs=1e-6)
    simulator.drive(2.2, 1.65)
    simulator.advance(8 * SECOND)
    (contact,) = [report for report in simulator.contact_reports if report.kind is ContactKind.PERSON]
    assert (contact.x, contact.y) == (5.0, 3.0)
    assert 0.3 < contact.speed < 0.8


def test_an_empty_world_has_no_person_near() -> None:
    simulator = Simulator(hall(), CHAIR_A)
    assert simulator.people == ()
    assert simulator.person_distance() == math.inf


def test_a_closed_door_is_in_the_scan_and_in_the_way() -> None:
    simulator = Simulator(load_world("second_floor").without_people(), CHAIR_A, seed=1)
    before, ticks = simulator.truth(), [m for m in simulator.advance(SECOND) if isinstance(m, WheelTicks)][-1]
    simulator.close("classroom")
    assert simulator.truth() == before
    assert [m for m in simulator.advance(SECOND) if isinstance(m, WheelTicks)][-1] == replace(
        ticks, stamp_ns=2 * SECOND
    )
    with pytest.raises(WorldError, match="no door 'barn'"):
        simulator.close("barn")


def test_the_lift_takes_the_chair_to_the_other_level_only_from_its_cabin() -> None:
    ground, upper = (load_world("two_floors", level) for level in ("ground", "upper"))
    (lift,) = ground.lifts
    outside = Simulator(ground, CHAIR_A)
    with pytest.raises(WorldError, match="not in lift"):
        outside.ride(upper)
    with pytest.raises(WorldError, match="no lift goes"):
        outside.ride(load_world("second_floor"))
    inside = Simulator(replace(ground, start=lift.middle @ Pose2(-0.25, 0.0, 0.0)), CHAIR_A)
    inside.advance(SECOND)
    before = inside.truth()
    inside.ride(upper)
    assert inside.world.level == "upper"
    assert inside.truth() == before
    assert any(isinstance(message, Scan) for message in inside.advance(SECOND))


def test_in_mujoco_a_chair_that_drives_down_the_stairs_falls_and_reports_it() -> None:
    world = load_world("stairs")
    (pit,) = world.pits
    at = pit.middle @ Pose2(0.0, pit.width / 2 + 1.0, 0.0)
    begin = Pose2(at.x, at.y, math.atan2(pit.middle.y - at.y, pit.middle.x - at.x))
    simulator = Simulator(replace(world, start=begin), CHAIR_A, SimulatorSettings(plant_model="mujoco"))
    simulator.drive(2.4, 1.65)
    simulator.advance(6 * SECOND)
    assert ContactKind.FALL in [report.kind for report in simulator.contact_reports]
    assert simulator.in_contact
