"""Saving the map of a running chair to a folder."""

from __future__ import annotations

import time
from pathlib import Path

from waychair.errors import RosError
from waychair.ros.client import ChairClient
from waychair.ros.interface_types import interface_type

SERVICE = "map_saver/save_map"


def save_running_map(folder: Path, *, domain: int | None = None, namespace: str = "", timeout_s: float = 60.0) -> None:
    """Ask the mapper to save its map; `folder` is a path on the mapper's computer.

    Raises:
        RosError: the mapper does not answer in time, or could not save.
    """
    kind = interface_type("nav2_msgs/srv/SaveMap")
    with ChairClient(domain=domain, namespace=namespace) as client:
        asked = client.node.create_client(kind, SERVICE)
        ends = time.monotonic() + timeout_s
        while not asked.service_is_ready():
            client.spin(0.05)
            if time.monotonic() > min(ends, ends - timeout_s + 5.0):
                raise RosError(f"no node offers '{SERVICE}': start the chair with `waychair up`")
        answer = asked.call_async(kind.Request(map_url=str(folder.resolve())))
        while not answer.done():
            client.spin(0.05)
            if time.monotonic() > ends:
                raise RosError(f"the map was not saved within {timeout_s:g} s: see the mapper's messages")
        if not answer.result().result:
            raise RosError(f"the map was not saved in {folder}: see the mapper's messages")
