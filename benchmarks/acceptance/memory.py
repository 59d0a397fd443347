"""The memory over ten hours, and killed: its time per frame stays flat, and what was committed stays."""

from __future__ import annotations

import math
import multiprocessing
import os
import signal
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from itertools import islice, pairwise
from pathlib import Path

import numpy as np

from benchmarks.acceptance.patrol import Patrol, Sight
from waychair.geometry import rotation
from waychair.maps.grid_assembly import GridAssembly
from waychair.slam.edges import Edge, EdgeKind
from waychair.slam.long_term import LongTerm
from waychair.slam.memory import Change, Memory
from waychair.slam.memory_settings import MemorySettings
from waychair.slam.nodes import Kept, Link, LinkKind, Node
from waychair.slam.pose_graph import PoseGraph
from waychair.slam.rehearsal import Verdict
from waychair.slam.robust import GraphSettings
from waychair.types import FloatArray, Json, OccupancyGrid, Pose2

HOUR = 3600
LIMIT = 300  # nodes of the WM
MOST_SLOPE, MOST_RSS_MB, MOST_ATE = 0.05, 600.0, 1.10
KILLS = 200

_ALIKE = 0.35  # share of words from which a place is looked at closely
_NEAR, _TURNED = 1.5, math.radians(20)  # within which that look succeeds
_ANCHOR_WAY = 2.0  # [m] from one anchor to the next


def bounded(out: Path, hours: float = 10.0) -> Json:
    """A patrol of 10 h at 1 Hz with at most 300 nodes in the WM, against the same without a limit."""
    limited = _Drive(MemorySettings(memory_thr=LIMIT), hours)
    limited.run()
    figures, whole = limited.figures(), _drawn_from_memory(limited)
    same_grid = whole.map_from_grid == limited.grid.map_from_grid and np.array_equal(whole.cells, limited.grid.cells)
    limited.close()
    _plot(out.with_suffix(".png"), limited)
    unlimited = _Drive(MemorySettings(), hours, draws=False)
    unlimited.run()
    free = unlimited.figures()
    unlimited.close()
    passed = (
        figures["slope"] <= MOST_SLOPE
        and figures["rss_mb"] <= MOST_RSS_MB
        and figures["ate_m"] <= MOST_ATE * free["ate_m"]
        and same_grid
    )
    return {"passed": bool(passed), "grid_whole": bool(same_grid), **figures, "unlimited": free}


class _Appearance:
    """Stands for the dictionary and the Bayes filter: the node of the WM that shares most words with a view."""

    def __init__(self) -> None:
        self._nodes: dict[int, list[int]] = {}  # by word
        self._words: dict[int, set[int]] = {}

    def follow(self, memory: Memory, change: Change) -> None:
        for node in change.left_wm:
            for word in self._words.pop(node):
                self._nodes[word].remove(node)
                if not self._nodes[word]:
                    del self._nodes[word]
        for node in change.entered_wm:
            words = self._words[node] = set(memory.node(node).words.tolist())
            for word in words:
                self._nodes.setdefault(word, []).append(node)

    def best(self, node: Node) -> tuple[int | None, float]:
        """The place, and the share of words."""
        shared = Counter(other for word in set(node.words.tolist()) for other in self._nodes.get(word, ()))
        if not shared:
            return None, 0.0
        place, count = max(shared.items(), key=lambda item: (item[1], item[0]))
        return place, count / max(len(node.words), len(self._words[place]))


@dataclass(slots=True)
class _Log:
    """By frame: CPU [ms] of memory, graph and grid in the thread that drives; nodes; by minute: memory in use [MB]."""

    memory: list[float] = field(default_factory=list)
    graph: list[float] = field(default_factory=list)
    grid: list[float] = field(default_factory=list)
    nodes: list[tuple[int, int, int]] = field(default_factory=list)
    rss: list[float] = field(default_factory=list)


