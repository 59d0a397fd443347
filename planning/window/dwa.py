"""The dynamic window approach: the next (v, omega), chosen among arcs that the chair can reach and can stop on.

Fox, Burgard and Thrun, "The Dynamic Window Approach to Collision Avoidance", IEEE Robotics & Automation Magazine 4(1),
1997; Eqs. (8)-(11) of the source paper (intelligent wheelchair, D* Lite and DWA), with these differences:

- The window is centred on the last *command*, never on the measured speed: a drive with a dead band ignores small
  commands, and a window around its standstill would offer nothing but these.
- Eq. (10) bounds omega by sqrt(2 dist brake) with dist in metres; the units only agree with the *angle* left to turn.
  Both bounds together are one condition on time: the chair brakes v and omega in proportion, stays on its arc and
  needs half the longer braking time at full speed, so the arc must be free for that long.
- eta of Eq. (11) is 0/0 where a term vanishes for all candidates; the critics here have fixed scales (`critics`).

`paper_dwa` has the equations as printed.

A candidate is a target speed. The command is the first control period towards it, and a stop from that command must
be free, too. Hence, in a static world, a full stop from any commanded speed touches nothing. Jerk is limited on the way
to a candidate (`CommandedMotion`) and in voluntary stops. Where limited jerk would leave no room for a full stop, and
where nothing else is left, the chair brakes at once: safety comes before comfort.

Moving people are predicted with constant velocity (`tracks`): no arc may meet one before the chair could stand.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.geometry import rotation, wrap_angle
from waychair.maps.grid.distance_field import DistanceField
from waychair.planning.body.clearance import EASE_STEP
from waychair.planning.body.footprint import (
    Footprint,
    along_arc,
    eased_footprint,
    footprint,
    free_time,
    in_cells,
    poses_in_cells,
    side_clearance,
)
from waychair.planning.body.personal_space import NO_TURNING_SPEED, NO_TURNING_WITHIN, STANDING_BEFORE_S
from waychair.planning.window.critics import ArcMeasures, weighted_score
from waychair.planning.window.dwa_kernels import (
    SPACING,
    first_free,
    fits_after,
    local_section,
    measure,
    meetings_with_people,
)
from waychair.planning.window.motion_limits import (
    MIN_OMEGA,
    MIN_SPEED,
    PERIOD,
    STANDING_OMEGA,
    STANDING_V,
    CommandedMotion,
    DwaSettings,
    braking,
    braking_hard,
    change_within,
    crawling,
    slowing_speed,
    standing,
    stop_time,
    stopping,
    towards_each,
)
from waychair.types import BoolArray, FloatArray, Path, Pose2, Twist

if TYPE_CHECKING:
    from waychair.planning.seen.person_tracks import Track

DEFAULTS = DwaSettings()
"""The limits for a chair with a rider, unless others are given."""

_LEAVING = 2.5
"""Where clearance is far too small, an admissible arc reaches a place with more within this time [s]."""

_NEAR_END = 1.5
"""On the last stretch [m] of a path, clearance beyond that at its end is worth nothing."""

_FAR = 2.0
"""Cap [m] of the progress scale: fast chairs weigh progress against the path as slow ones do."""

_LET_GO = 1e-6
"""A command within this [m/s] of standstill counts as standstill."""

V_SAMPLES, OMEGA_SAMPLES = 21, 31
"""Numbers of speeds and turning speeds tried; more find better arcs and take more time."""

WINDOW_TIME = 1.0
"""[s] The window holds all speeds that the chair can reach within this time."""

HORIZON = 2.5
"""[s] Duration of the arcs: long enough to stop from full speed."""

TURN_FIRST = 1.1
"""[rad] Where the path's direction differs by more from the heading, the chair turns on the spot first."""


@dataclass(frozen=True, slots=True)
class DwaResult:
    """The command, and why: candidates (N, 2) [m/s, rad/s], scores (N,) (-inf: not admissible).

    `in_position`: at the goal, except for the heading. `blocked`: no motion is possible; the twist brakes along the
    present arc and then stands. `arrived`: at the goal, in position and heading, standing still. `arc` (M, 3)
    [m, m, rad] is the chosen candidate's path, in the frame of the pose.
    """

    twist: Twist
    candidates: FloatArray
    scores: FloatArray
    arc: FloatArray
    blocked: bool = False
    arrived: bool = False
    in_position: bool = False


