"""Localisation of a recording on a saved map: its trajectory, and a report with the fit of its scans."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from waychair import __version__, config
from waychair.config import Settings
from waychair.errors import NoScans
from waychair.files import write_json
from waychair.offline.aids import CheckedRecording, checked_recording
from waychair.offline.mapping import peak_memory_mb
from waychair.recordings.recording import InputSettings, Recording, write_tum
from waychair.slam.localising.localiser import Localisation, LocalisationState, Localiser, LocaliserSettings
from waychair.types import Json, OccupancyGrid, Odometry, Pose2, SensorFrame, Trajectory, Twist


@dataclass(frozen=True, slots=True)
class LocalisingSettings(Settings):
    """All settings of `waychair localize`."""

    input: InputSettings = field(default_factory=InputSettings)
    localiser: LocaliserSettings = field(default_factory=LocaliserSettings)


@dataclass(frozen=True, slots=True)
class LocalisedRecording:
    """A localised recording: a pose for each frame with a scan, and the content of report.json."""

    trajectory: Trajectory
    report: Json


def localise_recording(
    recording: Recording,
    grid: OccupancyGrid,
    settings: LocalisingSettings,
    start: Pose2 | None = None,
    progress: Callable[[float], None] | None = None,
    checking: Callable[[float], None] | None = None,
) -> LocalisedRecording:
    """Localise a recording from its start pose in map or, without one, by a search over the whole map.

    The trajectory holds the poses by scan matching, without the frames at which the chair is lost. `progress` is called
    with the share of frames done; before, `checking` with the share of the scans by which odometry and IMU are checked.

    Raises:
        NoScans: the recording has no frame with a scan.
    """
    cpu, wall = time.process_time(), time.monotonic()
    checked = checked_recording(recording, settings.localiser.matching.range_max, checking)
    recording = replace(checked.recording, warnings=(*recording.warnings, *checked.sentences))
    checking_cpu_s = time.process_time() - cpu
    frames = [frame for frame in recording.frames if frame.scan is not None]
    if not frames:
        raise NoScans(f"{recording.path} holds no laser scan, so the drive cannot be localised")
    localiser = Localiser(grid, recording.base_from_laser, start, settings.localiser)
    found: list[Localisation] = []
    for index, frame in enumerate(frames):
        assert frame.scan is not None
        odom_from_base, twist = _reckoned(frame, found)
        found.append(localiser.process(frame.scan, odom_from_base, twist))
        if progress is not None:
            progress((index + 1) / len(frames))
    known = [(frame.stamp_ns, _pose(where)) for frame, where in zip(frames, found, strict=True) if not where.lost]
    stamps = np.array([stamp for stamp, _ in known], np.int64)
    trajectory = Trajectory(stamps, np.array([pose.array() for _, pose in known]).reshape(-1, 3))
    total = time.process_time() - cpu
    stages = {"checking": checking_cpu_s, "localising": total - checking_cpu_s, "total": total}
    duration_s = (frames[-1].stamp_ns - frames[0].stamp_ns) * 1e-9
    report = _report(recording, checked, trajectory, found) | {
        "duration_s": round(duration_s, 3),
        "times_real_time": round(duration_s / max(time.monotonic() - wall, 1e-3), 1),
        "cpu_seconds": {stage: round(value, 3) for stage, value in stages.items()},
    }
    return LocalisedRecording(trajectory, report)


def save_localised(folder: Path, localised: LocalisedRecording, settings: LocalisingSettings) -> None:
    """Write trajectory.tum, config.yaml and report.json, each atomically.

    Raises:
        OutputError: the folder cannot be written to.
    """
    write_tum(folder / "trajectory.tum", localised.trajectory)
    config.save(settings, folder / "config.yaml")
    write_json(folder / "report.json", localised.report)


def _reckoned(frame: SensorFrame, found: list[Localisation]) -> tuple[Pose2, Twist | None]:
    """Return `odom_from_base` and twist of a frame; without odometry, assume the motion between the last two scans."""
    own = [reading for reading in frame.wheels if isinstance(reading, Odometry)]
    if own:
        return own[-1].odom_from_base, own[-1].twist
    if not found:
        return Pose2(), None
    last = found[-1]
    before = last if last.jumped or len(found) == 1 else found[-2]
    # without odometry the frame odom may jump, so it is extrapolated from the pose by scan matching
    reckoned = last.map_from_odom.inverse() @ _pose(last)
    return reckoned @ (_pose(before).inverse() @ _pose(last)), None


def _pose(found: Localisation) -> Pose2:
    """Return the pose by scan matching; the published pose follows it in small steps."""
    return found.map_from_base @ found.remaining


def _report(recording: Recording, checked: CheckedRecording, trajectory: Trajectory, found: list[Localisation]) -> Json:
    states = [localisation.state for localisation in found]
    inliers = np.array([localisation.inliers for localisation in found])
    poses = trajectory.poses
    return {
        "waychair": __version__,
        "input": str(recording.path),
        "parts": [str(part) for part in recording.parts],
        "source": recording.source,
        "warnings": list(recording.warnings),
        "health": [*(found.as_json() for found in recording.findings), *checked.health()],
        "aids": checked.data(),
        "frames": len(found),
        "distance_m": round(float(np.hypot(*np.diff(poses[:, :2], axis=0).T).sum()), 3),
        "states": {state.value: states.count(state) for state in LocalisationState},
        "found_anew": sum(localisation.jumped for localisation in found),
        "first_known_stamp_s": round(int(trajectory.stamps_ns[0]) * 1e-9, 6) if len(poses) else None,
        "mean_inliers": round(float(inliers.mean()), 4),
        "least_inliers": round(float(inliers.min()), 4),
        "peak_memory_mb": round(peak_memory_mb(), 1),
    }
