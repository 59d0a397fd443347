"""The map of a recording, as the mapper gives it."""

from __future__ import annotations

from dataclasses import dataclass

from waychair.slam.graph.graph_optimisation import Edge, RejectedLoop
from waychair.types import FloatArray, Trajectory


@dataclass(frozen=True, slots=True)
class MapperResult:
    """The map of a recording.

    `trajectory` has one pose per frame, in the order of the input. Key scan k has pose `key_poses[k]` (N, 3) and is the
    scan of frame `key_frames[k]`. The grid is drawn from `scan_frames`: the key scans and the latest scans that they
    cover, in order of time. `counts` and `seconds` (CPU) by stage are for the report. The first `earlier_frames` frames are kept
    from earlier drives.
    """

    trajectory: Trajectory
    key_poses: FloatArray
    key_frames: tuple[int, ...]
    scan_frames: tuple[int, ...]
    edges: tuple[Edge, ...]
    rejected: tuple[RejectedLoop, ...]
    counts: dict[str, int]
    seconds: dict[str, float]
    earlier_frames: int = 0

    @property
    def drive_trajectory(self) -> Trajectory:
        """The trajectory of this drive, without frames of earlier drives."""
        return Trajectory(
            self.trajectory.stamps_ns[self.earlier_frames :], self.trajectory.poses[self.earlier_frames :]
        )