def choose(
    pose: Pose2,
    command: Twist,
    path: Path,
    distances: DistanceField,
    body: ChairBody,
    settings: DwaSettings = DEFAULTS,
    in_position: bool = False,
    motion: CommandedMotion | None = None,
    tracks: Sequence[Track] = (),
    fastest: float = math.inf,
) -> DwaResult:
    """Return the next command on a path.

    Pose (of the base, now), path, distances and tracks are in one frame without jumps.
    command: the last one sent. path: its last pose is the goal. distances: around the chair; anything outside counts as
    occupied. in_position: as in the last result; turning at the goal may then drift a little without being given up.
    motion: `motion_after` the last command; without it, jerk is not limited. tracks: as of the latest scan.
    fastest [m/s]: upper bound of the speed, for slowing down before the next leg.
    """
    shape, ease = eased_footprint(body, settings.clearance, distances, pose)
    settings = crawling(settings, settings.clearance - ease) if ease else settings
    now = _Tick(pose, command, shape, distances, settings, motion, tracks)
    ahead = now.ahead
    section, remaining = local_section(path.poses, ahead.array(), settings.max_speed * HORIZON + 0.5)

    tolerance = settings.tolerances.release if in_position else settings.tolerances.position
    if math.hypot(path.poses[-1, 0] - ahead.x, path.poses[-1, 1] - ahead.y) <= tolerance:
        return replace(_unless_meeting(now, _rotate(now, float(path.poses[-1, 2]))), in_position=True)
    off_path = wrap_angle(float(section[min(10, len(section) - 1), 2]) - ahead.theta)
    if abs(off_path) > TURN_FIRST and remaining > settings.tolerances.position:
        turn = _unless_meeting(now, _rotate(now, ahead.theta + off_path))
        if not turn.blocked:
            return turn

    fastest = min(fastest, slowing_speed(remaining, 0.0, settings))
    candidates = _window(command, max(fastest, MIN_SPEED), body, settings, motion)
    measures = _with_people(now, _measures(now, candidates, section))
    if motion is not None:
        measures = replace(measures, reversal=(candidates[:, 0] * motion.direction < 0).astype(np.float64))
    if ease > settings.clearance:  # the outline itself may be too near: admit arcs to more clearance only
        roomier = footprint(body, settings.clearance - ease + EASE_STEP, distances)
        reaches = fits_after(roomier, now.start, candidates, np.minimum(_LEAVING, measures.free_time))
        measures = replace(measures, admissible=measures.admissible & reaches)
    longest = min(settings.max_speed * HORIZON, _FAR)
    scores = weighted_score(measures, settings.people_weight, longest, settings.max_speed)
    scores = np.where(measures.admissible, scores, -np.inf)
    best = _best(now, candidates, scores)
    if best.blocked and _meets_somebody(now):
        return replace(best, twist=braking_hard(command, settings))
    return best


def rotate_to_heading(
    pose: Pose2,
    command: Twist,
    heading: float,
    distances: DistanceField,
    body: ChairBody,
    settings: DwaSettings = DEFAULTS,
    motion: CommandedMotion | None = None,
) -> DwaResult:
    """Turn on the spot to a heading [rad] in the pose's frame: in the shorter direction if it is free, else the longer.

    The whole sweep of the footprint is checked before the turn begins and at every call. `arrived` when the heading is
    reached and the chair stands; `blocked` when neither direction is free. With a `motion`, a chair that still drives
    first stops with limited jerk.
    """
    shape = footprint(body, settings.clearance, distances)
    return _rotate(_Tick(pose, command, shape, distances, settings, motion), heading)


