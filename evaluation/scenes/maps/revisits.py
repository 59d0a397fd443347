"""Scores of loop closure: drives with revisits, recorded with a camera and mapped with and without it.

The figures (two poses are at the same place if they are truly within 1 m and 30 degrees):

- A node is *at a true revisit* if an earlier node is at the same place and has left the short-term memory (it is more
  than 30 s older). Recall is the share of those nodes that the memory links to a node at that place, by a loop closure
  by appearance or by proximity (RTAB-Map's term), both checked by the lidar.
- A *revisit* is a stretch of the drive with nodes at true revisits, ended by 10 other nodes. It is closed if one of its
  nodes is linked. Revisits in the opposite direction, which a camera cannot recognise, are counted separately: they are
  closed if the map's relative pose of the two visits is right.
- A link or a loop edge is *false* if its relative pose is wrong by more than 0.5 m or 15 degrees.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from waychair.calibration.chair_body import CHAIR_A
from waychair.geometry import compose, invert, pose_from_array, wrap_angles
from waychair.offline.appearance_mapping import MemoryBuilder
from waychair.recordings.recording import read_recording
from waychair.simulation.plan.world import load_world
from waychair.simulation.sensors.camera import CameraSettings
from waychair.simulation.simulator import Simulator, SimulatorSettings, with_all_sensors
from waychair.slam.graph.edges import EdgeKind
from waychair.slam.mapping.appearance_loops import AppearanceLoopClosure
from waychair.slam.mapping.appearance_settings import AppearanceSettings
from waychair.slam.mapping.live_mapping import LiveMapping, LiveMappingSettings
from waychair.slam.mapping.mapper_result import MapperResult
from waychair.slam.memory.nodes import LOOPS, LinkKind
from waychair.slam.trajectory_errors import poses_at, truth_errors
from waychair.trials.record import drive_route, true_trajectory
from waychair.types import BoolArray, FloatArray, IntArray, Json, Pose2, Trajectory

_NEAR, _TURN, _BEFORE_NS = 1.0, np.radians(30.0), 30_000_000_000
_WRONG, _WRONG_TURN = 0.5, np.radians(15.0)
_PAUSE = 10


@dataclass(frozen=True, slots=True)
class MappedDrive:
    """A mapped drive, with its memory of places (None without camera) and the true trajectory."""

    result: MapperResult
    appearance: AppearanceLoopClosure | None
    truth: Trajectory


def record_drive(
    world: str, bag: Path, rate_hz: float, route: FloatArray | None = None, camera: CameraSettings | None = None
) -> None:
    """Record a drive along a route of a world (by default its mapping route) with pictures at `rate_hz`."""
    place = load_world(world)
    settings = with_all_sensors(SimulatorSettings())
    settings = dataclasses.replace(
        settings,
        sonar=dataclasses.replace(settings.sonar, rate_hz=0.0),
        camera=dataclasses.replace(camera or settings.camera, rate_hz=rate_hz),
    )
    simulator = Simulator(place, CHAIR_A, settings)
    drive_route(simulator, CHAIR_A, place.routes["mapping"] if route is None else route, bag)


def map_drive(bag: Path, *, camera: bool = True, settings: AppearanceSettings | None = None) -> MappedDrive:
    """Map a recorded drive, with its memory in RAM."""
    recording = read_recording(bag)
    live = LiveMapping(LiveMappingSettings(), recording.base_from_laser)
    appearance = AppearanceLoopClosure(settings or AppearanceSettings(), CHAIR_A.base_from_camera) if camera else None
    making = None if appearance is None else MemoryBuilder(appearance, recording.pictures())
    for frame in map(live.reckon, recording.frames):
        live.mapper.process(frame)
        if making is not None:
            making.follow(live.mapper, frame)
    result = live.mapper.result()
    if appearance is not None:
        appearance.finish(live.mapper)
    return MappedDrive(result, appearance, true_trajectory(bag))


def trajectory_error(drive: MappedDrive) -> float:
    """Return the absolute trajectory error [m], root mean square."""
    return round(truth_errors(drive.result.trajectory, drive.truth).rmse_m, 4)


def score(drive: MappedDrive) -> Json:
    """Return revisits, recall and false loops of a drive with camera."""
    assert drive.appearance is not None
    memory = drive.appearance.memory
    ids = np.array(memory.skeleton.ids())
    stamps = memory.skeleton.rows["stamp_ns"][ids]
    poses = poses_at(drive.truth.stamps_ns, drive.truth.poses, stamps)
    same, reversed_ = _same_places(poses, stamps)
    row = {int(node): k for k, node in enumerate(ids)}
    linked = np.zeros(len(ids), bool)
    for k, node in enumerate(ids.tolist()):
        partners = (row[other] for other in memory.skeleton.neighbours(node, LOOPS))
        linked[k] = any(same[k, other] for other in partners if other < k)
    at_revisit: BoolArray = np.logical_or.reduce(same, axis=1)
    turned: BoolArray = np.logical_or.reduce(reversed_, axis=1)
    passes = _stretches(at_revisit)
    back = _stretches(turned & ~at_revisit)
    right = _right_poses(drive, ids, poses, reversed_)
    kinds = [link.kind for link in memory.skeleton.every_link()]
    return {
        "nodes": len(ids),
        "at_revisits": int(at_revisit.sum()),
        "recall": round(float(linked[at_revisit].mean()), 4) if at_revisit.any() else 1.0,
        "revisits": len(passes),
        "closed": sum(bool(linked[stretch].any()) for stretch in passes),
        "revisits_reversed": len(back),
        "closed_reversed": sum(bool(right[stretch].any()) for stretch in back),
        "by_appearance": kinds.count(LinkKind.GLOBAL),
        "on_known_ground": kinds.count(LinkKind.SPACE),
        "loop_edges": sum(edge.kind is EdgeKind.LOOP for edge in drive.result.edges),
        "edges_by_appearance": drive.result.counts.get("loops_sighted", 0),
        "refused": len(drive.appearance.refused),
        "false_links": _false_links(drive),
        "false_edges": _false_edges(drive),
    }


def _same_places(poses: FloatArray, stamps: IntArray) -> tuple[BoolArray, BoolArray]:
    """Return (N, N) whether node k is where an older node i < k was: in the same direction, and in others."""
    away = np.hypot(*(poses[:, None, :2] - poses[None, :, :2]).transpose(2, 0, 1))
    turned = np.abs(wrap_angles((poses[:, None, 2] - poses[None, :, 2]).ravel())).reshape(away.shape)
    near = (away < _NEAR) & (stamps[:, None] - stamps[None, :] > _BEFORE_NS)
    return near & (turned < _TURN), near & (turned >= _TURN)


def _stretches(inside: BoolArray) -> list[IntArray]:
    """Return the true rows in groups; gaps within a group have at most `_PAUSE` rows."""
    rows = np.flatnonzero(inside)
    return [group for group in np.split(rows, np.flatnonzero(np.diff(rows) > _PAUSE) + 1) if len(group)]


def _right_poses(drive: MappedDrive, ids: IntArray, poses: FloatArray, again: BoolArray) -> BoolArray:
    """Return (N,) whether the map's relative pose of a node to a node that it revisits is right."""
    assert drive.appearance is not None
    memory = drive.appearance.memory
    found = memory.poses(ids.tolist())
    right = np.zeros(len(ids), bool)
    for k, i in zip(*np.nonzero(again), strict=True):
        true, own = (compose(invert(each[i : i + 1]), each[k : k + 1]) for each in (poses, found))
        gap = compose(invert(true), own)[0]
        right[k] |= bool(np.hypot(gap[0], gap[1]) < _WRONG and abs(gap[2]) < _WRONG_TURN)
    return right


