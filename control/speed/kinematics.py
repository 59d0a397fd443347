"""Kinematics of a differential drive: the base's twist and the ground speeds of its two drive wheels.

The base frame's origin lies in the middle of the drive axle, so v is the mean of the wheel speeds and omega their
difference over the track (Siegwart et al., Introduction to Autonomous Mobile Robots, section 3.2).
"""

from __future__ import annotations

from waychair.types import Twist, WheelSpeeds


def wheel_speeds_from_twist(twist: Twist, track: float) -> WheelSpeeds:
    """Return the wheel speeds [m/s] of a twist [m/s, rad/s] with drive wheels `track` [m] apart."""
    half = 0.5 * twist.omega * track
    return WheelSpeeds(twist.v - half, twist.v + half)


def twist_from_wheel_speeds(speeds: WheelSpeeds, track: float) -> Twist:
    """Return the twist [m/s, rad/s] of a base with drive wheels `track` [m] apart."""
    return Twist(0.5 * (speeds.left + speeds.right), (speeds.right - speeds.left) / track)


def saturate(speeds: WheelSpeeds, limit: float) -> WheelSpeeds:
    """Return the wheel speeds of the same arc, scaled together to at most `limit` [m/s] on either wheel."""
    fastest = max(abs(speeds.left), abs(speeds.right))
    if fastest <= limit:
        return speeds
    scale = limit / fastest
    return WheelSpeeds(speeds.left * scale, speeds.right * scale)