class _Drive:
    """A patrol whose nodes hang on a graph of anchors, which bends where a loop is found among the awake nodes."""

    def __init__(self, settings: MemorySettings, hours: float, seed: int = 6, draws: bool = True) -> None:
        self._draws = draws
        self._folder = tempfile.TemporaryDirectory()
        self.memory = Memory(settings, LongTerm(Path(self._folder.name) / "memory.db"))
        self.log, self.truth = _Log(), [Pose2()]  # by node id, from 1
        self.drawn: list[int] = []  # nodes whose scan is in the grid
        self._sights = islice(Patrol(seed).sights(), int(hours * HOUR))
        self._graph, self._assembly, self._appearance = PoseGraph(GraphSettings()), GridAssembly(), _Appearance()
        self._rng = np.random.default_rng(seed)
        self._at, self._off, self._odometry = 0, Pose2(), Pose2()
        self._joined: set[tuple[int, int]] = set()
        self._graph.add(np.zeros((1, 3)), [])

    def run(self) -> None:
        for number, sight in enumerate(self._sights):
            self._frame(sight)
            counts = self.memory.counts()
            self.log.nodes.append((counts.stm, counts.wm, counts.ltm))
            if number % 60 == 0:
                self.log.rss.append(_rss_mb())
        self.memory.flush()
        self._assembly.settle()

    @property
    def grid(self) -> OccupancyGrid:
        return self._assembly.grid()

    @property
    def anchors(self) -> FloatArray:
        return self._graph.poses

    def close(self) -> None:
        self.memory.close()
        self._folder.cleanup()

    def figures(self) -> Json:
        memory, graph, grid = (np.array(row) for row in (self.log.memory, self.log.graph, self.log.grid))
        ids = np.array(self.memory.skeleton.ids())
        counts = self.memory.counts()
        file = Path(self._folder.name) / "memory.db"
        return {
            "frames": len(memory),
            "memory_ms_median": round(float(np.median(memory)), 3),
            "memory_ms_p99": round(float(np.quantile(memory, 0.99)), 3),
            "memory_ms_max": round(float(memory.max()), 3),
            "slope": round(slope(memory), 4),
            "graph_ms_mean": round(float(graph.mean()), 3),
            "graph_ms_max": round(float(graph.max()), 1),
            "grid_ms_mean": round(float(grid.mean()), 3),
            "grid_ms_max": round(float(grid.max()), 1),
            "rss_mb": round(max(self.log.rss), 1),
            "rss_first_hour_mb": round(self.log.rss[min(60, len(self.log.rss) - 1)], 1),
            "file_mb": round(file.stat().st_size / 1e6, 1),
            "wm_most": max(wm for _, wm, _ in self.log.nodes),
            "anchors": len(self._graph.poses),
            "ate_m": round(aligned_rmse(self.memory.poses(ids), [self.truth[k] for k in ids.tolist()]), 4),
            "counts": asdict(counts),
        }

    def _frame(self, sight: Sight) -> None:
        node, memory = sight.node, self.memory
        motion = self._odometry.inverse() @ node.odom_from_base
        self._odometry, self._off = node.odom_from_base, self._off @ motion
        clock = [time.thread_time()]
        memory.bend(self._graph.poses)
        added = memory.add(node, np.diag([2500.0, 2500.0, 1e4]), self._at, self._off)
        clock.append(time.thread_time())  # memory
        self.truth += [sight.truth] * (memory.skeleton.count - len(self.truth))
        self._appearance.follow(memory, added.change)
        place, share = self._appearance.best(node)
        clock.append(time.thread_time())  # appearance
        here = memory.poses([added.id])[0]
        woken = memory.retrieve(place, Pose2(*here.tolist()))
        clock.append(time.thread_time())  # memory
        self._appearance.follow(memory, woken)
        link = None if place is None or share < _ALIKE else self._looked_at(place, added.id)
        clock.append(time.thread_time())  # appearance
        if link is not None:
            memory.link(link)
        slept = memory.transfer()
        clock.append(time.thread_time())  # memory
        is_anchor = False
        if link is not None:
            self._close(link)
        elif added.verdict is not Verdict.MERGE:  # an older node has its anchor already
            is_anchor = self._extend(added.id)
        clock.append(time.thread_time())  # graph
        if self._draws:
            self._draw(added.id if is_anchor else None, here)
        clock.append(time.thread_time())  # grid
        self._appearance.follow(memory, slept)
        adding, _, waking, _, sleeping, graph, drawing = (1e3 * np.diff(clock)).tolist()
        self.log.memory.append(adding + waking + sleeping)
        self.log.graph.append(graph)
        self.log.grid.append(drawing)

    def _extend(self, node: int) -> bool:
        """Whether the node becomes an anchor: it is the first, or knows no place and is far from the last anchor."""
        distance, is_first = math.hypot(self._off.x, self._off.y), self.memory.skeleton.count == 2
        if not is_first and distance < _ANCHOR_WAY:
            return False
        if not is_first:
            sigmas = np.array([0.02 * distance + 0.01, 0.02 * distance + 0.01, 0.02 + 0.01 * distance])
            edge = Edge(self._at, len(self._graph.poses), self._off, np.diag(sigmas**-2), EdgeKind.ODOMETRY)
            pose = Pose2(*self._graph.poses[self._at].tolist()) @ self._off
            self._graph.add(pose.array()[None], [edge])
            self._graph.update()
            self._at, self._off = edge.j, Pose2()
            self.memory.hang(node, self._at, self._off)
        return True

    def _looked_at(self, place: int, node: int) -> Link | None:
        """Stands for registration: the relative pose with its noise, where the two views overlap well."""
        apart = self.truth[place].inverse() @ self.truth[node]
        linked = self.memory.skeleton.linked(place, node) is not None
        if linked or math.hypot(apart.x, apart.y) > _NEAR or abs(apart.theta) > _TURNED:
            return None
        noise = self._rng.standard_normal(3) * (0.02, 0.02, 0.005)
        return Link(place, node, LinkKind.GLOBAL, apart @ Pose2(*noise.tolist()), np.diag([2500.0, 2500.0, 4e4]))

    def _close(self, link: Link) -> None:
        """The chair goes on from the anchor of the place it knows; the two anchors are joined, once."""
        skeleton = self.memory.skeleton
        edge = skeleton.anchor_edge(link)
        if edge is None:
            return
        ends = (min(edge.i, edge.j), max(edge.i, edge.j))
        if ends not in self._joined:
            self._joined.add(ends)
            self._graph.add(np.empty((0, 3)), [edge])
            self._graph.update()
        self._at, self._off = edge.i, skeleton.anchor_from_node(link.i) @ link.i_from_j

    def _draw(self, node: int | None, here: FloatArray) -> None:
        if node is not None:
            found = self.memory.node(node).evidence
            assert found is not None
            off = self.memory.skeleton.anchor_from_node(node).array()
            anchor = int(self.memory.skeleton.rows["anchor"][node])
            self._assembly.add(node, found.scan, anchor, off, off)
            self.drawn.append(node)
        self._assembly.bend(self._graph.poses, here[:2])
        self._assembly.draw()


