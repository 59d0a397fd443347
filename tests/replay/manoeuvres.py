"""The recorded manoeuvres: doors, a corner, a dead end, a parked chair, glass, an edge, a jump of the pose, a rubber band."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

from evaluation.figures.driving.harmonic import with_planner
from evaluation.runs.replay import Tape, pilots_part, record_tape
from evaluation.scenes.hazards import (
    Hazard,
    Protection,
    glass,
    hall_plan,
    hazard_of_scene,
    map_of_lidar,
    sensors_for,
    setup_of,
)
from evaluation.scenes.tight_places import (
    TightScene,
    corner_scene,
    dead_end_scene,
    door_scene,
    drive_variants,
    parked_scene,
)
from evaluation.speed.harmonic import SCENES, costmap_of

from waychair.calibration.chair_body import CHAIR_A, CHAIR_B
from waychair.control.speed.limiter import LimiterSettings
from waychair.planning.route.global_planner import PlannerSettings
from waychair.runtime.chair import Chair, ChairSettings
from waychair.simulation.plan.floor_plan import PlanPit
from waychair.simulation.plan.world import world_from_grid, world_from_plan
from waychair.simulation.simulator import Simulator
from waychair.trials.drive import TICK_NS
from waychair.types import Goal, Place, Pose2

_ENDS = ("arrived", "failed")
_ASKED_AT, _AFTER = 10, 10
"""Ticks before the goal is asked for, and after the drive has ended."""

Act = Callable[[Simulator, Chair], None]


@dataclass(frozen=True, slots=True)
class Manoeuvre:
    """A scene, the longest drive to its goal [s], and what happens meanwhile, by the time [s] since the start."""

    scene: Callable[[], Hazard]
    longest_s: float
    acts: Mapping[float, Act] = field(default_factory=dict)

    def taped(self) -> Tape:
        """Drive to the goal, and return the pilot's part of the tape, until shortly after the drive's end."""
        hazard = self.scene()
        place = hazard.goals[0]
        goal = Goal(place.pose, place.tolerance_m, place.tolerance_rad)

        def ask(_: Simulator, chair: Chair) -> None:
            chair.go(goal)
            chair.confirm()

        acts = {_ASKED_AT: ask, **{_tick(at_s): act for at_s, act in self.acts.items()}}
        tape = record_tape(setup_of(hazard), _simulator(hazard), acts, _tick(self.longest_s))
        stages = [moment.tick.stage for _, moment in tape.moments()]
        ended = next((k for k, stage in enumerate(stages) if k > _ASKED_AT and stage in _ENDS), len(stages))
        return pilots_part(replace(tape, ticks=tape.ticks[: ended + _AFTER]))


def _tick(at_s: float) -> int:
    return round(at_s * 1e9 / TICK_NS)


def _simulator(hazard: Hazard) -> Simulator:
    """Return the simulated chair with few beams and pixels, and pictures without noise, so that its tapes are small."""
    sensors = hazard.sensors
    sensors = replace(
        sensors,
        lidar=replace(sensors.lidar, beams=180),
        camera=replace(sensors.camera, width=64, height=48, noise=0.0),
        plant=replace(sensors.plant, step_ms=10),
    )
    return Simulator(hazard.world, hazard.body, sensors, 1)


def door_of(drive: str) -> TightScene:
    """Return a door of 0.90 m before B with its drive wheels at this place."""
    return door_scene(0.9, 30.0, drive_variants(CHAIR_B)[drive], 2)


def _banded() -> Hazard:
    """Return the room with scattered boxes, planned by the harmonic planner, whose line is smoothed like a rubber band."""
    scene = next(scene for scene in SCENES if scene.name == "scattered boxes")
    (x, y), goal = scene.start, Place("beyond", Pose2(*scene.goal, -0.6), 0.3, 0.4)
    grid = costmap_of(scene).grid
    world = world_from_grid(grid, Pose2(x, y, -0.6), name=scene.name)
    return with_planner(Hazard(scene.name, world, grid, (goal,)), PlannerSettings(planner="harmonic"))


def _edge() -> Hazard:
    """Return a hall that a drop-off cuts in two, seen by the camera only."""
    plan = hall_plan((8.5, 3.4), [PlanPit((4.9, 1.7), (1.0, 3.4))])
    world = replace(world_from_plan(plan, "edge"), start=Pose2(1.4, 1.7, 0.0))
    beyond = Place("beyond", Pose2(7.2, 1.7, 0.0))
    return Hazard("edge", world, map_of_lidar(world), (beyond,), sensors=sensors_for(Protection.CAMERA))


def _slow_hall() -> Hazard:
    """Return a hall for a chair of 0.35 m/s, which is soon as fast again after it was stopped."""
    world = replace(world_from_plan(hall_plan((7.0, 3.4)), "hall"), start=Pose2(1.2, 1.5, 0.0))
    chair = ChairSettings(limiter=LimiterSettings(max_speed=0.35))
    return Hazard("hall", world, world.grid, (Place("there", Pose2(5.0, 1.7, 0.0)),), chair=chair)


def _shove(simulator: Simulator, chair: Chair) -> None:
    """Shove the chair aside, and tell it where it is."""
    there = simulator.truth() @ Pose2(0.0, 0.3, math.radians(8.0))
    simulator.place(simulator.world, there)
    chair.relocalise(there)


MANOEUVRES: Mapping[str, Manoeuvre] = MappingProxyType(
    {
        "door_rear": Manoeuvre(lambda: hazard_of_scene(door_of("rear")), 50.0),
        "door_mid": Manoeuvre(lambda: hazard_of_scene(door_of("mid")), 50.0),
        "door_front": Manoeuvre(lambda: hazard_of_scene(door_of("front")), 50.0),
        "corner": Manoeuvre(lambda: hazard_of_scene(corner_scene(CHAIR_A, 0)), 60.0),
        "dead_end": Manoeuvre(lambda: hazard_of_scene(dead_end_scene(CHAIR_B, 0)), 60.0),
        "parked": Manoeuvre(lambda: hazard_of_scene(parked_scene("beside", CHAIR_A, 0)), 60.0),
        "glass": Manoeuvre(lambda: glass(Protection.SONAR, 0), 17.0),
        "edge": Manoeuvre(_edge, 9.0),
        "jump": Manoeuvre(_slow_hall, 40.0, {7.0: _shove}),
        "band": Manoeuvre(_banded, 40.0),
    }
)