class _Tick:
    """The input of one choice: pose and last command, the body on the distances, limits, and people.

    `ahead` is the pose after the reaction time, and `start` the same on the distances' cells: a command moves the chair
    only then, and until then the last one does.
    """

    def __init__(
        self,
        pose: Pose2,
        command: Twist,
        shape: Footprint,
        distances: DistanceField,
        settings: DwaSettings,
        motion: CommandedMotion | None,
        tracks: Sequence[Track] = (),
    ) -> None:
        self.pose, self.command, self.shape, self.distances = pose, command, shape, distances
        self.settings, self.motion, self.tracks = settings, motion, tracks
        arc = along_arc(pose.x, pose.y, pose.theta, command.v, command.omega, settings.reaction_time)
        self.ahead = Pose2(*arc)
        self.start = in_cells(distances, self.ahead)


def _time_needed(candidates: FloatArray, settings: DwaSettings) -> FloatArray:
    """Return (N,) Eq. (10) as a time [s] at full speed: a period and half the braking time, or the measured stop.

    A turn's stopping angle grows with the square of its rate once the brakes act; the part before belongs to the
    reaction time.
    """
    v, omega = np.abs(candidates).T
    needed: FloatArray = np.maximum(v / settings.braking, omega / settings.alpha) / 2
    if settings.stops is not None:
        table = settings.stops
        ways = np.interp(v, (0.0, *table.speeds), (0.0, *table.distances))
        needed = np.maximum(needed, ways / np.maximum(v, STANDING_V))
        if table.turn_rate:
            turned = max(table.turn_angle - table.delay_s * table.turn_rate, 0.0)
            needed = np.maximum(needed, turned * omega / table.turn_rate**2)
    return PERIOD + needed


def _can_stop(now: _Tick, twist: Twist) -> bool:
    """Return whether one period at this speed and the stop after it stay free (Eq. (10))."""
    twists = np.array([[twist.v, twist.omega]])
    return bool(first_free(now.shape, now.start, twists, _time_needed(twists, now.settings)) == 0)


def _window(
    command: Twist, fastest: float, body: ChairBody, settings: DwaSettings, motion: CommandedMotion | None
) -> FloatArray:
    """Return (N, 2) candidates around the command, 0 among them: Eqs. (8), (9), limits of wheel speed and lateral a.

    With a motion, Eq. (9) is of third order: the acceleration changes by the jerk.
    """
    time = WINDOW_TIME
    a, alpha = (None, None) if motion is None else (motion.acceleration.v, motion.acceleration.omega)
    faster = settings.acceleration if command.v >= 0 else settings.braking
    slower = settings.braking if command.v >= 0 else settings.acceleration
    v_high = min(settings.max_speed, fastest, command.v + change_within(a, 1.0, faster, settings.jerk, time))
    v_low = max(-settings.max_reverse, command.v - change_within(a, -1.0, slower, settings.jerk, time))
    more, less = (change_within(alpha, sign, settings.alpha, settings.alpha_jerk, time) for sign in (1.0, -1.0))
    omega_high = min(settings.max_omega, command.omega + more)
    omega_low = max(-settings.max_omega, command.omega - less)
    v = _samples(min(v_low, v_high), max(v_low, v_high), V_SAMPLES)
    v = np.where(v == 0.0, 0.0, np.copysign(np.maximum(np.abs(v), MIN_SPEED), v))
    omega = _samples(min(omega_low, omega_high), max(omega_low, omega_high), OMEGA_SAMPLES)
    # candidates of one turning speed in a row: `arc_fan` is fastest so
    pairs = np.stack(np.meshgrid(v, omega), axis=-1).reshape(-1, 2)
    # no turns on the spot within the drive's dead band
    pairs = pairs[(pairs[:, 0] != 0.0) | (pairs[:, 1] == 0.0) | (np.abs(pairs[:, 1]) >= MIN_OMEGA)]
    wheels = np.abs(pairs[:, 0]) + np.abs(pairs[:, 1]) * body.track / 2
    possible = (wheels <= settings.max_wheel_speed) & (np.abs(pairs[:, 0] * pairs[:, 1]) <= settings.max_lateral)
    # A command beyond the limits (lowered since) leaves no candidate: brake.
    return np.ascontiguousarray(pairs[possible]) if possible.any() else np.zeros((1, 2))


