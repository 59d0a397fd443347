"""The map that the nodes make on the way against the one that `waychair map` makes of the drive's bag."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from waychair.geometry import wrap_angle
from waychair.maps.map_files import load_map
from waychair.recording import read_recording, read_tum
from waychair.runtime.mapping import MappingSettings, map_recording
from waychair.simulation.world import load_world
from waychair.types import FloatArray, JoystickInput, Json

if TYPE_CHECKING:
    from tests.ros.harness import Harness

WORLD = "small_clinic"
DOMAIN = 91
BAR_M = 0.02
_REACHED_M, _STICK_HZ, _LONGEST_S = 0.25, 25.0, 400.0


def ros_mapping(out: Path) -> Json:
    """A simulated chair driven by the rider's stick along the world's mapping route, mapped live and recorded.

    The bag begins before the map; it is mapped from the scan on at which the live map begins, so that both have the same
    origin. Poses of the same scans and the cells of both grids are compared as they are. `longest_gap_s` is between two
    scans: a computer that stalls makes no fair comparison.
    """
    from tests.ros.harness import Harness, ended

    from waychair.ros import topics
    from waychair.ros.environment import enter_ros_environment

    out.mkdir(parents=True, exist_ok=True)
    bag, kept = out / "drive.mcap", out / "live"
    bag.unlink(missing_ok=True)
    enter_ros_environment(domain=DOMAIN)
    recording = ("--ros-args", "-p", f"out:={bag}")
    mapping = ("-p", "mapping:=true", "-p", f"keep:={kept}")
    simulated = ("-p", f"world:={WORLD}", "-p", "people:=false", "-p", "camera:=false", "-p", "board:=false")
    with Harness(DOMAIN) as ros, ros.process("-m", "waychair.ros.recorder_node", *recording) as recorder:
        with ros.process("-m", "waychair.ros.simulator_node", "--ros-args", *simulated):
            ros.report("recorder: recording", lambda report: int(dict(report.values).get("/scan", 0)) > 10)
            with ros.process("-m", "waychair.ros.mapper_node", "--ros-args", *mapping) as mapper:
                found = ros.heard(topics.LOCALISATION)
                ros.spin_until(lambda: found, "the mapper")
                driven = _drive(ros, load_world(WORLD).route())
                ended(mapper)
        ended(recorder)
    live = read_tum(kept / "trajectory.tum")
    recorded = read_recording(bag)
    frames = tuple(frame for frame in recorded.frames if frame.stamp_ns >= live.stamps_ns[0])
    offline = map_recording(replace(recorded, frames=frames), MappingSettings())
    common, first, second = np.intersect1d(live.stamps_ns, offline.result.driven.stamps_ns, return_indices=True)
    apart = live.poses[first] - offline.result.driven.poses[second]
    metres = np.hypot(apart[:, 0], apart[:, 1])
    one, other = load_map(kept), offline.grid
    same = one.cells.shape == other.cells.shape and bool((one.cells == other.cells).all())
    return {
        "world": WORLD,
        "route_done": driven,
        "scans": {"live": len(live.stamps_ns), "bag": len(offline.result.driven.stamps_ns), "common": len(common)},
        "apart_m": {"mean": round(float(metres.mean()), 5), "max": round(float(metres.max()), 5)},
        "turned_rad_max": round(max(abs(wrap_angle(turn)) for turn in apart[:, 2].tolist()), 5),
        "grids_are_the_same": same,
        "longest_gap_s": round(float(np.diff(live.stamps_ns).max()) * 1e-9, 2),
        "loops": sum(edge.kind.value == "loop" for edge in offline.result.edges),
        "passed": driven and float(metres.max()) <= BAR_M,
    }


def _drive(ros: Harness, route: FloatArray) -> bool:
    """Follow waypoints (N, 2) [m, map] by the stick, as the truth says where the chair is; whether all were reached."""
    from waychair.ros import topics
    from waychair.ros.interface_types import interface_type
    from waychair.ros.messages.sensors import joy
    from waychair.ros.messages.wire import serialised

    truth = ros.heard(topics.TRUTH)
    stick = ros.node.create_publisher(interface_type(topics.JOY.type), topics.JOY.name, topics.profile(topics.JOY.qos))
    ros.spin_until(lambda: len(truth) > 50, "the simulator")
    began, reached, pushed = time.monotonic(), 0, 0.0
    while reached < len(route) and time.monotonic() - began < _LONGEST_S:
        ros.executor.spin_once(timeout_sec=0.02)
        if time.monotonic() - pushed < 1.0 / _STICK_HZ:
            continue
        pushed, here = time.monotonic(), truth[-1].pose.pose
        ahead = route[reached] - (here.position.x, here.position.y)
        heading = 2.0 * math.atan2(here.orientation.z, here.orientation.w)
        turn = wrap_angle(math.atan2(ahead[1], ahead[0]) - heading)
        reached += math.hypot(*ahead) < _REACHED_M
        forward = 0.5 * max(0.0, math.cos(turn)) ** 3
        stick.publish(serialised(joy(JoystickInput(time.time_ns(), forward, min(max(1.2 * turn, -0.6), 0.6)))))
    ros.spin_until(lambda: abs(truth[-1].twist.twist.linear.x) < 0.01, "the chair to rest")
    return reached == len(route)
