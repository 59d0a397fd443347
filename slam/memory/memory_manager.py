"""The memory of nodes: short-term (STM), working (WM) and long-term memory (LTM), managed as in RTAB-Map 0.23.8.

New views are compared in the STM (rehearsal), loops are searched in the WM, and the LTM is asleep on disk (Labbe and
Michaud 2013, 2019). So the work per frame depends on the awake nodes and not on the length of the drive. One frame is

    added = memory.add(node, information)            # STM, rehearsal, STM -> WM
    ...                                              # likelihood and Bayes filter over the WM: a hypothesis
    woken = memory.retrieve(hypothesis, pose, path)  # LTM -> WM; nodes that must stay awake
    memory.link(...)                                 # accepted loops
    slept = memory.transfer(spent_ms)                # WM -> LTM, when the frame took too long

Each step returns the nodes that the vocabulary and the Bayes filter gain and lose (`MemoryChange`). A chair that only
localises adds no nodes; `retrieve` and `transfer` then keep the WM to its surroundings.

Nodes asleep keep their pose and links in RAM (`Skeleton`) and their scan on disk (`evidence`), so that the grid stays
complete.
"""

from __future__ import annotations

from collections import Counter, OrderedDict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from waychair.errors import LongTermDamaged, LongTermError
from waychair.slam.memory.anchor_poses import AnchorPoses
from waychair.slam.memory.long_term_memory import LongTermStore
from waychair.slam.memory.memory_changes import AddedNode, MemoryChange
from waychair.slam.memory.memory_journal import Journal
from waychair.slam.memory.memory_settings import MemoryCounts, MemorySettings
from waychair.slam.memory.nodes import LOOPS, Link, LinkKind, MemoryNode, NodeScan, NodeStatus, WordIds
from waychair.slam.memory.rehearsal import RehearsalResult, rehearse
from waychair.slam.memory.retrieval import immunised_nodes, nearby_nodes, nodes_to_wake
from waychair.slam.memory.skeleton import Skeleton
from waychair.slam.memory.transfer import NodesInRam, is_due, removable, with_intermediate
from waychair.types import Bytes, FloatArray, IntArray, Pose2

STM_SIZE = 10
"""Nodes with pictures in the STM (RTAB-Map's Mem/STMSize)."""

CACHED_NODES = 200
"""Nodes put to sleep last that stay decoded in RAM, so that waking them needs no disk."""


class _SessionClock:
    """The time [ns] since the first stamp of a session; it never goes back, even if stamps do."""

    def __init__(self) -> None:
        self.now_ns = 0
        self._start_ns: int | None = None

    def tick(self, stamp_ns: int) -> None:
        self._start_ns = stamp_ns if self._start_ns is None else self._start_ns
        self.now_ns = max(self.now_ns, stamp_ns - self._start_ns)


@dataclass(slots=True)
class _Iteration:
    """The nodes woken in this iteration, and those that must not be put to sleep in it."""

    woken: list[int] = field(default_factory=list)
    immunised: set[int] = field(default_factory=set)


