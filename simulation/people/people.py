"""The people of a world: their states, advanced in time and in answer to the chair.

There are five behaviours (`scene.Behaviour`): to and fro along a path, with social forces, seated, suddenly stepping
out, and drifting discs. A person is a disc that never moves into a wall, a chair or another person; `walking.py`,
`rails.py` and `social_force.py` move it.

All random numbers are drawn at the start, except the headings of drifting discs: one per disc every HEADING_NS. The
count of random numbers therefore depends on plan and time alone, not on the chairs.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.errors import WorldError
from waychair.geometry import wrap_angle
from waychair.maps.grid.cells import cells_from_points, inside
from waychair.simulation.people.person_surroundings import (
    ChairRectangle,
    Walls,
    chair_rectangle,
    chair_rows,
    nearest_wall,
    walls_from_grid,
)
from waychair.simulation.people.rails import rail_from_path
from waychair.simulation.people.walking import BOUNCE, PERSON, TOP_SPEED, WalkingSpace, move_people
from waychair.simulation.scene.scene import PersonBehaviour, PersonPlan, PersonState
from waychair.types import OccupancyGrid, Pose2, Twist

LONGEST_STEP_NS = 50_000_000
"""Longest step of the people's motion; longer times are divided."""

HEADING_NS = 2_000_000_000
"""Interval between new headings of a drifting disc: 2 s."""

STRIDE = 1.4
"""Length [m] of a stride of two steps, one turn of `PersonState.stride`."""

CONTACT_GAP = 1e-3
"""Gap [m] that a person keeps to the chair; a smaller gap counts as contact."""

VEER = (math.radians(6.0), math.radians(2.0))
"""Mean and deviation [rad] of the angle by which social walkers keep to the right (`social_force.veered`)."""


class SimulatedPeople:
    """The people of one level round its chairs; at time 0 each stands at the start of its path, facing along it."""

    def __init__(
        self, plans: Sequence[PersonPlan], grid: OccupancyGrid, body: ChairBody, rng: np.random.Generator
    ) -> None:
        """
        Raises:
            WorldError: a walking person starts outside the grid or too near to something solid, or its speed is above
                TOP_SPEED.
        """
        self._plans = tuple(plans)
        self._body = body
        self._rng = rng
        self._now_ns = 0
        self._walls = walls_from_grid(grid)
        rails = [rail_from_path(plan.path, plan.speed) for plan in self._plans]
        self._rails = np.concatenate([np.zeros((0, 5)), *rails])
        self._people = np.zeros(len(rails), PERSON)
        self._people["last"] = np.cumsum([len(rail) for rail in rails])
        self._people["first"] = self._people["last"] - [len(rail) for rail in rails]
        for number, (plan, rail) in enumerate(zip(self._plans, rails, strict=True)):
            _check_plan(number, plan, grid, self._walls)
            person = self._people[number]
            person["behaviour"] = tuple(PersonBehaviour).index(plan.behaviour)
            for name in ("yields", "radius", "speed", "trigger", "rest"):
                person[name] = getattr(plan, name)
            person["sign"], person["x"], person["y"], person["heading"] = 1.0, *rail[0, 1:4]
        self._phases = rng.uniform(0.0, math.tau, len(rails))
        self._people["veer"] = rng.normal(*VEER, len(rails))
        self._seeds = rng.integers(2**31, size=len(rails))
        self._take_new_headings()

    def step(self, duration_ns: int, map_from_base: Pose2, twist: Twist) -> None:
        """Let time pass round one chair, with its pose and twist constant; see `step_round`."""
        self.step_round(duration_ns, [chair_rectangle(self._body, map_from_base, twist)])

    def step_round(self, duration_ns: int, chairs: Iterable[ChairRectangle]) -> None:
        """Let time pass round some chairs, with their poses and twists constant.

        Raises:
            ValueError: the duration is negative.
        """
        if duration_ns < 0:
            raise ValueError(f"cannot move people by {duration_ns} ns: give a duration of at least 0")
        space = WalkingSpace(self._rails, self._walls, chair_rows(chairs))
        end_ns = self._now_ns + duration_ns
        while self._now_ns < end_ns:
            to_heading_ns = HEADING_NS - self._now_ns % HEADING_NS
            step_ns = min(end_ns - self._now_ns, LONGEST_STEP_NS, to_heading_ns)
            move_people(self._people, space, step_ns * 1e-9)
            self._now_ns += step_ns
            if step_ns == to_heading_ns:
                self._take_new_headings()

    @property
    def states(self) -> tuple[PersonState, ...]:
        """All people now, in the order of the plans."""
        return tuple(
            PersonState(
                pose=Pose2(float(person["x"]), float(person["y"]), wrap_angle(float(person["heading"]))),
                speed=math.hypot(person["vx"], person["vy"]),
                stride=float((phase + person["walked"] * math.tau / STRIDE) % math.tau),
                radius=plan.radius,
                behaviour=plan.behaviour,
                seed=int(seed),
            )
            for plan, person, phase, seed in zip(self._plans, self._people, self._phases, self._seeds, strict=True)
        )

    def _take_new_headings(self) -> None:
        drifting = self._people["behaviour"] == BOUNCE
        self._people["heading"][drifting] = self._rng.uniform(-math.pi, math.pi, int(drifting.sum()))


def _check_plan(number: int, plan: PersonPlan, grid: OccupancyGrid, walls: Walls) -> None:
    person = f"person {number + 1} ({plan.behaviour.value})"
    if not 0.0 < plan.speed <= TOP_SPEED:
        raise WorldError(
            f"{person} has a speed of {plan.speed:g} m/s: give a speed above 0 and up to {TOP_SPEED:g} m/s"
        )
    if plan.behaviour is PersonBehaviour.SEATED:
        return
    x, y = (float(value) for value in plan.path[0])
    if not inside(grid, cells_from_points(grid, plan.path[:1])).all():
        raise WorldError(f"{person} stands at ({x:g}, {y:g}), outside the world: start its path inside")
    distance = nearest_wall(walls, x, y, plan.radius)[0]
    if distance < plan.radius:
        raise WorldError(
            f"{person} stands at ({x:g}, {y:g}), {distance:.2f} m from something solid, but has a radius of {plan.radius:g} m: "
            "start its path on free floor"
        )
