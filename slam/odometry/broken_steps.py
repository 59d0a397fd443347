"""Steps of wheel odometry that no chair drives: a counter that begins anew, a pose that was set, a message that is wild.

Between two readings a chair moves by at most its greatest speed, and about as its own twist says. A step beyond that is
no motion. It is replaced by the motion that scans, twist or the steps around it tell.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from waychair.geometry import arcs, compose, invert, wrap_angles
from waychair.types import BoolArray, FloatArray, IntArray

FASTEST, FASTEST_TURN = 5.0, 6.0
"""Greatest speed [m/s] and turn rate [rad/s] of a step; a chair drives at up to 2.8 m/s and turns at up to 2 rad/s."""

_USUAL = 0.5  # [m/s]; fast steps of a recording that is not in metres stand for so much
_SLACK, _SLACK_TURN = 0.25, 0.35  # [m, rad]; a step may contradict its own twist by so much,
_GROWTH, _GROWTH_TURN = 1.0, 1.5  # [m/s, rad/s]; and by so much more per second
_TWIST_FITS = 0.3  # a twist is used whose median error is below this share of the motion
_NEAR_S = 0.5  # broken steps this near belong together
_NEIGHBOURS = 4  # steps on either side that tell the speed where no twist does
_ON_LINE = 1e-6  # [m, rad]; a reading this near the line between its neighbours was interpolated
_ORIGIN, _ORIGIN_TURN = 0.3, 0.2  # [m, rad]; a counter that begins anew begins this near zero
_LONGEST_S = 1.0  # a chair goes on as before for so long
_QUICK = 2.8  # m/s; speed of the fastest chair
_DRIFT = 0.2  # share of its way by which odometry and scans may differ over a gap
_FEW = 3  # readings before or after a break at either end of the recording that are wild ones
_JITTER_S = 0.2  # stamps of two readings may be nearer than the readings were by so much


class BreakKind(Enum):
    """The kind of a break."""

    MESSAGES = "messages"  # some messages are off, and those after them agree with those before
    RESTART = "restart"  # it begins anew at zero
    JUMP = "jump"


@dataclass(frozen=True, slots=True)
class Break:
    """A place at which odometry is no motion: between two times [s] it is off by `metres` and `radians`; `messages` is
    the number of messages between."""

    kind: BreakKind
    begin_s: float
    end_s: float
    metres: float
    radians: float
    messages: int


@dataclass(frozen=True, slots=True)
class OrderedOdometry:
    """Odometry in the order of the recording: times (N,) [s], poses (N, 3) [m, m, rad], speeds (N, 2) [m/s, rad/s].

    `between` (N,) marks readings that may have been interpolated from their neighbours.
    """

    times: FloatArray
    poses: FloatArray
    speeds: FloatArray
    between: BoolArray


Bridge = Callable[[float, float], FloatArray | None]
"""Returns the motion (3,) between two times [s] by scans, or None."""


def repaired(
    track: OrderedOdometry, bridge: Bridge = lambda begin_s, end_s: None
) -> tuple[OrderedOdometry, tuple[Break, ...]]:
    """Return the track without its broken steps, and the breaks; the same track where there are none."""
    if len(track.times) < 3:
        return track, ()
    corners = _corners(track)
    steps = _Steps.of(track, corners)
    broken = steps.broken()
    for gap in np.flatnonzero(broken & (steps.seconds > _LONGEST_S)).tolist():
        broken[gap] = _is_broken_gap(steps, gap, track.poses[corners[gap + 1]], bridge)
    if not broken.any():
        return track, ()
    motions = steps.motions.copy()
    for k in np.flatnonzero(broken):
        measured = bridge(float(steps.times[k]), float(steps.times[k + 1]))
        motions[k] = steps.expected[k] if measured is None else measured
    poses = _rebuilt(track, corners, motions, broken)
    return OrderedOdometry(track.times, poses, track.speeds, track.between), _breaks(
        track, corners, steps, broken, poses
    )


def _is_broken_gap(steps: _Steps, k: int, end: FloatArray, bridge: Bridge) -> bool:
    """Return whether the step over a gap of the readings is no motion: a chair may have driven anywhere meanwhile.

    The scans tell, where there are any; elsewhere a step is broken that is too far, or ends at zero.
    """
    motion, s, unit = steps.motions[k], float(steps.seconds[k]), steps.unit
    measured = bridge(float(steps.times[k]), float(steps.times[k + 1]))
    if measured is not None:
        gap = compose(invert(measured), motion)
        way = math.hypot(measured[0], measured[1])
        return bool(math.hypot(gap[0], gap[1]) > unit * (_SLACK + _DRIFT * way) or abs(gap[2]) > _SLACK_TURN)
    way = math.hypot(motion[0], motion[1])
    return way > unit * _QUICK * s + _SLACK or (way > unit and _is_origin(end, unit))


def _is_origin(pose: FloatArray, unit: float) -> bool:
    return math.hypot(pose[0], pose[1]) < _ORIGIN * unit and abs(pose[2]) < _ORIGIN_TURN


def _corners(track: OrderedOdometry) -> IntArray:
    """Return the indices of the readings that were not interpolated between their neighbours."""
    t, p = track.times, track.poses
    whole = t[2:] - t[:-2]
    with np.errstate(divide="ignore", invalid="ignore"):
        part = np.where(whole > 0.0, (t[1:-1] - t[:-2]) / whole, 0.0)[:, None]
    step, passed = p[2:] - p[:-2], p[1:-1] - p[:-2]
    step[:, 2], passed[:, 2] = wrap_angles(step[:, 2]), wrap_angles(passed[:, 2])
    off = np.abs(passed - part * step)
    off[:, 2] = np.abs(wrap_angles(off[:, 2]))
    scale = 1.0 + np.abs(step[:, :2]).max(axis=1)
    keep = np.ones(len(t), np.bool_)
    keep[1:-1] = ~track.between[1:-1] | (off.max(axis=1) > _ON_LINE * scale)
    return np.flatnonzero(keep)


@dataclass(frozen=True, slots=True)
class _Steps:
    """Steps (N) between the corners: times (N + 1,) [s], seconds (N,), motions and expected motions (N, 3)."""

    times: FloatArray
    seconds: FloatArray
    motions: FloatArray
    expected: FloatArray
    unit: float

    @staticmethod
    def of(track: OrderedOdometry, corners: IntArray) -> _Steps:
        times, poses, speeds = track.times[corners], track.poses[corners], track.speeds[corners]
        seconds = np.maximum(np.diff(times), max(1e-3, 0.5 * float(np.median(np.diff(times)))))
        motions = compose(invert(poses[:-1]), poses[1:])
        told = 0.5 * (speeds[:-1] + speeds[1:])
        way = np.hypot(motions[:, 0], motions[:, 1])
        moving = way / seconds > 0.02
        quick = float(np.quantile((way / seconds)[moving], 0.75)) if moving.any() else 0.0
        fits = _fits(told[:, 0] * seconds, motions[:, 0], 0.01 * seconds) and _fits(
            told[:, 1] * seconds, motions[:, 2], 0.02 * seconds
        )
        rates = told if fits else _neighbouring(motions, seconds)
        lasting = np.minimum(seconds, _LONGEST_S)
        expected = arcs(rates[:, 0] * lasting, rates[:, 1] * lasting)
        return _Steps(times, seconds, motions, expected, quick / _USUAL if quick > FASTEST else 1.0)

    def broken(self) -> BoolArray:
        """Return which steps (N,) are no motion of a chair."""
        way = np.hypot(self.motions[:, 0], self.motions[:, 1])
        off = np.hypot(*(self.motions[:, :2] - self.expected[:, :2]).T)
        turn = np.abs(self.motions[:, 2])
        off_turn = np.abs(wrap_angles(self.motions[:, 2] - self.expected[:, 2]))
        s = np.maximum(self.seconds, _JITTER_S)
        far: BoolArray = (way > self.unit * FASTEST * s + 0.05) | (off > self.unit * (_SLACK + _GROWTH * s))
        spun: BoolArray = (turn > FASTEST_TURN * s + 0.1) | (off_turn > _SLACK_TURN + _GROWTH_TURN * s)
        return far | spun


def _fits(told: FloatArray, moved: FloatArray, least: FloatArray) -> bool:
    """Return whether told motions (N,) agree with the motions (N,) of the poses in most steps that move."""
    moving = (np.abs(moved) > least) | (np.abs(told) > least)
    if not moving.any():
        return True
    off, whole = np.abs(told - moved)[moving], np.maximum(np.abs(told), np.abs(moved))[moving]
    return float(np.median(off / whole)) < _TWIST_FITS


def _neighbouring(motions: FloatArray, seconds: FloatArray) -> FloatArray:
    """Return the median speed and turn rate (N, 2) of the steps around each."""
    rates = np.stack([motions[:, 0] / seconds, motions[:, 2] / seconds], axis=1)
    padded = np.pad(rates, ((_NEIGHBOURS, _NEIGHBOURS), (0, 0)), mode="reflect")
    around = sliding_window_view(padded, 2 * _NEIGHBOURS + 1, axis=0)
    found: FloatArray = np.median(np.delete(around, _NEIGHBOURS, axis=2), axis=2)
    return found


def _rebuilt(track: OrderedOdometry, corners: IntArray, motions: FloatArray, broken: BoolArray) -> FloatArray:
    """Return the poses (N, 3) with these motions between the corners, on from the first broken step."""
    poses = track.poses.copy()
    for k in range(int(np.flatnonzero(broken)[0]), len(motions)):
        begin, end = int(corners[k]), int(corners[k + 1])
        inner = np.arange(begin + 1, end)
        if broken[k]:
            span = max(float(track.times[end] - track.times[begin]), 1e-9)
            parts = (track.times[inner] - track.times[begin]) / span
            moved = parts[:, None] * motions[k]
        else:
            moved = compose(invert(track.poses[begin]), track.poses[inner])
        poses[inner] = compose(poses[begin], moved)
        poses[end] = compose(poses[begin], motions[k])
    after = np.arange(int(corners[-1]) + 1, len(poses))
    poses[after] = compose(poses[corners[-1]], compose(invert(track.poses[corners[-1]]), track.poses[after]))
    return poses


def _breaks(
    track: OrderedOdometry, corners: IntArray, steps: _Steps, broken: BoolArray, poses: FloatArray
) -> tuple[Break, ...]:
    """Return the broken steps in groups, with what each looks like."""
    told, true = track.poses[corners], poses[corners]
    groups: list[list[int]] = []
    for k in np.flatnonzero(broken).tolist():
        if groups and (
            steps.times[k] - steps.times[groups[-1][1] + 1] < _NEAR_S
            or _returns(told, true, groups[-1][0], k, steps.unit)
        ):
            groups[-1][1] = k
        else:
            groups.append([k, k])
    found = []
    for first, last in groups:
        worst = max(range(first, last + 2), key=lambda k: _size(*_off(told, true, first, k), steps.unit))
        metres, radians = _off(told, true, first, worst)
        end, begin_s, end_s = told[last + 1], float(steps.times[first + 1]), float(steps.times[last + 1])
        between = range(int(corners[first]) + 1, int(corners[last + 1]))
        if last < _FEW <= len(told) - last - 1:
            kind, begin_s, end_s, between = (
                BreakKind.MESSAGES,
                float(steps.times[0]),
                float(steps.times[last]),
                range(int(corners[last]) + 1),
            )
            metres, radians = _off(told, true, 0, last + 1)
        elif first >= len(told) - 1 - _FEW > _FEW:
            kind, end_s, between = (
                BreakKind.MESSAGES,
                float(steps.times[-1]),
                range(int(corners[first]) + 1, len(track.times)),
            )
        elif last > first and _returns(told, true, first, last, steps.unit):
            kind = BreakKind.MESSAGES
        elif _is_origin(end, steps.unit):
            kind = BreakKind.RESTART
        else:
            kind, (metres, radians) = BreakKind.JUMP, _off(told, true, first, last + 1)
        count = sum(not track.between[index] for index in between)
        found.append(Break(kind, begin_s, end_s, metres, radians, count))
    return tuple(found)


def _off(told: FloatArray, true: FloatArray, begin: int, end: int) -> tuple[float, float]:
    """Return how far [m] and [rad] the told motion between two corners is from the true one."""
    gap = compose(invert(compose(invert(true[begin]), true[end])), compose(invert(told[begin]), told[end]))
    return float(math.hypot(gap[0], gap[1])), float(abs(gap[2]))


def _size(metres: float, radians: float, unit: float) -> float:
    return metres / unit + radians


def _returns(told: FloatArray, true: FloatArray, first: int, last: int, unit: float) -> bool:
    metres, radians = _off(told, true, first, last + 1)
    return metres < 2.0 * unit * _SLACK and radians < _SLACK_TURN
