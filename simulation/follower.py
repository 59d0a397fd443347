"""A simulated rider: follows waypoints by the true pose, waits for people, and moves the joystick.

It drives the mapping routes of recordings. Straight legs use pure pursuit (Coulter, Implementation of the Pure Pursuit
Path Tracking Algorithm, 1992). At a sharp corner the chair stops and turns on the spot, as riders do in corridors.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TypeAlias

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.errors import WorldError
from waychair.geometry import wrap_angle
from waychair.simulation.plant.kinematic_chair import moved
from waychair.simulation.plant.plant import PlantSettings, joystick_from_volts, volts_from_twist
from waychair.simulation.scene.contact import person_distance
from waychair.simulation.scene.scene import PersonState
from waychair.simulation.simulator import Simulator
from waychair.types import FloatArray, JoystickInput, Pose2, SensorMessage, Twist

STALL_NS = 60_000_000_000
"""A drive that moves less than 10 cm in this time has failed."""

_Point: TypeAlias = tuple[float, float]


# A calm rider, tuned on the mapping routes of the shipped worlds.
SPEED = 0.6  # m/s; on straight legs
TURN_RATE = 0.6  # rad/s; fastest turn
LOOK_AHEAD = 0.6  # m; distance of the aim along the leg
BRAKING = 0.4  # m/s^2; deceleration towards a waypoint
REACHED = 0.08  # m; a waypoint this near ahead counts as reached
TURN_GAIN = 1.8  # 1/s; turn rate per radian off the aim
TURN_FROM = 0.35  # rad; farther off the aim the chair turns on the spot
TURN_UNTIL = 0.05  # rad; a turn on the spot ends this near to the aim
PREDICTION_S = 1.5  # s; the rider waits for people to whom the chair would come too near within this time
PERSON_CLEARANCE = 0.12  # m; too near to a person


class Follower:
    """A rider on a `route` (N, 2) [m, map]; holds the present leg and whether the chair turns on the spot."""

    def __init__(self, route: FloatArray, track: float, plant: PlantSettings, speed: float = SPEED) -> None:
        """`track` [m] and `plant` describe the chair that the rider assumes; `speed` [m/s] is for straight legs."""
        self._waypoints: list[_Point] = [(float(x), float(y)) for x, y in route]
        self._track = track
        self._plant = plant
        self._speed = speed
        self._next = 0
        self._begin: _Point | None = None
        self._turning = False

    @property
    def done(self) -> bool:
        """Whether the last waypoint has been reached."""
        return self._next >= len(self._waypoints)

    def stick(
        self, map_from_base: Pose2, body: ChairBody | None = None, people: Sequence[PersonState] = ()
    ) -> tuple[float, float]:
        """Return the joystick (forward, turn) in [-1, 1] for the next tick: at rest when done or near a person."""
        twist = self._twist(map_from_base)
        if body and people and self._comes_near(map_from_base, twist, body, people):
            twist = Twist()
        return joystick_from_volts(self._plant, *volts_from_twist(self._plant, self._track, twist))

    def _comes_near(self, pose: Pose2, twist: Twist, body: ChairBody, people: Sequence[PersonState]) -> bool:
        """Return whether the chair would soon come nearer to a person than the limit and than it is now."""
        limit = min(PERSON_CLEARANCE, person_distance(body, pose, people))
        times = np.arange(1, 7) * PREDICTION_S / 6
        return any(person_distance(body, moved(pose, twist, float(t)), people) < limit for t in times)

    def _twist(self, pose: Pose2) -> Twist:
        begin = self._begin or (pose.x, pose.y)
        while not self.done and _remaining(begin, self._waypoints[self._next], pose) < REACHED:
            begin = self._waypoints[self._next]
            self._next += 1
        self._begin = begin
        if self.done:
            return Twist()
        waypoint = self._waypoints[self._next]
        remaining = _remaining(begin, waypoint, pose)
        # The aim may lie beyond the waypoint on the leg's line, so that the last metre stays straight.
        aim = _along(begin, waypoint, LOOK_AHEAD - remaining)
        off = wrap_angle(math.atan2(aim[1] - pose.y, aim[0] - pose.x) - pose.theta)
        omega = min(TURN_RATE, max(-TURN_RATE, TURN_GAIN * off))
        self._turning = abs(off) > (TURN_UNTIL if self._turning else TURN_FROM)
        if self._turning:
            return Twist(0.0, omega)
        speed = min(self._speed, math.sqrt(2 * BRAKING * remaining))
        return Twist(speed * (1.0 - 0.5 * abs(off) / TURN_FROM), omega)


def _remaining(begin: _Point, end: _Point, pose: Pose2) -> float:
    """Return the distance [m] left in the direction of the leg; 0 on a leg of no length."""
    x, y = end[0] - begin[0], end[1] - begin[1]
    length = math.hypot(x, y)
    return ((end[0] - pose.x) * x + (end[1] - pose.y) * y) / length if length > 1e-6 else 0.0


def _along(begin: _Point, end: _Point, beyond: float) -> _Point:
    """Return the point on the leg's line that lies `beyond` [m] past its end."""
    x, y = end[0] - begin[0], end[1] - begin[1]
    part = beyond / math.hypot(x, y)
    return end[0] + part * x, end[1] + part * y


class StallCheck:
    """Watches that a rider's drive makes progress."""

    def __init__(self, simulator: Simulator) -> None:
        self._simulator = simulator
        self._since_ns, self._seen = simulator.now_ns, simulator.truth()

    def check(self) -> None:
        """
        Raises:
            WorldError: the chair touched something, or moved less than 10 cm in a minute.
        """
        simulator, pose = self._simulator, self._simulator.truth()
        at = f"({pose.x:.2f}, {pose.y:.2f})"
        if simulator.in_contact:
            raise WorldError(f"the chair touched something at {at}: move the route away from it")
        if math.hypot(pose.x - self._seen.x, pose.y - self._seen.y) > 0.1:
            self._since_ns, self._seen = simulator.now_ns, pose
        elif simulator.now_ns - self._since_ns > STALL_NS:
            raise WorldError(f"the chair did not move for a minute at {at}: correct the route there")


def follow(simulator: Simulator, follower: Follower, tick_ns: int = 50_000_000) -> Iterator[SensorMessage]:
    """Yield the messages of a whole drive along the follower's route, from the simulator's present state.

    The rider's stick drives the chair's lines directly, or through the board that is wired in.

    Raises:
        WorldError: the chair touched something on the route, or moved less than 10 cm in a minute.
    """
    simulator.release()
    progress = StallCheck(simulator)
    try:
        while not follower.done:
            forward, turn = follower.stick(simulator.truth(), simulator.body, simulator.people)
            simulator.rider = JoystickInput(simulator.now_ns, forward, turn)
            yield from simulator.advance(tick_ns)
            progress.check()
    finally:
        simulator.rider = JoystickInput(simulator.now_ns)
