"""The building in which a live chair travels: one of a folder, or that of a world of several levels."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from waychair.calibration.chair_body import CHAIR_A
from waychair.errors import BuildingError
from waychair.maps.building.building import load_building
from waychair.simulation.plan.world import load_levels
from waychair.trials.live.live_journeys import LiveBuilding
from waychair.trials.travel.building_drive import raised_worlds
from waychair.trials.travel.world_building import building_of_world

PASSENGERS = 1
"""People who ride a building's lifts all the time."""


@contextmanager
def live_building(
    world: str | Path, folder: Path | None = None, map_folder: Path | None = None, *, people: bool = True
) -> Iterator[LiveBuilding | None]:
    """Yield the building in a folder, else that of a world, made for the time of the block; None for one map only.

    `map_folder`: the chair drives on this map alone. `people`: with the world's people, and one who rides the lifts.

    Raises:
        BuildingError: both folders are given, or there is no building in the folder.
        WorldError: there is no such world, or a lift's cabin is not free on a map.
    """
    if folder is not None and map_folder is not None:
        raise BuildingError("a chair drives in a building or on one map: give --building or --map")
    if folder is not None:
        building = load_building(folder)
        yield LiveBuilding(building, raised_worlds(building), PASSENGERS if people else 0)
        return
    levels = () if map_folder is not None else load_levels(world)
    if len(levels) < 2 or not any(level.lifts for level in levels):
        yield None
        return
    with tempfile.TemporaryDirectory(prefix="waychair-") as name:
        building = building_of_world(levels, Path(name), CHAIR_A)
        if not people:
            levels = tuple(level.without_people() for level in levels)
        yield LiveBuilding(building, levels, PASSENGERS if people else 0)
