"""The simulator's bars: speed, reproducible bytes, odometry errors, features in pictures, complete bags."""

from __future__ import annotations

import hashlib
import os
import platform
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
from rosbags.highlevel import AnyReader

from evaluation.speed.simulation import speed, suites
from waychair.calibration.chair_body import CHAIR_A
from waychair.geometry import in_space
from waychair.simulation.plan.world import World, load_world
from waychair.simulation.plant.chair_file import load_chair, randomised_chair
from waychair.simulation.sensors.camera import CameraSettings, RgbdCamera
from waychair.simulation.sensors.renderer import Renderer, camera_matrix
from waychair.simulation.simulator import Simulator, SimulatorSettings, with_all_sensors
from waychair.trials.demo.demo import run_demo
from waychair.trials.demo.demo_report import report
from waychair.trials.record import drive_route
from waychair.types import ImuSample, Json, Pose2, PressureSample, RgbdFrame, Scan, SensorMessage, SonarReadings, Twist

FLOOR = "second_floor"
SEEDS = 20
RATES = {
    "/scan": 10.0,
    "/odom": 50.0,
    "/imu/data": 200.0,
    "/camera/color/image_raw": 15.0,
    "/camera/color/camera_info": 15.0,
    "/camera/aligned_depth_to_color/image_raw": 15.0,
    "/camera/aligned_depth_to_color/camera_info": 15.0,
    "/sonar_0": 20.0,
    "/tf": 50.0,
}
"""Least rates of messages in a bag [Hz]."""


def run_speed(out: Path) -> Json:
    """Simulated seconds per processor second on the second floor, with its people, medians."""
    world = load_world(FLOOR)
    figures = {
        model: {
            name: round(speed(world, suite), 1) for name, suite in suites(SimulatorSettings(plant_model=model)).items()
        }
        for model in ("kinematic", "mujoco")
    }
    met = all(suite["full suite"] >= 3.0 and suite["lidar only"] >= 40.0 for suite in figures.values())
    return {"passed": met, "machine": f"{platform.machine()}, {os.cpu_count()} cores, no GPU used", **figures}


def run_bytes(out: Path) -> Json:
    """SHA-256 of all sensor messages of 20 s: equal in two processes of one seed, different for another seed."""
    hashes = [
        subprocess.run(
            [sys.executable, "-c", f"from evaluation.figures.chair.simulation import hash_of; print(hash_of({seed}))"],
            capture_output=True, text=True, check=True,
        ).stdout.strip()
        for seed in (7, 7, 8)
    ]  # fmt: skip
    return {"passed": hashes[0] == hashes[1] != hashes[2], "same_seed": hashes[:2], "other_seed": hashes[2]}


def hash_of(seed: int) -> str:
    """Return the hash of all sensor messages in 20 s, with the physical plant and people."""
    settings = with_all_sensors(SimulatorSettings(plant_model="mujoco"))
    simulator = Simulator(load_world(FLOOR), CHAIR_A, settings, seed)
    simulator.drive(2.0, 1.68)
    digest = hashlib.sha256()
    for message in simulator.advance(20_000_000_000):
        for part in _bytes(message):
            digest.update(part)
    return digest.hexdigest()


def _bytes(message: SensorMessage) -> Iterator[bytes]:
    yield f"{type(message).__name__} {message.stamp_ns}".encode()
    if isinstance(message, Scan | SonarReadings):
        yield message.ranges.tobytes()
    elif isinstance(message, ImuSample):
        yield message.accel.tobytes() + message.gyro.tobytes()
    elif isinstance(message, RgbdFrame):
        yield message.image.tobytes() + message.depth.tobytes()
    elif isinstance(message, PressureSample):
        yield f"{message.pascal!r}".encode()
    else:
        yield f"{message.left} {message.right}".encode()


