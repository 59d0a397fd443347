"""Where this chair may spin on the spot and where it may drive straight, on a costmap.

A spin needs the disc that the outline sweeps. A straight leg needs half the chair's width and the driver's wander on
both sides. Clearances are between cell centres, so half a cell's diagonal is added to every need.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from waychair.geometry import compose, wrap_angle
from waychair.maps.grid.cells import cells_from_points, inside
from waychair.planning.body.footprint import fits, fits_each
from waychair.planning.grid.costmap import Costmap
from waychair.planning.steps.step import Step, StepKind
from waychair.types import BoolArray, FloatArray, Pose2

SPIN_ROOM = 0.04
"""m; kept round the disc that the outline sweeps in a spin: a driver's hand does not turn quite on the spot."""

TURN_ROOM = 0.02
"""m; kept round the outline where only a part of a turn is free, as beside a wall at the start."""

_SAMPLE = 0.08
"""m; places along a leg at which the clearance is looked up, besides its ends."""

_TURN_STEP = math.radians(3.0)


@dataclass(frozen=True, slots=True)
class ClearGround:
    """A costmap with the questions that steps ask of it."""

    costmap: Costmap

    @property
    def _doubt(self) -> float:
        """Return half a cell's diagonal [m]."""
        return self.costmap.grid.resolution * math.sqrt(0.5)

    def clearance(self, points: FloatArray) -> FloatArray:
        """Return (N,) the free distance [m] round points (N, 2) in map; 0 off the map and in keep-out zones."""
        grid = self.costmap.grid
        cells = cells_from_points(grid, points)
        within = inside(grid, cells)
        found = np.zeros(len(points))
        found[within] = np.maximum(self.costmap.clearance[tuple(cells[within].T)] - self._doubt, 0.0)
        return found

    def spin_room(self, points: FloatArray) -> FloatArray:
        """Return (N,) what is left [m] round the swept disc at points (N, 2); negative where the chair cannot spin."""
        return self.clearance(points) - self.costmap.body.circumscribed_radius

    def side_rooms(self, start: FloatArray, ends: FloatArray) -> FloatArray:
        """Return (N,) the room [m] on either side of straight legs from one point (2,) to each of `ends` (N, 2).

        Negative where the chair does not pass, or the costmap has no price.
        """
        away = ends - start
        count = max(2, math.ceil(float(np.hypot(*away.T).max(initial=0.0)) / _SAMPLE) + 1)
        shares = np.linspace(0.0, 1.0, count)
        points = start + shares[:, None, None] * away
        clear = self.clearance(points.reshape(-1, 2)).reshape(count, len(ends))
        between: FloatArray = clear.min(axis=0) - self.costmap.body.width / 2
        return between

    def straight_is_free(self, start: Pose2, along: float, margin: float) -> bool:
        """Return whether the outline, grown by `margin` [m], drives straight by `along` [m], backwards if negative."""
        count = max(2, math.ceil(abs(along) / (self.costmap.grid.resolution * 2)) + 1)
        on = np.linspace(0.0, along, count)
        return bool(self.free_until(compose(start.array(), np.column_stack([on, np.zeros((count, 2))])), margin)[-1])

    def free_until(self, poses: FloatArray, margin: float) -> BoolArray:
        """Return (N,) whether the outline, grown by `margin` [m], is free at each of poses (N, 3) and at all before it."""
        free: BoolArray = np.logical_and.accumulate(fits_each(self.costmap.body, margin, self.costmap.field, poses))
        return free

    def room_at(self, pose: Pose2, most: float) -> float | None:
        """Return the room [m] round the outline at a pose, up to `most`; None inside a thing by more than a cell.

        It is negative where the outline reaches into the cell of a thing: a chair may stand nearer to a wall than a cell
        tells.
        """
        cell = self.costmap.grid.resolution
        rooms = (most, 0.0, -0.5 * cell, -cell)
        return next((room for room in rooms if fits(self.costmap.body, room, self.costmap.field, pose)), None)

    def is_free_from(self, steps: Sequence[Step], pose: Pose2) -> bool:
        """Return whether the outline drives the straight legs of `steps`, from the chair's pose on the first of them."""
        for number, step in enumerate(steps):
            if step.kind not in (StepKind.STRAIGHT, StepKind.BACK):
                continue
            ahead = 1.0 if step.kind is StepKind.STRAIGHT else -1.0
            done = min(max(ahead * (step.start.inverse() @ pose).x, 0.0), step.length) if number == 0 else 0.0
            if not self.straight_is_free(step.start @ Pose2(ahead * done), ahead * (step.length - done), 0.0):
                return False
        return True

    def turn_is_free(self, at: Pose2, heading: float) -> bool:
        """Return whether the outline is free through the shorter turn from a pose to a heading [rad].

        A chair that stands nearer to something than `TURN_ROOM` keeps as much room as it has.
        """
        room, turn = self.room_at(at, TURN_ROOM), wrap_angle(heading - at.theta)
        if room is None:
            return False
        count = max(2, math.ceil(abs(turn) / _TURN_STEP) + 1)
        turned = np.column_stack([np.zeros((count, 2)), np.linspace(0.0, turn, count)])
        return bool(self.free_until(compose(at.array(), turned), room)[-1])
