"""A tape whose messages came to the navigator's node over ROS: encoded, in bytes, and decoded as the node does.

A tape of a node itself would not be the same twice: its ticks follow the computer's clock, and a message that comes a
little later comes in the next tick. What a node adds to the pilot is what its messages carry, and that is repeatable.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from evaluation.runs.part_replays import localisation_at
from evaluation.runs.replay import Tape, TapedTick

from waychair.recordings.bags import ros_messages
from waychair.ros.messages import chair, motion, sensors, wire
from waychair.ros.messages.camera import read_rgbd
from waychair.ros.nodes.parts.map_layout import MapLayout
from waychair.runtime.black_box.box_file import LoggedLocalisation, Moment, Tick, encoded
from waychair.runtime.drive_base import ChairMessage
from waychair.slam.odometry.odometry_track import OdometryTrack
from waychair.types import Goal, Place, Pose2, RgbdFrame, Scan, SonarReadings


def through_ros(tape: Tape, place: Place) -> Tape:
    """Return the pilot's tape as the node would have heard it, on a map with this place."""
    layout, track = MapLayout({place.name: place}, ()), OdometryTrack()
    return replace(tape, ticks=tuple(_heard(taped, moment, layout, track) for taped, moment in tape.moments()))


def over_the_wire(message: Any) -> Any:
    """Return a message from its bytes."""
    return wire.deserialised(wire.serialised(message), message.__msgtype__)


def _heard(taped: TapedTick, moment: Moment, layout: MapLayout, track: OdometryTrack) -> TapedTick:
    tick = _reported(moment.tick)
    if tick.located is not None:
        tick = _located(tick, tick.located, track)
    heard = tuple(message for sent in moment.heard for message in _sensed(sent))
    told = tuple(replace(each, goals=tuple(_goal(goal, tick, layout) for goal in each.goals)) for each in taped.told)
    return replace(taped, told=told, moment=encoded(Moment(tick, heard)))


def _reported(tick: Tick) -> Tick:
    """Return the tick with the verdict and the command of the bridge's report; it tells no halt and no share of speed."""
    command = tick.command if tick.sent.active else None
    sent = chair.DriveReport(
        tick.stamp_ns, 1, tick.mode, tick.reason, drops_goal=tick.drops_goal, ready=True, command=command
    )
    came = chair.read_drive_state(over_the_wire(chair.drive_state(sent)))
    return replace(
        tick, mode=came.mode, reason=came.reason, drops_goal=came.drops_goal, halt=None, share=1.0, command=came.command
    )


def _located(tick: Tick, located: LoggedLocalisation, track: OdometryTrack) -> Tick:
    """Return the tick with the pose that localisation and odometry give."""
    found = localisation_at(located, tick.map_from_base)
    _, came, _ = chair.read_localisation_on_floor(over_the_wire(chair.localisation(tick.stamp_ns, found)))
    odom_from_base = located.map_from_odom.inverse() @ tick.map_from_base
    sent = ros_messages.odometry(tick.stamp_ns, ros_messages.ODOM_FRAME, odom_from_base, tick.twist)
    track.take(motion.read_odometry(over_the_wire(sent)))
    here = track.odom_from_base(tick.stamp_ns)
    assert here is not None
    logged = LoggedLocalisation(
        state=came.state.value,
        health=came.health,
        inliers=came.inliers,
        map_from_odom=came.map_from_odom,
        remaining=came.remaining,
        jumped=came.jumped,
    )
    return replace(tick, located=logged, map_from_base=came.map_from_odom @ here, twist=track.twist)


def _sensed(message: ChairMessage) -> Iterator[ChairMessage]:
    """Yield the scan, the readings of all sonars, or the picture that a message becomes."""
    if isinstance(message, Scan):
        yield sensors.read_scan(over_the_wire(ros_messages.laser_scan(message)))
    elif isinstance(message, SonarReadings):
        ring = sensors.SonarRing(len(message.ranges))
        for k, distance in enumerate(message.ranges.tolist()):
            readings = ring.hear(k, over_the_wire(ros_messages.sonar_range(message.stamp_ns, k, distance)))
            if readings is not None:
                yield readings
    elif isinstance(message, RgbdFrame):
        parts = (ros_messages.colour_image, ros_messages.depth_image, ros_messages.camera_info)
        yield read_rgbd(*(over_the_wire(part(message)) for part in parts))


def _goal(goal: Goal, tick: Tick, layout: MapLayout) -> Goal:
    assert isinstance(goal.target, Pose2)
    return layout.goal_at(motion.read_pose_stamped(over_the_wire(motion.pose_stamped(tick.stamp_ns, goal.target))))
