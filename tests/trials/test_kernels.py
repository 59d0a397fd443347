"""All kernels are loaded before a chair drives; loading one during a drive would stop the loop for a second."""

from __future__ import annotations

import gc
from dataclasses import replace
from multiprocessing import get_context

from evaluation.scenes.hazards import setup_of, to_the_lift
from numba.core.dispatcher import Dispatcher

from waychair.simulation.simulator import Simulator
from waychair.trials.demo.demo import randomised_settings
from waychair.trials.drive import advance_tick, simulated_chair, start_drive
from waychair.types import Goal


def kernels() -> set[tuple[str, str, int]]:
    """Return module, name and number of loaded signatures of a chair's kernels in this process."""
    functions = (thing for thing in gc.get_objects() if isinstance(thing, Dispatcher))
    named = {(each.py_func.__module__, each.py_func.__name__, len(each.signatures)) for each in functions}
    return {
        each for each in named if each[0].startswith("waychair.") and not each[0].startswith("waychair.simulation.")
    }


def loaded_while_driving() -> set[tuple[str, str, int]]:
    """Return the kernels loaded during 20 s along a corridor, past people."""
    hazard = to_the_lift(1)
    simulator = Simulator(hazard.world, hazard.body, replace(hazard.sensors, plant=randomised_settings(1).plant), 1)
    with simulated_chair(setup_of(hazard), simulator) as chair:
        start_drive(simulator, chair, Goal(hazard.goals[0].name))
        before = kernels()
        for _ in range(20 * 20):
            messages = advance_tick(simulator, chair)
            chair.step(simulator.now_ns, messages)
        assert chair.ready
        return kernels() - before


def test_no_kernel_is_first_loaded_while_a_chair_drives_past_people() -> None:
    with get_context("spawn").Pool(1) as own_process:
        assert own_process.apply(loaded_while_driving) == set()
