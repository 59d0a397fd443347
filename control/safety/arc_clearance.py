"""Clearance along an arc: the time until the chair's grown outline meets points, and the share of a speed that leaves room to
stop.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.calibration.fits.stopping import StopTable
from waychair.config import Settings, given, setting
from waychair.control.safety.arc_entry import entry_times, may_enter
from waychair.planning.body.clearance import (
    CRAWL_SPEED,
    FULL_SPEED,
    MONITORED_AHEAD_AT_CRAWL,
    MONITORED_AHEAD_AT_FULL_SPEED,
    MONITORED_AT_CRAWL,
    MONITORED_AT_FULL_SPEED,
)
from waychair.planning.body.personal_space import LegClearanceSettings
from waychair.types import BoolArray, FloatArray, Twist

LEAST_POINTS = 3
"""Fewest points of an obstacle; fewer are noise."""

BESIDE_HAND = 0.01
"""m beside a chair that a hand drives, by a lidar's noise more than nothing."""

SLOWING, SLOWING_ALPHA = 0.6, 0.8
"""m/s^2, rad/s^2; braking in comfort, by which the chair begins to slow down."""


@dataclass(frozen=True, slots=True)
class MonitorSettings(Settings):
    """The chair's emergency braking before its stops were measured, and the extra clearance to legs.

    `emergency` [m/s^2] and `emergency_alpha` [rad/s^2] are the decelerations assumed without measured stops.
    """

    reaction_s: float = setting(
        0.3,
        "s",
        "time from a verdict to the first braking, without measured stops; larger: the chair brakes earlier",
        low=0.0,
        high=2.0,
    )
    emergency: float = given(1.5)
    emergency_alpha: float = given(1.5)
    legs: LegClearanceSettings = field(default_factory=LegClearanceSettings)


def permitted_along(
    points: FloatArray,
    slim: BoolArray,
    command: Twist,
    body: ChairBody,
    settings: MonitorSettings,
    stops: StopTable | None = None,
    *,
    gave_way: bool = False,
) -> tuple[float, float]:
    """Return the share of a command that points (N, 2) [m] in base permit, 0 to stop, and its contact time [s].

    `slim` (N,) marks those that may be legs. The share is at most that of a crawl if the chair `gave_way`.
    """
    share, contact_s = _comfortable(points, slim, command, body, settings, gave_way, 0.0)
    if share < 1.0 and contact_s < stop_seconds(command, settings, stops):  # with the clearance of a crawl
        return 0.0, contact_s
    return share, contact_s


def stoppable_along(
    points: FloatArray,
    slim: BoolArray,
    push: Twist,
    body: ChairBody,
    settings: MonitorSettings,
    stops: StopTable | None = None,
    *,
    gave_way: bool = False,
    scanned: bool = False,
) -> float:
    """Return the share of a push, a twist that is not driven yet, from which the chair stops in comfort before points (N, 2)
    [m] in base, and in any case by its measured stops; 0 where not even a crawl can be stopped.

    A hand does not hold its line as the computer does: beside it, `BESIDE_HAND` is kept at any speed. The points of a scan
    (`scanned`) are exact to the centimetre, so that way and turn of a stop count apart; those of a map or a camera may be
    half a cell or an error of the pose nearer, and the longer stop of any part of the chair counts.
    """
    braking_s = settings.reaction_s + _half_braking_s(push)
    later_s = max(braking_s, stop_seconds(push, settings, stops), stop_seconds(push, settings, stops, apart=True))
    share, contact_s = _comfortable(points, slim, push, body, settings, gave_way, BESIDE_HAND, later_s + _LATER_S)
    for _ in range(_HALVINGS):
        slower = Twist(share * push.v, share * push.omega)
        if share >= 1.0 or contact_s >= share * stop_seconds(slower, settings, stops, apart=scanned):
            return share
        share /= 2.0
    return 0.0


_LATER_S = 0.1
"""s; a contact so long after the longest stop permits a whole push."""

_HALVINGS = 6
"""Halvings of a share before it counts as none."""


