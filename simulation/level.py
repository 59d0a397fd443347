"""One level of a building with its time, its people and its chairs, which step in lockstep.

In each step all chairs move one after the other, then the people, then every chair senses the others where they are now.
Lifts carry chairs to the building's other levels, where nobody but chairs and the lifts' passengers is about.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Protocol

from waychair.calibration.chair_body import ChairBody
from waychair.simulation.contact_watch import CONTACT_ENDS
from waychair.simulation.lifts.lifts import Lifts
from waychair.simulation.people.people import SimulatedPeople
from waychair.simulation.people.person_surroundings import chair_rectangle
from waychair.simulation.plan.world import World
from waychair.simulation.scene.boxes import nearest_points, touch
from waychair.simulation.scene.contact import ChairContact, box_of
from waychair.simulation.scene.scene import Mover, OtherChair, PersonPlan, PersonState
from waychair.simulation.scene.seeds import random_stream
from waychair.types import Pose2, SensorMessage, Twist

PEOPLE_STEP_NS = 50_000_000
"""Step of the people's motion and of the check for contact with them."""


class ChairInLevel(Protocol):
    """A chair as the level steps it."""

    body: ChairBody

    @property
    def key(self) -> str: ...
    @property
    def world(self) -> World: ...
    @property
    def speed_before(self) -> float: ...
    def truth(self) -> Pose2: ...
    def twist(self) -> Twist: ...
    def move(self) -> None: ...
    def answer(self) -> None: ...
    def follow_lifts(self, lifts: Lifts) -> None: ...
    def report(self, people_moved: bool) -> None: ...
    def sense(self) -> Iterator[SensorMessage]: ...


class Level:
    """A world in time; `people` are all people there now, `chair_contacts` the contacts of chairs with chairs so far.

    `lifts` move and carry chairs to the building's other levels.
    """

    def __init__(self, world: World, seed: int, step_ns: int, lifts: Lifts | None = None) -> None:
        self.world = world
        self.seed = seed
        self.lifts = lifts
        self.now_ns = 0
        self.people: tuple[PersonState, ...] = ()
        self._step_ns = step_ns
        self._people: SimulatedPeople | None = None
        self._chairs: list[ChairInLevel] = []
        self._touching: set[tuple[int, int]] = set()
        self.chair_contacts: list[ChairContact] = []

    def enter(self, chair: ChairInLevel) -> int:
        """Take in a chair that is about to be placed; return its number."""
        self._chairs.append(chair)
        return len(self._chairs) - 1

    def populate(self, people: Sequence[PersonPlan]) -> None:
        """Replace all people by these.

        Raises:
            WorldError: a person's start is not free, or its speed is impossible.
        """
        body, stream = self._chairs[0].body, random_stream(self.seed, 4)
        self._people = SimulatedPeople(people, self.world.grid, body, stream)
        self.people = self._everybody(self._people)
        self.world = replace(self.world, people=tuple(people))

    def change(self, world: World) -> None:
        """Go on in another state of the level, or on another level, which has its own people."""
        other = world.level != self.world.level
        self.world = world
        if other:
            self.populate(world.people)

    def advance(self, duration_ns: int) -> Iterator[tuple[int, SensorMessage]]:
        """Let a whole number of steps pass; yield the messages of that time in order, with the number of their chair.

        Raises:
            ValueError: the duration is negative or not a multiple of the step.
        """
        if duration_ns < 0 or duration_ns % self._step_ns:
            raise ValueError(f"cannot advance by {duration_ns} ns: give a multiple of {self._step_ns} ns")
        for _ in range(duration_ns // self._step_ns):
            self._step()
            for number, chair in enumerate(self._chairs):
                for message in chair.sense():
                    yield number, message

    def people_on(self, level: str) -> tuple[PersonState, ...]:
        """Return all people on a level, now."""
        if level == self.world.level:
            return self.people
        return () if self.lifts is None else self.lifts.people(level)

    def seen_by(self, number: int) -> Sequence[Mover]:
        """Return the people and the other chairs on a chair's level."""
        people = self.people_on(self._chairs[number].world.level)
        if len(self._chairs) == 1:
            return people
        return (*people, *(OtherChair(chair.truth(), chair.body, other) for other, chair in self._others(number)))

    def taken_by(self, number: int, pose: Pose2) -> int | None:
        """Return another chair that stands where a chair would be at a pose on its level; None if there is none."""
        if len(self._chairs) == 1:
            return None
        own = box_of(self._chairs[number].body, pose)
        boxes = ((other, box_of(chair.body, chair.truth())) for other, chair in self._others(number))
        return next((other for other, box in boxes if touch(own, box)), None)

    def report_touch(self, number: int, other: int) -> None:
        """Report that a chair was stopped by another one, once until they have parted."""
        pair = min(number, other), max(number, other)
        if pair in self._touching:
            return
        self._touching.add(pair)
        first, second = (self._chairs[each] for each in pair)
        _, x, y = nearest_points(box_of(first.body, first.truth()), box_of(second.body, second.truth()))
        speeds = first.speed_before, second.speed_before
        self.chair_contacts.append(ChairContact(self.now_ns, pair, float(x), float(y), speeds))

    def between(self, number: int, other: int) -> float:
        """Return the distance [m] between two chairs' rectangles, 0 in contact, infinite between levels."""
        chairs = self._chairs[number], self._chairs[other]
        if chairs[0].world.level != chairs[1].world.level:
            return math.inf
        one, two = (box_of(chair.body, chair.truth()) for chair in chairs)
        return 0.0 if touch(one, two) else float(nearest_points(one, two)[0])

    def _others(self, number: int) -> Iterator[tuple[int, ChairInLevel]]:
        """Yield the other chairs on a chair's level, with their numbers."""
        level = self._chairs[number].world.level
        for other, chair in enumerate(self._chairs):
            if other != number and chair.world.level == level:
                yield other, chair

    def _step(self) -> None:
        """Let one step pass: chairs, their boards, people, contacts."""
        for chair in self._chairs:
            chair.move()
        self.now_ns += self._step_ns
        for chair in self._chairs:
            chair.answer()
        if self.lifts is not None:
            self._step_lifts(self.lifts)
        someone = bool(self.people) or self.lifts is not None
        people_moved = someone and self.now_ns % PEOPLE_STEP_NS == 0
        if people_moved and self._people is not None:
            rectangles = [
                chair_rectangle(chair.body, chair.truth(), chair.twist())
                for chair in self._chairs
                if chair.world.level == self.world.level
            ]
            self._people.step_round(PEOPLE_STEP_NS, rectangles)
            self.people = self._everybody(self._people)
        for chair in self._chairs:
            chair.report(people_moved)
        self._touching = {pair for pair in self._touching if self.between(*pair) <= CONTACT_ENDS}

    def _step_lifts(self, lifts: Lifts) -> None:
        """Let cars, leaves and passengers move, and the chairs with their cars."""
        for chair in self._chairs:
            lifts.note_chair(chair.key, chair.world.level, chair.truth(), chair.body)
        lifts.step(self.now_ns)
        for chair in self._chairs:
            chair.follow_lifts(lifts)

    def _everybody(self, people: SimulatedPeople) -> tuple[PersonState, ...]:
        """Return the people of this level, and the passengers of its lifts."""
        passengers = () if self.lifts is None else self.lifts.people(self.world.level)
        return (*people.states, *passengers)
