"""Kind 1, wheels: odometry that restarts, jumps, has other units or axes, stops, or comes late."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from evaluation.corruptions.fault import faults_of, messages_fault
from evaluation.corruptions.messages import ODOM, BagMessage, Messages, change, set_stamp, set_yaw, stamp_of, yaw_of
from evaluation.corruptions.sound_drive import SECOND

Rng = np.random.Generator
_STEP = "jump|restart|begins anew|no chair|steps?\\b|wild|reset|[\\d.]+ (k?m|degrees) off"
_SCALE = "scale|units?|long|short|millimet|centimet|factor|radius|[\\d.]+ times (too|the true)"


def _readings(messages: Messages) -> list[BagMessage]:
    return messages.of(ODOM)


def _from(messages: Messages, rng: Rng) -> list[BagMessage]:
    """Return the readings from a moment in the middle of the drive on."""
    readings = _readings(messages)
    return readings[int(rng.uniform(0.25, 0.75) * len(readings)) :]


def _pose_by(events: list[BagMessage], by: Callable[[float, float, float], tuple[float, float, float]]) -> None:
    for event in events:
        at = event.body.pose.pose.position
        at.x, at.y, yaw = by(float(at.x), float(at.y), yaw_of(event.body))
        set_yaw(event.body, yaw)


def _seen_from(events: list[BagMessage], x0: float, y0: float, yaw0: float, into: tuple[float, float, float]) -> None:
    """Give the poses from another origin: the pose (x0, y0, yaw0) becomes `into`."""
    turn = into[2] - yaw0
    c, s = math.cos(turn), math.sin(turn)
    _pose_by(
        events,
        lambda x, y, yaw: (
            into[0] + c * (x - x0) - s * (y - y0),
            into[1] + s * (x - x0) + c * (y - y0),
            yaw + turn,
        ),
    )


@messages_fault(1, "odometry", _STEP)
def odometry_restarts_at_zero(messages: Messages, rng: Rng) -> None:
    later = _from(messages, rng)
    at = later[0].body.pose.pose.position
    _seen_from(later, float(at.x), float(at.y), yaw_of(later[0].body), (0.0, 0.0, 0.0))


@messages_fault(1, "odometry", _STEP)
def odometry_jumps(messages: Messages, rng: Rng) -> None:
    later = _from(messages, rng)
    at, yaw = later[0].body.pose.pose.position, yaw_of(later[0].body)
    far, way = rng.uniform(1.0, 20.0), rng.uniform(-math.pi, math.pi)
    turned = yaw + rng.uniform(-2.0, 2.0)
    to = (float(at.x) + far * math.cos(way), float(at.y) + far * math.sin(way), turned)
    _seen_from(later, float(at.x), float(at.y), yaw, to)


@messages_fault(1, "odometry", _STEP + "|finite")
def odometry_has_wild_messages(messages: Messages, rng: Rng) -> None:
    later = _from(messages, rng)
    size = 10.0 ** rng.uniform(1.0, 30.0)
    for event in later[: int(rng.choice([1, 3, 40]))]:
        event.body.pose.pose.position.x += size
        event.body.pose.pose.position.y -= size


@messages_fault(1, "odometry", "finite|nan|numbers|" + _STEP)
def odometry_has_nan(messages: Messages, rng: Rng) -> None:
    path = str(rng.choice(["pose.pose.position.x", "pose.pose.orientation.z", "twist.twist.linear.x"]))
    share = float(rng.choice([0.01, 0.3, 1.0]))
    for event in _readings(messages):
        if rng.random() < share:
            change(event.body, path, lambda _: float(rng.choice([math.nan, math.inf])))


@messages_fault(1, "odometry", _SCALE)
def odometry_is_in_other_units(messages: Messages, rng: Rng) -> None:
    unit = float(rng.choice([1000.0, 100.0, 39.37, 3.28084, 0.001]))
    _pose_by(_readings(messages), lambda x, y, yaw: (unit * x, unit * y, yaw))


@messages_fault(1, "odometry", _SCALE)
def odometry_speeds_are_in_other_units(messages: Messages, rng: Rng) -> None:
    field, unit = ("linear.x", 1000.0) if rng.random() < 0.5 else ("angular.z", 180 / math.pi)
    for event in _readings(messages):
        change(event.body, f"twist.twist.{field}", lambda value: unit * value)


@messages_fault(1, "odometry", _SCALE)
def wheels_are_long_or_short(messages: Messages, rng: Rng) -> None:
    by = float(rng.choice([0.5, 0.95, 0.97, 1.03, 1.05, 1.2, 2.0]))
    _pose_by(_readings(messages), lambda x, y, yaw: (by * x, by * y, yaw))


@messages_fault(1, "odometry", "headings?|track|" + _SCALE)
def wheels_turn_too_far(messages: Messages, rng: Rng) -> None:
    _rolled(_readings(messages), way=1.0, turn=float(rng.choice([0.8, 0.9, 1.1, 1.3, 2.0])))


@messages_fault(1, "odometry", "other way|exchanged|mirror|backward|against")
def wheels_are_exchanged(messages: Messages, rng: Rng) -> None:
    way, turn = [(1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)][int(rng.integers(3))]
    _rolled(_readings(messages), way=way, turn=turn)


@messages_fault(1, "odometry", "degrees|headings?|exchanged|axes|other way|mirror|" + _SCALE)
def odometry_has_other_axes(messages: Messages, rng: Rng) -> None:
    which = int(rng.integers(4))
    _pose_by(
        _readings(messages),
        lambda x, y, yaw: [
            (y, x, yaw), (x, -y, yaw), (x, y, -yaw), (x, y, yaw * 180 / math.pi)][which],
    )  # fmt: skip


@messages_fault(1, "odometry", "quaternion|headings?|orientation|finite")
def odometry_has_no_orientation(messages: Messages, rng: Rng) -> None:
    zero = rng.random() < 0.5
    for event in _readings(messages):
        turn = event.body.pose.pose.orientation
        turn.x = turn.y = turn.z = 0.0
        turn.w = 0.0 if zero else 1.0


@messages_fault(1, "odometry", "nothing|stand|stuck|stop|stick|same|jump")
def odometry_sticks(messages: Messages, rng: Rng) -> None:
    later = _from(messages, rng)
    kept: Any = later[0].body
    for event in later if rng.random() < 0.5 else later[: int(rng.integers(40, 200))]:
        event.body.pose, event.body.twist = kept.pose, kept.twist


@messages_fault(1, "odometry", "late\\b|delay|early|earlier|clock|behind|stamps?|apart")
def odometry_is_late(messages: Messages, rng: Rng) -> None:
    by = int(float(rng.choice([0.2, 0.5, 1.0, -0.5])) * SECOND)
    for event in _readings(messages):
        set_stamp(event.body, stamp_of(event.body) + by)


@messages_fault(1, ("odometry", "clock"), "stamp|clock")
def odometry_has_no_stamps(messages: Messages, rng: Rng) -> None:
    for event in _readings(messages):
        if rng.random() < 0.5 or event.true_ns:
            set_stamp(event.body, 0)


@messages_fault(1, ("odometry", "clock"), "stamp|clock|before|after|cover|overlap|apart")
def odometry_has_another_clock(messages: Messages, rng: Rng) -> None:
    by = int(float(rng.choice([-3600.0, 7200.0, -1.7e9, 86400.0])) * SECOND)
    for event in _readings(messages):
        set_stamp(event.body, max(1, stamp_of(event.body) + by))


@messages_fault(1, "odometry", "gap|missing|silen|no odometry|alone|no messages|before the first or after the last")
def odometry_is_silent_for_a_while(messages: Messages, rng: Rng) -> None:
    later = _from(messages, rng)
    messages.remove(later if rng.random() < 0.3 else later[: int(rng.integers(20, 300))])


@messages_fault(1, "odometry", "no odometry|alone|missing|holds no nav_msgs")
def odometry_is_missing(messages: Messages, rng: Rng) -> None:
    messages.remove(_readings(messages))


@messages_fault(1, "odometry", "twice|duplicate|same|repeat")
def odometry_comes_twice(messages: Messages, rng: Rng) -> None:
    for event in _readings(messages):
        if rng.random() < 0.5:
            copy = BagMessage(ODOM, event.log_ns + 1, event.body, event.true_ns)
            messages.events.append(copy)
    messages.events.sort(key=lambda event: event.log_ns)


@messages_fault(1, "odometry", "order|sort|stamps?|late\\b")
def odometry_is_out_of_order(messages: Messages, rng: Rng) -> None:
    for event in _readings(messages):
        event.log_ns += int(rng.integers(0, SECOND // 2))
    messages.events.sort(key=lambda event: event.log_ns)


@messages_fault(1, "odometry", "robot|several|chosen|which|--odom|/odom")
def another_robot_is_in_the_bag(messages: Messages, rng: Rng) -> None:
    for event in _readings(messages):
        twin = messages.make(
            "nav_msgs/msg/Odometry",
            messages.header(stamp_of(event.body), "robot2/odom"),
            "robot2/base_link",
            event.body.pose.__class__(event.body.pose.pose, event.body.pose.covariance),
            event.body.twist,
        )
        pose = event.body.pose.pose
        other = pose.__class__(pose.position.__class__(-pose.position.y, 0.5 * pose.position.x, 0.0), pose.orientation)
        twin.pose.pose = other
        for k in range(2 if rng.random() < 0.5 else 1):
            messages.events.append(BagMessage("/robot2/odom", event.log_ns + k, twin, event.true_ns))
    messages.events.sort(key=lambda event: event.log_ns)


def _rolled(events: list[BagMessage], way: float, turn: float) -> None:
    poses = np.array([(e.body.pose.pose.position.x, e.body.pose.pose.position.y, yaw_of(e.body)) for e in events])
    poses[:, 2] = np.unwrap(poses[:, 2])
    steps = np.diff(poses, axis=0)
    middle = 0.5 * (poses[1:, 2] + poses[:-1, 2])
    ahead = way * (np.cos(middle) * steps[:, 0] + np.sin(middle) * steps[:, 1])
    heading = np.concatenate([[0.0], np.cumsum(turn * steps[:, 2])])
    middle = 0.5 * (heading[1:] + heading[:-1])
    x, y = (np.concatenate([[0.0], np.cumsum(ahead * of(middle))]) for of in (np.cos, np.sin))
    for event, x0, y0, yaw in zip(events, x.tolist(), y.tolist(), heading.tolist(), strict=True):
        event.body.pose.pose.position.x, event.body.pose.pose.position.y = x0, y0
        set_yaw(event.body, yaw)
        change(event.body, "twist.twist.linear.x", lambda value: way * value)
        change(event.body, "twist.twist.angular.z", lambda value: turn * value)


ODOMETRY_FAULTS = faults_of(globals())
