"""Conversion of grid maps to and from nav_msgs/OccupancyGrid."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from waychair.errors import MessageError
from waychair.recordings.bags.ros_messages import MAP_FRAME, header, make
from waychair.recordings.bags.ros_transforms import stamp_ns as nanoseconds
from waychair.ros.messages.motion import pose, read_pose
from waychair.ros.messages.wire import require_frame
from waychair.types import UNKNOWN, OccupancyGrid

_OCCUPIED = 100


def occupancy_grid(stamp_ns: int, grid: OccupancyGrid, frame: str = MAP_FRAME, loaded_ns: int = 0) -> Any:
    """Return a nav_msgs/OccupancyGrid, row 0 at the lower edge; `loaded_ns`: when the map was loaded, 0 while it is made."""
    height, width = grid.cells.shape
    head = header(stamp_ns, frame)
    loaded = header(loaded_ns, frame).stamp
    info = make("nav_msgs/msg/MapMetaData", loaded, grid.resolution, width, height, pose(grid.map_from_grid))
    return make("nav_msgs/msg/OccupancyGrid", head, info, np.ascontiguousarray(grid.cells, np.int8).ravel())


def read_loaded_grid(message: Any) -> tuple[OccupancyGrid, int]:
    """Return the grid as `read_occupancy_grid`, and when it was loaded [ns], which is the revision of its floor.

    Raises:
        MessageError: as `read_occupancy_grid`.
    """
    return read_occupancy_grid(message), nanoseconds(message.info.map_load_time)


def read_occupancy_grid(message: Any) -> OccupancyGrid:
    """Return the grid of a nav_msgs/OccupancyGrid in map; the float32 resolution is rounded to 7 digits.

    Raises:
        MessageError: another frame, a wrong number of cells, cells outside -1..100, or an invalid resolution.
    """
    require_frame(message, MAP_FRAME)
    info = message.info
    # A copy: a read-only array, as messages have, would make numba compile the kernels again, in a drive's first tick.
    cells = np.array(message.data, np.int8)
    if len(cells) != info.width * info.height or not len(cells):
        raise MessageError(f"a map of {info.width} x {info.height} cells holds {len(cells)}: restart its sender")
    low, high = int(cells.min()), int(cells.max())
    if low < UNKNOWN or high > _OCCUPIED:
        raise MessageError(f"a map's cells lie in {low}..{high}: they must be -1 (unknown) or 0..100 %")
    resolution = float(info.resolution)
    if not (math.isfinite(resolution) and resolution > 0.0):
        raise MessageError(f"a map's resolution of {resolution:g} m is impossible: restart its sender")
    return OccupancyGrid(cells.reshape(info.height, info.width), float(f"{resolution:.7g}"), read_pose(info.origin))
