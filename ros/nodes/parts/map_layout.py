"""The map that a node drives on, with its places and zones, which follows the floor that is told."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path as FilePath

from waychair.calibration.calibration_file import ChairCalibration
from waychair.maps.drawn.places import load_places
from waychair.maps.drawn.zones import Zone, load_zones
from waychair.maps.folders.depth_layer import load_depth_layer, scanned_part
from waychair.maps.folders.map_drawing import DrawnFiles
from waychair.maps.grid.cells import unscanned_points
from waychair.ros.messages.floor import NO_REVISION, Floor
from waychair.runtime.pilot import Pilot, PilotSettings
from waychair.types import Goal, OccupancyGrid, Place, Pose2


@dataclass(slots=True)
class MapLayout:
    """The map in `folder` with its places and zones; `next_grid` waits for the end of the current drive, `drawn` is their files.

    `revision`: of the floor whose map the pilot has. `floor`: the one told last, until its map has come as well; `loaded_ns`:
    when the map that came last was loaded.
    """

    places: dict[str, Place]
    zones: tuple[Zone, ...]
    folder: FilePath | None = None
    grid: OccupancyGrid | None = None
    next_grid: OccupancyGrid | None = None
    drawn: DrawnFiles | None = None
    revision: int = NO_REVISION
    floor: Floor | None = None
    loaded_ns: int = 0

    @property
    def waits(self) -> bool:
        """Whether the map that came last is of a floor that has not been told yet."""
        return self.floor is not None and self.loaded_ns != self.revision

    def goal_at(self, pose: Pose2) -> Goal:
        """Return the goal at a pose, with the tolerances of the place there if there is one."""
        for place in self.places.values():
            if math.hypot(place.pose.x - pose.x, place.pose.y - pose.y) < 0.01:
                return Goal(pose, place.tolerance_m, place.tolerance_rad)
        return Goal(pose)

    def pilot_on(self, grid: OccupancyGrid, calibration: ChairCalibration, settings: PilotSettings) -> Pilot:
        """Take a map, and return a pilot on it with the places and zones.

        Raises:
            MapError: the depth layer of the map's folder is damaged, or belongs to another map.
        """
        layer = None if self.folder is None else load_depth_layer(self.folder, grid)
        self.grid = grid
        return Pilot(
            grid=grid,
            places=self.places,
            body=calibration.body,
            settings=settings,
            stops=calibration.stops,
            zones=self.zones,
            tops=unscanned_points(grid, scanned_part(grid, layer)),
        )

    def follow(self) -> bool:
        """Take the floor that was told last once its map has come, too; return whether it is another one.

        Raises:
            PlaceError, ZoneError: its places or zones are damaged; then nothing changes.
        """
        told = self.floor
        if told is None or told.revision in (self.revision, NO_REVISION) or told.revision != self.loaded_ns:
            return False
        folder = FilePath(told.map_folder)
        self.places, self.zones = load_places(folder), load_zones(folder)
        self.folder, self.revision, self.drawn = folder, told.revision, DrawnFiles(folder)
        self.next_grid = self.grid if self.next_grid is None else self.next_grid
        return True


def first_layout(map_folder: str) -> MapLayout:
    """Return the layout of the map folder that the node was started with.

    Raises:
        PlaceError, ZoneError: the places or zones of the map are damaged.
    """
    if not map_folder:
        return MapLayout({}, ())
    folder = FilePath(map_folder)
    return MapLayout(load_places(folder), load_zones(folder), folder, drawn=DrawnFiles(folder))
