"""The nodes of a chair as real processes over real DDS: rates, periods, latency, deaths and goals.

The times are the processes' own stamps in wall time, so other load on the computer affects them. Each run begins with a
fresh `waychair up` in its own ROS domain.
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

from evaluation.runs.live_stack import WORLD, Death, LiveStack, SeenMessages, kill, waychair
from waychair.files import write_json
from waychair.ros import topics
from waychair.ros.interface_types import interface_type
from waychair.ros.messages.motion import pose_stamped
from waychair.ros.messages.outcomes import TaskResult
from waychair.ros.messages.reports import read_diagnostics
from waychair.ros.messages.wire import native, serialised
from waychair.ros.topics import RosTopic
from waychair.simulation.plan.world import load_world
from waychair.types import Json, Place, Pose2

_DOMAIN = 87
_DEATHS = int(os.environ.get("WAYCHAIR_DEATHS", "20"))
_PLAIN = ("--no-camera", "--no-people")
_SENSORS: tuple[RosTopic, ...] = (topics.IMU, topics.ODOMETRY, topics.SCAN, topics.COLOUR, topics.DEPTH)
_KILLED = ("navigator", "mapper", "bridge", "simulator")
_PATIENCE_S = 120.0
_KEPT = 0.97
"""Least share of a sensor's nominal rate; best-effort topics may lose single messages."""

_GONE_MS, _BACK_S, _PERIOD_MS, _LATENCY_MS = 150.0, 5.0, 10.0, 120.0


def places() -> dict[str, Place]:
    """Return the places of the world."""
    return {place.name: place for place in load_world(WORLD).places}


def ros_killed(out: Path) -> Json:
    """Each node killed 20 times at a random moment of a drive: the lines are released, nothing resumes.

    Each result is written at once, beside the stack's log.
    """
    deaths: list[Death] = []
    rng = random.Random(1)
    with LiveStack(out.with_suffix(""), _DOMAIN, *_PLAIN) as stack:
        for name in _KILLED * _DEATHS:  # in turn, as a node that dies repeatedly is not restarted for ever
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
    """Goals by topic, by the interface of Nav2's client, and by the command line, several in a row: all are reached."""
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
    """All sensors on, with the camera: each sensor's rate, the control loop's period, CPU and memory.

    Rates are those that bridge and navigator report as received, averaged over 20 s.
    """
    seconds = 20.0
    with LiveStack(out.with_suffix(""), _DOMAIN) as stack:
        reports = SeenMessages()
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
    """The period of the 20 Hz control loop during a drive, by the stamps of its requests."""
    with LiveStack(out.with_suffix(""), _DOMAIN, *_PLAIN) as stack:
        stack.begin(far_goal(stack))
        stack.spin(20.0)
        periods = _periods_ms(stack)
    return {"passed": periods["period_error_p99_ms"] <= _PERIOD_MS, **periods}


def ros_latency(out: Path) -> Json:
    """From the end of a scan's sweep to the first change of the lines that is based on it.

    The simulator stamps both, a scan by its beginning. A request names its scan, and the bridge passes it on. Scans
    without a change of the lines are left out.
    """
    with LiveStack(out.with_suffix(""), _DOMAIN, *_PLAIN) as stack:
        scans = SeenMessages()
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


def latencies_ms(stack: LiveStack, scans: SeenMessages) -> list[float]:
    """Return the latencies [ms] of `ros_latency`."""
    changes = np.array([lines.stamp_ns for _, lines in stack.lines.all])
    ends = {stamp: stamp + round((count - 1) * step * 1e9) for _, (stamp, count, step) in scans.all}
    delays, counted = [], set()
    states = [state for _, state in stack.states.all]
    for state, after in itertools.pairwise(states):
        if state.command is None or state.scan_ns in counted or state.scan_ns not in ends:
            continue
        counted.add(state.scan_ns)
        later = changes[changes >= state.stamp_ns]
        if len(later) and later[0] < after.stamp_ns:  # else a later decision changed them
            delays.append((later[0] - ends[state.scan_ns]) / 1e6)
    return delays


