"""Whether a place that looks like the present one is it: what two pictures say of the way between them, and what scans do."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from waychair.geometry import wrap_angles
from waychair.slam.features import Features
from waychair.slam.information import of_match, turned
from waychair.slam.mapper import Mapper, MapperSettings
from waychair.slam.memory import Memory
from waychair.slam.nodes import Kept, Node
from waychair.slam.reference import Reference
from waychair.slam.scan_matching import refine
from waychair.slam.scan_points import MIN_POINTS, ScanPoints
from waychair.types import FloatArray, Pose2, Pose3

_LATEST = 4  # nodes of a key scan that are looked at, however often the chair has come by: they stand side by side


@dataclass(frozen=True, slots=True)
class Fit:
    """Where a scan lies on surfaces: its pose, information (3, 3) in that pose's frame, share of its points on them."""

    pose: Pose2
    information: FloatArray
    inliers: float


def features_of(node: Node) -> Features:
    """What a node keeps of its features: pixels, descriptors and points; of the rest nothing is known."""
    count = len(node.pixels)
    nothing = np.full(count, np.nan, np.float32)
    return Features(node.pixels, node.descriptors, node.points, nothing, np.zeros(count, np.uint8), nothing)


def motion_of_base(old_from_new: Pose3, base_from_camera: Pose3) -> Pose2:
    """The chair's motion over the ground by that of its camera."""
    return (base_from_camera @ old_from_new @ base_from_camera.inverse()).planar()


def fit_to_keys(mapper: Mapper, key: int, scan: ScanPoints, guess: Pose2) -> Fit:
    """A scan laid onto the surfaces of a key scan and of those certain of it, from a pose in map."""
    keys, settings = mapper.keys, mapper.settings
    members = sorted(keys.ways(key, settings.loops.chain_reach))
    reference = keys.reference(members, keys.poses[key], settings.running_reach, settings.matching)
    return _fit(reference, scan, guess, settings)


def nearest_place(memory: Memory, anchors: Iterable[int], node: int, near: float, turn: float) -> int | None:
    """The node, beyond the short-term memory, nearest to a new one.

    Looked for on some anchors, within `near` [m] and `turn` [rad] by the map; None where there is none.
    """
    skeleton = memory.skeleton
    every = np.array([other for anchor in anchors for other in skeleton.on(anchor)[-_LATEST:]], np.int64)
    ids = every[np.isin(skeleton.rows["kept"][every], (Kept.WM, Kept.LTM))]
    here = memory.poses([node])[0]
    if not len(ids):
        return None
    gaps = memory.poses(ids) - here
    away, turned_by = np.hypot(gaps[:, 0], gaps[:, 1]), np.abs(wrap_angles(gaps[:, 2]))
    cost = np.where((away <= near) & (turned_by <= turn), away / max(near, 1e-9) + turned_by / max(turn, 1e-9), np.inf)
    best = int(np.argmin(cost))
    return int(ids[best]) if np.isfinite(cost[best]) else None


def _fit(reference: Reference, scan: ScanPoints, guess: Pose2, settings: MapperSettings) -> Fit:
    if len(scan) < MIN_POINTS:
        return Fit(guess, np.zeros((3, 3)), 0.0)
    pose, information, inliers, _ = refine(scan, reference, guess, guess, np.zeros((3, 3)), settings.matching)
    return Fit(pose, turned(of_match(information, settings.noise), -pose.theta), inliers)
