"""Several whole chairs in one building, in lockstep, each with its own body, plant, board, sensors and random streams.

They see each other by lidar, sonars and camera, they touch each other, and the world's people avoid them all. The first
chair gives the bytes of `Simulator` if it is alone. Lifts carry chairs to other levels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from waychair.calibration.chair_body import ChairBody
from waychair.errors import ConfigError, WorldError
from waychair.simulation.level import Level
from waychair.simulation.lifts.lifts import Lifts
from waychair.simulation.plan.world import World
from waychair.simulation.scene.contact import ChairContact
from waychair.simulation.scene.scene import PersonPlan, PersonState
from waychair.simulation.simulated_chair import SimulatedChair
from waychair.simulation.simulator_settings import SimulatorSettings
from waychair.types import Pose2, SensorMessage


@dataclass(frozen=True, slots=True)
class ChairPlan:
    """A chair of a fleet: its body, its settings, and its pose at the start, in the map of a `level` (none: the world's)."""

    body: ChairBody
    settings: SimulatorSettings
    start: Pose2
    level: str | None = None


class FleetSimulator:
    """Chairs in a world, from time 0 on; `chairs` in the order of the plans, which is the order of their steps."""

    def __init__(self, world: World, plans: Sequence[ChairPlan], seed: int = 0, lifts: Lifts | None = None) -> None:
        """`lifts` move and carry chairs to the other levels of `world`'s building.

        Raises:
            ConfigError: there is no chair, their plants step at different rates, or several chairs are MuJoCo's.
            WorldError: a chair does not fit at its start, or two stand in one place, or on no level of the lifts.
        """
        steps = {plan.settings.plant.step_ms for plan in plans}
        if len(steps) != 1:
            raise ConfigError(
                f"{len(plans)} chairs with steps of {sorted(steps)} ms cannot be in lockstep: give one step"
            )
        if len(plans) > 1 and any(plan.settings.plant_model == "mujoco" for plan in plans):
            raise ConfigError("several MuJoCo chairs would not feel each other: take the kinematic plant")
        self._level = Level(world, seed, steps.pop() * 1_000_000, lifts)
        self.chairs: list[SimulatedChair] = []
        for plan in plans:
            chair = SimulatedChair(self._level, plan.body, plan.settings, plan.start, _level_of(plan, world, lifts))
            self.chairs.append(chair)
            number = len(self.chairs) - 1
            if lifts is not None:
                lifts.note_chair(chair.key, chair.world.level, plan.start, plan.body)
            other = self._level.taken_by(number, plan.start)
            if other is not None:
                raise WorldError(f"chairs {other + 1} and {number + 1} start in one place: give each its own")
        self.populate(world.people)

    @property
    def now_ns(self) -> int:
        """The time of all chairs."""
        return self._level.now_ns

    @property
    def world(self) -> World:
        """The level as it is now."""
        return self._level.world

    @property
    def people(self) -> tuple[PersonState, ...]:
        """All people on this level, now."""
        return self._level.people

    @property
    def chair_contacts(self) -> list[ChairContact]:
        """The contacts of chairs with chairs so far; each is reported once, however long it lasts."""
        return self._level.chair_contacts

    def populate(self, people: Sequence[PersonPlan]) -> None:
        """Replace all people by these; each starts its plan from the beginning.

        Raises:
            WorldError: a person's start is not free, or its speed is impossible.
        """
        self._level.populate(people)

    def refurnish(self, world: World) -> None:
        """Replace the level by another state of it, such as one with a door shut; its chairs come to rest.

        Raises:
            WorldError: a chair does not fit there.
        """
        for chair in self.chairs:
            if chair.world.level == world.level:
                chair.place(world, chair.truth())
        self._level.change(world)

    def between(self, number: int, other: int) -> float:
        """Return the true distance [m] between two chairs' rectangles, 0 in contact."""
        return self._level.between(number, other)

    def advance(self, duration_ns: int) -> tuple[tuple[SensorMessage, ...], ...]:
        """Let a whole number of steps pass; return the messages of that time in order, of each chair.

        Raises:
            ValueError: the duration is negative or not a multiple of the plants' step.
        """
        heard: tuple[list[SensorMessage], ...] = tuple([] for _ in self.chairs)
        for number, message in self._level.advance(duration_ns):
            heard[number].append(message)
        return tuple(map(tuple, heard))


def _level_of(plan: ChairPlan, world: World, lifts: Lifts | None) -> World:
    """Return the level on which a chair starts."""
    if plan.level is None or plan.level == world.level:
        return world
    if lifts is None or plan.level not in lifts.levels:
        known = ", ".join([world.level] if lifts is None else lifts.levels)
        raise WorldError(f"no lift leads to the level '{plan.level}': let the chair start on {known}")
    return lifts.levels[plan.level]