def _comfortable(
    points: FloatArray,
    slim: BoolArray,
    command: Twist,
    body: ChairBody,
    settings: MonitorSettings,
    gave_way: bool,
    least_beside: float,
    within_s: float = math.inf,
) -> tuple[float, float]:
    """Return the share of a command that stops in comfort, and the contact time [s] of the whole command.

    Contacts after `within_s` [s] may count as none.
    """
    near = _may_touch(points, slim, command, body, settings.legs, least_beside, within_s)
    points, slim = points[near], slim[near]
    considered = judged_shares(command, body).tolist()
    considered = considered[-1:] if gave_way else considered

    def contact_at(pace: float) -> float:
        return _contact_s(points, slim, command, body, settings.legs, pace, gave_way, least_beside)

    whole_s = contact_at(considered[0])
    share = min(considered[0], slow_share(whole_s, command, settings))
    if share >= 1.0 or len(considered) == 1:
        return share, whole_s
    contact_s = contact_at(considered[-1])
    share = max(share, min(considered[-1], slow_share(contact_s, command, settings)))
    for pace in considered[1:-1]:
        if share >= pace:  # a slower pace permits no more than itself
            break
        share = max(share, min(pace, slow_share(contact_at(pace), command, settings)))
    return share, contact_s


def _may_touch(
    points: FloatArray,
    slim: BoolArray,
    command: Twist,
    body: ChairBody,
    legs: LegClearanceSettings,
    least_beside: float,
    within_s: float,
) -> BoolArray:
    """Return a mask (N,) of the points that the footprint may touch in time, grown by the most that `contact_times` does."""
    beside, more = margins(command, body)
    if slim.any():
        more = max(more, legs.ahead, legs.ahead_after, legs.beside, legs.beside_after, legs.turning)
    grown = max(beside, least_beside) + more
    return may_enter(points, command, body.front + grown, body.rear + grown, body.width / 2 + grown, within_s)


def _contact_s(
    points: FloatArray,
    slim: BoolArray,
    command: Twist,
    body: ChairBody,
    legs: LegClearanceSettings,
    pace: float,
    gave_way: bool,
    least_beside: float,
) -> float:
    """Return the driving time [s] until contact with enough points to be an obstacle."""
    if len(points) < LEAST_POINTS:
        return math.inf
    times = contact_times(points, slim, command, body, legs, pace=pace, gave_way=gave_way, least_beside=least_beside)
    return float(np.partition(times, LEAST_POINTS - 1)[LEAST_POINTS - 1])


def judged_shares(command: Twist, body: ChairBody) -> FloatArray:
    """Return the shares of a command to judge it at, from the whole command down to a crawl, evenly spaced."""
    slowest = min(1.0, CRAWL_SPEED / max(fastest_part(command, body), 1e-9))
    return np.linspace(1.0, slowest, _PACES) if slowest < 1.0 else np.ones(1)


_PACES = 4
"""Number of such shares; a command at a crawl has one."""


def margins(command: Twist, body: ChairBody, pace: float = 1.0) -> tuple[float, float]:
    """Return the clearance [m] on all sides, and the extra one in the direction of travel, at a share of a command."""
    share = min(max((pace * fastest_part(command, body) - CRAWL_SPEED) / (FULL_SPEED - CRAWL_SPEED), 0.0), 1.0)
    return (
        MONITORED_AT_CRAWL + share * (MONITORED_AT_FULL_SPEED - MONITORED_AT_CRAWL),
        MONITORED_AHEAD_AT_CRAWL + share * (MONITORED_AHEAD_AT_FULL_SPEED - MONITORED_AHEAD_AT_CRAWL),
    )


def fastest_part(command: Twist, body: ChairBody) -> float:
    """Return the larger of the driving speed and the farthest corner's speed in turning [m/s]."""
    return max(abs(command.v), abs(command.omega) * body.circumscribed_radius)