def run_odometry(out: Path) -> Json:
    """Final error of wheel odometry after the second floor's mapping route, with both plants."""
    ends: dict[str, list[float]] = {}
    for model, seeds in (("kinematic", SEEDS), ("mujoco", 5)):
        ends[model] = []
        for seed in range(seeds):
            chair = randomised_chair(load_chair("A"), seed)
            settings = SimulatorSettings(plant_model=model, plant=chair.plant, mujoco=chair.mujoco)
            world = load_world(FLOOR)
            drive = drive_route(Simulator(world, chair.body, settings, seed), chair.body, world.route())
            ends[model].append(round(drive.odometry_error_m, 2))
    every = [end for model in ends.values() for end in model]
    within = sum(5.0 <= end <= 15.0 for end in every)
    median = statistics.median(every)
    return {
        "passed": 5.0 <= median <= 15.0,
        "median_m": median,
        "within_5_to_15_m": f"{within} of {len(every)}",
        **ends,
    }


def run_features(out: Path) -> Json:
    """Numbers of ORB keypoints (at most 1000) in frames every 2 m along the mapping routes."""
    figures: Json = {}
    for name in (FLOOR, "basement"):
        counts = [_keypoints(frame) for frame in _frames(load_world(name))]
        figures[name] = {"frames": len(counts), "median": statistics.median(counts), "least": min(counts)}
    return {"passed": all(floor["median"] >= 500 for floor in figures.values()), **figures}


def _keypoints(frame: RgbdFrame) -> int:
    return len(cv2.ORB_create(1000).detect(cv2.cvtColor(frame.image, cv2.COLOR_RGB2GRAY), None))  # type: ignore[attr-defined]


def _frames(world: World) -> Iterator[RgbdFrame]:
    """Yield a frame every 2 m along the mapping route, facing along it, after a second of automatic exposure."""
    settings = CameraSettings()
    matrix = camera_matrix(settings.width, settings.height, settings.field_of_view)
    renderer = Renderer(world, matrix, settings.width, settings.height)
    camera = RgbdCamera(settings, CHAIR_A.base_from_camera, np.random.default_rng(0), renderer)
    route, stamp_ns = world.route(), 0
    for begin, end in pairwise(route):
        ahead = np.arctan2(*(end - begin)[::-1])
        for along in np.arange(0.0, np.hypot(*(end - begin)), 2.0):
            x, y = begin + along * np.array([np.cos(ahead), np.sin(ahead)])
            stamp_ns += 1_000_000_000
            yield camera.frame(stamp_ns, in_space(Pose2(float(x), float(y), float(ahead))), Twist(0.6, 0.0))
    renderer.release()


def run_bag(out: Path) -> Json:
    """Contents of a recorded drive with all sensors, in both bag formats, read with rosbags."""
    world = load_world("corridor_t")
    figures: Json = {}
    for suffix in (".mcap", ".db3"):
        with tempfile.TemporaryDirectory() as folder:
            bag = Path(folder) / f"drive{suffix}"
            simulator = Simulator(world, CHAIR_A, with_all_sensors(SimulatorSettings(plant_model="mujoco")))
            drive = drive_route(simulator, CHAIR_A, world.route()[:1], bag)
            with AnyReader([bag]) as reader:
                counts = {connection.topic: connection.msgcount for connection in reader.connections}
            rates = {topic: round(counts.get(topic, 0) / drive.duration_s, 2) for topic in RATES}
            figures[suffix] = {
                "duration_s": round(drive.duration_s, 2),
                "size_mb": round(bag.stat().st_size / 1e6, 1),
                "tf_static": counts.get("/tf_static", 0),
                "rates_hz": rates,
                "others": sorted(set(counts) - set(RATES) - {"/tf_static"}),
            }
    met = all(
        abs(figure["rates_hz"][topic] / rate - 1.0) < 0.03
        for figure in figures.values()
        for topic, rate in RATES.items()
    )
    return {"passed": met and all(figure["tf_static"] == 1 for figure in figures.values()), **figures}


def run_thin_stack(out: Path) -> Json:
    """`waychair demo --world second_floor`, seed 0, on the map of a recorded drive of its route."""
    result = report(run_demo(out.with_suffix(""), 0, world=FLOOR))
    return {
        "passed": result["goals_reached"] == result["goals"] and result["contacts"] == 0,
        **{key: result[key] for key in ("goals", "goals_reached", "contacts", "min_clearance_m")},
    }
