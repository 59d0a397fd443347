"""The kernels of `crowd.py`: one step of chairs and people on the sections of a traffic graph."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from waychair.maps.traffic.indexed_traffic import IndexedTraffic
from waychair.types import FloatArray, IntArray

HUMANS_FIRST, CHAIRS_FIRST, FLEXIBLE = 0, 1, 2
"""The paper's rules A, B and C."""

ROUTINE, PEOPLE, TOP = 0, 1, 2
"""Levels of priority of the flexible rule."""

GOING, ARRIVED, ASKING, ENTERED = 0, 1, 2, 3
"""News of a chair: none, it has reached the end of its route, it stands at a node and has no permit to go on, or it has
entered a section."""

ANY = -2
"""A permit for every section: the nodes admit the chair by their own rule."""


class CrowdRules(NamedTuple):
    """Constants of a crowd, as `crowd.CrowdModel` explains them."""

    step_s: float
    chair_speed: float
    walking_speed: float
    stand_distance: float
    gap: float
    rule: int
    inheritance: bool
    tells_entries: bool
    tells_last_entry: bool


class ChairRows(NamedTuple):
    """C chairs; one on no section has section -1 and stands at its node.

    Attributes:
        section, direction, offset: (C,) the chair's section, its direction on it, and the metres driven on it.
        node: (C,) the node at which the chair is, or that it left last.
        spare: (C,) m that a chair had left of its step when it came to its node.
        level, inherited: (C,) the chair's own priority, and the higher one of a chair in whose way it is.
        route, position, moves: (C, K) sections ahead, the index of the next one (C,), and their number (C,).
        permit: (C,) the section that the chair may enter next; -1: none, `ANY`: as the nodes' rule says.
        news: (C,) GOING, ARRIVED, ASKING or ENTERED.
        moving: (C,) whether the chair drove in the last step.
        waited: (C, 2) s stood for people and for chairs.
        stood_since: (C,) s, the time of the last movement.
    """

    section: IntArray
    direction: IntArray
    offset: FloatArray
    node: IntArray
    spare: FloatArray
    level: IntArray
    inherited: IntArray
    route: IntArray
    position: IntArray
    moves: IntArray
    permit: IntArray
    news: IntArray
    moving: IntArray
    waited: FloatArray
    stood_since: FloatArray


class PeopleRows(NamedTuple):
    """P people.

    Attributes:
        on_section, walking, at: (P,) the person's section, direction and metres walked on it.
        held_up: (P,) s that the person stood for chairs.
    """

    on_section: IntArray
    walking: IntArray
    at: FloatArray
    held_up: FloatArray


class CrowdArrays(NamedTuple):
    """Chairs and people on S sections.

    Attributes:
        queued: (S, 2) s that chairs stood for people and for chairs on or before each section.
        facing: (S, 2) people on a section that walk in a direction.
        clock: (2,) time [s] and the longest time in which no chair moved.
        random: (1,) the state of the random stream.
    """

    chairs: ChairRows
    people: PeopleRows
    queued: FloatArray
    facing: IntArray
    clock: FloatArray
    random: NDArray[np.uint64]


@njit(cache=True, error_model="numpy", inline="always")
def draw(state: NDArray[np.uint64], below: int) -> int:
    """Return a random integer in [0, below) from an xorshift64* stream (S. Vigna, 2016)."""
    x = state[0]
    x ^= x >> np.uint64(12)
    x ^= x << np.uint64(25)
    x ^= x >> np.uint64(27)
    state[0] = x
    return int((x * np.uint64(2685821657736338717)) >> np.uint64(33)) % below


