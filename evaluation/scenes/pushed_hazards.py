"""Hazards before a driver who pushes the stick forward without a pause, at the level guard: stairs down, the edge of a table, a
glass door, somebody who steps out. Nobody advises this driver, who overrides the guard by the push itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from evaluation.scenes.hazards import (
    ContactCause,
    Hazard,
    Protection,
    contact_cause,
    hall_plan,
    least_to_drop_off,
    least_to_people,
    map_of_lidar,
    sensors_for,
    setup_of,
)
from waychair.simulation.plan.floor_plan import PlanPit
from waychair.simulation.plan.world import World, world_from_plan
from waychair.simulation.scene.scene import Block, PersonBehaviour, PersonPlan
from waychair.trials.demo.demo import randomised_settings
from waychair.trials.drive import TICK_NS, simulated_chair
from waychair.trials.guiding.helped_chair import HelpedChair
from waychair.trials.ride import RecordingSimulator
from waychair.types import HelpLevel, JoystickInput, Pose2

LENGTH, WIDTH = 9.0, 3.0
"""m; the hall of these scenes."""

PUSH_S = 18.0
"""s of the push: the way to the hazard, the board's override with its warning, and a little more."""


@dataclass(frozen=True, slots=True)
class PushedRun:
    """One run: falls, contacts of the chair's own motion with their speeds [m/s], and whether the push became an override.

    `distance_m` driven [m]; `drop_off_m`, `person_m`: least distances [m], as in `HazardResult`. `reason`: why it did not begin.
    """

    falls: int
    contact_speeds: tuple[float, ...]
    bumped: int
    overridden: bool
    distance_m: float
    drop_off_m: float
    person_m: float
    reason: str = ""


def stairs_down(seed: int) -> Hazard:
    """Return a hall whose far half is a stairwell; the depth camera looks ahead."""
    rng = np.random.default_rng(seed)
    edge = float(rng.uniform(5.0, 6.0))
    plan = hall_plan((LENGTH, WIDTH), [PlanPit(((edge + LENGTH) / 2, WIDTH / 2), (LENGTH - edge, WIDTH))])
    return _hazard("stairs down", world_from_plan(plan, "stairs"), rng, Protection.CAMERA)


def table_edge(seed: int) -> Hazard:
    """Return a hall with a table's top across it, above the lidar and not on its map; the depth camera looks ahead."""
    rng = np.random.default_rng(seed)
    top = _table_top(rng, seed)
    hazard = _hazard("table edge", _hall(), rng, Protection.CAMERA)
    return replace(hazard, world=_with(hazard.world, top))


def mapped_table(seed: int) -> Hazard:
    """Return a hall with a table's top across it, above the lidar, which the map has; no other sensor shows it."""
    rng = np.random.default_rng(seed)
    hazard = _hazard("mapped table", _hall(), rng, Protection.NOTHING)
    world = _with(hazard.world, _table_top(rng, seed))
    return replace(hazard, world=world, grid=map_of_lidar(world), scanned=hazard.grid)


def _table_top(rng: np.random.Generator, seed: int) -> Block:
    return Block(Pose2(float(rng.uniform(5.0, 6.5)), WIDTH / 2), 0.8, 2.4, 0.66, 0.72, "wood", seed)


def glass_door(seed: int) -> Hazard:
    """Return a hall with a pane across it, through which the lidar looks; sonars look ahead."""
    rng = np.random.default_rng(seed)
    turned = math.pi / 2 + float(rng.uniform(-0.3, 0.3))
    pane = Block(Pose2(float(rng.uniform(5.0, 6.5)), WIDTH / 2, turned), 1.1 * WIDTH, 0.02, 0.0, 2.1, "glass")
    return _hazard("glass door", _with(_hall(), pane), rng, Protection.SONAR)


def steps_out(seed: int) -> Hazard:
    """Return a hall in which somebody steps out from the side into the chair's lane, and stands there."""
    rng = np.random.default_rng(seed)
    x, side = float(rng.uniform(4.5, 6.0)), float(rng.choice([-1.0, 1.0]))
    path = np.array([[x, WIDTH / 2 + 1.2 * side], [x, WIDTH / 2 + float(rng.uniform(-0.3, 0.3))]])
    person = PersonPlan(
        PersonBehaviour.SUDDEN,
        path,
        speed=float(rng.uniform(0.8, 1.4)),
        yields=False,
        trigger=float(rng.uniform(2.0, 3.0)),
    )
    return _hazard("steps out", replace(_hall(), people=(person,)), rng, Protection.NOTHING)


PUSHED: Mapping[str, Callable[[int], Hazard]] = {
    "stairs down": stairs_down,
    "table edge": table_edge,
    "mapped table": mapped_table,
    "glass door": glass_door,
    "steps out": steps_out,
}
"""The hazards by name; each takes a seed."""


def run_pushed(name: str, seed: int) -> PushedRun:
    """Let the driver choose the guard, wait until the board guards, and push.

    Raises:
        BoardBuildError: the firmware cannot be built: no C compiler.
    """
    hazard = PUSHED[name](seed)
    plant = replace(hazard.sensors, plant=randomised_settings(seed).plant)
    simulator = RecordingSimulator(hazard.world, hazard.body, plant, seed)
    aside = float(np.random.default_rng(seed).uniform(-0.03, 0.03))
    overridden = False
    with simulated_chair(setup_of(hazard), simulator) as chair:
        helped = HelpedChair(simulator, chair)
        for _ in helped.begin(HelpLevel.GUARD):
            pass
        guards = helped.guards
        for _ in range(round(PUSH_S * 1e9 / TICK_NS) if guards else 0):
            simulator.rider = JoystickInput(simulator.now_ns, 1.0, aside)
            helped.tick()
            telemetry = chair.bridge.telemetry
            overridden |= telemetry is not None and telemetry.guard is not None and telemetry.guard.overridden
        told = chair.level_told if not guards or chair.level is not HelpLevel.GUARD else ""
    motion = simulator.motion()
    causes = [
        (contact_cause(contact, hazard.world, hazard.body, motion), contact.speed)
        for contact in simulator.contact_reports
    ]
    steps = np.diff(motion.poses[:, :2], axis=0)
    return PushedRun(
        falls=sum(cause is ContactCause.EDGE for cause, _ in causes),
        contact_speeds=tuple(speed for cause, speed in causes if cause not in (ContactCause.EDGE, ContactCause.BUMPED)),
        bumped=sum(cause is ContactCause.BUMPED for cause, _ in causes),
        overridden=overridden,
        distance_m=float(np.hypot(*steps.T).sum()),
        drop_off_m=least_to_drop_off(hazard.world, hazard.body, motion),
        person_m=least_to_people(motion),
        reason=told,
    )


def _hall() -> World:
    return world_from_plan(hall_plan((LENGTH, WIDTH)), "hall")


def _with(world: World, block: Block) -> World:
    return replace(world, blocks=(*world.blocks, block))


def _hazard(name: str, world: World, rng: np.random.Generator, protection: Protection) -> Hazard:
    """Return a hazard ahead of a chair that begins near the hall's one end; the chair's map is that of a lidar."""
    start = Pose2(
        float(rng.uniform(1.0, 1.6)), WIDTH / 2 + float(rng.uniform(-0.2, 0.2)), float(rng.uniform(-0.06, 0.06))
    )
    world = replace(world, start=start)
    return Hazard(name, world, map_of_lidar(world), (), sensors=sensors_for(protection))
