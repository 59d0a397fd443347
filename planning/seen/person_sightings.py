"""Clusters of lidar points that may be people, and what the scan around them shows of their motion.

Points that touch form a cluster, and slim clusters close together are the legs of one person.
Part of a wall or of furniture behind something nearer seems to walk while the chair drives: the line of sight moves its
end. So an end that something hides is no measurement (`sightings`), and a cluster with both ends hidden shows no motion.
The part of a thing in view may also slide along the thing. So somebody has only walked if the beams pass through the
place that was left, or passed through the new place before (`has_changed_place`): a static thing lets no beam through.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from waychair.planning.body.personal_space import PERSON_RADIUS
from waychair.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class MoverModel:
    """Sizes and motion of the moving things that are tracked; the defaults are people's."""

    radius: float = PERSON_RADIUS
    """[m] Radius in predictions."""
    largest: float = 1.2
    """[m] A cluster wider than this is no person."""
    link: float = 0.55
    """[m] Legs nearer than this to each other belong to one person."""
    apart: float = 0.6
    """[m] No new track begins nearer than this to an existing one."""
    acceleration: float = 1.0
    """[m/s^2] Standard deviation of the acceleration."""
    sigma: float = 0.08
    """[m] Standard deviation of a cluster's middle about the person's: legs swing."""
    walking: float = 0.2
    """[m/s] A certain speed above this, after a displacement, shows that a track moves by itself."""
    displacement: float = 0.3
    """[m] So does a displacement above this alone, if it goes on."""
    still_walking: float = 0.15
    """[m] Displacement above which a track that has walked before is still walking."""
    seeks_way: bool = True
    """Whether it looks for a way past the chair, so that a path which would meet it is worth planning anew."""


PEOPLE = MoverModel()

SMALL_ROBOTS = MoverModel(
    radius=0.15,
    largest=0.6,
    link=0.05,
    apart=0.25,  # two of them may touch
    acceleration=0.3,
    sigma=0.05,
    walking=0.1,  # they drift at 0.15 m/s, no faster than furniture seems to
    displacement=0.15,
    still_walking=0.08,
    seeks_way=False,
)
"""Discs of 0.3 m that drift slowly, among which a robot of their size drives."""

TOUCH, LEG = 0.15, 0.22
"""[m] Points nearer than the first belong to one cluster; a cluster no wider than the second may be one leg of two."""

LEAST_POINTS = 3
"""Least number of points of a person's cluster; fewer are noise."""


HIDES, NEXT_BEAM = 0.1, math.radians(3.0)
"""[m], [rad] A point nearer than its neighbour by the first hides the rest of the neighbour's thing, if the angle between
the two is no larger than the second: farther apart they are no neighbours."""

HALF_PERSON = 0.15
"""[m] Half the width of two legs: a person with one end hidden is so far from the end in view."""

BEYOND, BESIDE = 0.25, 0.1
"""[m] A beam that ends farther away than a place by the first, and passes it nearer than the second, finds nothing there."""


@dataclass(frozen=True, slots=True)
class ScanAround:
    """The scan that unexplained points are part of: all points (M, 2) [m] in the order of its beams, and the laser (2,).

    `strangers` (N,) are the indices of the unexplained points. `free` (K, 2) [m] are the ends of free space on the other
    beams; None: unknown, a beam without a point may have met nothing.
    """

    points: FloatArray
    strangers: IntArray
    laser: FloatArray
    free: FloatArray | None = None

    def is_cut(self, stranger: int, step: int, group: IntArray) -> bool:
        """Return whether a thing of some strangers (indices of indices) goes on, or may, beyond its end `stranger`.

        `step` is 1 or -1, out of the group in the order of the beams. The end is cut where a neighbouring point hides the
        rest or is part of the thing, and at the edge of the view.
        """
        i = int(self.strangers[stranger])
        k = (i + step) % len(self.points)
        if k in self.strangers[group]:
            return False
        end, neighbour = self.points[i] - self.laser, self.points[k] - self.laser
        (x, y), (u, v) = end.tolist(), neighbour.tolist()
        if abs(math.atan2(x * v - y * u, x * u + y * v)) > NEXT_BEAM:
            return k != i + step
        return math.dist((x, y), (u, v)) < TOUCH or math.hypot(u, v) < math.hypot(x, y) - HIDES

    def sees_through(self, place: FloatArray) -> bool:
        """Return whether the beams at a place (2,) [m], and close to it on both sides, reach farther: nothing is there."""
        ends = (self.points if self.free is None else np.concatenate([self.points, self.free])) - self.laser
        x, y = (place - self.laser).tolist()
        away = math.hypot(x, y)
        off = np.arctan2(ends[:, 1] * x - ends[:, 0] * y, ends @ np.array([x, y]))
        near = np.abs(off) < max(NEXT_BEAM / 2, math.atan2(BESIDE, away))
        around = self.free is None or ((off[near] <= 0).any() and (off[near] > 0).any())
        return bool(around and (np.hypot(*ends[near].T) > away + BEYOND).all())


