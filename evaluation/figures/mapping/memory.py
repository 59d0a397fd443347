"""The memory over ten hours and after kills: constant time per frame, and durable commits."""

from __future__ import annotations

import math
import multiprocessing
import os
import signal
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from itertools import islice, pairwise
from pathlib import Path

import numpy as np

from evaluation.runs.patrol import CAMERA, Patrol, PatrolSecond
from waychair.calibration.chair_body import CHAIR_A
from waychair.geometry import compose, rotation
from waychair.maps.grid.cells import cells_from_points, inside
from waychair.slam.graph.edges import EdgeKind
from waychair.slam.mapping.appearance_loops import AppearanceLoopClosure
from waychair.slam.mapping.appearance_settings import AppearanceSettings
from waychair.slam.mapping.live_mapping import LiveMapping, LiveMappingSettings
from waychair.slam.memory.long_term_memory import LongTermStore
from waychair.slam.memory.memory_manager import NodeMemory
from waychair.slam.memory.memory_settings import MemorySettings
from waychair.slam.memory.nodes import LinkKind, MemoryNode, NodeStatus
from waychair.types import FloatArray, Json, Pose2

HOUR = 3600
LIMIT = 300  # nodes in the working memory (WM)
UNLIMITED_HOURS = 1.5
MOST_SLOPE, MOST_RSS_MB, MOST_ATE = 0.05, 600.0, 1.10
KILLS = 200


def bounded(out: Path, hours: float = 10.0, unlimited_hours: float = UNLIMITED_HOURS) -> Json:
    """A patrol of 10 h at 1 Hz with at most 300 nodes in the WM; mapper, memory, words, belief and grid are those of
    `waychair map`. Features are synthesised instead of pictures (see `patrol`).

    The run without a limit is shorter, as its time grows with the square of its length. The two are compared by their
    trajectories over that part.
    """
    limited = _Drive(MemorySettings(working_memory_limit=LIMIT), hours)
    early = limited.run(until_hours=unlimited_hours)
    limited.run()
    figures = limited.figures()
    limited.close()
    _plot(out.with_suffix(".png"), limited)
    unlimited = _Drive(MemorySettings(), unlimited_hours)
    free = unlimited.run()
    unlimited.close()
    passed = (
        figures["slope"] <= MOST_SLOPE
        and figures["rss_mb"] <= MOST_RSS_MB
        and early <= MOST_ATE * free
        and figures["grid_known"] >= 0.999
        and figures["false_links"] == 0
    )
    compared = {"ate_m_limited": round(early, 4), "ate_m_unlimited": round(free, 4), "compared_hours": unlimited_hours}
    return {"passed": bool(passed), **figures, **compared}


@dataclass(slots=True)
class _Log:
    """Per frame: CPU time [ms] of all but optimisation and grid, of the memory with words and belief in it, of the
    optimisation, of the grid; nodes; whether a loop was closed. Per minute: memory in use [MB]."""

    frame: list[float] = field(default_factory=list)
    memory: list[float] = field(default_factory=list)
    optimisation: list[float] = field(default_factory=list)
    grid: list[float] = field(default_factory=list)
    nodes: list[tuple[int, int, int]] = field(default_factory=list)
    closed: list[bool] = field(default_factory=list)
    rss: list[float] = field(default_factory=list)