def _samples(low: float, high: float, count: int) -> FloatArray:
    """Return evenly spaced values; a 0 among or between them is hit exactly, so standing and straight on are tried."""
    values = np.linspace(low, high, count)
    if low < 0.0 < high:
        values[np.argmin(np.abs(values))] = 0.0
    return values


def _measures(now: _Tick, candidates: FloatArray, section: FloatArray) -> ArcMeasures:
    """Roll out every candidate and measure it against the path and the obstacles."""
    shape, settings, local = now.shape, now.settings, poses_in_cells(now.distances, section)
    needed = np.minimum(_time_needed(candidates, settings), HORIZON)
    rows = measure(shape, now.start, candidates, local, needed, HORIZON)
    admissible: BoolArray = rows[:, 0] >= needed
    end_is_near = (len(section) - 1) * SPACING <= _NEAR_END
    x, y, theta = local[-1].tolist()
    change = np.abs(candidates - (now.command.v, now.command.omega)) / (settings.max_speed, settings.max_omega)
    return ArcMeasures(
        candidates=candidates,
        admissible=admissible,
        free_time=rows[:, 0],
        clearance=rows[:, 1],
        path_error=rows[:, 2],
        heading_error=rows[:, 3],
        progress=rows[:, 4],
        target_distance=rows[:, 5],
        change=change.mean(axis=1),
        people_gap=np.full(len(candidates), math.inf),
        reversal=np.zeros(len(candidates)),
        end_clearance=float(side_clearance(shape, x, y, math.cos(theta), math.sin(theta))) if end_is_near else math.inf,
    )


def _with_people(now: _Tick, measures: ArcMeasures) -> ArcMeasures:
    """Return the measures with people: arcs that meet a predicted person before the chair stands are inadmissible.

    Standing is always admissible: a standing chair runs into nobody. So is an arc on which the chair can stop if it
    would be met later there, and comes no nearer to anybody, than standing still. Turns on the spot in front of
    somebody approaching are inadmissible: they block one side after the other, and neither gets past.
    """
    if not now.tracks:
        return measures
    spares, gaps = _avoid_people(now, measures.candidates)
    here = (now.ahead.x, now.ahead.y)
    if any(t.speed > NO_TURNING_SPEED and math.dist(t.position, here) < NO_TURNING_WITHIN for t in now.tracks):
        spares &= (measures.candidates[:, 0] != 0.0) | (measures.candidates[:, 1] == 0.0)
    return replace(measures, admissible=measures.admissible & spares, people_gap=gaps)


def _unless_meeting(now: _Tick, turn: DwaResult) -> DwaResult:
    """Return the turn on the spot, or a stop if a corner of the chair would meet a predicted person."""
    tried = np.array([[turn.twist.v, turn.twist.omega]])
    if not now.tracks or standing(turn.twist) or _avoid_people(now, tried)[0][0]:
        return turn
    return replace(turn, twist=braking(now.command, now.settings), blocked=True)


def _avoid_people(now: _Tick, candidates: FloatArray) -> tuple[BoolArray, FloatArray]:
    """Return (N,) whether candidates meet nobody too soon, and (N,) their least gaps [m]; see `_with_people`."""
    needed = np.minimum(_time_needed(candidates, now.settings), HORIZON)
    met = _meetings(now, np.concatenate([candidates, np.zeros((1, 2))]))
    met, stood = met[:-1], met[-1]
    stands = (candidates == 0.0).all(axis=1)
    in_time = met[:, 0] > needed + STANDING_BEFORE_S
    better = (met[:, 0] > np.maximum(needed, stood[0])) & (met[:, 1] >= stood[1])
    spares: BoolArray = in_time | stands | better
    return spares, met[:, 1]


def _meets_somebody(now: _Tick) -> bool:
    """Return whether a chair that brakes comfortably would meet somebody before it stands."""
    if not now.tracks or standing(now.command):
        return False
    present = np.array([[now.command.v, now.command.omega]])
    return bool(_meetings(now, present)[0, 0] < stop_time(now.command, now.settings))


