"""Chairs and people on a traffic graph, in steps: the people walk by themselves, and the chairs' decisions come from outside.

A chair enters a section of one lane when no chair is on it against it. Chairs behind each other keep a gap. By rule A
(humans first) a chair enters only when nobody walks towards it on that section, and it stands while a person who comes
towards it is near. A person squeezes past a chair that stands. By rule B (chairs first) the people stand while a chair
passes them. By rule C (flexible) people stand for a chair of top priority, which warns by light, and routine chairs stand
for people. A chair in the way of a higher one inherits its priority, towards people, too: without that, a top chair behind
a routine chair behind a person who stands for the top chair would wait for ever.

A node holds any number of chairs, as in the paper. On sections of two lanes everybody keeps right and nobody waits.
People take no lifts.
"""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from waychair.errors import TrafficError
from waychair.maps.traffic.indexed_traffic import IndexedTraffic, indexed_traffic
from waychair.maps.traffic.traffic_graph import TrafficGraph
from waychair.simulation.graph_traffic.crowd_kernels import (
    ANY,
    ARRIVED,
    ASKING,
    CHAIRS_FIRST,
    ENTERED,
    FLEXIBLE,
    GOING,
    HUMANS_FIRST,
    ROUTINE,
    TOP,
    ChairRows,
    CrowdArrays,
    CrowdRules,
    PeopleRows,
    run_crowd,
)
from waychair.simulation.scene.seeds import seed_from_names
from waychair.types import FloatArray

MOST_PEOPLE = 10_000
"""More people than that are no crowd of a building but a mistake."""


class RightOfWay(enum.Enum):
    """The paper's rules: A humans first, B chairs first, C flexible."""

    HUMANS = "humans"
    CHAIRS = "chairs"
    FLEXIBLE = "flexible"


_RULES = {
    RightOfWay.HUMANS: HUMANS_FIRST,
    RightOfWay.CHAIRS: CHAIRS_FIRST,
    RightOfWay.FLEXIBLE: FLEXIBLE,
}


@dataclass(frozen=True, slots=True)
class CrowdModel:
    """How chairs and people move.

    Attributes:
        step_s: time step [s].
        chair_speed: m/s; the paper's simulation uses 0.330.
        walking_speed: m/s of all people; the paper gives none, 0.6 fits its tables.
        stand_distance: m; from here on the chair stands for a person who comes towards it, or the person for the chair.
        gap: m between the middles of chairs behind each other: a chair's length and 0.2 m.
        inheritance: whether a chair in a higher one's way inherits its priority.
    """

    step_s: float = 0.25
    chair_speed: float = 0.33
    walking_speed: float = 0.6
    stand_distance: float = 1.5
    gap: float = 1.2
    inheritance: bool = True


