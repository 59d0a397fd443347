"""Commands that keep what a running chair senses and makes: a bag of its drive, its map."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from waychair.cli.arguments import Count

USUAL = ("/scan", "/odom", "/imu/data", "/tf_static")
"""Without these `waychair map` has to guess, or can do nothing."""


def record_command(
    *,
    out: Annotated[Path | None, Parameter(name=["--out", "-o"])] = None,
    camera: bool = False,
    domain: Count | None = None,
    namespace: str = "",
) -> None:
    """Record what the nodes of a chair say into a ROS 2 bag, until Ctrl-C; `waychair map` makes a map of it.

    Parameters
    ----------
    out
        The bag: a file that ends in .mcap or .db3, or a folder; by default drive-DATE-TIME.mcap.
    camera
        With pictures and depth, some 25 MB a second before they are compressed.
    domain
        ROS domain of the chair.
    namespace
        Namespace of the chair's nodes.
    """
    from waychair.ros.environment import enter_ros_environment
    from waychair.ros.recorder_node import record

    enter_ros_environment(domain=domain)
    path = out or Path(time.strftime("drive-%Y%m%d-%H%M%S.mcap"))
    print(f"recording into {path}: end it with Ctrl-C", file=sys.stderr)
    done = record(path, camera, namespace)
    for topic in (name for name in USUAL if not any(known.endswith(name) for known in done.counts)):
        print(f"warning: nothing has come on {topic}", file=sys.stderr)
    print(f"{done.path}: {done.seconds:.1f} s, {done.megabytes:.1f} MB in {sum(done.counts.values())} messages")


def save_command(folder: Path, /, *, domain: Count | None = None, namespace: str = "") -> None:
    """Write the map of the running chair to a folder, also while it is being made.

    Parameters
    ----------
    folder
        The map's folder.
    domain
        ROS domain of the chair.
    namespace
        Namespace of the chair's nodes.
    """
    from waychair.ros.map_saving import save_running_map

    save_running_map(folder, domain=domain, namespace=namespace)
    print(f"{folder}/map.yaml")
