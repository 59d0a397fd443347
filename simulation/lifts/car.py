"""One lift's car: its calls, its ride, and the door that opens, waits, closes and reopens."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field

from waychair.simulation.lifts.ride_profile import RideProfile, ride_profile

LEAF_SPEED = 0.3
"""m/s; speed of each leaf."""

DWELL_S = 5.0
"""s; time for which an open door waits."""

SETTLE_S = 0.8
"""s; time between a closed door and a ride, and between a ride and the opening door."""


class DoorKind(enum.Enum):
    """What makes a closing door open again."""

    CURTAIN = "curtain"  # anything between its leaves, as EN 81-20 demands
    CONTACT = "contact"  # only what a leaf touches
    BAD = "bad"  # nothing: its leaves push on


class LiftFault(enum.Enum):
    """A lift that does not do as it is asked."""

    NONE = "none"
    NEVER_COMES = "never comes"
    STOPS_ELSEWHERE = "stops elsewhere"  # every second ride ends one stop off


class LeafObstruction(enum.Enum):
    """What is in the way of closing leaves."""

    NONE = 0
    BETWEEN = 1  # between the leaves, not touched by their next step
    TOUCHED = 2  # their next step would touch it


@dataclass(slots=True)
class Car:
    """A car at the stop `at`, an index of `heights` [m]; `ride` to `at` from `came_from` since `ride_ns`."""

    heights: tuple[float, ...]
    door_width: float
    at: int = 0
    kind: DoorKind = DoorKind.CURTAIN
    fault: LiftFault = LiftFault.NONE
    opened: float = 0.0
    """Part of the way by which the leaves are open, 0 to 1."""
    moves: int = 0
    """+1 while the leaves open, -1 while they close."""
    calls: set[int] = field(default_factory=set)
    holds: set[str] = field(default_factory=set)
    """Names of those who hold the door open."""
    ride: RideProfile | None = None
    ride_ns: int = 0
    came_from: int = 0
    rides: int = 0
    rest_until_ns: int = 0
    leaf_moved_ns: int = -(10**12)
    """Stamp of the last motion of a leaf."""

    def call(self, stop: int, now_ns: int) -> None:
        """Take a call from the hall or the cabin."""
        if self.ride is None and stop == self.at and self.fault is not LiftFault.NEVER_COMES:
            self.open(now_ns)
        else:
            self.calls.add(stop)

    def open(self, now_ns: int) -> None:
        """Open the door, or keep it open for longer."""
        if self.ride is not None:
            return
        if self.opened < 1.0:
            self.moves = 1
        self.rest_until_ns = now_ns + round(DWELL_S * 1e9)

    def acceleration(self, now_ns: int) -> float:
        """Return the car's vertical acceleration [m/s^2]."""
        return 0.0 if self.ride is None else self.ride.at((now_ns - self.ride_ns) * 1e-9)[2]

    def height(self, now_ns: int) -> float:
        """Return the car's height [m]."""
        if self.ride is None:
            return self.heights[self.at]
        return self.heights[self.came_from] + self.ride.at((now_ns - self.ride_ns) * 1e-9)[0]

    def step(self, now_ns: int, seconds: float, obstruction: LeafObstruction) -> bool:
        """Let time pass up to `now_ns`; return whether a ride begins now. `obstruction` is for a closing door."""
        if self.fault is LiftFault.NEVER_COMES:
            return False
        if self.ride is not None:
            if (now_ns - self.ride_ns) * 1e-9 >= self.ride.seconds + SETTLE_S:
                self.ride = None
                self.open(now_ns)
            return False
        if self.moves:
            self._slide(now_ns, seconds, obstruction)
            return False
        if now_ns < self.rest_until_ns:
            return False
        if self.opened > 0.0:
            if self.holds:
                self.rest_until_ns = now_ns + round(DWELL_S * 1e9)
            elif obstruction is not LeafObstruction.NONE and self.kind is DoorKind.CURTAIN:
                self.rest_until_ns = now_ns + round(1e9)
            else:
                self.moves = -1
            return False
        return bool(self.calls) and self._set_off(now_ns)

    def _slide(self, now_ns: int, seconds: float, obstruction: LeafObstruction) -> None:
        if self.moves < 0 and self._reopens(obstruction):
            self.open(now_ns)
        elif self.moves < 0 and obstruction is LeafObstruction.TOUCHED:
            return  # it pushes on
        part = self.moves * LEAF_SPEED * seconds / (self.door_width / 2)
        self.opened = min(1.0, max(0.0, self.opened + part))
        self.leaf_moved_ns = now_ns
        if self.opened >= 1.0 and self.moves > 0:
            self.moves, self.rest_until_ns = 0, now_ns + round(DWELL_S * 1e9)
        elif self.opened <= 0.0 and self.moves < 0:
            self.moves, self.rest_until_ns = 0, now_ns + round(SETTLE_S * 1e9)

    def _reopens(self, obstruction: LeafObstruction) -> bool:
        if obstruction is LeafObstruction.NONE or self.kind is DoorKind.BAD:
            return False
        return self.kind is DoorKind.CURTAIN or obstruction is LeafObstruction.TOUCHED

    def _set_off(self, now_ns: int) -> bool:
        """Ride to the next call in the present direction, else in the other."""
        self.calls.discard(self.at)
        above, below = [c for c in self.calls if c > self.at], [c for c in self.calls if c < self.at]
        if not above and not below:
            self.open(now_ns)
            return False
        went_up = self.at >= self.came_from
        up = bool(above) if not (above and below) else went_up
        to = min(above) if up else max(below)
        self.calls.discard(to)
        self.rides += 1
        if self.fault is LiftFault.STOPS_ELSEWHERE and self.rides % 2 == 0:
            others = [k for k in range(len(self.heights)) if k not in (to, self.at)]
            to = min(others, key=lambda k: abs(k - to)) if others else to
        self.came_from, self.at = self.at, to
        self.ride, self.ride_ns = ride_profile(self.heights[to] - self.heights[self.came_from]), now_ns
        return True