class Crowd:
    """Chairs at nodes and people on sections of a graph, from a seed: the same seed moves them the same way.

    Args:
        graph: the building; its sections have positive lengths.
        starts: the node of each chair, by number.
        people: their number.
        rule: the right of way between people and chairs.
        top: the chairs of top priority, by number; they count with rule C and between chairs.
        permits: whether a chair enters a section only by `permit`; otherwise the nodes admit chairs by themselves.
        tells_entries: whether `run` also returns when a chair has entered a section from which it will go on.
        tells_last_entry: with it, for the last section of a route, too.

    Raises:
        TrafficError: the number of people is impossible, or the graph has no section.
    """

    def __init__(
        self,
        graph: TrafficGraph,
        starts: Sequence[int],
        people: int,
        rule: RightOfWay,
        seed: int,
        *,
        top: Sequence[int] = (),
        permits: bool = False,
        tells_entries: bool = False,
        tells_last_entry: bool = False,
        model: CrowdModel | None = None,
    ) -> None:
        if not 0 <= people <= MOST_PEOPLE:
            raise TrafficError(f"{people} people are impossible; give 0 to {MOST_PEOPLE}")
        if not graph.sections:
            raise TrafficError(f"{graph.name} has no section; give a graph with at least one")
        self.model = model or CrowdModel()
        self.indexed: IndexedTraffic = indexed_traffic(graph)
        self._rules = CrowdRules(
            self.model.step_s,
            self.model.chair_speed,
            self.model.walking_speed,
            self.model.stand_distance,
            self.model.gap,
            _RULES[rule],
            self.model.inheritance,
            tells_entries,
            tells_last_entry,
        )
        self._arrays = _initial(self.indexed, starts, people, seed, top, permits)

    @property
    def now(self) -> float:
        """The time [s] since the start."""
        return float(self._arrays.clock[0])

    @property
    def longest_standstill(self) -> float:
        """The longest time [s] in which no chair moved."""
        return float(self._arrays.clock[1])

    @property
    def waited(self) -> FloatArray:
        """The time (C, 2) [s] that each chair has stood for people and for chairs."""
        return self._arrays.chairs.waited.copy()

    @property
    def queued(self) -> FloatArray:
        """The time (S, 2) [s] that chairs have stood on or before each section, for people and for chairs."""
        return self._arrays.queued.copy()

    @property
    def people_held_up(self) -> float:
        """The mean time [s] that a person has stood for chairs."""
        held_up = self._arrays.people.held_up
        return float(held_up.mean()) if len(held_up) else 0.0

    def give(self, chair: int, sections: Sequence[int]) -> None:
        """Give a chair at a node its route: numbers of sections that follow each other from its node."""
        arrays = self._arrays
        if len(sections) > arrays.chairs.route.shape[1]:
            longer = np.zeros((len(arrays.chairs.section), 2 * len(sections)), dtype=np.int64)
            longer[:, : arrays.chairs.route.shape[1]] = arrays.chairs.route
            self._arrays = arrays = arrays._replace(chairs=arrays.chairs._replace(route=longer))
        arrays.chairs.route[chair, : len(sections)] = sections
        arrays.chairs.position[chair] = 0
        arrays.chairs.moves[chair] = len(sections)
        arrays.chairs.news[chair] = GOING if sections else ARRIVED
        arrays.chairs.spare[chair] = 0.0

    def turn_off(self, chair: int, sections: Sequence[int]) -> None:
        """Give a chair under way another route from the end of its section on, or from its node."""
        section, news = self.section_of(chair), int(self._arrays.chairs.news[chair])
        spare = float(self._arrays.chairs.spare[chair])
        self.give(chair, [*([section] if section >= 0 else []), *sections])
        arrays = self._arrays
        arrays.chairs.position[chair] = int(section >= 0)
        arrays.chairs.news[chair], arrays.chairs.spare[chair] = news, spare

    def next_node(self, chair: int) -> int:
        """Return the node at the end of a chair's section, or at which it is."""
        arrays, section = self._arrays, self.section_of(chair)
        if section < 0:
            return self.node_of(chair)
        return int(self.indexed.ends[section, 1 - arrays.chairs.direction[chair]])

    def permit(self, chair: int, section: int) -> None:
        """Allow a chair to enter a section next."""
        self._arrays.chairs.permit[chair] = section
        if self._arrays.chairs.news[chair] == ASKING:
            self._arrays.chairs.news[chair] = GOING

    def set_top(self, chair: int, top: bool) -> None:
        """Give a chair top priority or routine."""
        self._arrays.chairs.level[chair] = TOP if top else ROUTINE

    def node_of(self, chair: int) -> int:
        """Return the node at which a chair is, or that it left last."""
        return int(self._arrays.chairs.node[chair])

    def section_of(self, chair: int) -> int:
        """Return the section on which a chair is, -1 at a node."""
        return int(self._arrays.chairs.section[chair])

    def direction_of(self, chair: int) -> int:
        """Return the direction in which a chair drives on its section, or drove on its last one."""
        return int(self._arrays.chairs.direction[chair])

    def standing_s(self, chair: int) -> float:
        """Return the time [s] for which a chair has not moved."""
        return self.now - float(self._arrays.chairs.stood_since[chair])

    def progress(self, chair: int) -> tuple[int, float]:
        """Return the moves of its route that a chair has begun, and the seconds that the last of them still takes.

        The seconds are negative for a chair that came to its node within the last step.
        """
        arrays = self._arrays
        begun, section = int(arrays.chairs.position[chair]), int(arrays.chairs.section[chair])
        if section < 0:
            return begun, -float(arrays.chairs.spare[chair]) / self.model.chair_speed
        left = self.indexed.length[section] - arrays.chairs.offset[chair]
        return begun, float(left / self.model.chair_speed + self.indexed.delay_s[section])

    def run(self, until: float) -> bool:
        """Move everybody until a time [s], or until a step in which a chair has news; return whether one has."""
        return bool(run_crowd(self.indexed, self._arrays, self._rules, until))

    def arrived(self) -> list[tuple[int, float]]:
        """Return the chairs at the end of their routes, and when [s] each came there."""
        arrays, speed = self._arrays, self.model.chair_speed
        return [
            (int(c), self.now - float(arrays.chairs.spare[c]) / speed)
            for c in np.flatnonzero(arrays.chairs.news == ARRIVED)
        ]

    def entered(self) -> list[int]:
        """Return the chairs that have entered a section since the last call, as far as `run` tells entries."""
        news = self._arrays.chairs.news
        chairs = [int(c) for c in np.flatnonzero(news == ENTERED)]
        news[chairs] = GOING
        return chairs

    def asking(self) -> list[int]:
        """Return the chairs that stand at a node without a permit."""
        return [int(c) for c in np.flatnonzero(self._arrays.chairs.news == ASKING)]


def _initial(
    graph: IndexedTraffic, starts: Sequence[int], people: int, seed: int, top: Sequence[int], permits: bool
) -> CrowdArrays:
    chairs, sections = len(starts), len(graph.length)
    random = np.random.default_rng(seed)
    on_section = random.choice(sections, size=people, p=graph.length / graph.length.sum())
    walking = random.integers(0, 2, size=people)
    facing = np.zeros((sections, 2), dtype=np.int64)
    np.add.at(facing, (on_section, walking), 1)
    level = np.full(chairs, ROUTINE, dtype=np.int64)
    level[list(top)] = TOP
    rows = ChairRows(
        section=np.full(chairs, -1, dtype=np.int64),
        direction=np.zeros(chairs, dtype=np.int64),
        offset=np.zeros(chairs),
        node=np.array(starts, dtype=np.int64),
        spare=np.zeros(chairs),
        level=level,
        inherited=level.copy(),
        route=np.zeros((chairs, 16), dtype=np.int64),
        position=np.zeros(chairs, dtype=np.int64),
        moves=np.zeros(chairs, dtype=np.int64),
        permit=np.full(chairs, -1 if permits else ANY, dtype=np.int64),
        news=np.full(chairs, ARRIVED, dtype=np.int64),
        moving=np.zeros(chairs, dtype=np.int64),
        waited=np.zeros((chairs, 2)),
        stood_since=np.zeros(chairs),
    )
    walkers = PeopleRows(
        on_section=on_section.astype(np.int64),
        walking=walking.astype(np.int64),
        at=random.uniform(0.0, 1.0, size=people) * graph.length[on_section],
        held_up=np.zeros(people),
    )
    return CrowdArrays(
        chairs=rows,
        people=walkers,
        queued=np.zeros((sections, 2)),
        facing=facing,
        clock=np.zeros(2),
        random=np.array([seed_from_names("crowd", seed) * 2 + 1], dtype=np.uint64),
    )
