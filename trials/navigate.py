"""A simulated chair on a saved map: the world is raised from the map itself."""

from __future__ import annotations

from collections.abc import Sequence

from waychair.calibration.chair import CHAIR_A
from waychair.calibration.dac import DEFAULT
from waychair.simulation.simulator import Simulator
from waychair.simulation.world import world_from_grid
from waychair.trials.demo import chair_of
from waychair.trials.drive import Leg, Setting, drive_to_places
from waychair.types import OccupancyGrid, Place, Pose2


def navigate(grid: OccupancyGrid, start: Pose2, goals: Sequence[Place], seed: int = 0) -> tuple[Leg, ...]:
    """Drives chair A from a start to places in turn.

    Raises:
        WorldError: the chair does not fit at the start, or the start lies outside the map.
    """
    world = world_from_grid(grid, start)
    simulator = Simulator(world, CHAIR_A, chair_of(seed), seed)
    setting = Setting(grid, {place.name: place for place in goals}, CHAIR_A, DEFAULT)
    return drive_to_places(setting, simulator, [place.name for place in goals])
