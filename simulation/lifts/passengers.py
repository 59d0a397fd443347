"""People who call lifts, ride and leave; each appears before a door and is gone once it has walked away from one."""

from __future__ import annotations

import enum
import itertools
import math
from dataclasses import dataclass, field

import numpy as np

from waychair.simulation.people.people import STRIDE
from waychair.simulation.scene.scene import PersonBehaviour, PersonState
from waychair.types import FloatArray, Pose2

SPEED, RADIUS = 0.8, 0.25
"""m/s, m; of a passenger."""

SPOT_AHEAD, SPOT_ASIDE = 1.2, 1.1
"""m; a passenger waits so far before the door and beside its middle, and goes to the other side when it leaves."""

CHAIR_GAP, PASSENGER_GAP = 0.25, 0.02
"""m; a passenger stops so far before a chair, and before another passenger: in a cabin people squeeze past each other."""

PASSES_S = 3.0
"""s; a passenger whose way is taken outside the doorway waits for so long, then goes another way and is gone."""

PAUSE_S = (15.0, 60.0)
"""s; least and longest time from leaving one lift to calling another."""


class Doing(enum.Enum):
    """What a passenger does."""

    AWAY = 0
    WAITS = 1
    ENTERS = 2
    RIDES = 3
    LEAVES = 4


@dataclass(slots=True)
class Passenger:
    """One passenger: at (x, y) [m, map] of the level `stop` of its lift, which it wants to ride to `wants`."""

    lift: int = 0
    stop: int = 0
    wants: int = 0
    doing: Doing = Doing.AWAY
    until_ns: int = 0
    x: float = 0.0
    y: float = 0.0
    heading: float = 0.0
    speed: float = 0.0
    walked: float = 0.0
    slot: int = 0
    seed: int = 0
    way: list[tuple[float, float]] = field(default_factory=list)

    @property
    def here(self) -> bool:
        """Whether it is anywhere at all."""
        return self.doing is not Doing.AWAY

    def is_behind(self, other: Passenger) -> bool:
        """Return whether it leaves the same lift at the same stop after another, as it has farther to go."""
        if (self.doing, self.lift, self.stop) != (Doing.LEAVES, other.lift, other.stop):
            return False
        return (self._left(), self.seed) > (other._left(), other.seed)

    def _left(self) -> float:
        """Return how far [m] it has to go."""
        points = [(self.x, self.y), *self.way]
        return sum(math.dist(a, b) for a, b in itertools.pairwise(points))

    def state(self) -> PersonState:
        """Return it for the sensors."""
        stride = self.walked * math.tau / STRIDE % math.tau
        pose = Pose2(self.x, self.y, self.heading)
        return PersonState(pose, self.speed, stride, RADIUS, PersonBehaviour.PATH, self.seed)

    def walk(self, seconds: float, others: FloatArray) -> bool:
        """Walk on along `way`; return whether it is there. It stops before `others`, (N, 4) x, y, radius and gap [m]."""
        self.speed = 0.0
        if not self.way:
            return True
        tx, ty = self.way[0]
        dx, dy = tx - self.x, ty - self.y
        left = math.hypot(dx, dy)
        if left < 0.05:
            self.way.pop(0)
            return not self.way
        step = min(SPEED * seconds, left)
        self.heading = math.atan2(dy, dx)
        nx, ny = self.x + dx / left * step, self.y + dy / left * step
        if len(others):
            now = np.hypot(others[:, 0] - self.x, others[:, 1] - self.y) - others[:, 2] - RADIUS
            then = np.hypot(others[:, 0] - nx, others[:, 1] - ny) - others[:, 2] - RADIUS
            if ((then < others[:, 3]) & (then < now)).any():
                return False
        self.x, self.y, self.speed = nx, ny, step / seconds
        self.walked += step
        return False


def slots_of(length: float, width: float) -> tuple[tuple[float, float], ...]:
    """Return where passengers stand in a cabin, in its frame: its corners, those at the back first."""
    x, y = length / 2 - RADIUS - 0.05, width / 2 - RADIUS - 0.05
    return ((-x, y), (-x, -y), (x, y), (x, -y))
