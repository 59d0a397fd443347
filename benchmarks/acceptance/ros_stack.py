"""The nodes of a chair as real processes over real DDS: rates, periods, latency, deaths and goals.

By stamps that the processes take themselves and the clock on the wall: on a computer that does other things, too, these
are figures of both. Each run begins with a fresh `waychair up` in a ROS domain of its own.
"""

from __future__ import annotations

import itertools
import math
import os
import random
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.acceptance.live_stack import WORLD, Death, LiveStack, Seen, kill, waychair
from waychair.files import write_json
from waychair.ros import topics
from waychair.ros.client import TaskResult
from waychair.ros.interface_types import interface_type
from waychair.ros.messages.motion import pose_stamped
from waychair.ros.messages.reports import read_diagnostics
from waychair.ros.messages.wire import native, serialised
from waychair.ros.topics import RosTopic
from waychair.simulation.world import load_world
from waychair.types import Json, Place, Pose2

_DOMAIN = 87
_DEATHS = int(os.environ.get("WAYCHAIR_DEATHS", "20"))
_PLAIN = ("--no-camera", "--no-people")
_SENSORS: tuple[RosTopic, ...] = (topics.IMU, topics.ODOMETRY, topics.SCAN, topics.COLOUR, topics.DEPTH)
_KILLED = ("navigator", "mapper", "bridge", "simulator")
_PATIENCE_S = 120.0
_KEPT = 0.97
"""Share of a sensor's nominal rate that counts as held: what is best effort may lose one."""

_GONE_MS, _BACK_S, _PERIOD_MS, _LATENCY_MS = 150.0, 5.0, 10.0, 120.0


def places() -> dict[str, Place]:
    """Of the world that is driven in."""
    return {place.name: place for place in load_world(WORLD).places}


def ros_killed(out: Path) -> Json:
    """Each node killed 20 times at a random moment of a drive: the lines let go, back, and nothing resumed.

    What became of each is written down at once, beside the stack's log.
    """
    deaths: list[Death] = []
    rng = random.Random(1)
    with LiveStack(out.with_suffix(""), _DOMAIN, *_PLAIN) as stack:
        for name in _KILLED * _DEATHS:  # in turn: who dies again and again is not started again for ever
            under_way(stack, rng.uniform(0.2, 4.0))
            deaths.append(kill(stack, name))
            write_json(stack.folder / "deaths.json", {"deaths": [asdict(death) for death in deaths]})
    gone, back = (np.array([getattr(death, key) for death in deaths]) for key in ("gone_ms", "back_s"))
    resumed = sum(death.resumed for death in deaths)
    return {
        "passed": bool((gone <= _GONE_MS).all() and (back <= _BACK_S).all()) and not resumed,
        "deaths": len(deaths),
        "resumed": resumed,
        "off_m": round(max(death.off_m for death in deaths), 3),
        "jitter_ms": round(max(death.jitter_ms for death in deaths), 1),
        **{
            f"{name}_{key}": round(max(getattr(d, key) for d in deaths if d.process == name), 2)
            for name in _KILLED
            for key in ("gone_ms", "back_s")
        },
        "median_gone_ms": round(float(np.median(gone)), 1),
        "median_back_s": round(float(np.median(back)), 2),
    }


def ros_goals(out: Path) -> Json:
    """Goals by topic, by the names of Nav2's own client, and by the command line, several in a row: all are reached."""
    known = places()
    reached: dict[str, bool] = {}
    with LiveStack(out.with_suffix(""), _DOMAIN, *_PLAIN) as stack:
        for name in ("reception", "ward"):
            reached[f"topic {name}"] = by_topic(stack, known[name])
        for name in ("entrance", "reception"):
            reached[f"action {name}"] = by_action(stack, known[name])
        names = ("entrance", "lift", "reception")
        told = waychair(_DOMAIN, "goto", *names, "--yes")
        stack.spin(0.5)
        last = is_at(stack, known[names[-1]])
        reached["command line"] = told.returncode == 0 and told.stdout.count("reached") == len(names) and last
        code = stack.end()
    return {"passed": all(reached.values()) and code == 0, "reached": reached, "exit_code": code}