def contact_times(
    points: FloatArray,
    legs: BoolArray,
    command: Twist,
    body: ChairBody,
    leg_clearance: LegClearanceSettings,
    *,
    pace: float = 1.0,
    gave_way: bool = False,
    least_beside: float = 0.0,
) -> FloatArray:
    """Return the driving times (N,) [s] until contact of a command's arc with points (N, 2) [m] in base; +inf if never.

    The footprint is grown by the `margins` of a share `pace` of the command's speed, by `least_beside` [m] at least, and by
    more for points of `legs` (N,), less once the chair `gave_way`; the time is that of the whole command. A point already
    within the grown footprint is in contact now if it comes nearer by more than a centimetre in the next second, beside a
    hand-driven chair (`least_beside`) by more than half of the gap that is left; driving along it or away from it is free; a
    point straight before the chair is not beside it, however near to its side's line.
    A point well within the footprint itself is in contact at once for any command that moves the chair.
    """
    s, x, y = leg_clearance, points[:, 0], points[:, 1]
    beside, besides_ahead = margins(command, body, pace)
    beside = max(beside, least_beside)
    to_come = legs & ((x > body.front) | (x < -body.rear))
    beside_legs, ahead_of_legs = (s.beside_after, s.ahead_after) if gave_way else (s.beside, s.ahead)
    # a corner that swings faster than the chair drives approaches people beside the chair
    swings = abs(command.omega) * body.circumscribed_radius > abs(command.v)
    around = beside + np.where(legs & swings, s.turning, 0.0)
    half = body.width / 2 + np.maximum(around, beside + np.where(to_come, beside_legs, 0.0))
    ahead = beside + np.where(legs, max(besides_ahead, ahead_of_legs), besides_ahead)
    front = body.front + np.maximum(around, ahead if command.v > 0.0 else 0.0)
    rear = body.rear + np.maximum(around, ahead if command.v < 0.0 else 0.0)
    # move the side nearest to a point inwards until the point lies a centimetre outside
    off = np.abs(y)
    to_front, to_rear, to_side = front - x, rear + x, half - off
    straight = off < body.width / 2
    before, behind = straight & (x > body.front), straight & (x < -body.rear)
    at_front = before | (~behind & (to_front <= to_rear) & (to_front <= to_side))
    at_rear = ~at_front & (behind | (to_rear <= to_side))
    at_side = ~(at_front | at_rear)
    closer: FloatArray | float = _CLOSER
    if least_beside > 0.0:
        closer = np.where(at_side, np.clip(0.5 * (off - body.width / 2), _LEAST_CLOSER, _CLOSER), _CLOSER)
    moved = ((front, to_front, at_front), (rear, to_rear, at_rear), (half, to_side, at_side))
    sides = (side - np.where(here, np.maximum(gap + closer, 0.0), 0.0) for side, gap, here in moved)
    times = entry_times(x, y, command, *sides)
    within = np.minimum(np.minimum(to_front, to_rear), to_side)
    times = np.where((within > 0.0) & (times < _SOON), 0.0, times)
    deep = np.minimum(np.minimum(body.front - x, body.rear + x), body.width / 2 - off) > _DEEP
    moves = abs(command.v) > 0.0 or abs(command.omega) > 0.0
    return np.where(deep & moves, 0.0, times)


_CLOSER = 0.01
"""m; a point within the zone counts when it comes nearer by more than a lidar's noise and one step of the chair."""

_LEAST_CLOSER = 0.002
"""m; beside a hand-driven chair a nearer point counts when it comes nearer by half of the gap that is left, or by so much at least."""

_SOON = 1.0
"""s; it counts when it does so within this time, so that the chair cannot creep up to it in small steps."""

_DEEP = 0.05
"""m; a point so far inside the footprint is no noise at its edge."""


def stop_seconds(
    command: Twist, settings: MonitorSettings, stops: StopTable | None = None, *, apart: bool = False
) -> float:
    """Return the driving time [s] at full speed over the distance of an emergency stop.

    Braking both speeds in proportion keeps the arc, and its distance is half the braking time at full speed. A measured
    stop counts where it is longer than the one reckoned from the settings; with `apart` by its way and its turn, each along the
    arc, instead of the way of the farthest part of the chair.
    """
    v, omega = abs(command.v), abs(command.omega)
    reckoned = settings.reaction_s + 0.5 * max(v / settings.emergency, omega / settings.emergency_alpha)
    if stops is None:
        return reckoned
    fastest = stops.speeds[-1]
    known = min(max(v, 1e-6), fastest)
    way = stops.way if apart else stops.distance
    straight = way(known) / known * max(1.0, v / fastest) if v > 0.0 else 0.0
    turning = (
        stops.turn_angle / stops.turn_rate * max(1.0, omega / stops.turn_rate) if omega and stops.turn_rate else 0.0
    )
    return max(reckoned, straight, turning)


def slow_share(contact_s: float, command: Twist, settings: MonitorSettings) -> float:
    """Return the share of a command at which the chair stops comfortably before a contact after `contact_s` [s].

    At a share k the stop covers k reaction + k^2 T of the command's driving time, T being half the braking time. The
    greatest allowed k makes that equal to contact_s.
    """
    half = _half_braking_s(command)
    if math.isinf(contact_s) or half == 0.0:
        return 1.0
    reaction = settings.reaction_s
    return min(1.0, (math.sqrt(reaction * reaction + 4.0 * half * contact_s) - reaction) / (2.0 * half))


def _half_braking_s(command: Twist) -> float:
    """Return half the time [s] of braking in comfort from a command."""
    return 0.5 * max(abs(command.v) / SLOWING, abs(command.omega) / SLOWING_ALPHA)
