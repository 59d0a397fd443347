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
from waychair.slam.nodes import IN_TIME, Kept, Node
from waychair.slam.reference import Reference, reference_from_points
from waychair.slam.scan_matching import refine
from waychair.slam.scan_points import MIN_POINTS, ScanPoints, scan_points
from waychair.types import FloatArray, Pose2, Pose3

_LATEST = 32  # nodes of a key scan that are looked at, however often the chair has come by
_STORED = 4  # links in time to each side of a node of an earlier session whose scans make its surroundings


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


def fit_to_node(memory: Memory, place: int, scan: ScanPoints, guess: Pose2, mapper: Mapper) -> Fit:
    """A scan laid onto what was seen round a node of any session, from a pose in the node's frame."""
    poses = {place: Pose2()}
    for level in memory.skeleton.levels(place, _STORED, IN_TIME):
        for node in level:
            for link in memory.skeleton.links(node, IN_TIME):
                poses.setdefault(link.j, poses[node] @ link.i_from_j)
    matching = mapper.settings.matching
    seen = [
        scan_points(evidence.scan, poses[node] @ evidence.node_from_first, matching.range_max)
        for chunk in memory.evidence(poses)
        for node, evidence in chunk
    ]
    if not seen:
        return Fit(guess, np.zeros((3, 3)), 0.0)
    points, normals = (np.concatenate(parts) for parts in zip(*((s.points, s.normals) for s in seen), strict=True))
    reference = reference_from_points(points, normals, matching.resolution, matching.sigma)
    return _fit(reference, scan, guess, mapper.settings)


def nearest_place(memory: Memory, anchors: Iterable[int], node: int, near: float, turn: float) -> int | None:
    """The node, beyond the short-term memory, nearest to a new one.

    Looked for on some anchors, within `near` [m] and `turn` [rad] by the map; None where there is none.
    """
    skeleton = memory.skeleton
    ids = [other for anchor in anchors for other in list(skeleton.on(anchor))[-_LATEST:]]
    ids = [other for other in ids if skeleton.kept(other) in (Kept.WM, Kept.LTM)]
    here = memory.poses([node])[0]
    if not ids:
        return None
    gaps = memory.poses(ids) - here
    away, turned_by = np.hypot(gaps[:, 0], gaps[:, 1]), np.abs(wrap_angles(gaps[:, 2]))
    cost = np.where((away <= near) & (turned_by <= turn), away / max(near, 1e-9) + turned_by / max(turn, 1e-9), np.inf)
    best = int(np.argmin(cost))
    return ids[best] if np.isfinite(cost[best]) else None


def _fit(reference: Reference, scan: ScanPoints, guess: Pose2, settings: MapperSettings) -> Fit:
    if len(scan) < MIN_POINTS:
        return Fit(guess, np.zeros((3, 3)), 0.0)
    pose, information, inliers, _ = refine(scan, reference, guess, guess, np.zeros((3, 3)), settings.matching)
    return Fit(pose, turned(of_match(information, settings.noise), -pose.theta), inliers)
