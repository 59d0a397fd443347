"""The paper's network: a node for every vertex of the traffic graph, with a mailbox, and messages between neighbours.

No node knows the whole graph. A node knows its own sections, the commitments of chairs that will pass it, and one Bloom
filter for each neighbour v: the goals t with w(u, v) + d(v, t) <= 1.5 d(u, t), to which the way over v is no large detour.
Where no filter of a node says yes, it asks its neighbours for theirs ("nodes with two hops"). A filter never denies a
member, so that no shortest route is lost; a false yes costs messages. The paper's sources on its filters were not to be
had; these are our reading.

The four phases (section 4.1 of the paper):

1. A `Command` goes to the node at which the chair is.
2. A `Query` goes from node to node and makes a label in each, as `plan_fwpp.py` explains; a node passes it on when its
   label has changed. A node remembers the last offer of each neighbour, so that the labels end at the same values in
   whatever order messages come. The search stops after `hops` hops (the paper: the number of nodes) and `timer_s` after its
   start (the paper: "usually two minutes").
3. When the timer is over, the target sends a `Confirm` to its predecessor of least label, then of fewest hops (the paper's
   broad-first-search-like policy), and so on to the source. Each node on the way commits itself to the chair.
4. The chair drives node by node. A late chair is announced by `Late`; one that searches again by `Cancel`.

The paper hands the weight of a path over from node to node. The node that a section leads to computes conflict and
penalty, because it knows the chairs that will come the other way.
"""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import count
from typing import NamedTuple

from waychair.errors import TrafficError
from waychair.maps.traffic.traffic_graph import Section, TrafficGraph
from waychair.planning.fleet.paper.bloom import BloomFilter
from waychair.planning.fleet.paper.goal_filters import goal_filters
from waychair.planning.fleet.paper.messages import Asked, Cancel, Command, Confirm, Hint, Late, Message, Query
from waychair.planning.fleet.paper.plan_fwpp import Conflicts

HOP_S = 0.02
"""s; time of one message from node to node."""


@dataclass(frozen=True, slots=True)
class SearchStops:
    """The two stops of a search: `hops`, where None is the number of nodes, and `timer_s`; the paper's timer is 120 s."""

    hops: int | None = None
    timer_s: float = 2.0


class Committed(NamedTuple):
    """A node's promise to a chair that passes it: when it comes, and its next section, the node there and the time there.

    `section` and `ahead` are empty at the target. `shortest_s` is the chair's time on the shortest section at the node.
    """

    chair: int
    priority: int
    arrival_s: float
    section: str
    ahead: str
    ahead_s: float
    duration_s: float
    shortest_s: float


class OfferedLabel(NamedTuple):
    """A label [s] with its hops, and the neighbour and section that it comes from; compares as the paper's BFSP does."""

    label: float
    hops: int
    neighbour: str
    section: str


@dataclass(slots=True)
class Search:
    """A node's memory of one search: the last offer over each section, the best one as told, and those it told."""

    offers: dict[str, OfferedLabel] = field(default_factory=dict)
    best: OfferedLabel | None = None
    told: set[str] = field(default_factory=set)
    hints: dict[str, bool] | None = None


@dataclass(slots=True)
class NetworkNode:
    """One node: its neighbours by section, filters by neighbour, commitments by chair, searches by number.

    `work` counts the messages that it has handled.
    """

    name: str
    neighbours: tuple[tuple[Section, str], ...]
    filters: Mapping[str, BloomFilter]
    committed: dict[int, Committed] = field(default_factory=dict)
    searches: dict[int, Search] = field(default_factory=dict)
    work: int = 0

    def knows(self, target: str) -> bool:
        """Return whether the node is the target, or one of its filters knows it."""
        return target == self.name or any(target in each for each in self.filters.values())


class FoundRoute(NamedTuple):
    """A route: its `nodes`, one more than `sections`, and the foreseen time of day [s] at each node."""

    nodes: tuple[str, ...]
    sections: tuple[str, ...]
    arrivals_s: tuple[float, ...]


