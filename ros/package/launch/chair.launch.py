"""Launch all nodes of a chair, as `waychair up` does: ros2 launch waychair_ros chair.launch.py sim:=small_clinic

Nodes and their parameter files come from `waychair.ros.stack`. A node that dies is restarted, but no drive resumes by
itself. There is no page, and so no countdown before a drive, unless `params` sets the bridge's `supervisor.countdown_s`.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch_ros.actions import Node

from waychair.ros.stack import Stack, processes
from waychair.ros.stack_checks import check_stack
from waychair.runtime.chair import ChairSettings

if TYPE_CHECKING:
    from launch import LaunchContext, LaunchDescriptionEntity

ARGUMENTS = {
    "sim": ("", "simulate a chair in this world (`waychair worlds`)"),
    "map": ("", "map folder to drive on; a simulated chair without one uses its world's floor plan"),
    "mapping": ("false", "make a map on the way"),
    "chair": ("", "a real chair's calibration file"),
    "cable": ("", "port of a real chair's board: /dev/ttyUSB0, pty:PATH or tcp:HOST:PORT"),
    "camera": ("true", "with a camera"),
    "perceive": ("false", "with the behaviour cells for a rider who cannot see"),
    "people": ("true", "with the world's people"),
    "seed": ("0", "seed of the simulated chair"),
    "namespace": ("", "namespace of all nodes"),
    "params": ("", "a ROS parameter file that overrides the others"),
    "out": ("out/up", "folder for the run's files"),
    "box": ("", "folder of the black box; by default `box` in the run's"),
}


def generate_launch_description() -> LaunchDescription:
    """Return the description for ros2 launch."""
    declared = [
        DeclareLaunchArgument(name, default_value=value, description=about)
        for name, (value, about) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=nodes)])


def nodes(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """Return the nodes' processes for the given arguments."""
    given = {name: context.launch_configurations[name] for name in ARGUMENTS}
    stack = Stack(
        folder=Path(given["out"]),
        world=given["sim"],
        map_folder=_path(given["map"]),
        mapping=_is_true(given["mapping"]),
        calibration=_path(given["chair"]),
        cable=given["cable"],
        camera=_is_true(given["camera"]),
        people=_is_true(given["people"]),
        seed=int(given["seed"]),
        parameters=_path(given["params"]),
        box=_path(given["box"]) or Path(given["out"], "box"),
        namespace=given["namespace"],
        settings={"cells": {"perceive": True}} if _is_true(given["perceive"]) else {},
    )
    check_stack(stack, ChairSettings())
    return [
        Node(
            package="waychair_ros",
            executable=row.name,
            arguments=list(row.arguments),
            output="screen",
            respawn=True,
            respawn_delay=0.2,
        )
        for row in processes(stack)
    ]


def _path(text: str) -> Path | None:
    return Path(text) if text else None


def _is_true(text: str) -> bool:
    return text.lower() in ("true", "1", "yes", "on")
