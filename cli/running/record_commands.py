"""`waychair record` and `waychair save`: the bag and the map of a running chair."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from waychair.cli.options.arguments import BadArgument, NonNegativeInt

NEEDED_TOPICS = ("/scan", "/odom", "/imu/data", "/tf_static")
"""Topics that `waychair map` needs, or without which it has to guess."""


def record_command(
    *,
    out: Annotated[Path | None, Parameter(name=["--out", "-o"])] = None,
    camera: bool = False,
    domain: NonNegativeInt | None = None,
    namespace: str = "",
    quiet: bool = False,
) -> None:
    """Record the topics of a running chair into a ROS 2 bag until Ctrl-C, for `waychair map`.

    Parameters
    ----------
    out
        The bag: a .mcap or .db3 file, or a folder; default drive-DATE-TIME.mcap.
    camera
        Record pictures and depth, about 25 MB a second before compression.
    domain
        ROS domain of the chair.
    namespace
        Namespace of the chair's nodes.
    quiet
        Print nothing but errors.
    """
    from waychair.ros.environment import enter_ros_environment
    from waychair.ros.nodes.recorder_node import record

    enter_ros_environment(domain=domain)
    path = out or Path(time.strftime("drive-%Y%m%d-%H%M%S.mcap"))
    if not quiet:
        print(f"recording into {path}: stop with Ctrl-C", file=sys.stderr)
    done = record(path, camera, namespace)
    if quiet:
        return
    for topic in (name for name in NEEDED_TOPICS if not any(known.endswith(name) for known in done.counts)):
        print(f"warning: nothing was received on {topic}", file=sys.stderr)
    print(f"{done.path}: {done.seconds:.1f} s, {done.megabytes:.1f} MB in {sum(done.counts.values())} messages")


def save_command(
    folder: Path | None = None,
    /,
    *,
    out: Annotated[Path | None, Parameter(name=["--out", "-o"])] = None,
    domain: NonNegativeInt | None = None,
    namespace: str = "",
    quiet: bool = False,
) -> None:
    """Write the map of the running chair to a folder; also works during mapping.

    Parameters
    ----------
    folder
        The map's folder; or give it as --out.
    out
        The map's folder.
    domain
        ROS domain of the chair.
    namespace
        Namespace of the chair's nodes.
    quiet
        Print nothing but errors.
    """
    from waychair.ros.map_saving import save_running_map

    target = folder or out
    if target is None or (folder is not None and out is not None):
        raise BadArgument("give the folder of the map once: waychair save FOLDER, or --out FOLDER")
    save_running_map(target, domain=domain, namespace=namespace)
    if not quiet:
        print(f"{target}/map.yaml")
