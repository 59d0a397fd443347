"""Caps for the rider's own stick: for each direction the largest deflection from which the chair can still stop free.

The rider drives; the caps slow or stop, and never steer. For each of the four directions one full push is judged: the
push that the stick makes now, stretched to the end of the swing, and straight pushes in the other directions. Of its
twist three shares are taken, and the least counts: that of the collision monitor, that of unseen space, and that of the
points that no scan shows: drop-offs, things that sonars or depth camera have seen, and what the map shows where no
sensor looks. A drop-off is told to the board as one, because the rider cannot override it. No push is faster than `FULL_SPEED`,
up to which clearances are known: from more, nobody who steps out could be spared.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.calibration.fits.stopping import StopTable
from waychair.control.safety.arc_clearance import MonitorSettings, fastest_part, stoppable_along
from waychair.control.safety.sight_speed import Sector, UnseenSettings, in_view, sight_share
from waychair.firmware_bridge.bridge import AT_REST
from waychair.firmware_bridge.caps import Caps, StickMotion
from waychair.geometry import transform_points
from waychair.planning.body.clearance import FULL_SPEED
from waychair.types import FloatArray, HelpLevel, JoystickInput, Pose2, Twist

GUARDED = (HelpLevel.GUARD, HelpLevel.GUIDE)
"""The levels of help in which the board guards the rider's own stick."""

WATCHED_WITHIN = 4.0
"""m; points farther away than a stop from the fastest push need not be judged."""

BLIND_WITHIN = 1.5
"""m; the same where no sensor looks, because the chair is slow there."""

LEAST_SPEED = 0.05
"""m/s; a push that may be no faster than this is stopped, so that the chair does not creep up to things for ever."""

CREEP = 0.09
"""m/s of the chair's fastest part while the rider overrides the guard by a press; with the error of its lines, a touch is no faster
than 0.1 m/s."""

SPOKEN = {
    HelpLevel.INFORM: "Inform: nothing slows or stops your joystick.",
    HelpLevel.GUARD: "Guard: the chair slows and stops before what it sees. It does not see everything. Let go of the joystick "
    "for two seconds.",
    HelpLevel.GUIDE: "Guide: guarded, and led step by step; a turn ends at its heading, and a push that was not asked for may do "
    "nothing. Let go of the joystick for two seconds.",
}
"""The sentence of each level when it begins."""

GUARD_ENDED = "The guard has ended: "
"""The beginning of the sentence with which the level falls to inform because the board guards no longer."""

UNCALIBRATED = (
    "The guard needs a chair whose joystick was measured: run `waychair calibrate dac`. You are informed only."
)


def _nothing() -> FloatArray:
    return np.empty((0, 2))


@dataclass(frozen=True, slots=True)
class Unscanned:
    """Points (N, 2) [m] that no scan shows: `drops`, edges and places without floor, and other `things`.

    `mapped` is the outline of all that the map shows, and of what has just been seen to stand: it counts where no sensor looks now, as
    behind the chair.
    """

    drops: FloatArray = field(default_factory=_nothing)
    things: FloatArray = field(default_factory=_nothing)
    mapped: FloatArray = field(default_factory=_nothing)

    def seen_from(self, map_from_base: Pose2) -> Unscanned:
        """Return points in map as points in base."""
        here = map_from_base.inverse()
        return Unscanned(*(transform_points(here, points) for points in (self.drops, self.things, self.mapped)))

    def with_mapped(self, points: FloatArray) -> Unscanned:
        """Return these points and more mapped ones (N, 2) [m], in the same frame."""
        return Unscanned(self.drops, self.things, np.concatenate([self.mapped, points]))

    def near(self, at: tuple[float, float] = (0.0, 0.0), beyond: float = 0.0) -> Unscanned:
        """Return the points that matter to the next stop of a chair within `beyond` [m] of a place, by default base."""

        def within(points: FloatArray, way: float) -> FloatArray:
            near: FloatArray = points[np.hypot(*(points - at).T) <= way + beyond]
            return near

        return Unscanned(
            within(self.drops, WATCHED_WITHIN),
            within(self.things, WATCHED_WITHIN),
            within(self.mapped, BLIND_WITHIN),
        )

    def unwatched(self, body: ChairBody, sectors: Sequence[Sector]) -> FloatArray:
        """Return the mapped points in base that no sector shows. Those inside the outline show an error of the pose."""
        x, y = self.mapped.T
        inside = (x < body.front) & (x > -body.rear) & (np.abs(y) < body.width / 2)
        unseen: FloatArray = self.mapped[~inside & ~in_view(self.mapped, sectors)]
        return unseen


@dataclass(frozen=True, slots=True)
class Pushes:
    """Full pushes of the stick to the front, the rear, the left and the right, with their twists, of which caps are made.

    The twists have the chair's own `bend` [rad/m] in them (`own_bend`).
    """

    deflections: tuple[tuple[float, float], ...]
    twists: tuple[Twist, ...]
    bend: float = 0.0