def ros_rates(out: Path) -> Json:
    """Everything on, with the camera: each sensor's rate, the control loop's period, CPU and memory.

    Rates are those that bridge and navigator themselves report of what reached them, the mean of 20 s.
    """
    seconds = 20.0
    with LiveStack(out.with_suffix(""), _DOMAIN) as stack:
        reports = Seen()
        stack.listen(topics.DIAGNOSTICS, read_diagnostics, reports)
        stack.begin(far_goal(stack))
        began_ns = time.time_ns()
        cpu = _cpu_s(stack.process.pid)
        stack.spin(seconds)
        used = _cpu_s(stack.process.pid) - cpu
        rates = {topic.name: _reported_hz(reports, topic, began_ns) for topic in _SENSORS}
        memory = _memory_mb(stack.process.pid)
        periods = _periods_ms(stack)
    held = all(rates[topic.name] >= _KEPT * topic.rate_hz for topic in _SENSORS)
    return {
        "passed": held,
        **{f"{name}_hz": round(rate, 1) for name, rate in rates.items()},
        "cpu_percent_of_a_core": round(100.0 * used / seconds, 1),
        "memory_mb": round(memory),
        **periods,
    }


def ros_period(out: Path) -> Json:
    """The control loop of 20 Hz while it drives, by the stamps of its requests."""
    with LiveStack(out.with_suffix(""), _DOMAIN, *_PLAIN) as stack:
        stack.begin(far_goal(stack))
        stack.spin(20.0)
        periods = _periods_ms(stack)
    return {"passed": periods["period_error_p99_ms"] <= _PERIOD_MS, **periods}


def ros_latency(out: Path) -> Json:
    """From the end of a scan's sweep to the first change of the lines by what was decided from it.

    The simulator stamps both, a scan by its beginning; a request names the scan by which it was decided, and the bridge
    the one of the request that it answers. Scans after which the lines stayed as they were are left out.
    """
    with LiveStack(out.with_suffix(""), _DOMAIN, *_PLAIN) as stack:
        scans = Seen()
        stack.listen(topics.SCAN, lambda message: (_stamp(message), len(message.ranges), message.time_increment), scans)
        for _ in range(2):
            stack.begin(far_goal(stack))
            stack.until(lambda: not stack.driving, "the end of the drive", 120.0)
        delays = latencies_ms(stack, scans)
    p50, p99 = np.percentile(delays, [50, 99])
    return {
        "passed": bool(p99 <= _LATENCY_MS) and len(delays) > 100,
        "scans": len(delays),
        "p50_ms": round(float(p50), 1),
        "p99_ms": round(float(p99), 1),
        "worst_ms": round(float(max(delays)), 1),
    }


def latencies_ms(stack: LiveStack, scans: Seen) -> list[float]:
    """See `ros_latency`."""
    changes = np.array([lines.stamp_ns for _, lines in stack.lines.all])
    ends = {stamp: stamp + round((count - 1) * step * 1e9) for _, (stamp, count, step) in scans.all}
    delays, counted = [], set()
    states = [state for _, state in stack.states.all]
    for state, after in itertools.pairwise(states):
        if state.command is None or state.scan_ns in counted or state.scan_ns not in ends:
            continue
        counted.add(state.scan_ns)
        later = changes[changes >= state.stamp_ns]
        if len(later) and later[0] < after.stamp_ns:  # else they changed by what was decided next
            delays.append((later[0] - ends[state.scan_ns]) / 1e6)
    return delays


def under_way(stack: LiveStack, seconds: float) -> None:
    """A drive that has gone on for so long; another one, where a computer that stalls has ended it before."""
    ends = time.monotonic() + _PATIENCE_S
    while True:
        stack.begin(far_goal(stack))
        stack.spin(seconds)
        if stack.driving:
            return
        assert time.monotonic() < ends, f"no drive lasts {seconds:.1f} s:\n{stack.history()}\n{stack.log}"


def far_goal(stack: LiveStack) -> Pose2:
    """The place that is farthest from where the chair is."""
    here = stack.really.odom_from_base if stack.really is not None else Pose2()
    return max(
        (place.pose for place in places().values()), key=lambda pose: math.hypot(pose.x - here.x, pose.y - here.y)
    )


