"""A chair in a plain hall with a known map, driven by the whole stack over the shipped firmware, in lockstep."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from dataclasses import replace
from types import TracebackType
from typing import Self
from unittest.mock import patch

import numpy as np

from waychair.calibration.chair_body import CHAIR_A
from waychair.calibration.fits.dac import DEFAULT
from waychair.maps.drawn.zones import Zone
from waychair.planning.window import dwa
from waychair.runtime.chair import Chair, ChairSettings, ChairState
from waychair.runtime.drive_base import ChairMessage
from waychair.simulation.plan.plan_blocks import fill_rectangle
from waychair.simulation.plan.world import World, world_from_grid
from waychair.simulation.scene.scene import Block, PersonPlan, Pit
from waychair.simulation.sensors.lidar import LidarSettings
from waychair.simulation.simulator import Simulator, SimulatorSettings
from waychair.trials.drive import DriveSetup, advance_tick, simulated_chair, start_drive
from waychair.types import DriveMode, Goal, OccupancyGrid, Pose2

START = Pose2(2.0, 2.5, 0.0)
FAR = Goal(Pose2(10.0, 2.5, 0.0), 0.3, 0.3)
LIDAR = LidarSettings(beams=240)


def coarse_arcs() -> AbstractContextManager[object]:
    """Try only 99 arcs per tick while this is entered: the drives of these tests need no better ones."""
    return patch.multiple(dwa, V_SAMPLES=9, OMEGA_SAMPLES=11)


def hall(people: tuple[PersonPlan, ...] = (), width: float = 5.0) -> World:
    """A hall of 12 m with two cupboards for the place along it; `width` [m] about the chair's way."""
    cells = np.full((100, 240), 100, np.int8)
    half = round(10 * width)
    cells[51 - half : 49 + half, 1:-1] = 0
    cells[51 - half : 55 - half, 60:80] = cells[45 + half : 49 + half, 150:180] = 100
    return replace(world_from_grid(OccupancyGrid(cells, 0.05), START, name="hall"), people=people)


class Ride:
    """A chair under way; `change` makes a fault of the sensors: it maps the messages of a tick."""

    def __init__(
        self,
        settings: ChairSettings | None = None,
        simulator: SimulatorSettings | None = None,
        people: tuple[PersonPlan, ...] = (),
        width: float = 5.0,
        blocks: tuple[Block, ...] = (),
        pits: tuple[Pit, ...] = (),
        zones: tuple[Zone, ...] = (),
        tops: tuple[Block, ...] = (),
    ) -> None:
        """`blocks` and `pits` are in the hall but not on the chair's map, `zones` on the map only.

        `tops` of tables are in the hall and on the map, but not on the part of it that a lidar sees.
        """
        plain = hall(people, width)
        world = replace(plain, blocks=(*plain.blocks, *blocks, *tops), pits=pits)
        simulation = simulator or SimulatorSettings()
        simulation = replace(simulation, lidar=LIDAR, plant=replace(simulation.plant, step_ms=10))
        self.simulator = Simulator(world, CHAIR_A, simulation, 0)
        chair = settings or ChairSettings()
        grid = replace(world.grid, cells=world.grid.cells.copy())
        for top in tops:
            fill_rectangle(grid.cells, grid, top.middle, top.length, top.width)
        scanned = world.grid if tops else None
        self.setup = DriveSetup(grid, {}, CHAIR_A, DEFAULT, chair=chair, zones=zones, scanned=scanned)
        self.change: Callable[[tuple[ChairMessage, ...]], tuple[ChairMessage, ...]] = lambda messages: messages
        self.states: list[ChairState] = []
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        self._stack.enter_context(coarse_arcs())
        self.chair: Chair = self._stack.enter_context(simulated_chair(self.setup, self.simulator))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    def tick(self, count: int = 1) -> ChairState:
        """Run ticks of 50 ms; return the state after the last one."""
        for _ in range(count):
            messages = self.change(tuple(advance_tick(self.simulator, self.chair)))
            self.states.append(self.chair.step(self.simulator.now_ns, messages))
        return self.states[-1]

    def drive(self, ticks: int = 80) -> ChairState:
        """Ask for a goal and confirm it; drive through the two seconds of rest and on."""
        start_drive(self.simulator, self.chair, FAR)
        state = self.tick(ticks)
        assert (state.verdict.mode, state.sent.active) == (DriveMode.AUTONOMOUS, True), state.verdict.reason
        return state

    @property
    def speed(self) -> float:
        """True speed over the ground [m/s]."""
        return self.simulator.twist().v

    @property
    def stands(self) -> bool:
        """Return whether the simulated chair rests."""
        twist = self.simulator.twist()
        return abs(twist.v) < 1e-3 and abs(twist.omega) < 1e-3
