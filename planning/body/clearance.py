"""The clearance policy: how much room [m] the chair keeps from obstacles, for every part that plans or drives.

Clearance is measured from the chair's footprint unless a line says otherwise. There are three levels:

- hard: never closer. The footprint itself stays free; what noise of a scan puts nearer is tolerated to a bound.
- planned: what a path, a turn on the spot or a commanded arc keeps.
- comfortable: the clearance from which more costs no less. Below it, costs rise.

Where the chair is fast, more is kept; those values name the speed. `personal_space` holds the room given to people.
"""

from __future__ import annotations

from dataclasses import dataclass

from waychair.config import Settings, setting

# hard ---------------------------------------------------------------------------------------------------------------

HARD = 0.0
"""[m] The footprint as it is: start, goal and the straight line through a door must fit with this."""

EASE_STEP, EASE_STEPS = 0.002, 26
"""[m] and count: the planned clearance is eased in steps of 2 mm, by at most 25 of them (5 cm), where noise of a scan
or of the localisation puts an obstacle inside it. Without that a chair that stands too near could never leave."""

NOISE = 0.005
"""[m] Below this the distance to an obstacle is noise. No unplanned drive starts from there."""

# planned ------------------------------------------------------------------------------------------------------------

PLANNED = 0.03
"""[m] Kept by the local planner and, beside the chair's half width, by the costmap. It covers localisation noise."""

PLANNED_TURN = 0.06
"""[m] Kept where a turn on the spot is planned: `PLANNED`, and as much again because the stop is not exact."""

MANOEUVRE, MANOEUVRE_TIGHT = (0.05, PLANNED), (0.02, 0.015, 0.015)
"""[m] Tried in turn for a multi-point turn. The tight ones come after leading the chair out of its place has failed.
Less than the last is less than the accuracy of the localisation."""

CRAMPED = PLANNED
"""[m] A chair with less than this around it is led out before it turns."""

LEAVING = (0.025, 0.02, 0.015, 0.0125, 0.01, 0.0075, 0.005, 0.0025, 0.0)
"""[m] Tried in turn for leading a chair out of a cramped place: the first that fits where it stands is kept."""

LEAVING_STEP, MAP_DOUBT = 0.005, 0.6
"""[m] and part of a map's cell: a surface lies anywhere in the cell that it makes occupied, and the pose follows the cells'
middles. So a chair whose front or rear seems to be in a mapped obstacle, by up to this part of a cell, stands free. It is
led straight away from it, as a body shortened in steps of the first value."""

LEAVING_DIP = 1 / 3
"""Part of the clearance in `LEAVING` that may be lost on the way out: every turn begins by coming a little nearer."""

LEFT = 0.06
"""[m] A cramped chair is out once it has this much around it, enough to turn like anywhere else."""

# comfortable --------------------------------------------------------------------------------------------------------

COMFORTABLE = 1.0
"""[m] From the drive axle's middle: the costmap's prices rise below this; the default of `ClearanceSettings`."""


@dataclass(frozen=True, slots=True)
class ClearanceSettings(Settings):
    """The clearance that a site may want to change."""

    comfortable: float = setting(
        COMFORTABLE,
        "m",
        "distance to obstacles below which a path costs more; larger: longer detours around furniture",
        low=0.0,
        high=5.0,
    )


COMFORTABLE_ARC, COMFORTABLE_ARC_LEAST = 0.3, 0.05
"""[m] Beside the footprint: more earns an arc of the dynamic window nothing. Near the path's end only as much is worth
anything as there is at the end, but never less than the second value."""

COMFORTABLE_MANOEUVRE = 0.06
"""[m] Beyond the clearance of a multi-point turn: steps with less than this cost more."""

NARROW = 0.6
"""[m] From the drive axle's middle: below this a place between two obstacles is treated as a doorway."""

STRAIGHT_DOOR = 0.25
"""[m] Clear width beyond the chair's own: the chair passes a door with no more than this straight, on its axis."""

TOLD_APART = 2.0
"""[m] Larger distances to obstacles are not told apart in a costmap."""

# by speed: the collision monitor ------------------------------------------------------------------------------------

CRAWL_SPEED, FULL_SPEED = 0.3, 0.8
"""[m/s] Speeds of the chair's fastest part. The monitor keeps the clearance at a crawl up to the first, the full one
from the second, and in proportion between them."""

MONITORED_AT_CRAWL, MONITORED_AT_FULL_SPEED = 0.0, 0.05
"""[m] Kept by the monitor on all sides. Nothing at a crawl: a doorway leaves 5 cm at best."""

MONITORED_AHEAD_AT_CRAWL, MONITORED_AHEAD_AT_FULL_SPEED = 0.01, 0.10
"""[m] Kept by the monitor in the direction of travel, besides the clearance on all sides."""

# where the map or the plan tells little -----------------------------------------------------------------------------

DROP_OFF = 0.15
"""[m] Kept around drop-offs, since the depth of a floor's edge is uncertain."""

TRACKED = 0.01
"""[m] Kept while tracking a planned line: the line was planned with more. On a line that this blocks, `HARD` is kept."""

BACKING_OUT, BACKING_OUT_NOISE = 0.02, 0.005
"""[m] A chair that backs out never comes nearer to an obstacle than it has been, unless it keeps the first value. An
approach by less than the second is noise of the pose."""