class NodeNetwork:
    """All nodes of a graph and the mail between them; `conflicts` is the reading of Plan-FWPP.

    Attributes:
        nodes: by name.
        closed: the sections that nobody may drive.
        messages: the number of messages by kind.
    """

    def __init__(
        self,
        graph: TrafficGraph,
        conflicts: Conflicts = Conflicts.READ,
        *,
        stops: SearchStops | None = None,
        filtered: bool = True,
    ) -> None:
        self.graph, self.conflicts = graph, conflicts
        self.stops = stops or SearchStops()
        self.messages: Counter[str] = Counter()
        self.closed: frozenset[str] = frozenset()
        self._filtered = filtered
        filters = goal_filters(graph) if filtered else {}
        self.nodes = {
            node.name: NetworkNode(
                node.name,
                tuple((graph.section[move.section], move.end) for move in graph.moves[node.name]),
                filters.get(node.name, {}),
            )
            for node in graph.nodes
        }
        self._mail: list[tuple[float, int, str, Message]] = []
        self._numbers = count()
        self._found: dict[int, FoundRoute] = {}

    def search(
        self, chair: int, source: str, target: str, *, start_s: float, speed: float, priority: int = 0
    ) -> FoundRoute:
        """Return the route of a chair, and commit the nodes on it; the chair's earlier commitments end.

        Args:
            start_s: the time of day [s] at which the chair sets out.
            speed: the chair's, m/s.
            priority: higher goes first.

        Raises:
            TrafficError: source or target is unknown, or no open way joins them within the stops of the search.
        """
        for name in (source, target):
            if name not in self.nodes:
                raise TrafficError(f"there is no node {name} in {self.graph.name}; give the name of one of its nodes")
        self.cancel(chair)
        command = Command(chair, target, priority, speed, start_s)
        number = next(self._numbers)
        until = self.stops.timer_s
        self._post(0.0, source, command)
        self._deliver(number, until)
        if number in self.nodes[target].searches:
            self._confirm(number, command, self.nodes[target], (), until)
            self._deliver(number, float("inf"))
        for node in self.nodes.values():
            node.searches.pop(number, None)
        found = self._found.pop(number, None)
        if found is None:
            limit = f"{self._most_hops} hops and {self.stops.timer_s:g} s"
            raise TrafficError(
                f"no way from {source} to {target} was found within {limit}; open a section or wait longer"
            )
        return found

    def follow(self, command: Command, source: str, way: Sequence[tuple[Section, str]]) -> FoundRoute:
        """Commit the nodes to a way of sections and nodes that was found without labels, and return it as a route."""
        names = [source, *(name for _, name in way)]
        times = [command.start_s]
        for section, _ in way:
            times.append(times[-1] + section.seconds(command.speed))
        for i, name in enumerate(names):
            last = i == len(way)
            self.messages["Confirm"] += not last
            self._commit(
                self.nodes[name],
                command,
                times[i],
                ("", "", times[i]) if last else (names[i + 1], way[i][0].name, times[i + 1]),
            )
        return FoundRoute(tuple(names), tuple(section.name for section, _ in way), tuple(times))

    def cost_at(self, node: str, section: Section, query: Query) -> float:
        """Return the time [s] over a section to a node with the penalty of the conflicts that the node predicts."""
        return self._cost(self.nodes[node], section, query)

    def late(self, chair: int, node: str, by_s: float) -> None:
        """Tell the nodes from `node` on that a chair comes later than it said by some seconds."""
        self._post(0.0, node, Late(chair, by_s))
        self._deliver(-1, float("inf"))

    def cancel(self, chair: int) -> None:
        """End all commitments to a chair, from the first node of its route on."""
        ahead = {node.committed[chair].ahead for node in self.nodes.values() if chair in node.committed}
        for node in self.nodes.values():
            if chair in node.committed and node.name not in ahead:
                self._post(0.0, node.name, Cancel(chair))
        self._deliver(-1, float("inf"))

    def close(self, section: str) -> None:
        """Close a section on which a thing lies that no chair can pass (CommonRule); the filters are made anew.

        Raises:
            TrafficError: there is no such section.
        """
        if section not in self.graph.section:
            raise TrafficError(f"there is no section {section} in {self.graph.name}; give the name of one")
        self._set_closed(self.closed | {section})

    def open(self, section: str) -> None:
        """Open a section again."""
        self._set_closed(self.closed - {section})

    @property
    def _most_hops(self) -> int:
        return len(self.nodes) if self.stops.hops is None else self.stops.hops

    def _set_closed(self, closed: frozenset[str]) -> None:
        self.closed = closed
        if not self._filtered:
            return
        for name, filters in goal_filters(self.graph, closed).items():
            node = self.nodes[name]
            self.messages["Filter"] += sum(filters[each] != node.filters.get(each) for each in filters)
            node.filters = filters

    def _post(self, now_s: float, to: str, message: Message) -> None:
        self.messages[type(message).__name__] += 1
        heapq.heappush(self._mail, (now_s + HOP_S, next(self._numbers), to, message))

    def _deliver(self, number: int, until_s: float) -> None:
        """Let the nodes handle their mail, and what they send on, until the network is quiet or the timer is over."""
        while self._mail:
            now_s, _, to, message = heapq.heappop(self._mail)
            if now_s > until_s:
                continue  # the search is over: what is still on its way is of no use
            node = self.nodes[to]
            node.work += 1
            if isinstance(message, Command):
                search = node.searches.setdefault(number, Search())
                search.best = OfferedLabel(0.0, 0, "", "")
                self._relay(now_s, node, number, message)
            elif isinstance(message, Query):
                self._hear(now_s, node, message)
            elif isinstance(message, Asked):
                self._post(
                    now_s, message.sender, Hint(message.search, to, message.command, node.knows(message.command.target))
                )
            elif isinstance(message, Hint):
                self._hinted(now_s, node, message)
            elif isinstance(message, Confirm):
                self._confirm(message.search, message.command, node, message.way, now_s)
            else:
                self._pass_on(now_s, node, message)

    def _hear(self, now_s: float, node: NetworkNode, query: Query) -> None:
        """Phase 2: note an offer, and pass the query on if it has changed the node's label."""
        search = node.searches.setdefault(query.search, Search())
        if search.best is not None and search.best.hops == 0:
            return  # the source
        section = self.graph.section[query.section]
        label = query.label + self._cost(node, section, query)
        search.offers[query.section] = OfferedLabel(label, query.hops, query.sender, query.section)
        best = min(search.offers.values())
        if best == search.best:
            return
        search.best = best
        if node.name != query.command.target:
            self._relay(now_s, node, query.search, query.command)

    def _relay(self, now_s: float, node: NetworkNode, number: int, command: Command) -> None:
        """Phase 2: send the node's label to the neighbours that a filter names, and to those that have an older label."""
        search = node.searches[number]
        target = command.target
        if self._filtered and search.hints is None and target not in node.filters and not node.knows(target):
            search.hints = {}
            for neighbour in dict.fromkeys(neighbour for _, neighbour in node.neighbours):
                self._post(now_s, neighbour, Asked(number, node.name, command))
            return
        for section, neighbour in node.neighbours:
            if section.name not in search.told and not self._worth(search, node, neighbour, target):
                continue
            self._tell(now_s, node, number, command, section, neighbour)

    def _worth(self, search: Search, node: NetworkNode, neighbour: str, target: str) -> bool:
        if search.best is not None and neighbour == search.best.neighbour:
            return False
        if not self._filtered or neighbour == target:
            return True
        return target in node.filters[neighbour] or bool(search.hints and search.hints.get(neighbour))

    def _tell(
        self, now_s: float, node: NetworkNode, number: int, command: Command, section: Section, neighbour: str
    ) -> None:
        search = node.searches[number]
        best = search.best
        if best is None or best.hops >= self._most_hops or section.name in self.closed:
            return
        search.told.add(section.name)
        query = Query(number, command, node.name, section.name, best.label, best.hops + 1, self.stops.timer_s)
        self._post(now_s, neighbour, query)

    def _hinted(self, now_s: float, node: NetworkNode, hint: Hint) -> None:
        search = node.searches[hint.search]
        if search.hints is None:
            return
        search.hints[hint.sender] = hint.known
        if hint.known:
            for section, neighbour in node.neighbours:
                if neighbour == hint.sender and self._worth(search, node, neighbour, hint.command.target):
                    self._tell(now_s, node, hint.search, hint.command, section, neighbour)

    def _cost(self, node: NetworkNode, section: Section, query: Query) -> float:
        """Return the time [s] from the sender over a section to this node, with the penalty of Plan-FWPP."""
        command = query.command
        duration = section.seconds(command.speed)
        if self.conflicts is Conflicts.NONE or section.lanes > 1:
            return duration
        here_s = command.start_s + query.label
        against = [
            each
            for each in node.committed.values()
            if each.section == section.name and _meets(self.conflicts, each, here_s, duration)
        ]
        worst = 0.0
        for each in sorted(against):
            if each.priority < command.priority:
                continue
            if self.conflicts is Conflicts.EXACT:
                worst = max(worst, each.ahead_s - here_s)
                continue
            if each.priority > command.priority:
                others_s = [here_s + duration, *(other.arrival_s for other in against if other is not each)]
                if abs(min(others_s) - each.arrival_s) < each.shortest_s / 3.0:
                    return duration + each.duration_s
            worst = max(worst, each.duration_s)
        return duration + worst

    def _confirm(
        self, number: int, command: Command, node: NetworkNode, way: tuple[tuple[str, str, float], ...], now_s: float
    ) -> None:
        """Phase 3: commit a node and send the confirmation to its predecessor."""
        best = node.searches[number].best
        if best is None or len(way) > len(self.nodes):
            return
        arrival_s = command.start_s + best.label
        self._commit(node, command, arrival_s, way[0] if way else ("", "", arrival_s))
        if best.hops > 0:
            step = (node.name, best.section, arrival_s)
            confirm = Confirm(number, command, node.name, best.section, arrival_s, (step, *way))
            self._post(now_s, best.neighbour, confirm)
            return
        self._found[number] = FoundRoute(
            (node.name, *(name for name, _, _ in way)),
            tuple(section for _, section, _ in way),
            (arrival_s, *(time for _, _, time in way)),
        )

    def _commit(self, node: NetworkNode, command: Command, arrival_s: float, step: tuple[str, str, float]) -> None:
        ahead, section, ahead_s = step
        duration_s = self.graph.section[section].seconds(command.speed) if section else 0.0
        shortest_s = min((each.seconds(command.speed) for each, _ in node.neighbours), default=0.0)
        node.committed[command.chair] = Committed(
            command.chair, command.priority, arrival_s, section, ahead, ahead_s, duration_s, shortest_s
        )

    def _pass_on(self, now_s: float, node: NetworkNode, message: Late | Cancel) -> None:
        """Phase 4: change or end a commitment and tell the next node of the route."""
        kept = node.committed.get(message.chair)
        if kept is None:
            return
        if isinstance(message, Late):
            later = kept._replace(arrival_s=kept.arrival_s + message.by_s, ahead_s=kept.ahead_s + message.by_s)
            node.committed[message.chair] = later
        else:
            del node.committed[message.chair]
        if kept.ahead:
            self._post(now_s, kept.ahead, message)


def _meets(conflicts: Conflicts, other: Committed, here_s: float, duration: float) -> bool:
    """Return whether a chair that comes the other way is on the section in conflict, by a reading of Eq (1)."""
    left = other.ahead_s - here_s
    if conflicts is Conflicts.PRINTED:
        return -left > other.duration_s
    if conflicts is Conflicts.READ:
        return 0.0 <= left < other.duration_s
    return 0.0 < left < other.duration_s + duration