def pushes_of(stick: JoystickInput, motion: StickMotion, bend: float = 0.0) -> Pushes:
    """Return the pushes to judge for a stick's position, on a chair that bends by so much beyond it [rad/m].

    A position that is no number counts as rest.
    """
    deflections = _deflections(stick.forward, stick.turn)
    twists = (motion.twist(*each) for each in deflections)
    return Pushes(deflections, tuple(Twist(each.v, each.omega + bend * each.v) for each in twists), bend)


def _deflections(forward: float, turn: float) -> tuple[tuple[float, float], ...]:
    largest = max(abs(forward), abs(turn))
    if not AT_REST < largest < float("inf"):
        return (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)
    stretched = forward / largest, turn / largest
    along = stretched[0] if abs(forward) > AT_REST else 0.0
    turning = abs(turn) > AT_REST
    return (
        stretched if along > 0.0 else (1.0, 0.0),
        stretched if along < 0.0 else (-1.0, 0.0),
        stretched if turning and turn > 0.0 else (along, 1.0),
        stretched if turning and turn < 0.0 else (along, -1.0),
    )


def caps_of(
    pushes: Pushes,
    monitored: Sequence[float] | None,
    sectors: Sequence[Sector],
    unscanned: Unscanned,
    motion: StickMotion,
    body: ChairBody,
    monitor: MonitorSettings,
    unseen: UnseenSettings,
    stops: StopTable | None = None,
) -> Caps:
    """Return the caps of the stick.

    `monitored`: the monitor's shares of the pushes; None: it has no fit scan, so that all space counts as unseen.
    """
    seen = () if monitored is None else sectors
    near, caps, drops = unscanned.near(), [], []
    things = np.concatenate([near.things, near.unwatched(body, seen)])
    for at, twist in enumerate(pushes.twists):
        falls = _share(near.drops, twist, body, monitor, stops)
        share = min(
            1.0 if monitored is None else monitored[at],
            sight_share(twist, body, seen, unseen),
            falls,
            _share(things, twist, body, monitor, stops),
        )
        fastest = fastest_part(twist, body)
        share = min(share, FULL_SPEED / max(fastest, FULL_SPEED))
        share = share if share * fastest >= LEAST_SPEED else 0.0
        forward, turn = motion.deflection(Twist(share * twist.v, share * (twist.omega - pushes.bend * twist.v)))
        part = forward if at < 2 else turn
        asked = pushes.deflections[at][0 if at < 2 else 1]
        caps.append(1.0 if share >= 1.0 and abs(asked) >= 1.0 else abs(part))
        drops.append(falls < 1.0)
    front, rear, left, right = caps
    return Caps(front, rear, left, right, drops=(drops[0], drops[1], drops[2], drops[3]))


def crept(caps: Caps, stick: JoystickInput, motion: StickMotion, body: ChairBody) -> Caps:
    """Return the caps raised to a creep, for an override by the rider's own act; not towards a drop-off.

    Both axes share the creep as the stick does, because their speeds add up at a corner of the chair.
    """
    forward, turn = abs(stick.forward), abs(stick.turn)
    ahead = forward / (forward + turn) if AT_REST < max(forward, turn) < float("inf") else 0.5
    drive, swivel = CREEP * ahead, CREEP * (1.0 - ahead) / body.circumscribed_radius
    aside = motion.deflection(Twist(0.0, swivel))[1]
    front, rear, left, right = (
        cap if drop else max(cap, creep)
        for cap, drop, creep in zip(
            caps.each,
            caps.drops,
            (motion.deflection(Twist(drive, 0.0))[0], -motion.deflection(Twist(-drive, 0.0))[0], aside, aside),
            strict=True,
        )
    )
    return Caps(front, rear, left, right, caps.drops)


OVERRIDE_S = 10.0
"""s for which a press of the override lets the rider creep at most; the board's own, by a long push, lasts as long."""


@dataclass(frozen=True, slots=True)
class PressedOverride:
    """An override by a press: its end, and whether the stick has been pushed since."""

    until_ns: int
    pushed: bool = False

    @classmethod
    def begun(cls, now_ns: int) -> PressedOverride:
        """Return the override of a press now."""
        return cls(now_ns + round(OVERRIDE_S * 1e9))

    def after(self, now_ns: int, stick: JoystickInput) -> PressedOverride | None:
        """Return the override after a tick; it ends with its time, and when a stick that was pushed is let go."""
        held = max(abs(stick.forward), abs(stick.turn)) > AT_REST
        ends = now_ns >= self.until_ns or (self.pushed and not held)
        return None if ends else replace(self, pushed=self.pushed or held)


def _share(
    points: FloatArray, twist: Twist, body: ChairBody, monitor: MonitorSettings, stops: StopTable | None
) -> float:
    """Return the share of a twist that points (N, 2) [m] in base permit."""
    if not len(points):
        return 1.0
    return stoppable_along(points, np.zeros(len(points), np.bool_), twist, body, monitor, stops)