def slope(milliseconds: FloatArray) -> float:
    """By how much the time per frame has grown at the end, against after the first hour, by a line through its minutes."""
    minutes = len(milliseconds) // 60
    means = milliseconds[: 60 * minutes].reshape(minutes, 60).mean(axis=1)
    after = np.arange(min(60, minutes // 10), minutes)
    gradient, start = np.polyfit(after - after[0], means[after], 1)
    return float(gradient * len(after) / start)


def aligned_rmse(poses: FloatArray, truth: list[Pose2]) -> float:
    """RMSE [m] of positions (N, 3) after the best rotation and shift (Umeyama, 1991)."""
    a, b = poses[:, :2], np.array([(pose.x, pose.y) for pose in truth])
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    angle = math.atan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())
    return float(np.sqrt(((a @ rotation(angle).T - b) ** 2).sum(axis=1).mean()))


def _drawn_from_memory(drive: _Drive) -> OccupancyGrid:
    """The grid drawn anew from what the memory gives back of nodes of which nearly all sleep."""
    assembly, skeleton = GridAssembly(), drive.memory.skeleton
    for chunk in drive.memory.evidence(drive.drawn):
        for node, found in chunk:
            off = skeleton.anchor_from_node(node).array()
            assembly.add(node, found.scan, int(skeleton.rows["anchor"][node]), off, off)
    assembly.bend(drive.anchors, np.zeros(2))
    assembly.settle()
    return assembly.grid()


def _rss_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def _plot(path: Path, drive: _Drive) -> None:
    import matplotlib.pyplot as plt

    path.parent.mkdir(parents=True, exist_ok=True)
    figure, (times, graph, nodes) = plt.subplots(3, 1, figsize=(8, 8), sharex=True, layout="constrained")
    minutes = len(drive.log.memory) // 60
    hours = np.arange(minutes) / 60

    def by_minute(values: list[float]) -> FloatArray:
        return np.array(values[: 60 * minutes]).reshape(minutes, 60)

    memory = by_minute(drive.log.memory)
    times.plot(hours, memory.max(axis=1), color="0.8", label="slowest of a minute")
    times.plot(hours, memory.mean(axis=1), label="mean of a minute")
    times.set(ylabel="memory, CPU per frame [ms]", ylim=(0, 3 * float(np.quantile(memory, 0.99))))
    graph.plot(hours, by_minute(drive.log.graph).max(axis=1), label="optimisation, slowest of a minute")
    graph.plot(hours, by_minute(drive.log.grid).max(axis=1), label="grid, slowest of a minute")
    graph.set(ylabel="CPU per frame [ms]", ylim=(0, None))
    for values, name in zip(np.array(drive.log.nodes).T, ("STM", "WM", "LTM"), strict=True):
        nodes.plot(np.arange(len(values)) / HOUR, values, label=name)
    nodes.set(ylabel="nodes", yscale="symlog", xlabel="time [h]", ylim=(0, None))
    used = nodes.twinx()
    used.plot(np.arange(len(drive.log.rss)) / 60, drive.log.rss, "k:")
    nodes.plot([], [], "k:", label="RSS")
    used.set(ylabel="RSS [MB]", ylim=(0, MOST_RSS_MB))
    for axes in (times, graph, nodes):
        axes.legend(loc="upper right" if axes is not nodes else "center right")
    figure.savefig(path, dpi=120)
    plt.close(figure)


def killed(out: Path, kills: int = KILLS) -> Json:
    """A mapping process killed (kill -9) at random moments, and its file opened again each time: every node that was
    committed is there and as it was, and no more than the last one is lost."""
    rng = np.random.default_rng(2026)
    lost, wrong, opened, frames = [], 0, [], 0
    with tempfile.TemporaryDirectory() as folder:
        for number in range(kills):
            path = Path(folder) / f"memory-{number // 20}.db"  # the same file is killed twenty times
            before = set(_ids(path)) if path.exists() else set()
            added = _killed_after(path, float(rng.uniform(0.0, 0.4)))
            started = time.process_time()
            there = set(_ids(path))
            opened.append(time.process_time() - started)
            missing = (before | set(added)) - there
            frames += len(added)
            lost.append(len(missing))
            wrong += not missing <= set(added[-1:])
            wrong += _differing(path)
    return {
        "passed": wrong == 0 and frames > kills,
        "kills": kills,
        "nodes_added": frames,
        "most_lost": max(lost),
        "kills_that_lost_one": sum(lost),
        "nodes_wrong": int(wrong),
        "open_cpu_ms_max": round(1e3 * max(opened), 1),
    }


def _killed_after(path: Path, seconds: float) -> list[int]:
    """Nodes whose addition had returned in a child process when it was killed."""
    read, tell = os.pipe()
    child = multiprocessing.get_context("fork").Process(target=_map_for_ever, args=(path, tell))
    child.start()
    os.close(tell)
    with os.fdopen(read, "rb") as pipe:
        time.sleep(seconds)
        assert child.pid is not None
        os.kill(child.pid, signal.SIGKILL)
        said = pipe.read()
    child.join()
    lines = said.decode().split("\n")[:-1]  # the last may be half a line
    return [int(line) for line in lines]


def _map_for_ever(path: Path, tell: int) -> None:
    memory = Memory(MemorySettings(memory_thr=30), LongTerm(path))
    while True:
        node = memory.skeleton.count
        memory.add(made_of(node), np.eye(3))
        os.write(tell, f"{node}\n".encode())
        memory.retrieve(min(memory.wm, default=None), Pose2())
        memory.transfer()


def made_of(number: int) -> Node:
    """A node all of whose contents follow from its number; none is like another."""
    rng = np.random.default_rng(number)
    words = np.arange(1, 201, dtype=np.int32) + 200 * number
    points, bits = rng.random((200, 3), np.float32), rng.integers(0, 256, (200, 32), dtype=np.uint8)
    return Node(number * 1_000_000_000, Pose2(0.5 * number), words, points[:, :2], points, bits)


def _ids(path: Path) -> list[int]:
    store = LongTerm(path)
    try:
        return [node for node, _, _ in store.load().nodes]
    finally:
        store.close()


def _differing(path: Path) -> int:
    """Nodes in a file that are not as they were made, that no longer hang together, or that cannot be read."""
    memory = Memory(store=LongTerm(path))
    nodes = memory.skeleton.ids(Kept.WM, Kept.LTM)
    wrong = sum(_differs(memory.node(node)) for node in nodes)
    wrong += sum(memory.skeleton.linked(a, b) is None for a, b in _consecutive(memory, nodes))
    memory.close()
    return wrong


def _differs(node: Node) -> bool:
    made = made_of(node.id)
    pairs = ((node.words, made.words), (node.points, made.points), (node.descriptors, made.descriptors))
    return not all(np.array_equal(a, b) for a, b in pairs)


def _consecutive(memory: Memory, nodes: list[int]) -> Iterator[tuple[int, int]]:
    maps = memory.skeleton.rows["map_id"]
    return ((a, b) for a, b in pairwise(nodes) if maps[a] == maps[b])
