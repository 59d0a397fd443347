"""The simulator: simulated seconds per second of processor time, for both plants, with and without the lidar.

    python -m benchmarks.simulation

Medians in one process, the rider driving back and forth by joystick in the small clinic and in a hall of a thousand
pillars; the figure of one core, whatever else the machine does.
"""

from __future__ import annotations

import statistics
import time
from dataclasses import replace

import numpy as np

from waychair.calibration.chair import CHAIR_A
from waychair.simulation.lidar import LidarSettings
from waychair.simulation.simulator import PLANT_MODELS, Simulator, SimulatorSettings
from waychair.simulation.world import World, load_world, world_from_grid
from waychair.types import JoystickInput, OccupancyGrid, Pose2

RUNS = 9
LEG_NS = 2_000_000_000
BLIND = LidarSettings(beams=2)
"""The least there can be, so that what is left is the plant."""


def pillars(count: int = 1000) -> World:
    """A hall of 40 x 40 m with so many pillars of 10 cm, none of them within 5 m of the chair."""
    cells = np.zeros((800, 800), np.int8)
    rng = np.random.default_rng(0)
    placed = 0
    while placed < count:
        row, col = rng.integers(0, 798, 2).tolist()
        if max(abs(row - 400), abs(col - 400)) > 100:
            cells[row : row + 2, col : col + 2] = 100
            placed += 1
    return world_from_grid(OccupancyGrid(cells, 0.05), Pose2(20.0, 20.0, 0.0), name="pillars")


def speed(world: World, settings: SimulatorSettings) -> float:
    """Median simulated seconds per processor second, after a first leg that may compile."""
    simulator = Simulator(world, CHAIR_A, settings)
    speeds = []
    for run in range(RUNS + 1):
        simulator.rider = JoystickInput(simulator.now_ns, 0.4 if run % 2 == 0 else -0.4)
        started = time.process_time_ns()
        simulator.advance(LEG_NS)
        speeds.append(LEG_NS / (time.process_time_ns() - started))
    return statistics.median(speeds[1:])


def main() -> None:
    """Print the table."""
    print(f"{'world':<14}{'plant':<12}{'lidar 720 x 10 Hz':>18}{'no lidar':>12}")
    for world in (load_world("small_clinic"), pillars()):
        for model in PLANT_MODELS:
            settings = SimulatorSettings(plant_model=model)
            seeing, blind = speed(world, settings), speed(world, replace(settings, lidar=BLIND))
            print(f"{world.name:<14}{model:<12}{seeing:>17.0f}x{blind:>11.0f}x")


if __name__ == "__main__":
    main()
