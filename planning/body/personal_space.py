"""Personal space: how much room is given to people, and for how long.

Hall's intimate distance is 0.45 m. A lidar at the height of shins sees legs; shoulders reach about 0.2 m beyond them.
"""

from __future__ import annotations

from dataclasses import dataclass

from waychair.config import Settings, setting
from waychair.errors import ConfigError


@dataclass(frozen=True, slots=True)
class PersonalSpaceSettings(Settings):
    """How near the chair passes people."""

    radius: float = setting(
        0.4,
        "m",
        "radius kept free around a tracked person; larger: fewer corridors have room to pass somebody",
        low=0.05,
        high=1.0,
    )
    squeezed: float = setting(
        0.3,
        "m",
        "radius kept free around a person after the chair gave way, at most radius; larger: fewer passes",
        low=0.05,
        high=1.0,
    )


PERSON_RADIUS = 0.3
"""[m] Radius of a person in predictions: no commanded arc may touch this circle."""

PREDICTED_GROWTH = 0.3
"""[m] The radius of a predicted person grows with the uncertainty of the speed by no more than this: nobody can tell
where a person goes in two seconds, and a larger circle would block every corridor."""

COMFORTABLE = 0.6
"""[m] Distance to people beyond which more earns an arc nothing: Hall's intimate distance and some to spare."""

COMFORT_WEIGHT = 2.0
"""Weight of the distance to people among the critics of an arc."""

STANDING_BEFORE_S = 0.5
"""[s] The chair stands this long before a predicted person reaches it."""

NO_TURNING_SPEED, NO_TURNING_WITHIN = 0.2, 2.0
"""[m/s], [m] Somebody faster than this and nearer than this is looking for a way past: the chair does not turn on the
spot before them, which would bar one side and then the other."""

PASSING = 0.25
"""[m] Kept free beside the chair when it keeps to one side of a corridor for people."""

PASSING_OPEN = 1.5
"""[m] With more free space than this on all sides the chair does not keep to one side."""

GIVE_WAY_S = 1.5
"""[s] The chair stands this long for people in its way before it passes them nearer (`squeezed`)."""

LINGERS_AFTER_S = 2.0
"""[s] Somebody who moves to and fro for longer near a chair that makes no progress is waiting for it."""

SETTLED_AFTER_S = 15.0
"""[s] Somebody who stands for longer counts as an obstacle that stays."""

LEAVING_PEOPLE = 0.03
"""[m] Left between the chair and people's personal space on the cells of the local window, so that it can move away."""

WAITED_FOR_WITHIN = 1.0
"""[m] The chair waits for people that walk nearer to its clearance than this, instead of backing out."""

PERSON_POINTS = 0.5
"""[m] Points nearer than this to the middle of a walking person belong to the person."""

LEG_WIDTH = 0.35
"""[m] A slim object that stands free is taken for legs if it is no wider than this: two legs of one person together."""


@dataclass(frozen=True, slots=True)
class LegClearanceSettings(Settings):
    """Extra clearance of the collision monitor towards legs, since a body reaches about 0.2 m beyond them.

    The `_after` values hold once the chair has given way for `GIVE_WAY_S`.
    """

    ahead: float = setting(
        0.55,
        "m",
        "extra clearance to legs in the direction of travel; larger: the chair stops earlier",
        low=0.0,
        high=1.0,
    )
    beside: float = setting(
        0.45,
        "m",
        "extra clearance to legs on both sides until they are passed; larger: the chair gives way more often",
        low=0.0,
        high=1.0,
    )
    turning: float = setting(
        0.20,
        "m",
        "extra clearance to legs on all sides in a turn on the spot; larger: the chair turns less",
        low=0.0,
        high=1.0,
    )
    ahead_after: float = setting(
        0.33,
        "m",
        "extra clearance to legs ahead after giving way, at most ahead; larger: the chair stops earlier",
        low=0.0,
        high=1.0,
    )
    beside_after: float = setting(
        0.20,
        "m",
        "extra clearance to legs on both sides after giving way, at most beside; larger: fewer passes",
        low=0.0,
        high=1.0,
    )

    def __post_init__(self) -> None:
        Settings.__post_init__(self)
        if self.beside_after > self.beside or self.ahead_after > self.ahead:
            raise ConfigError(
                f"beside_after = {self.beside_after:g} m and ahead_after = {self.ahead_after:g} m must not exceed "
                f"beside = {self.beside:g} m and ahead = {self.ahead:g} m: after giving way the chair may pass nearer"
            )