def _false_links(drive: MappedDrive) -> int:
    assert drive.appearance is not None
    skeleton = drive.appearance.memory.skeleton
    links = [link for link in skeleton.every_link() if link.kind in LOOPS]
    stamps = skeleton.rows["stamp_ns"]
    begin, end = stamps[[link.i for link in links]], stamps[[link.j for link in links]]
    return _count_false(drive.truth, begin, end, [link.i_from_j for link in links])


def _false_edges(drive: MappedDrive) -> int:
    stamps = drive.result.trajectory.stamps_ns[list(drive.result.key_frames)]
    edges = [edge for edge in drive.result.edges if edge.kind is EdgeKind.LOOP]
    begin, end = stamps[[edge.i for edge in edges]], stamps[[edge.j for edge in edges]]
    return _count_false(drive.truth, begin, end, [edge.i_from_j for edge in edges])


def _count_false(truth: Trajectory, from_ns: IntArray, to_ns: IntArray, measured: list[Pose2]) -> int:
    """Return the number of measured relative poses between two stamps that are wrong."""
    count = 0
    ends = (poses_at(truth.stamps_ns, truth.poses, stamps) for stamps in (from_ns, to_ns))
    for a, b, found in zip(*ends, measured, strict=True):
        gap = (pose_from_array(a).inverse() @ pose_from_array(b)).inverse() @ found
        count += bool(np.hypot(gap.x, gap.y) > _WRONG or abs(gap.theta) > _WRONG_TURN)
    return count
