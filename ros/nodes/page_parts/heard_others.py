"""The page's port of a chair that may share its building: it also shows what the navigator tells of the other chairs."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from waychair.calibration.calibration_file import ChairCalibration
from waychair.ros import topics
from waychair.ros.messages.others import read_others
from waychair.ros.nodes.node import ChairNode
from waychair.ros.nodes.page_parts.page_port import PagePort
from waychair.runtime.pages.chair_port import ChairView, OthersView

_SILENT_NS = 2_000_000_000
"""Time after which a silent navigator has no others to show."""


class SharingPagePort(PagePort):
    """A page's port with the other chairs, where there are some."""

    _others: tuple[int, OthersView] | None = None

    def __init__(
        self, node: ChairNode[Any], calibration: ChairCalibration, folder: Path | None, scan_frame: str
    ) -> None:
        super().__init__(node, calibration, folder, scan_frame)
        node.listen(topics.OTHERS, read_others, self._take_others, needed=False)

    def _take_others(self, others: OthersView) -> None:
        self._others = time.monotonic_ns(), others

    def view(self) -> ChairView:
        """See `ChairPort`."""
        heard = self._others
        is_there = heard is not None and time.monotonic_ns() - heard[0] <= _SILENT_NS
        return replace(super().view(), others=heard[1] if heard is not None and is_there else None)
