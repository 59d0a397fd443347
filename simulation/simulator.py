"""A chair in a world, in lockstep: joystick lines in, stamped messages out, the same bytes for the same seed.

Time passes only in `advance`. The truth (pose, twist, contacts, clearance, people) is for scores and reports only; software
that drives the chair must not read it.
"""

from __future__ import annotations

from collections.abc import Sequence

from waychair.calibration.chair_body import ChairBody
from waychair.errors import WorldError
from waychair.simulation.level import Level
from waychair.simulation.lifts.lifts import Lifts
from waychair.simulation.plan.world import World
from waychair.simulation.scene.scene import PersonPlan
from waychair.simulation.simulated_chair import SimulatedChair
from waychair.simulation.simulator_settings import (
    PLANT_MODELS,
    SensorSettings,
    SimulationSettings,
    SimulatorSettings,
    with_all_sensors,
)
from waychair.types import Pose2, SensorMessage

__all__ = [
    "PLANT_MODELS",
    "SensorSettings",
    "SimulationSettings",
    "Simulator",
    "SimulatorSettings",
    "with_all_sensors",
]


class Simulator(SimulatedChair):
    """One chair on one level; it starts at `world.start`, at rest, at time 0, with the joystick live."""

    def __init__(
        self,
        world: World,
        body: ChairBody,
        settings: SimulatorSettings | None = None,
        seed: int = 0,
        lifts: Lifts | None = None,
    ) -> None:
        """`lifts` move and carry the chair from level to level; without them, lifts are open and `ride` is at once.

        Raises:
            WorldError: the chair does not fit at the world's start, or its plant does not know moving leaves.
            MissingExtra: the plant is MuJoCo's, which is not installed.
        """
        s = settings or SimulatorSettings()
        if lifts is not None and s.plant_model != "kinematic":
            raise WorldError("lifts move with the kinematic plant only: set plant_model = kinematic")
        if lifts is not None:
            lifts.note_chair(body.chair_id, world.level, world.start, body)
        super().__init__(Level(world, seed, s.plant.step_ms * 1_000_000, lifts), body, s, world.start)
        self.populate(world.people)

    @property
    def lifts(self) -> Lifts | None:
        """The lifts that move and carry the chair; None without any."""
        return self._level.lifts

    def populate(self, people: Sequence[PersonPlan]) -> None:
        """Replace all people by these; each starts its plan from the beginning.

        Raises:
            WorldError: a person's start is not free, or its speed is impossible.
        """
        self._level.populate(people)

    def close(self, *doors: str) -> None:
        """Close doors of this level.

        Raises:
            WorldError: there is no door of this name, or the chair stands in it.
        """
        self.place(self.world.with_closed(doors), self.truth())

    def refurnish(self, world: World) -> None:
        """Replace the level by another state of it, such as one with a door open again; the chair comes to rest.

        Raises:
            WorldError: the chair does not fit there.
        """
        self.place(world, self.truth())

    def ride(self, level: World) -> None:
        """Take the lift to another level of the building; the chair keeps its pose in the cabin and is at rest.

        Raises:
            WorldError: no lift stops at both levels, or the chair is not in its cabin.
        """
        pose = self.truth()
        shared = [lift for lift in self.world.lifts if lift in level.lifts]
        if not shared:
            raise WorldError(f"no lift goes from {self.world.level or self.world.name} to {level.level or level.name}")
        for lift in shared:
            if lift.holds(pose):
                return self.place(level, pose)
        names = ", ".join(lift.name for lift in shared)
        raise WorldError(f"the chair at ({pose.x:.2f}, {pose.y:.2f}) is not in {names}: drive it into the cabin first")

    def advance(self, duration_ns: int) -> tuple[SensorMessage, ...]:
        """Let a whole number of steps pass; return the messages of that time in order.

        Raises:
            ValueError: the duration is negative or not a multiple of the plant's step.
        """
        return tuple(message for _, message in self._level.advance(duration_ns))

    def place(self, world: World, pose: Pose2) -> None:
        """See `SimulatedChair.place`; another level has its own people."""
        super().place(world, pose)
        self._level.change(world)