class _Drive:
    """A patrol mapped like a recording: scans, then the pictures between them, then the grid."""

    def __init__(self, settings: MemorySettings, hours: float, seed: int = 6) -> None:
        self._folder = tempfile.TemporaryDirectory()
        memory = NodeMemory(settings, LongTermStore(Path(self._folder.name) / "memory.db"))
        self.live = LiveMapping(LiveMappingSettings(), Pose2())
        seeing = AppearanceSettings(gap=1.5, memory=settings)  # one scan per second
        self.appearance = AppearanceLoopClosure(seeing, CHAIR_A.base_from_camera, memory)
        self.log = _Log()
        self.truth: list[Pose2] = []
        self._sights = islice(Patrol(seed).sights(), int(hours * HOUR))

    def run(self, until_hours: float = math.inf) -> float:
        """Drive on; return the error [m] of the aligned trajectory up to then."""
        for sight in self._sights:
            self._frame(sight)
            if len(self.truth) >= until_hours * HOUR:
                break
        return self.ate()

    def ate(self) -> float:
        """Return the RMSE [m] of the map's present trajectory."""
        mapper = self.live.mapper
        poses = compose(mapper.keys.poses[mapper.frames.keys], mapper.frames.poses)
        return aligned_rmse(poses, self.truth)

    def close(self) -> None:
        self.appearance.memory.close()
        self._folder.cleanup()

    def _frame(self, sight: PatrolSecond) -> None:
        live, log = self.live, self.log
        frame, keys = sight.frame, live.mapper.keys
        before, loops = self._spent(), keys.kinds[EdgeKind.LOOP]
        live.include(live.reckon(frame))
        mapped = time.process_time()
        solved = live.mapper.seconds["optimisation"]
        self.appearance.take(frame.stamp_ns, sight.features, CAMERA)
        self.appearance.follow(live.mapper, frame)
        remembered = time.process_time() - mapped - (live.mapper.seconds["optimisation"] - solved)
        live.draw()
        whole, optimisation, grid = (1e3 * (self._spent() - before)).tolist()
        log.frame.append(whole - optimisation - grid)
        log.memory.append(1e3 * remembered)
        log.optimisation.append(optimisation)
        log.grid.append(grid)
        log.closed.append(keys.kinds[EdgeKind.LOOP] > loops)
        counts = self.appearance.memory.counts()
        log.nodes.append((counts.stm, counts.wm, counts.ltm))
        if len(self.truth) % 60 == 0:
            log.rss.append(_rss_mb())
        self.truth.append(sight.truth)

    def _spent(self) -> FloatArray:
        """Return the CPU times [s] so far: total, optimisation, grid."""
        return np.array([time.process_time(), self.live.mapper.seconds["optimisation"], self.live.seconds["grid"]])

    def figures(self) -> Json:
        log, memory = self.log, self.appearance.memory
        frame, remembered, solved, grid = (np.array(row) for row in (log.frame, log.memory, log.optimisation, log.grid))
        closed = np.array(log.closed)
        whole = frame + solved + grid
        keys = self.live.mapper.keys
        return {
            "frames": len(frame),
            "slope": round(slope(frame), 4),
            "slope_memory": round(slope(remembered), 4),
            "slope_with_optimisation_and_grid": round(slope(whole), 4),
            "frame_ms": _spread(frame),
            "memory_ms": _spread(remembered),
            "optimisation_ms": _spread(solved),
            "grid_ms": _spread(grid),
            "worst_frame_after_closure_ms": round(float(whole[closed].max(initial=0.0)), 1),
            "closures": int(closed.sum()),
            "rss_mb": round(max(log.rss), 1),
            "rss_first_hour_mb": round(log.rss[min(60, len(log.rss) - 1)], 1),
            "file_mb": round((Path(self._folder.name) / "memory.db").stat().st_size / 1e6, 1),
            "wm_most": max(wm for _, wm, _ in log.nodes),
            "key_scans": len(keys),
            "edges": len(keys.edges),
            "ate_m": round(self.ate(), 4),
            "grid_known": round(self._known(), 5),
            "false_links": self._false_links(),
            "counts": asdict(memory.counts(len(self.appearance.recognition.vocabulary))),
        }

    def _known(self) -> float:
        """Return the share of all visited positions that are free in the grid, whether asleep or not."""
        grid, mapper = self.live.grid(), self.live.mapper
        at = compose(mapper.keys.poses[mapper.frames.keys], mapper.frames.poses)[:, :2]
        cells = cells_from_points(grid, at)
        there = inside(grid, cells)
        values = grid.cells[tuple(cells[there].T)]
        return float(((values >= 0) & (values < 50)).sum() / len(at))

    def _false_links(self) -> int:
        """Return the number of loops by appearance with an error of 0.5 m or more."""
        skeleton, false = self.appearance.memory.skeleton, 0
        for link in skeleton.every_link():
            if link.kind is LinkKind.GLOBAL:
                a, b = (self.truth[int(skeleton.rows["stamp_ns"][k]) // 10**9] for k in (link.i, link.j))
                gap = (a.inverse() @ b).inverse() @ link.i_from_j
                false += math.hypot(gap.x, gap.y) > 0.5
        return int(false)


def _spread(milliseconds: FloatArray) -> Json:
    figures = {"median": np.median(milliseconds), "p99": np.quantile(milliseconds, 0.99), "max": milliseconds.max()}
    return {name: round(float(value), 2) for name, value in figures.items()}


def slope(milliseconds: FloatArray) -> float:
    """Return the growth of the time per frame from the first hour to the end, by a line fitted through the minutes."""
    minutes = len(milliseconds) // 60
    means = milliseconds[: 60 * minutes].reshape(minutes, 60).mean(axis=1)
    after = np.arange(min(60, minutes // 10), minutes)
    gradient, start = np.polyfit(after - after[0], means[after], 1)
    return float(gradient * len(after) / start)


def aligned_rmse(poses: FloatArray, truth: list[Pose2]) -> float:
    """Return the RMSE [m] of positions (N, 3) after the best rotation and shift (Umeyama, 1991)."""
    a, b = poses[:, :2], np.array([(pose.x, pose.y) for pose in truth])
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    angle = math.atan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())
    return float(np.sqrt(((a @ rotation(angle).T - b) ** 2).sum(axis=1).mean()))


def _rss_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def _plot(path: Path, drive: _Drive) -> None:
    import matplotlib.pyplot as plt

    path.parent.mkdir(parents=True, exist_ok=True)
    figure, (times, graph, nodes) = plt.subplots(3, 1, figsize=(8, 8), sharex=True, layout="constrained")
    minutes = len(drive.log.frame) // 60
    hours = np.arange(minutes) / 60

    def by_minute(values: list[float]) -> FloatArray:
        return np.array(values[: 60 * minutes]).reshape(minutes, 60)

    frame = by_minute(drive.log.frame)
    times.plot(hours, frame.max(axis=1), color="0.8", label="slowest of a minute")
    times.plot(hours, frame.mean(axis=1), label="mean of a minute")
    times.plot(hours, by_minute(drive.log.memory).mean(axis=1), label="of it the memory")
    times.set(ylabel="frame, CPU [ms]", ylim=(0, 3 * float(np.quantile(frame, 0.99))))
    graph.plot(hours, by_minute(drive.log.optimisation).max(axis=1), label="optimisation, slowest of a minute")
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
    """A mapping process killed (kill -9) at random moments, and its file reopened each time: all committed nodes are
    there and unchanged, and at most the last node is lost."""
    rng = np.random.default_rng(2026)
    lost, wrong, opened, frames = [], 0, [], 0
    with tempfile.TemporaryDirectory() as folder:
        for number in range(kills):
            path = Path(folder) / f"memory-{number // 20}.db"  # twenty kills per file
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
    """Kill a child process; return the nodes of finished additions."""
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
    lines = said.decode().split("\n")[:-1]  # the last line may be incomplete
    return [int(line) for line in lines]


def _map_for_ever(path: Path, tell: int) -> None:
    memory = NodeMemory(MemorySettings(working_memory_limit=30), LongTermStore(path))
    while True:
        node = memory.skeleton.count
        memory.add(made_of(node), np.eye(3))
        os.write(tell, f"{node}\n".encode())
        memory.retrieve(min(memory.wm, default=None), Pose2())
        memory.transfer()


def made_of(number: int) -> MemoryNode:
    """Return a node with contents computed from its number, all different."""
    rng = np.random.default_rng(number)
    words = np.arange(1, 201, dtype=np.int32) + 200 * number
    points, bits = rng.random((200, 3), np.float32), rng.integers(0, 256, (200, 32), dtype=np.uint8)
    return MemoryNode(number * 1_000_000_000, Pose2(0.5 * number), words, points[:, :2], points, bits)


def _ids(path: Path) -> list[int]:
    store = LongTermStore(path)
    try:
        return [node for node, _, _ in store.load().nodes]
    finally:
        store.close()


def _differing(path: Path) -> int:
    """Return the number of nodes in a file that are changed, disconnected or unreadable."""
    memory = NodeMemory(store=LongTermStore(path))
    nodes = memory.skeleton.ids(NodeStatus.WM, NodeStatus.LTM)
    wrong = sum(_differs(memory.node(node)) for node in nodes)
    wrong += sum(memory.skeleton.linked(a, b) is None for a, b in _consecutive(memory, nodes))
    memory.close()
    return wrong


def _differs(node: MemoryNode) -> bool:
    made = made_of(node.id)
    pairs = ((node.words, made.words), (node.points, made.points), (node.descriptors, made.descriptors))
    return not all(np.array_equal(a, b) for a, b in pairs)


def _consecutive(memory: NodeMemory, nodes: list[int]) -> Iterator[tuple[int, int]]:
    maps = memory.skeleton.rows["map_id"]
    return ((a, b) for a, b in pairwise(nodes) if maps[a] == maps[b])