def has_changed_place(before: ScanAround, old: FloatArray, after: ScanAround, new: FloatArray) -> bool:
    """Return whether a thing at (2,) [m] in a scan stands at another place in a later one, and is no other part of it."""
    return after.sees_through(old) or before.sees_through(new)


def sightings(points: FloatArray, model: MoverModel, scan: ScanAround | None = None) -> tuple[FloatArray, BoolArray]:
    """Return (K, 2) middles [m] of what may be people among points (N, 2) [m], and (K,) whether they show their motion.

    The middle is that between both ends. Where one end is hidden, it is beside the other; where both are, nothing is
    known of the motion.
    """
    groups = clusters(points, model)
    middles, shown = np.empty((len(groups), 2)), np.ones(len(groups), np.bool_)
    for k, group in enumerate(groups):
        thing = points[group]
        middles[k] = (thing.min(axis=0) + thing.max(axis=0)) / 2
        if scan is None:
            continue
        first, last = int(group.min()), int(group.max())
        cut = scan.is_cut(first, -1, group), scan.is_cut(last, 1, group)
        shown[k] = not all(cut)
        if any(cut) and shown[k]:
            end, other = (points[last], points[first]) if cut[0] else (points[first], points[last])
            long = max(math.dist(end, other), 1e-9)
            middles[k] = end + HALF_PERSON / long * (other - end)
    return middles, shown


def clusters(points: FloatArray, model: MoverModel) -> list[IntArray]:
    """Return the indices of the points (N, 2) [m] of each cluster or pair of legs that may be a person."""
    if len(points) == 0:
        return []
    things = _linked(points, np.arange(len(points)), TOUCH)
    slim = [bool(np.hypot(*np.ptp(points[thing], axis=0)) <= LEG) for thing in things]
    legs = [thing for thing, leg in zip(things, slim, strict=True) if leg]
    bodies = [thing for thing, leg in zip(things, slim, strict=True) if not leg]
    if legs:
        bodies += _linked(points, np.concatenate(legs), model.link)
    return [
        group
        for group in bodies
        if len(group) >= LEAST_POINTS and np.hypot(*np.ptp(points[group], axis=0)) <= model.largest
    ]


def _linked(points: FloatArray, some: IntArray, link: float) -> list[IntArray]:
    """Return some of the points (N, 2) [m], as indices, split into groups connected by steps of at most a link [m]."""
    labels = linked_groups(points[some], link)
    return [some[labels == label] for label in range(labels.max() + 1)]


@njit(cache=True)
def linked_groups(points: FloatArray, link: float) -> IntArray:
    """Return (N,) the group of each of points (N, 2) [m]; steps of at most a link [m] connect the points of a group.

    Groups are numbered in the order of their first points. All pairs are tested: a scan has few unexplained points.
    """
    labels = np.full(len(points), -1, np.int64)
    waiting = np.empty(len(points), np.int64)
    groups = 0
    for first in range(len(points)):
        if labels[first] >= 0:
            continue
        labels[first], waiting[0], count = groups, first, 1
        while count:
            count -= 1
            i = waiting[count]
            for j in range(len(points)):
                if labels[j] < 0:
                    dx, dy = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1]
                    if dx * dx + dy * dy <= link * link:
                        labels[j], waiting[count] = groups, j
                        count += 1
        groups += 1
    return labels