def _meetings(now: _Tick, candidates: FloatArray) -> FloatArray:
    """Return (N, 2) when [s] each candidate meets a predicted person, and the least gap [m] (`meetings_with_people`)."""
    people = np.array([track.row(now.settings.reaction_time) for track in now.tracks])
    distances = now.distances
    people[:, :2] = poses_in_cells(distances, np.column_stack([people[:, :2], np.zeros(len(people))]))[:, :2]
    people[:, 2:4] = people[:, 2:4] @ rotation(distances.map_from_grid.theta) / now.shape.cell
    met: FloatArray = meetings_with_people(now.shape, now.start, candidates, people, HORIZON)
    return met


def _best(now: _Tick, candidates: FloatArray, scores: FloatArray) -> DwaResult:
    """Return the best candidate whose first period can stop; braking when there is none."""
    order = np.argsort(-scores, kind="stable")
    order = order[scores[order] > -np.inf]
    twists = towards_each(now.command, candidates[order], now.settings, now.motion)
    first = first_free(now.shape, now.start, twists, _time_needed(twists, now.settings))
    if first == len(order):
        stop = braking(now.command, now.settings)
        return DwaResult(stop, candidates, scores, now.ahead.array()[None], blocked=True)
    twist, candidate = Twist(*twists[first].tolist()), candidates[order[first]]
    stuck = standing(twist) and standing(Twist(*candidate.tolist()))
    return DwaResult(twist, candidates, scores, _arc(now.ahead, candidate, HORIZON), blocked=stuck)


def _arc(start: Pose2, candidate: FloatArray, horizon: float) -> FloatArray:
    """Return (26, 3) poses along a candidate."""
    times = np.linspace(0.0, horizon, 26)
    return np.array([along_arc(start.x, start.y, start.theta, candidate[0], candidate[1], t) for t in times])


def _rotate(now: _Tick, heading: float) -> DwaResult:
    """Brake v, comfortably if there is room, then turn as fast as stopping within the remaining angle allows.

    The turn ends only when the measured heading confirms it. A small turn given up as soon as its command should have
    sufficed would never begin where a dead band or a lag swallows the first part.
    """
    pose, ahead, command, settings = now.pose, now.ahead, now.command, now.settings
    none, here = np.zeros((0, 2)), ahead.array()[None]
    eased = stopping(command, settings, now.motion)
    if abs(command.v) >= STANDING_V or abs(eased.v) > _LET_GO:
        stopped = eased if _can_stop(now, eased) else braking(command, settings)
        return DwaResult(stopped, none, np.zeros(0), here)
    error, seen = wrap_angle(heading - ahead.theta), wrap_angle(heading - pose.theta)
    if abs(error) <= settings.tolerances.heading:
        if abs(seen) > settings.tolerances.heading and command.omega * seen > 0.0:
            error = math.copysign(max(abs(error), MIN_OMEGA**2 / (1.4 * settings.alpha)), seen)
        else:
            there = standing(command)
            return DwaResult(Twist() if there else braking(command, settings), none, np.zeros(0), here, arrived=there)
    for angle in _turning_angles(error, command.omega):
        needed = abs(angle) / settings.max_omega
        if free_time(now.shape, now.start, 0.0, math.copysign(settings.max_omega, angle), needed, needed) < needed:
            continue
        omega = math.copysign(min(settings.max_omega, math.sqrt(1.4 * settings.alpha * abs(angle))), angle)
        step = settings.alpha * PERIOD
        twist = Twist(0.0, min(max(omega, command.omega - step), command.omega + step))
        if _can_stop(now, twist):
            target = np.array([[0.0, omega]])
            return DwaResult(twist, target, np.zeros(1), _arc(ahead, target[0], needed))
    return DwaResult(braking(command, settings), none, np.zeros(0), here, blocked=True)


def _turning_angles(error: float, omega: float) -> tuple[float, float]:
    """Return angles [rad] to turn, the preferred first: the shorter, unless the chair already turns the other way."""
    other = error - math.copysign(math.tau, error)
    turning_back = error * omega < 0 and abs(omega) > STANDING_OMEGA
    return (other, error) if turning_back and abs(error) > 0.8 * math.pi else (error, other)