@njit(cache=True, error_model="numpy", nogil=True)
def run_crowd(graph: IndexedTraffic, crowd: CrowdArrays, rules: CrowdRules, until: float) -> bool:
    """Let chairs and people move until a time [s], or until the step after which a chair has news; return whether one has."""
    chairs = len(crowd.chairs.section)
    order: IntArray = np.arange(chairs)
    while crowd.clock[0] < until - 1e-9:
        crowd.clock[0] += rules.step_s
        _inherit(graph, crowd, rules)
        for c in range(chairs):
            crowd.chairs.moving[c] = 0
            if crowd.chairs.section[c] >= 0:
                _drive(graph, crowd, rules, c)
        for i in range(chairs):
            order[i] = i  # so that it does not matter how often the caller has asked for news
        for i in range(chairs - 1, 0, -1):  # equal chairs have equal chances at a section
            k = draw(crowd.random, i + 1)
            order[i], order[k] = order[k], order[i]
        for level in range(TOP, ROUTINE - 1, -1):
            for i in range(chairs):
                if crowd.chairs.section[order[i]] < 0 and crowd.chairs.inherited[order[i]] == level:
                    _enter(graph, crowd, rules, order[i])
        news = False
        moved = crowd.clock[0]
        for c in range(chairs):
            if crowd.chairs.moving[c]:
                crowd.chairs.stood_since[c] = crowd.clock[0]
            news = news or crowd.chairs.news[c] != GOING
            moved = min(moved, crowd.clock[0] - crowd.chairs.stood_since[c])
        crowd.clock[1] = max(crowd.clock[1], moved)
        _walk(graph, crowd, rules)
        if news:
            return True
    return False


@njit(cache=True, error_model="numpy")
def _inherit(graph: IndexedTraffic, crowd: CrowdArrays, rules: CrowdRules) -> None:
    """Give every chair that is in a higher one's way the higher one's priority, towards people, too (as in PIBT)."""
    chairs = len(crowd.chairs.section)
    for c in range(chairs):
        crowd.chairs.inherited[c] = crowd.chairs.level[c]
    if not rules.inheritance:
        return
    changed = True
    while changed:
        changed = False
        for c in range(chairs):
            if crowd.chairs.inherited[c] == ROUTINE:
                continue
            ahead = crowd.chairs.section[c]
            if ahead < 0:
                if crowd.chairs.position[c] >= crowd.chairs.moves[c]:
                    continue
                ahead = crowd.chairs.route[c, crowd.chairs.position[c]]
            for other in range(chairs):
                if crowd.chairs.section[other] != ahead or crowd.chairs.inherited[other] >= crowd.chairs.inherited[c]:
                    continue
                in_the_way = crowd.chairs.section[c] < 0 or crowd.chairs.offset[other] > crowd.chairs.offset[c]
                if in_the_way and graph.lanes[ahead] == 1:
                    crowd.chairs.inherited[other] = crowd.chairs.inherited[c]
                    changed = True


@njit(cache=True, error_model="numpy", inline="always")
def _gives_way(crowd: CrowdArrays, rules: CrowdRules, c: int) -> bool:
    """Whether a chair stands for people."""
    return rules.rule == HUMANS_FIRST or (rules.rule == FLEXIBLE and crowd.chairs.inherited[c] < PEOPLE)


@njit(cache=True, error_model="numpy", inline="always")
def _stand(crowd: CrowdArrays, rules: CrowdRules, c: int, s: int, whom: int) -> None:
    """Count a step that a chair stands on or before a section, for people (0) or for chairs (1)."""
    crowd.chairs.waited[c, whom] += rules.step_s
    crowd.queued[s, whom] += rules.step_s


@njit(cache=True, error_model="numpy")
def _drive(graph: IndexedTraffic, crowd: CrowdArrays, rules: CrowdRules, c: int) -> None:
    """Move a chair on its section, unless a person comes towards it or a chair is before it."""
    s, d = crowd.chairs.section[c], crowd.chairs.direction[c]
    if graph.lanes[s] == 1 and crowd.facing[s, 1 - d] > 0 and _gives_way(crowd, rules, c):
        for p in range(len(crowd.people.on_section)):
            if crowd.people.on_section[p] == s and crowd.people.walking[p] != d:
                between = graph.length[s] - crowd.people.at[p] - crowd.chairs.offset[c]
                if 0.0 <= between < rules.stand_distance:
                    _stand(crowd, rules, c, s, 0)
                    return
    for other in range(len(crowd.chairs.section)):
        if other != c and crowd.chairs.section[other] == s and crowd.chairs.direction[other] == d:
            between = crowd.chairs.offset[other] - crowd.chairs.offset[c]
            if 0.0 < between < rules.gap or (between == 0.0 and other < c):
                _stand(crowd, rules, c, s, 1)
                return
    crowd.chairs.moving[c] = 1
    crowd.chairs.offset[c] += rules.chair_speed * rules.step_s
    over = crowd.chairs.offset[c] - graph.length[s] - graph.delay_s[s] * rules.chair_speed
    if over >= 0.0:
        crowd.chairs.node[c] = graph.ends[s, 1 - d]
        crowd.chairs.section[c] = -1
        crowd.chairs.spare[c] = over
        if crowd.chairs.position[c] >= crowd.chairs.moves[c]:
            crowd.chairs.news[c] = ARRIVED


