"""Differential drive: the twist of the base and the ground speeds of its two drive wheels.

The base frame's origin lies in the middle of the drive axle, so v is the mean of the wheel speeds and omega their
difference over the track (Siegwart et al., Introduction to Autonomous Mobile Robots, section 3.2).
"""

from __future__ import annotations

from waychair.types import Twist, WheelSpeeds


def wheel_speeds_from_twist(twist: Twist, track: float) -> WheelSpeeds:
    """Wheel speeds [m/s] of a twist [m/s, rad/s] of a base whose drive wheels are `track` [m] apart."""
    half = 0.5 * twist.omega * track
    return WheelSpeeds(twist.v - half, twist.v + half)


def twist_from_wheel_speeds(speeds: WheelSpeeds, track: float) -> Twist:
    """Twist [m/s, rad/s] of a base whose drive wheels are `track` [m] apart."""
    return Twist(0.5 * (speeds.left + speeds.right), (speeds.right - speeds.left) / track)


def saturate(speeds: WheelSpeeds, limit: float) -> WheelSpeeds:
    """The same arc no faster than `limit` [m/s] on either wheel: both speeds scaled together, curvature kept."""
    fastest = max(abs(speeds.left), abs(speeds.right))
    if fastest <= limit:
        return speeds
    scale = limit / fastest
    return WheelSpeeds(speeds.left * scale, speeds.right * scale)
