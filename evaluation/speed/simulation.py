"""The simulator's speed: simulated seconds per processor second, for both plants and growing sets of sensors.

    python -m evaluation.speed.simulation

Medians in one process: a rider drives back and forth by joystick on the second floor, with and without people, and in
a hall of a thousand pillars. The figures are for one core, independent of other load.
"""

from __future__ import annotations

import statistics
import time
from dataclasses import replace

import numpy as np

from waychair.calibration.chair_body import CHAIR_A
from waychair.simulation.plan.world import World, load_world, world_from_grid
from waychair.simulation.sensors.imu import ImuSettings
from waychair.simulation.sensors.lidar import LidarSettings
from waychair.simulation.simulator import PLANT_MODELS, Simulator, SimulatorSettings, with_all_sensors
from waychair.types import JoystickInput, OccupancyGrid, Pose2

RUNS = 9
LEG_NS = 2_000_000_000
BLIND = LidarSettings(beams=2)
"""The fewest beams, so that the plant dominates the time."""


def suites(settings: SimulatorSettings) -> dict[str, SimulatorSettings]:
    """Return the sets of sensors, by column name."""
    return {
        "plant alone": replace(settings, lidar=BLIND),
        "lidar only": settings,
        "lidar, IMU": replace(settings, imu=ImuSettings(rate_hz=200.0)),
        "full suite": with_all_sensors(settings),
    }


def pillars(count: int = 1000) -> World:
    """Return a hall of 40 x 40 m with `count` pillars of 10 cm, none within 5 m of the chair."""
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
    """Return the median of simulated seconds per processor second, after a first drive that may compile."""
    simulator = Simulator(world, CHAIR_A, settings)
    speeds = []
    for run in range(RUNS + 1):
        simulator.rider = JoystickInput(simulator.now_ns, 0.4 if run % 2 == 0 else -0.4)
        started = time.process_time_ns()
        simulator.advance(LEG_NS)
        speeds.append(LEG_NS / (time.process_time_ns() - started))
    return statistics.median(speeds[1:])


def main() -> None:
    """Print the table of real-time factors per core; the full suite has pictures of 640 x 480 at 15 Hz."""
    floor = load_world("second_floor")
    worlds = {"second_floor": floor, "without people": floor.without_people(), "pillars": pillars()}
    print(f"{'world':<16}{'plant':<12}" + "".join(f"{name:>14}" for name in suites(SimulatorSettings())))
    for name, world in worlds.items():
        for model in PLANT_MODELS:
            figures = [speed(world, suite) for suite in suites(SimulatorSettings(plant_model=model)).values()]
            print(f"{name:<16}{model:<12}" + "".join(f"{figure:>13.1f}x" for figure in figures))


if __name__ == "__main__":
    main()