def under_way(stack: LiveStack, seconds: float) -> None:
    """Wait until a drive has lasted this long; begin another one if a stall of the computer ended it."""
    ends = time.monotonic() + _PATIENCE_S
    while True:
        stack.begin(far_goal(stack))
        stack.spin(seconds)
        if stack.driving:
            return
        assert time.monotonic() < ends, f"no drive lasts {seconds:.1f} s:\n{stack.history()}\n{stack.log}"


def far_goal(stack: LiveStack) -> Pose2:
    """Return the place farthest from the chair."""
    here = stack.really.odom_from_base if stack.really is not None else Pose2()
    return max(
        (place.pose for place in places().values()), key=lambda pose: math.hypot(pose.x - here.x, pose.y - here.y)
    )


def is_at(stack: LiveStack, place: Place) -> bool:
    """Return whether the chair stands within twice a place's tolerances, to allow for localisation errors."""
    assert stack.really is not None
    off = place.pose.inverse() @ stack.really.odom_from_base
    return math.hypot(off.x, off.y) <= place.tolerance_m + 0.1 and abs(off.theta) <= place.tolerance_rad + 0.1


def by_topic(stack: LiveStack, place: Place) -> bool:
    """Drive to a place by the topic goal_pose."""
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
    """Drive to a place by the interface of nav2_simple_commander."""
    client = stack.client
    client.waitUntilNav2Active()

    def ask() -> None:
        client.goToPose(native(pose_stamped(client.node.get_clock().now().nanoseconds, place.pose)))

    stack.drive(ask, lambda: client.getResult() is TaskResult.SUCCEEDED)
    return client.isTaskComplete() and client.getFeedback() is not None and is_at(stack, place)


def _reported_hz(reports: SeenMessages, topic: RosTopic, since_ns: int) -> float:
    """Return the mean rate of a topic as reported by bridge and navigator, the lower of both."""
    rates: dict[str, list[float]] = {}
    for _, each in reports.since(since_ns + 1_000_000_000):  # the first report may cover earlier time
        for report in each:
            if report.name.endswith(f": input {topic.name}"):
                rates.setdefault(report.name, []).append(float(dict(report.values)["rate [Hz]"]))
    chosen = [float(np.mean(found)) for name, found in rates.items() if name.startswith(("/bridge", "/navigator"))]
    return min(chosen, default=0.0)


def _periods_ms(stack: LiveStack) -> dict[str, Any]:
    """Return the errors of the navigator's period during a drive [ms]."""
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
    """Return a process and all its descendants."""
    parents: dict[int, int] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit() and (stat := _read(entry / "stat")):
            parents[int(entry.name)] = int(stat.rsplit(") ", 1)[1].split()[1])
    found = [root]
    for pid in found:
        found += [child for child, parent in parents.items() if parent == pid]
    return found


def _cpu_s(root: int) -> float:
    """Return the CPU time [s] of a process tree so far (proc(5))."""
    ticks = 0
    for pid in _tree(root):
        if stat := _read(Path(f"/proc/{pid}/stat")):
            ticks += sum(map(int, stat.rsplit(") ", 1)[1].split()[11:13]))
    return ticks / os.sysconf("SC_CLK_TCK")


def _memory_mb(root: int) -> float:
    """Return the proportional set size of a process tree [MB]; shared pages count once."""
    rows = [_read(Path(f"/proc/{pid}/smaps_rollup")) for pid in _tree(root)]
    return sum(int(line.split()[1]) for row in rows for line in row.splitlines() if line.startswith("Pss:")) / 1024.0


def _read(path: Path) -> str:
    """Return a file's text, empty for a process that has ended."""
    try:
        return path.read_text(encoding="ascii", errors="replace")
    except OSError:
        return ""
