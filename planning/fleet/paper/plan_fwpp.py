"""Plan-FWPP, "plan forward with punishment and priority": labels of travel time with a penalty for predicted conflicts.

Source: the paper on harmonic navigation of several robotic wheelchairs over a wireless visual sensor network, section 4.1.
L(i) is the label of node i, the travel time from the chair's source; τ(i) = start + L(i) is the time when the chair is at
i. T(l, i) is the duration of the way from l to i, r the chair that searches, r1 a chair that has committed itself before.

    L(i) = min over the neighbours l of i of  L(l) + T(l, i) + p

Slips of the paper, and how they are read here (`Conflicts`):

- Eq (1) as printed, τ(l) - τ1(l) > T1(i, l), says that r comes to l long after r1 has left the section: the two never
  meet. `PRINTED` keeps it. `READ` exchanges the order: 0 ≤ τ1(l) - τ(l) < T1(i, l), so that r comes to l while r1 is on
  the section. `EXACT`, ours, asks whether the two are on the section at once:
  0 < τ1(l) - τ(l) < T1(i, l) + T(l, i).
- Labels are compared although the chairs started at different times; τ is meant.
- Penalty (B) adds the time of day T1_min(i) to a duration; the sentence after Eq (2) names the duration T1_min(i, l).
- "The latest/earliest wins" and "the latest wins" contradict each other and rule B; see `admission.py`.

The penalty (A) is the largest T1(i, l) of the conflicts with chairs of equal or higher priority; a chair of lower priority
costs nothing. Where a chair r1 of higher priority fulfils Eq (2), the penalty is (B), T1(i, l) of that chair alone:
|min τ'(i) over the others - τ1(i)| < ⅓ min over l of T1(l, i); the others are r and the chairs in conflict with it. The
text names (A) for equal priorities only, the displayed formula for every conflict; the formula is followed, so that a
routine chair plans round a top chair. `EXACT` takes the longest time until a chair of equal or higher priority has left.
"""

from __future__ import annotations

import enum
from typing import NamedTuple

import numpy as np
from numba import njit

from waychair.maps.traffic.indexed_traffic import IndexedTraffic
from waychair.types import FloatArray, IntArray


class Conflicts(enum.Enum):
    """The reading of the paper's conflict condition; `NONE` is the shortest path."""

    NONE = 0
    PRINTED = 1
    READ = 2
    EXACT = 3


class Commitments(NamedTuple):
    """The routes of R chairs as the nodes know them, at most K moves each.

    Attributes:
        moves: (R,) moves of each route; 0 for a chair that rests.
        sections: (R, K) the sections driven.
        nodes: (R, K + 1) the nodes passed.
        arrivals: (R, K + 1) s, the time of day at which the chair is at each node.
        durations: (R, K) s that each move takes without waiting.
        shortest: (R, K + 1) s that the shortest section at each node takes.
        priority: (R,) higher goes first.
    """

    moves: IntArray
    sections: IntArray
    nodes: IntArray
    arrivals: FloatArray
    durations: FloatArray
    shortest: FloatArray
    priority: IntArray


class PlannedRoute(NamedTuple):
    """A route of K moves: `sections` (K,), `nodes` (K + 1,), `labels` (K + 1,) s since the start, with penalties."""

    sections: IntArray
    nodes: IntArray
    labels: FloatArray


def no_commitments(chairs: int, longest: int) -> Commitments:
    """Return the commitments of chairs that all rest; `longest` is the number of moves of the longest possible route."""
    return Commitments(
        np.zeros(chairs, dtype=np.int64),
        np.zeros((chairs, longest), dtype=np.int64),
        np.zeros((chairs, longest + 1), dtype=np.int64),
        np.zeros((chairs, longest + 1)),
        np.zeros((chairs, longest)),
        np.zeros((chairs, longest + 1)),
        np.zeros(chairs, dtype=np.int64),
    )


def commit(
    graph: IndexedTraffic,
    commitments: Commitments,
    chair: int,
    route: PlannedRoute,
    start_s: float,
    durations: FloatArray,
) -> None:
    """Enter a chair's route that starts at a time of day [s]; `durations` (S,) [s] are the chair's on every section."""
    moves = len(route.sections)
    commitments.moves[chair] = moves
    commitments.sections[chair, :moves] = route.sections
    commitments.nodes[chair, : moves + 1] = route.nodes
    commitments.arrivals[chair, : moves + 1] = start_s + route.labels
    commitments.durations[chair, :moves] = durations[route.sections]
    for k, node in enumerate(route.nodes):
        at_node = graph.leaving[graph.first[node] : graph.first[node + 1], 0]
        commitments.shortest[chair, k] = durations[at_node].min()


def put_off(commitments: Commitments, chair: int, begun: int, node_s: float) -> None:
    """Shift what is left of a chair's route: `node_s` is the time of day [s] when move number `begun` will be over.

    The node that a chair leaves tells the next ones when the chair comes late. With `begun` 0 the chair is at its source
    since `node_s`.
    """
    if begun < commitments.moves[chair] + 1:
        late = node_s - commitments.arrivals[chair, begun]
        commitments.arrivals[chair, begun:] += late


