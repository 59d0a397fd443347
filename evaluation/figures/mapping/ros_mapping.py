"""The nodes' live map compared with the map that `waychair map` makes of the drive's bag."""

from __future__ import annotations

import math
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from evaluation.runs.live_stack import COMMAND, WORLD, LiveStack, SeenMessages
from waychair.geometry import wrap_angle
from waychair.maps.folders.map_files import load_map
from waychair.offline.mapping import MappingSettings, map_recording
from waychair.recordings.recording import read_recording, read_tum
from waychair.ros import topics
from waychair.ros.environment import ros_environment
from waychair.ros.interface_types import interface_type
from waychair.ros.messages.reports import read_diagnostics
from waychair.ros.messages.sensors import joy
from waychair.ros.messages.wire import serialised
from waychair.ros.stack import MADE_MAP
from waychair.simulation.plan.world import load_world
from waychair.types import FloatArray, JoystickInput, Json

DOMAIN = 91
BAR_M = 0.02
_REACHED_M, _STICK_HZ, _LONGEST_S = 0.25, 25.0, 400.0


def ros_mapping(out: Path) -> Json:
    """All nodes with a simulated chair, driven by joystick along the world's mapping route, mapped live and recorded by
    `waychair record` from the start of the map.

    Poses of the same scans and cells of both grids are compared without alignment. `longest_gap_s` between two scans
    shows whether the computer stalled, which makes the comparison unfair.
    """
    out = out.with_suffix("")
    bag = out / "drive.mcap"
    bag.unlink(missing_ok=True)
    with LiveStack(out, DOMAIN, "--no-camera", "--no-people", "--mapping") as stack, _recording(stack, bag):
        driven = _drive(stack, load_world(WORLD).route())
    kept = out / "run" / MADE_MAP
    live, recorded = read_tum(kept / "trajectory.tum"), read_recording(bag)
    offline = map_recording(recorded, MappingSettings())
    common, first, second = np.intersect1d(
        live.stamps_ns, offline.result.drive_trajectory.stamps_ns, return_indices=True
    )
    apart = live.poses[first] - offline.result.drive_trajectory.poses[second]
    metres = np.hypot(apart[:, 0], apart[:, 1])
    one, other = load_map(kept), offline.grid
    same = one.cells.shape == other.cells.shape and bool((one.cells == other.cells).all())
    return {
        "world": WORLD,
        "route_done": driven,
        "scans": {
            "live": len(live.stamps_ns),
            "bag": len(offline.result.drive_trajectory.stamps_ns),
            "common": len(common),
        },
        "apart_m": {"mean": round(float(metres.mean()), 5), "max": round(float(metres.max()), 5)},
        "turned_rad_max": round(max(abs(wrap_angle(turn)) for turn in apart[:, 2].tolist()), 5),
        "grids_are_the_same": same,
        "longest_gap_s": round(float(np.diff(live.stamps_ns).max()) * 1e-9, 2),
        "loops": sum(edge.kind.value == "loop" for edge in offline.result.edges),
        "passed": driven and len(common) > 0.9 * len(live.stamps_ns) and float(metres.max()) <= BAR_M,
    }


@contextmanager
def _recording(stack: LiveStack, bag: Path) -> Iterator[None]:
    """Run `waychair record` from its first scans until the chair rests."""
    reports = SeenMessages()
    stack.listen(topics.DIAGNOSTICS, read_diagnostics, reports)
    with subprocess.Popen(
        [*COMMAND, "record", "--out", str(bag)], env=ros_environment(domain=stack.domain)
    ) as recorder:
        stack.until(lambda: _scans_in(reports) > 10, "the recorder")
        try:
            yield
        finally:
            recorder.send_signal(signal.SIGINT)


def _scans_in(reports: SeenMessages) -> int:
    """Return the recorder's number of scans, by its own report."""
    said = [report for report in reports.last or () if report.name.endswith("recorder: recording")]
    return int(dict(said[0].values).get("/scan", 0)) if said else 0


def _drive(stack: LiveStack, route: FloatArray) -> bool:
    """Follow waypoints (N, 2) [m, map] by joystick and true pose; return whether all were reached."""
    topic = topics.JOY
    stick = stack.client.node.create_publisher(interface_type(topic.type), topic.name, topics.profile(topic.qos))
    began, reached, pushed = time.monotonic(), 0, 0.0
    while reached < len(route) and time.monotonic() - began < _LONGEST_S:
        stack.spin(0.01)
        if stack.really is None or time.monotonic() - pushed < 1.0 / _STICK_HZ:
            continue
        pushed, here = time.monotonic(), stack.really.odom_from_base
        ahead = route[reached] - (here.x, here.y)
        turn = wrap_angle(math.atan2(ahead[1], ahead[0]) - here.theta)
        reached += math.hypot(*ahead) < _REACHED_M
        forward = 0.5 * max(0.0, math.cos(turn)) ** 3
        stick.publish(serialised(joy(JoystickInput(time.time_ns(), forward, min(max(1.2 * turn, -0.6), 0.6)))))
    stack.until(lambda: stack.really is not None and abs(stack.really.twist.v) < 0.01, "the chair to rest")
    return reached == len(route)