def is_at(stack: LiveStack, place: Place) -> bool:
    """Whether the chair really stands within a place's tolerances and as much again for what it does not know."""
    assert stack.really is not None
    off = place.pose.inverse() @ stack.really.odom_from_base
    return math.hypot(off.x, off.y) <= place.tolerance_m + 0.1 and abs(off.theta) <= place.tolerance_rad + 0.1


def by_topic(stack: LiveStack, place: Place) -> bool:
    """Drive there by goal_pose."""
    topic = topics.GOAL
    node = stack.client.node
    publisher = node.create_publisher(interface_type(topic.type), topic.name, topics.profile(topic.qos))
    stack.until(lambda: publisher.get_subscription_count() > 0, "the navigator to listen")

    def ask() -> None:
        publisher.publish(serialised(pose_stamped(node.get_clock().now().nanoseconds, place.pose)))

    stack.drive(ask, lambda: not stack.driving and is_at(stack, place))
    node.destroy_publisher(publisher)
    return is_at(stack, place)


def by_action(stack: LiveStack, place: Place) -> bool:
    """Drive there by the names of nav2_simple_commander."""
    client = stack.client
    client.waitUntilNav2Active()

    def ask() -> None:
        client.goToPose(native(pose_stamped(client.node.get_clock().now().nanoseconds, place.pose)))

    stack.drive(ask, lambda: client.getResult() is TaskResult.SUCCEEDED)
    return client.isTaskComplete() and client.getFeedback() is not None and is_at(stack, place)


def _reported_hz(reports: Seen, topic: RosTopic, since_ns: int) -> float:
    """Mean rate of a topic as bridge and navigator report it, of whichever gets less."""
    rates: dict[str, list[float]] = {}
    for _, each in reports.since(since_ns + 1_000_000_000):  # the first may be of the time before
        for report in each:
            if report.name.endswith(f": input {topic.name}"):
                rates.setdefault(report.name, []).append(float(dict(report.values)["rate [Hz]"]))
    chosen = [float(np.mean(found)) for name, found in rates.items() if name.startswith(("/bridge", "/navigator"))]
    return min(chosen, default=0.0)


def _periods_ms(stack: LiveStack) -> dict[str, Any]:
    """Errors of the navigator's period while it drives [ms]."""
    requests = [request for _, request in stack.requests.all]
    pairs = itertools.pairwise(requests)
    steps = [(b.stamp_ns - a.stamp_ns) / 1e6 for a, b in pairs if a.driving and b.driving]
    errors = np.abs(np.array(steps) - 50.0)
    return {
        "periods": len(steps),
        "period_error_p99_ms": round(float(np.percentile(errors, 99)), 1),
        "period_error_worst_ms": round(float(errors.max()), 1),
        "period_mean_ms": round(float(np.mean(steps)), 2),
    }


def _stamp(message: Any) -> int:
    return int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)


def _tree(root: int) -> Sequence[int]:
    """A process and all that it has started."""
    parents: dict[int, int] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit() and (stat := _read(entry / "stat")):
            parents[int(entry.name)] = int(stat.rsplit(") ", 1)[1].split()[1])
    found = [root]
    for pid in found:
        found += [child for child, parent in parents.items() if parent == pid]
    return found


def _cpu_s(root: int) -> float:
    """CPU time [s] that the processes of a tree have used so far (proc(5))."""
    ticks = 0
    for pid in _tree(root):
        if stat := _read(Path(f"/proc/{pid}/stat")):
            ticks += sum(map(int, stat.rsplit(") ", 1)[1].split()[11:13]))
    return ticks / os.sysconf("SC_CLK_TCK")


def _memory_mb(root: int) -> float:
    """Proportional set size of a tree [MB]: what processes share is counted once."""
    rows = [_read(Path(f"/proc/{pid}/smaps_rollup")) for pid in _tree(root)]
    return sum(int(line.split()[1]) for row in rows for line in row.splitlines() if line.startswith("Pss:")) / 1024.0


def _read(path: Path) -> str:
    """Empty for a process that has ended meanwhile."""
    try:
        return path.read_text(encoding="ascii", errors="replace")
    except OSError:
        return ""
