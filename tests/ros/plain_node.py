"""A node with a few settings and inputs, as a process for tests of `ChairNode`."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field

from waychair.config import Settings, setting
from waychair.ros.messages.sensors import read_scan
from waychair.ros.nodes.node import ChairNode, run_node
from waychair.ros.topics import SCAN


@dataclass(frozen=True, slots=True)
class Inner(Settings):
    """Nested settings."""

    range: float = setting(8.0, "m", "how far it looks", low=0.5, high=30.0)
    sectors: tuple[float, ...] = setting((), "rad", "where sectors begin")


@dataclass(frozen=True, slots=True)
class PlainSettings(Settings):
    """One of each kind."""

    name: str = setting("A", "", "name of the chair")
    beams: int = setting(3, "", "how many", low=1, high=9)
    speed: float = setting(0.5, "m/s", "how fast", low=0.0, high=1.5)
    loud: bool = setting(False, "", "whether it speaks")
    inner: Inner = field(default_factory=Inner)


class PlainNode(ChairNode[PlainSettings]):
    """Takes scans in, and lets its speed be changed."""

    def __init__(self, arguments: list[str] | None = None) -> None:
        super().__init__("plain", PlainSettings, dynamic={"speed", "inner.range"}, arguments=arguments)
        self.scans = self.listen(SCAN, read_scan)
        self.told: list[PlainSettings] = []

    def on_settings(self, settings: PlainSettings) -> None:
        self.told.append(settings)


if __name__ == "__main__":
    sys.exit(run_node(PlainNode))
