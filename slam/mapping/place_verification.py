"""Verification of recognised places: the motion between two pictures, and the fit of scans."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from waychair.geometry import wrap_angles
from waychair.slam.camera.features import ImageFeatures
from waychair.slam.graph.information import match_information, rotated_information
from waychair.slam.mapping.loop_candidates import CHAIN_REACH
from waychair.slam.mapping.mapper import LOCAL_REACH, Mapper, MapperSettings
from waychair.slam.memory.memory_manager import NodeMemory
from waychair.slam.memory.nodes import MemoryNode, NodeStatus
from waychair.slam.scan.reference_surfaces import ScanReference
from waychair.slam.scan.scan_matching import refine
from waychair.slam.scan.scan_points import MIN_POINTS, ScanPoints
from waychair.types import FloatArray, Pose2, Pose3

_LATEST = 4  # newest nodes of a key scan that are considered; all of them stand side by side


@dataclass(frozen=True, slots=True)
class ScanFit:
    """The fit of a scan to surfaces: its pose, information (3, 3) in that pose's frame, share of points on them."""

    pose: Pose2
    information: FloatArray
    inliers: float


def features_of(node: MemoryNode) -> ImageFeatures:
    """Return a node's features: pixels, descriptors and points; it keeps nothing else."""
    count = len(node.pixels)
    nothing = np.full(count, np.nan, np.float32)
    return ImageFeatures(
        pixels=node.pixels,
        descriptors=node.descriptors,
        points=node.points,
        response=nothing,
        octave=np.zeros(count, np.uint8),
        angle=nothing,
    )


def motion_of_base(old_from_new: Pose3, base_from_camera: Pose3) -> Pose2:
    """Return the chair's planar motion from that of its camera."""
    return (base_from_camera @ old_from_new @ base_from_camera.inverse()).planar()


def fit_to_keys(mapper: Mapper, key: int, scan: ScanPoints, guess: Pose2) -> ScanFit:
    """Fit a scan to the surfaces of a key scan and its reliably connected neighbours, from a guessed pose in map."""
    keys, settings = mapper.keys, mapper.settings
    members = sorted(keys.path_lengths(key, CHAIN_REACH))
    reference = keys.reference(members, keys.poses[key], LOCAL_REACH, settings.matching.resolution)
    return _fit(reference, scan, guess, settings)


def nearest_place(memory: NodeMemory, anchors: Iterable[int], node: int, near: float, turn: float) -> int | None:
    """Return the node outside the short-term memory that is nearest to a node, or None.

    Only nodes of the given anchors count, within `near` [m] and `turn` [rad] in the map.
    """
    skeleton = memory.skeleton
    every = np.array([other for anchor in anchors for other in skeleton.attached_to(anchor)[-_LATEST:]], np.int64)
    ids = every[np.isin(skeleton.rows["kept"][every], (NodeStatus.WM, NodeStatus.LTM))]
    here = memory.poses([node])[0]
    if not len(ids):
        return None
    gaps = memory.poses(ids) - here
    away, turned_by = np.hypot(gaps[:, 0], gaps[:, 1]), np.abs(wrap_angles(gaps[:, 2]))
    cost = np.where((away <= near) & (turned_by <= turn), away / max(near, 1e-9) + turned_by / max(turn, 1e-9), np.inf)
    best = int(np.argmin(cost))
    return int(ids[best]) if np.isfinite(cost[best]) else None


def _fit(reference: ScanReference, scan: ScanPoints, guess: Pose2, settings: MapperSettings) -> ScanFit:
    if len(scan) < MIN_POINTS:
        return ScanFit(guess, np.zeros((3, 3)), 0.0)
    pose, information, inliers, _ = refine(
        scan=scan,
        reference=reference,
        start=guess,
        guess=guess,
        guess_information=np.zeros((3, 3)),
        settings=settings.matching,
    )
    return ScanFit(pose, rotated_information(match_information(information), -pose.theta), inliers)
