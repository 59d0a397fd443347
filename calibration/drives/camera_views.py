"""Views of the planes that camera and lidar both see, from which the camera's mount is found."""

from __future__ import annotations

import math

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.calibration.fits.camera_mount import PlaneView
from waychair.calibration.fits.planes import Plane, planes_from_depth
from waychair.types import BoolArray, FloatArray, Pose3, RgbdFrame, Scan

_TAPE_ERROR = 0.15  # [m]: error of a mount by tape measure
_GREATEST_TILT_SIN = math.sin(math.radians(15.0))
_LEAST_BEAMS = 10
_FLOOR_POINTS = np.array([[1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [3.0, 1.0, 0.0], [3.0, -1.0, 0.0]])
_REST_DIFFERENCE = 0.05  # [m]: most beams of two scans at rest differ by less
_REST_WITHIN_NS = 500_000_000  # scans farther apart in time cannot show that the chair rested


def views_of_planes(
    frame: RgbdFrame, scan: Scan, body: ChairBody, nominal: Pose3, seed: int = 0
) -> tuple[PlaneView, ...]:
    """Return the planes that camera and lidar both see: walls with the beams that hit them, and the floor.

    `nominal` is `camera_from_laser` by tape measure. A beam belongs to a wall if it ends near the part that the camera
    saw of it, and near no other wall. No beam ends on the floor, but the laser's height above it is known.
    """
    points = _beam_ends(scan)
    planes = planes_from_depth(frame.depth, frame.camera_matrix, np.random.default_rng(seed))
    upright = [abs(float(plane.normal @ nominal.rotation[:, 2])) for plane in planes]
    walls = [plane for plane, up in zip(planes, upright, strict=True) if up < _GREATEST_TILT_SIN]
    on = np.array([_near_plane(points, plane, nominal) for plane in walls]).reshape(len(walls), len(points))
    alone = on.sum(axis=0) == 1  # in a corner a beam may belong to either wall
    views = [
        PlaneView(plane.normal, plane.distance, points[mine & alone])
        for plane, mine in zip(walls, on, strict=True)
        if (mine & alone).sum() >= _LEAST_BEAMS
    ]
    floor = _FLOOR_POINTS - (0.0, 0.0, body.laser_z)
    floors = [plane for plane, up in zip(planes, upright, strict=True) if up > math.sqrt(1.0 - _GREATEST_TILT_SIN**2)]
    return (*views, *(PlaneView(plane.normal, plane.distance, floor) for plane in floors))


def _beam_ends(scan: Scan) -> FloatArray:
    """Return the end points (N, 3) [m] of all beams with a hit, in the laser frame."""
    hit = np.isfinite(scan.ranges) & (scan.ranges > max(scan.range_min, 0.05))
    ranges, angles = scan.ranges[hit].astype(float), scan.angles()[hit]
    return np.stack([ranges * np.cos(angles), ranges * np.sin(angles), np.zeros(len(ranges))], axis=1)


def _near_plane(points: FloatArray, plane: Plane, camera_from_laser: Pose3) -> BoolArray:
    """Return (N,) whether points (N, 3) lie near the part of a plane that the camera saw, by the nominal mount."""
    there = points @ camera_from_laser.rotation.T + camera_from_laser.translation
    between = (there > plane.extent[0] - _TAPE_ERROR) & (there < plane.extent[1] + _TAPE_ERROR)
    near: BoolArray = (np.abs(there @ plane.normal - plane.distance) < _TAPE_ERROR) & between[:, 0] & between[:, 2]
    return near


def nominal_mount(body: ChairBody) -> Pose3:
    """Return `camera_from_laser` by tape measure."""
    laser = body.base_from_laser
    c, s = math.cos(laser.theta), math.sin(laser.theta)
    rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    origin = np.array([laser.x, laser.y, body.laser_z])
    camera = body.base_from_camera
    back = camera.rotation.T
    return Pose3(back @ rotation, back @ (origin - camera.translation))


def is_at_rest(before: Scan, after: Scan) -> bool:
    """Return whether two successive scans show a chair at rest."""
    if len(before.ranges) != len(after.ranges) or after.stamp_ns - before.stamp_ns > _REST_WITHIN_NS:
        return False
    both = np.isfinite(before.ranges) & np.isfinite(after.ranges)
    off = np.abs(after.ranges[both] - before.ranges[both])
    return bool(both.sum() >= _LEAST_BEAMS and np.percentile(off, 80.0) < _REST_DIFFERENCE)