def plan_route(
    graph: IndexedTraffic,
    durations: FloatArray,
    closed: IntArray,
    chair: int,
    source: int,
    target: int,
    start_s: float,
    commitments: Commitments,
    conflicts: Conflicts,
) -> PlannedRoute | None:
    """Return the route of least label from source to target, or None where no open way leads there.

    Args:
        durations: (S,) s that the chair takes on each section.
        closed: (S,) 1 where nobody may drive.
        start_s: the time of day [s] at which it starts.
        commitments: the other chairs' routes; the chair's own row is not looked at, but for its priority.
    """
    labels, before, by = fwpp_labels(graph, durations, closed, chair, source, start_s, commitments, conflicts.value)
    if not np.isfinite(labels[target]):
        return None
    nodes, sections = [target], []
    while nodes[-1] != source:
        sections.append(by[nodes[-1]])
        nodes.append(before[nodes[-1]])
    nodes.reverse()
    sections.reverse()
    return PlannedRoute(np.array(sections, dtype=np.int64), np.array(nodes, dtype=np.int64), labels[nodes])


def label_of(
    graph: IndexedTraffic,
    durations: FloatArray,
    chair: int,
    route: PlannedRoute,
    start_s: float,
    commitments: Commitments,
    conflicts: Conflicts,
) -> float:
    """Return the label [s] that a route's target has by now, against the commitments as they are."""
    label = 0.0
    for section, at, ahead in zip(route.sections, route.nodes[:-1], route.nodes[1:], strict=True):
        duration = float(durations[section])
        here_s = start_s + label
        label += duration
        if conflicts is not Conflicts.NONE and graph.lanes[section] == 1:
            label += penalty(duration, commitments, chair, section, at, ahead, here_s, conflicts.value)
    return label


@njit(cache=True, error_model="numpy", nogil=True)
def fwpp_labels(
    graph: IndexedTraffic,
    durations: FloatArray,
    closed: IntArray,
    chair: int,
    source: int,
    start_s: float,
    commitments: Commitments,
    conflicts: int,
) -> tuple[FloatArray, IntArray, IntArray]:
    """Return labels (N,) [s], and predecessors (N,) with the sections (N,) from them, -1 at the source.

    As penalties are never negative, nodes in the order of their labels give the same labels as the messages of
    `network.py`; among equal labels the predecessor of fewer hops is taken, then the lower number.
    """
    nodes = len(graph.first) - 1
    labels = np.full(nodes, np.inf)
    hops = np.zeros(nodes, dtype=np.int64)
    before = np.full(nodes, -1, dtype=np.int64)
    by = np.full(nodes, -1, dtype=np.int64)
    done = np.zeros(nodes, dtype=np.bool_)
    labels[source] = 0.0
    for _ in range(nodes):
        at = -1
        for i in range(nodes):
            if not done[i] and np.isfinite(labels[i]) and (at < 0 or labels[i] < labels[at]):
                at = i
        if at < 0:
            break
        done[at] = True
        for k in range(graph.first[at], graph.first[at + 1]):
            section, ahead = graph.leaving[k, 0], graph.leaving[k, 2]
            if done[ahead] or closed[section]:
                continue
            here = start_s + labels[at]
            offer = labels[at] + durations[section]
            if conflicts != 0 and graph.lanes[section] == 1:
                offer += penalty(durations[section], commitments, chair, section, at, ahead, here, conflicts)
            fewer = hops[at] + 1 < hops[ahead] or (hops[at] + 1 == hops[ahead] and at < before[ahead])
            if offer < labels[ahead] or (offer == labels[ahead] and fewer):
                labels[ahead], before[ahead], by[ahead], hops[ahead] = offer, at, section, hops[at] + 1
    return labels, before, by


@njit(cache=True, error_model="numpy")
def penalty(
    duration: float,
    commitments: Commitments,
    chair: int,
    section: int,
    at: int,
    ahead: int,
    here_s: float,
    conflicts: int,
) -> float:
    """Return the penalty [s] for a chair that leaves node `at` for node `ahead` at the time of day `here_s`."""
    worst = 0.0
    for other in range(len(commitments.moves)):
        if other == chair or commitments.priority[other] < commitments.priority[chair]:
            continue
        k = conflicting_move(duration, commitments, other, section, at, here_s, conflicts)
        if k < 0:
            continue
        if conflicts == 3:
            worst = max(worst, commitments.arrivals[other, k + 1] - here_s)
            continue
        taken = commitments.durations[other, k]
        arrival = commitments.arrivals[other, k]
        if commitments.priority[other] > commitments.priority[chair]:
            first = here_s + duration  # the time at which r, or another chair in conflict with it, is first at `ahead`
            for third in range(len(commitments.moves)):
                if third not in (chair, other):
                    j = conflicting_move(duration, commitments, third, section, at, here_s, conflicts)
                    if j >= 0:
                        first = min(first, commitments.arrivals[third, j])
            if abs(first - arrival) < commitments.shortest[other, k] / 3.0:
                return float(taken)
        worst = max(worst, taken)
    return float(worst)


@njit(cache=True, error_model="numpy")
def conflicting_move(
    duration: float, commitments: Commitments, other: int, section: int, at: int, here_s: float, conflicts: int
) -> int:
    """Return the move of another chair that comes towards `at` on the section in conflict, or -1."""
    for k in range(commitments.moves[other]):
        if commitments.sections[other, k] != section or commitments.nodes[other, k + 1] != at:
            continue
        taken = commitments.durations[other, k]
        leaves = commitments.arrivals[other, k + 1]
        if conflicts == 1:
            meets = here_s - leaves > taken
        elif conflicts == 2:
            meets = 0.0 <= leaves - here_s < taken
        else:
            meets = 0.0 < leaves - here_s < taken + duration
        if meets:
            return k
    return -1
