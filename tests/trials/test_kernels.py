"""All kernels are loaded before a chair drives; loading one during a drive would stop the loop for a second."""

from __future__ import annotations

from dataclasses import replace
from multiprocessing import get_context

from evaluation.scenes.hazards import setup_of, to_the_lift

from tests.loaded_kernels import loaded_kernels
from waychair.simulation.simulator import Simulator
from waychair.trials.demo.demo import randomised_settings
from waychair.trials.drive import advance_tick, simulated_chair, start_drive
from waychair.types import Goal


def loaded_while_driving() -> set[tuple[str, str, int]]:
    """Return the kernels loaded during 20 s along a corridor, past people."""
    hazard = to_the_lift(1)
    simulator = Simulator(hazard.world, hazard.body, replace(hazard.sensors, plant=randomised_settings(1).plant), 1)
    with simulated_chair(setup_of(hazard), simulator) as chair:
        start_drive(simulator, chair, Goal(hazard.goals[0].name))
        before = loaded_kernels()
        for _ in range(20 * 20):
            messages = advance_tick(simulator, chair)
            chair.step(simulator.now_ns, messages)
        assert chair.ready
        return loaded_kernels() - before


def test_no_kernel_is_first_loaded_while_a_chair_drives_past_people() -> None:
    with get_context("spawn").Pool(1) as own_process:
        assert own_process.apply(loaded_while_driving) == set()
