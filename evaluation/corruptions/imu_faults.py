"""Kind 1, IMU and mounts: other units, signs and axes, nothing, no gravity; mounts that are missing or wrong."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from evaluation.corruptions.fault import faults_of, messages_fault
from evaluation.corruptions.messages import (
    IMU,
    SCAN,
    STATIC,
    BagMessage,
    Messages,
    mount_message,
    quaternion,
    set_stamp,
    stamp_of,
)
from evaluation.corruptions.sound_drive import MOUNT, SECOND

Rng = np.random.Generator
_GRAVITY = "gravity|9.8|in g|upside|axes|axis|tilt|lean"
_MOUNT = "mount|--base-from-laser|connect|/tf|upside|elsewhere|looks"


def _samples(messages: Messages) -> list[BagMessage]:
    return messages.of(IMU)


def _vectors(
    events: list[BagMessage], field: str, by: Callable[[float, float, float], tuple[float, float, float]]
) -> None:
    for event in events:
        told = getattr(event.body, field)
        told.x, told.y, told.z = by(float(told.x), float(told.y), float(told.z))


@messages_fault(1, "imu", "degrees|57|scale|units?|[\\d.]+ times (too|the true)")
def gyro_is_in_other_units(messages: Messages, rng: Rng) -> None:
    unit = float(rng.choice([180 / math.pi, 1000.0, 0.5, 2.0]))
    _vectors(_samples(messages), "angular_velocity", lambda x, y, z: (unit * x, unit * y, unit * z))


@messages_fault(1, "imu", "upside|other way|axis|axes|on edge")
def imu_is_mounted_otherwise(messages: Messages, rng: Rng) -> None:
    which = int(rng.integers(3))
    turned = [
        lambda x, y, z: (x, -y, -z),  # upside down
        lambda x, y, z: (x, z, -y),  # on edge
        lambda x, y, z: (z, y, -x),
    ][which]
    for field in ("angular_velocity", "linear_acceleration"):
        _vectors(_samples(messages), field, turned)


@messages_fault(1, "imu", "other way|mirror|upside")
def gyro_turns_the_other_way(messages: Messages, rng: Rng) -> None:
    _vectors(_samples(messages), "angular_velocity", lambda x, y, z: (x, y, -z))


@messages_fault(1, "imu", "nothing|zero|stand still|missing")
def imu_is_all_zero(messages: Messages, rng: Rng) -> None:
    samples = _samples(messages)
    part = samples if rng.random() < 0.5 else samples[int(rng.uniform(0.2, 0.7) * len(samples)) :]
    for field in ("angular_velocity", "linear_acceleration"):
        _vectors(part, field, lambda x, y, z: (0.0, 0.0, 0.0))


@messages_fault(1, "imu", _GRAVITY)
def imu_has_no_gravity(messages: Messages, rng: Rng) -> None:
    _vectors(_samples(messages), "linear_acceleration", lambda x, y, z: (x, y, z - 9.81))


@messages_fault(1, "imu", _GRAVITY + "|unit|scale")
def forces_are_in_other_units(messages: Messages, rng: Rng) -> None:
    unit = float(rng.choice([1 / 9.81, 1000 / 9.81, 9.81]))
    _vectors(_samples(messages), "linear_acceleration", lambda x, y, z: (unit * x, unit * y, unit * z))


@messages_fault(1, "imu", "finite|nan|numbers")
def imu_has_nan(messages: Messages, rng: Rng) -> None:
    share = float(rng.choice([0.02, 0.5, 1.0]))
    field = str(rng.choice(["angular_velocity", "linear_acceleration"]))
    for event in _samples(messages):
        if rng.random() < share:
            _vectors([event], field, lambda x, y, z: (x, math.nan, math.nan))


@messages_fault(1, "imu", "stick|stuck|same|stand still|do not follow")
def imu_sticks(messages: Messages, rng: Rng) -> None:
    samples = _samples(messages)
    first = int(rng.uniform(0.2, 0.7) * len(samples))
    kept = samples[first].body
    for event in samples[first:]:
        event.body.angular_velocity, event.body.linear_acceleration = kept.angular_velocity, kept.linear_acceleration


@messages_fault(1, "imu", "bias|drift|offset|constant error")
def gyro_has_a_bias(messages: Messages, rng: Rng) -> None:
    bias = float(rng.choice([-0.3, -0.05, 0.1, 0.5]))
    samples = _samples(messages)
    part = samples if rng.random() < 0.6 else samples[len(samples) // 2 :]
    _vectors(part, "angular_velocity", lambda x, y, z: (x, y, z + bias))


@messages_fault(1, "imu", "wild|no chair")
def gyro_has_wild_samples(messages: Messages, rng: Rng) -> None:
    samples, size = _samples(messages), 10.0 ** rng.uniform(1.0, 8.0)
    for k in rng.integers(0, len(samples), int(rng.choice([1, 10, 100]))):
        _vectors([samples[k]], "angular_velocity", lambda x, y, z: (x, y, z + size))


@messages_fault(1, ("imu", "clock"), "late|delay|clock|early|stamp|apart|behind")
def imu_is_late(messages: Messages, rng: Rng) -> None:
    by = int(float(rng.choice([0.2, 0.6, -0.4, 3600.0, -1.7e9])) * SECOND)
    for event in _samples(messages):
        set_stamp(event.body, max(1, stamp_of(event.body) + by))


@messages_fault(1, ("imu", "clock"), "stamp|clock")
def imu_has_no_stamps(messages: Messages, rng: Rng) -> None:
    for event in _samples(messages):
        set_stamp(event.body, 0)


@messages_fault(1, "imu", "gap|missing|silen|no samples|no messages|end before")
def imu_is_silent_for_a_while(messages: Messages, rng: Rng) -> None:
    samples = _samples(messages)
    first = int(rng.uniform(0.1, 0.6) * len(samples))
    messages.remove(samples[first:] if rng.random() < 0.4 else samples[first : first + int(rng.integers(50, 800))])


def _mounts(messages: Messages, child: str) -> list[BagMessage]:
    return [event for event in messages.of(STATIC) if event.body.transforms[0].child_frame_id == child]


def _told_mount(messages: Messages, xyz: tuple[float, float, float], yaw: float = 0.0, roll: float = 0.0) -> None:
    for event in _mounts(messages, "laser"):
        event.body = mount_message(messages, "base_link", "laser", xyz, yaw, roll)


@messages_fault(1, ("mount", "lidar"), _MOUNT)
def lidar_looks_elsewhere(messages: Messages, rng: Rng) -> None:
    _told_mount(messages, (*MOUNT, 0.3), yaw=float(rng.choice([math.pi, math.pi / 2, -math.pi / 2, 0.5, -0.3])))


@messages_fault(1, ("mount", "lidar"), _MOUNT)
def lidar_is_told_upside_down(messages: Messages, rng: Rng) -> None:
    _told_mount(messages, (*MOUNT, 0.3), roll=math.pi)


@messages_fault(1, ("mount", "lidar"), _MOUNT + "|place|far|unit|large|impossible")
def lidar_is_told_elsewhere(messages: Messages, rng: Rng) -> None:
    far = float(rng.choice([0.6, 1.0, 250.0, 1000.0]))
    _told_mount(messages, (MOUNT[0] + far, MOUNT[1], 0.3))


@messages_fault(1, ("mount", "lidar"), _MOUNT)
def lidar_mount_is_missing(messages: Messages, rng: Rng) -> None:
    messages.remove(_mounts(messages, "laser"))


@messages_fault(1, ("mount", "imu"), "mount|connect|level")
def imu_mount_is_missing(messages: Messages, rng: Rng) -> None:
    messages.remove(_mounts(messages, "imu_link"))


@messages_fault(1, "mount", _MOUNT + "|frame|name")
def mount_names_another_frame(messages: Messages, rng: Rng) -> None:
    parent, child = [("base_link", "base_laser"), ("base_footprint", "laser"), ("laser", "base_link")][
        int(rng.integers(3))
    ]
    for event in _mounts(messages, "laser"):
        event.body = mount_message(messages, parent, child, (*MOUNT, 0.3))


@messages_fault(1, "mount", _MOUNT + "|finite|nan|quaternion|rotation")
def mount_is_no_transform(messages: Messages, rng: Rng) -> None:
    which = int(rng.integers(3))
    for event in _mounts(messages, "laser"):
        transform = event.body.transforms[0].transform
        turn = transform.rotation
        if which == 0:
            turn.x = turn.y = turn.z = turn.w = 0.0
        elif which == 1:
            transform.translation.x = math.nan
        else:
            turn.w = 7.0


@messages_fault(1, "mount", _MOUNT + "|two|contradict|moves|several|parent")
def mount_is_told_twice(messages: Messages, rng: Rng) -> None:
    event = _mounts(messages, "laser")[0]
    other = mount_message(messages, "base_link", "laser", (*MOUNT, 0.3), yaw=float(rng.choice([math.pi / 2, math.pi])))
    messages.events.insert(0 if rng.random() < 0.5 else 2, BagMessage(STATIC, event.log_ns, other, event.true_ns))


@messages_fault(1, "mount", _MOUNT + "|loop|circle|cycle|parent")
def mounts_go_round(messages: Messages, rng: Rng) -> None:
    first = _mounts(messages, "laser")[0]
    for parent, child in (("laser", "plate"), ("plate", "base_link")):
        messages.events.insert(
            0, BagMessage(STATIC, first.log_ns, mount_message(messages, parent, child, (0.1, 0.0, 0.0)), first.true_ns)
        )


@messages_fault(1, ("mount", "lidar"), _MOUNT + "|frame")
def scans_change_their_frame(messages: Messages, rng: Rng) -> None:
    scans = messages.of(SCAN)
    for event in scans[int(rng.uniform(0.2, 0.8) * len(scans)) :] if rng.random() < 0.6 else scans:
        event.body.header.frame_id = str(rng.choice(["", "laser_frame", "/laser"]))


@messages_fault(1, ("mount", "imu"), "tilt|level|axes|upside|mount|gravity|lean|axis")
def imu_mount_is_wrong(messages: Messages, rng: Rng) -> None:
    roll = float(rng.choice([math.pi, math.pi / 2]))
    for event in _mounts(messages, "imu_link"):
        turn = event.body.transforms[0].transform
        turn.rotation = quaternion(lambda *xyzw: messages.make("geometry_msgs/msg/Quaternion", *xyzw), 0.0, roll)


IMU_FAULTS = faults_of(globals())