class NodeMemory:
    """Nodes and links, the memory that each node is in, and the rules by which nodes move.

    It reads no clock: time is that of the nodes' stamps since the first one of the session.
    """

    def __init__(self, settings: MemorySettings | None = None, store: LongTermStore | None = None) -> None:
        """Load earlier sessions from the store: nodes that were awake are awake again, the rest asleep."""
        self.settings = settings or MemorySettings()
        self.store = store or LongTermStore()
        self.skeleton = Skeleton()
        self.map_id = 0
        self.last_closure = 0
        """The newer node of the latest loop closure by appearance; 0 before the first."""
        self._stm: list[int] = []
        self._wm: set[int] = set()
        self._awake: dict[int, MemoryNode] = {}
        self._cache: OrderedDict[int, MemoryNode] = OrderedDict()
        self._counts: Counter[str] = Counter()
        self._anchors = AnchorPoses()
        self._clock = _SessionClock()
        self._localised = 0  # the older node of the latest loop closure
        self._iteration = _Iteration()
        self._journal = Journal()
        self._restore()

    @classmethod
    def opened(cls, path: Path, settings: MemorySettings | None = None, most_bytes: int | None = None) -> NodeMemory:
        """Return a memory in a file or, if that cannot be used, in RAM: see `store.fault` and `store.notes`."""
        try:
            return cls(settings, LongTermStore(path, most_bytes))
        except LongTermError as error:
            return cls(settings, LongTermStore.in_ram(error))

    @property
    def stm(self) -> tuple[int, ...]:
        """The ids of the STM's nodes in the order of their addition."""
        return tuple(self._stm)

    @property
    def wm(self) -> frozenset[int]:
        """The ids of the WM's nodes, among which loops are searched."""
        return frozenset(self._wm)

    @property
    def immunised(self) -> frozenset[int]:
        """The nodes that must not be put to sleep in this iteration."""
        return frozenset(self._iteration.immunised)

    @property
    def awake(self) -> tuple[MemoryNode, ...]:
        """The nodes in RAM; the vocabulary and the Bayes filter begin with those of earlier sessions."""
        return tuple(self._awake.values())

    @property
    def anchors(self) -> FloatArray:
        """The anchors' poses (A, 3), from the last `move_anchors` or an earlier session."""
        return self._anchors.poses

    def counts(self, words: int = 0) -> MemoryCounts:
        """Return present numbers of nodes and counts of events, with the vocabulary's number of words."""
        there = {"stm": len(self._stm), "wm": len(self._wm), "ltm": self._asleep}
        return MemoryCounts(**there, **self._counts, words=words)

    def node(self, node: int) -> MemoryNode:
        """Return a node, awake or asleep.

        Raises:
            LongTermError: the node is asleep and cannot be read.
        """
        found = self._awake.get(node) or self._cache.get(node)
        return self.store.node(node) if found is None else found

    def weight(self, node: int) -> int:
        """Return how often the view did not change; -1 for an intermediate node."""
        return int(self.skeleton.rows["weight"][node])

    def poses(self, nodes: Iterable[int]) -> FloatArray:
        """Return the poses (K, 3) [m, m, rad] of nodes in map, awake or asleep; nan before their anchor has a pose."""
        return self.skeleton.poses(nodes, self._anchors.poses)

    def start_map(self) -> int:
        """Start a new map without a link to the last, after kidnapping or an odometry restart; return its id."""
        self.map_id += 1
        return self.map_id

    def add(
        self,
        node: MemoryNode,
        information: FloatArray,
        anchor: int | None = None,
        anchor_from_node: Pose2 | None = None,
        *,
        motion: Pose2 | None = None,
        intermediate: bool = False,
        new_words: tuple[IntArray, Bytes] | None = None,
    ) -> AddedNode:
        """Add a new node to the STM, and move the STM's oldest nodes to the WM.

        Args:
            node: the view; the memory sets its `id` and `map_id`.
            information: (3, 3) of the motion from the previous node.
            anchor: the key scan that it moves with, a row of the poses given to `move_anchors`; by default its own id.
            anchor_from_node: its pose in the anchor's frame.
            motion: its pose in the previous node's frame, where a scan knows better than odometry.
            intermediate: a node of which only the pose matters; it is never compared or counted.
            new_words: words that the vocabulary has made of it, ids (K,) and descriptors (K, D) as bytes.
        """
        self._iteration = _Iteration()
        self._clock.tick(node.stamp_ns)
        node = replace(node, id=self.skeleton.count, map_id=self.map_id)
        before = self._stm[-1] if self._stm and self._awake[self._stm[-1]].map_id == self.map_id else None
        self.skeleton.add(
            node.id,
            node.stamp_ns,
            node.map_id,
            node.id if anchor is None else anchor,
            anchor_from_node or Pose2(),
        )
        self.skeleton.rows["weight"][node.id] = -1 if intermediate else 0
        self._stm.append(node.id)
        self._awake[node.id] = node
        self._counts["frames"] += not intermediate
        if before is None:
            motion = None
        else:
            motion = motion or self._awake[before].odom_from_base.inverse() @ node.odom_from_base
            self._link(Link(before, node.id, LinkKind.NEIGHBOUR, motion, information))
        verdict, stands = self._rehearse(node, motion, before)
        change = self._overflow()
        self._journal.states.add(stands)
        self._write(self._awake[stands] if stands == node.id else None, new_words)
        return AddedNode(stands, verdict, change)

    def retrieve(self, hypothesis: int | None, here: Pose2, path: Sequence[int] = ()) -> MemoryChange:
        """Wake nodes that may be needed, refresh the age of near ones, and choose those that must stay awake.

        Args:
            hypothesis: the most likely place of the Bayes filter, of any probability; awake, or None.
            here: pose of the chair in map.
            path: nodes of the planned path, from the chair on.
        """
        if not self.settings.bounded and not self._asleep:
            return MemoryChange()
        newest = self._stm[-1] if self._stm else 0
        around = nearby_nodes(
            skeleton=self.skeleton, anchors=self._anchors, here=here, newest=newest, wm=self._wm, path=path
        )
        for later, node in enumerate(reversed(around.near)):
            self.skeleton.rows["entered_ns"][node] = self._clock.now_ns + later
        woken = self._wake(nodes_to_wake(self.skeleton, hypothesis, around)) if self._asleep else ()
        self._iteration.woken = [node.id for node in woken]
        if self.settings.bounded:
            self._iteration.immunised = immunised_nodes(
                self.skeleton, hypothesis, around, self._awake.keys(), len(self._wm)
            )
            self._iteration.immunised |= {*self._iteration.woken, self._localised}
        return MemoryChange(woken=woken, entered_wm=tuple(self._iteration.woken))

    def transfer(self, spent_ms: float = 0.0) -> MemoryChange:
        """Put nodes to sleep if a limit is exceeded: two more than were woken, so that the WM shrinks by one."""
        weight = self.skeleton.rows["weight"]
        if not self.settings.bounded or (self._stm and weight[self._stm[-1]] < 0):
            return MemoryChange()
        pictures = int((weight[np.fromiter(self._wm, np.int64)] >= 0).sum())
        if not is_due(spent_ms, pictures, self.settings):
            return MemoryChange()
        awake = NodesInRam(self._stm, self._wm, self.last_closure, self._iteration.immunised)
        picked = removable(self.skeleton, awake, len(self._iteration.woken) + 2)
        going = with_intermediate(self.skeleton, picked, self._wm)
        slept = tuple(self._put_to_sleep(node) for node in going)
        return MemoryChange(slept=slept, left_wm=tuple(going))

    def link(self, link: Link) -> None:
        """Add a loop between two nodes, awake or asleep.

        Raises:
            ValueError: a node does not exist.
        """
        for end in (link.i, link.j):
            if self.skeleton.kept(end) is NodeStatus.GONE or link.i == link.j:
                raise ValueError(
                    f"cannot link the nodes {link.i} and {link.j}: node {end} does not exist, or both are one"
                )
        self._link(link)
        if link.kind is LinkKind.GLOBAL:
            self._counts["closures"] += 1
            self.last_closure, self._localised = max(link.i, link.j), min(link.i, link.j)

    def unlink(self, i: int, j: int) -> None:
        """Remove a loop, such as one that the graph has refused."""
        link = self.skeleton.linked(i, j)
        if link is None or link.kind not in LOOPS:
            raise ValueError(f"there is no loop between the nodes {i} and {j}")
        self._counts["closures"] -= link.kind is LinkKind.GLOBAL
        self._unlink(i, j)

    def drop(self, node: int) -> MemoryChange:
        """Remove the newest node, as for a chair that has not moved. Its weight goes to the nodes of its loops.

        Raises:
            ValueError: the node is not the newest one.
        """
        if not self._stm or self._stm[-1] != node:
            raise ValueError(f"node {node} is not the newest one; only that can be dropped")
        parents = [link.j for link in self.skeleton.links(node) if link.kind is LinkKind.GLOBAL]
        gone = self._awake[node]
        self._give_weight(node, parents)
        self._remove(node)
        self._counts["dropped"] += 1
        return MemoryChange(slept=(gone,))

    def rewrite(self, node: int, words: WordIds) -> None:
        """Give the words (K,) of an awake node new ids, as when it was woken."""
        self._awake[node] = replace(self._awake[node], words=words)
        self._journal.rewritten(self._awake[node])

    def attach(self, node: int, anchor: int, anchor_from_node: Pose2) -> None:
        """Attach the node to another anchor."""
        self.skeleton.attach(node, anchor, anchor_from_node)
        self._journal.states.add(node)

    def move_anchors(self, anchors: FloatArray) -> None:
        """Take over the anchors' poses (A, 3) [m, m, rad] in map (see `AnchorPoses.update`), and move all nodes."""
        self._journal.moved(self._anchors.update(anchors))

    def evidence(self, nodes: Iterable[int], beams: int = 20_000) -> Iterator[list[tuple[int, NodeScan]]]:
        """Yield the scans of nodes, asleep or not, in chunks of at most `beams` beams (one scan at least).

        Nodes without a scan, removed or unreadable ones are left out. No node is woken.

        Raises:
            LongTermError: the file cannot be read.
        """
        chunk: list[tuple[int, NodeScan]] = []
        held = 0
        for node in nodes:
            found = self._evidence(node)
            if found is None:
                continue
            count = len(found.scan.ranges)
            if chunk and held + count > beams:
                yield chunk
                chunk, held = [], 0
            chunk.append((node, found))
            held += count
        if chunk:
            yield chunk

    def flush(self) -> None:
        """Write everything to disk, and wait for it."""
        self._write()
        while self._journal.has_moved:
            self._write()
        self.store.flush()

    def close(self) -> None:
        """Write the rest and close the file."""
        self.flush()
        self.store.close()

    def _rehearse(self, new: MemoryNode, motion: Pose2 | None, before: int | None) -> tuple[RehearsalResult, int]:
        """Compare the new node with the last picture; return the result and the id of the remaining node."""
        weight = self.skeleton.rows["weight"]
        old = next((node for node in reversed(self._stm[:-1]) if weight[node] >= 0), None)
        if old is None or weight[new.id] < 0:
            return RehearsalResult.DIFFERENT, new.id
        verdict = rehearse(new, self._awake[old], motion, before == old)
        if verdict is RehearsalResult.DIFFERENT:
            return verdict, new.id
        weight[old] += weight[new.id] + 1
        weight[new.id] = 0 if verdict is RehearsalResult.ADD_WEIGHT else -1
        self._journal.states |= {old, new.id}
        if verdict is not RehearsalResult.MERGE:
            return verdict, new.id
        self._counts["merged"] += 1
        self._remove(new.id)
        return verdict, old

    def _overflow(self) -> MemoryChange:
        """Move the STM's oldest nodes to the WM while it holds too many pictures."""
        weight = self.skeleton.rows["weight"]
        entered: list[int] = []
        slept: list[MemoryNode] = []
        pictures = sum(int(weight[node]) >= 0 for node in self._stm)
        while pictures > STM_SIZE:
            node = self._stm[0]
            pictures -= int(weight[node]) >= 0
            if self.settings.reduce_graph and self._reduce(node, slept):
                continue
            del self._stm[0]
            self._enter_wm(node)
            entered.append(node)
        return MemoryChange(slept=tuple(slept), entered_wm=tuple(entered))

    def _reduce(self, node: int, slept: list[MemoryNode]) -> bool:
        """Return whether the node has closed a loop; if so, connect its neighbours to the loop's node and remove it."""
        loops = self.skeleton.links(node, LOOPS)
        if not loops:
            return False
        to = min(loops, key=lambda loop: loop.j)
        for link in self.skeleton.links(node):
            if link.j != to.j and self.skeleton.linked(to.j, link.j) is None:
                self._link(to.reversed().then(link, LinkKind.MERGED))
        slept.append(self._awake[node])
        self._give_weight(node, [to.j])
        self._remove(node)
        self._counts["reduced"] += 1
        return True

    def _give_weight(self, node: int, parents: Sequence[int]) -> None:
        weight = self.skeleton.rows["weight"]
        if weight[node] > 0:
            for parent in parents:
                weight[parent] += weight[node]
                self._journal.states.add(parent)

    def _remove(self, node: int) -> None:
        """Remove a node of the STM, also from the disk: no code reads a removed node again (unlike RTAB-Map)."""
        del self._awake[node]
        self._stm.remove(node)
        for link in self.skeleton.links(node):
            self._unlink(link.i, link.j)
        self._journal.gone(node)
        self.skeleton.remove(node)

    def _enter_wm(self, node: int) -> None:
        self.skeleton.rows["kept"][node] = NodeStatus.WM
        self.skeleton.rows["entered_ns"][node] = self._clock.now_ns
        self._wm.add(node)
        self._counts["entered_wm"] += 1

    def _wake(self, nodes: Sequence[int]) -> tuple[MemoryNode, ...]:
        """Move nodes from the LTM to the WM; unreadable ones are lost from now on."""
        woken = []
        for node in nodes:
            try:
                found = self._cache.pop(node, None) or self.store.node(node)
            except LongTermDamaged:
                self.skeleton.rows["kept"][node] = NodeStatus.LOST
                self._counts["unreadable"] += 1
                continue
            except LongTermError:  # the disk is gone (see store.fault): the nodes stay asleep
                break
            self._awake[node] = found
            self._enter_wm(node)
            self._journal.states.add(node)
            self._counts["retrieved"] += 1
            woken.append(found)
        return tuple(woken)

    def _put_to_sleep(self, node: int) -> MemoryNode:
        self._wm.remove(node)
        self.skeleton.rows["kept"][node] = NodeStatus.LTM
        self._journal.states.add(node)
        self._counts["transferred"] += 1
        found = self._cache[node] = self._awake.pop(node)
        while len(self._cache) > CACHED_NODES:
            self._cache.popitem(last=False)
        return found

    def _evidence(self, node: int) -> NodeScan | None:
        if self.skeleton.kept(node) is NodeStatus.GONE:
            return None
        here = self._awake.get(node) or self._cache.get(node)
        if here is not None:
            return here.evidence
        try:
            return self.store.evidence(node)
        except LongTermDamaged:
            return None

    def _link(self, link: Link) -> None:
        self.skeleton.link(link)
        self._journal.linked(link)

    def _unlink(self, i: int, j: int) -> None:
        self.skeleton.unlink(i, j)
        self._journal.unlinked(i, j)

    @property
    def _asleep(self) -> int:
        return int((self.skeleton.rows["kept"] == NodeStatus.LTM).sum())

    def _write(self, added: MemoryNode | None = None, words: tuple[IntArray, Bytes] | None = None) -> None:
        """Write all changes in one transaction."""
        new = () if added is None else (added,)
        journal = self._journal
        self.store.write(journal.batch(new, words, self.skeleton, self._awake.keys(), self._anchors.poses))
        self._journal = journal.following()

    def _restore(self) -> None:
        """Load earlier sessions; nodes that were awake go to the WM, older than all new ones."""
        stored = self.store.load()
        states = {state.id: state for state in stored.states if not state.parent}
        for node, map_id, stamp_ns in stored.nodes:
            state = states.get(node)
            if state is None:
                continue
            self.skeleton.add(node, stamp_ns, map_id, state.anchor, state.anchor_from_node)
            self.skeleton.rows["weight"][node] = state.weight
            self.skeleton.rows["kept"][node] = NodeStatus.LTM
        for link in stored.links:
            if NodeStatus.GONE not in (self.skeleton.kept(link.i), self.skeleton.kept(link.j)):
                self.skeleton.link(link)
                if link.kind is LinkKind.GLOBAL:
                    self.last_closure = max(self.last_closure, link.i, link.j)
        self.skeleton.reserve(stored.last + 1)
        self._anchors = AnchorPoses(stored.anchors)
        self._wake(
            [node for node, state in states.items() if state.awake and self.skeleton.kept(node) is NodeStatus.LTM]
        )
        self.map_id = max((map_id for _, map_id, _ in stored.nodes), default=-1) + 1
        self._counts.clear()