@njit(cache=True, error_model="numpy")
def _enter(graph: IndexedTraffic, crowd: CrowdArrays, rules: CrowdRules, c: int) -> None:
    """Let a chair at a node into its next section, if it may."""
    if crowd.chairs.position[c] >= crowd.chairs.moves[c]:
        return
    s = crowd.chairs.route[c, crowd.chairs.position[c]]
    d = 0 if graph.ends[s, 0] == crowd.chairs.node[c] else 1
    spare = crowd.chairs.spare[c]
    crowd.chairs.spare[c] = 0.0
    has_people = graph.lanes[s] == 1 and crowd.facing[s, 1 - d] > 0 and _gives_way(crowd, rules, c)
    whom = 0 if has_people else 1  # it would stand for people, whether or not a chair were in its way
    if crowd.chairs.permit[c] not in (s, ANY):
        _stand(crowd, rules, c, s, whom)
        crowd.chairs.news[c] = ASKING
        return
    for other in range(len(crowd.chairs.section)):
        if crowd.chairs.section[other] != s:
            continue
        against = crowd.chairs.direction[other] != d and graph.lanes[s] == 1
        if against or (crowd.chairs.direction[other] == d and crowd.chairs.offset[other] < rules.gap):
            _stand(crowd, rules, c, s, whom)
            return
    if has_people:
        _stand(crowd, rules, c, s, 0)
        return
    if crowd.chairs.permit[c] != ANY:
        crowd.chairs.permit[c] = -1
    crowd.chairs.section[c] = s
    crowd.chairs.direction[c] = d
    crowd.chairs.offset[c] = spare
    crowd.chairs.position[c] += 1
    crowd.chairs.moving[c] = 1
    if rules.tells_entries and (rules.tells_last_entry or crowd.chairs.position[c] < crowd.chairs.moves[c]):
        crowd.chairs.news[c] = ENTERED


@njit(cache=True, error_model="numpy")
def _walk(graph: IndexedTraffic, crowd: CrowdArrays, rules: CrowdRules) -> None:
    """Move the people; at a node each goes on by a random section, and back only at a dead end."""
    on_section, walking, at, facing = crowd.people.on_section, crowd.people.walking, crowd.people.at, crowd.facing
    length, ends, first, leaving = graph.length, graph.ends, graph.first, graph.leaving
    chairs_on, random = crowd.chairs.section, crowd.random
    walked = rules.walking_speed * rules.step_s
    for p in range(len(on_section)):
        s, d = on_section[p], walking[p]
        if rules.rule != HUMANS_FIRST and graph.lanes[s] == 1:
            near = False
            for c in range(len(chairs_on)):
                near = near or chairs_on[c] == s
            if near and _must_stand(graph, crowd, rules, p):
                crowd.people.held_up[p] += rules.step_s
                continue
        at[p] += walked
        over = at[p] - length[s]
        if over < 0.0:
            continue
        node = ends[s, 1 - d]
        ways = first[node + 1] - first[node]
        choice = first[node]
        if ways > 1:
            choice += draw(random, ways - 1)
            for i in range(first[node], choice + 1):
                if leaving[i, 0] == s:
                    choice += 1
                    break
        facing[s, d] -= 1
        on_section[p], walking[p], at[p] = leaving[choice, 0], leaving[choice, 1], over
        facing[on_section[p], walking[p]] += 1


@njit(cache=True, error_model="numpy")
def _must_stand(graph: IndexedTraffic, crowd: CrowdArrays, rules: CrowdRules, p: int) -> bool:
    """Whether a person stands aside: for a chair that drives by, or for the light of a chair of top priority."""
    s, d = crowd.people.on_section[p], crowd.people.walking[p]
    for c in range(len(crowd.chairs.section)):
        if crowd.chairs.section[c] != s or crowd.chairs.direction[c] == d or _gives_way(crowd, rules, c):
            continue
        between = graph.length[s] - crowd.people.at[p] - crowd.chairs.offset[c]
        if 0.0 <= between < rules.stand_distance and (rules.rule == FLEXIBLE or crowd.chairs.moving[c]):
            return True
    return False
